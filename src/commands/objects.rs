//! `tsense objects`: what the knowledge store believes, asked of it where its graph runs, read from its file where not.
//!
//! In: answers of the service `store`, or a store's file (GeoPackage), read only. Out: a table, JSON or GeoJSON on
//! standard output, nearest first where a place is given; where it came from on standard error. Confidence is decayed
//! to now; a running graph's clock says when that is.

mod show;
mod source;

use super::{Failure, Outcome, print, tell, words};
use clap::{Args, ValueEnum};
use source::Source;
use std::path::PathBuf;
use tsense_contract::Class;
use tsense_geometry::COORDINATE_MAX_M;
use tsense_kstore::Query;

const EXAMPLE: &str = "Example:\n  tsense objects --near 500012.5,4000003 --radius 20 --class tree\n  \
tsense objects --geojson > trees.geojson\n  tsense objects --history 17";

/// Show the objects the knowledge store believes in: trees, rocks, drops, walls, patches of brush.
#[derive(Debug, Args)]
#[command(before_help = EXAMPLE)]
pub struct ObjectsArgs {
    /// Only near this place: easting and northing, metres; nearest first.
    #[arg(long, value_name = "E,N", value_parser = place, allow_hyphen_values = true)]
    pub near: Option<Place>,
    /// How near, metres.
    #[arg(long, value_name = "M", default_value = "30", value_parser = radius, requires = "near")]
    pub radius: f64,
    /// Only this class.
    #[arg(long, value_enum)]
    pub class: Option<ClassName>,
    /// Only at this confidence and above.
    #[arg(long, value_name = "C", default_value_t = 0.0, value_parser = words::within(0.0, 1e6), alias = "confidence")]
    pub min_confidence: f64,
    /// Also what is not believed enough to be reported.
    #[arg(long)]
    pub unreported: bool,
    /// Show what became of one object, and why, instead of the objects there are.
    #[arg(long, value_name = "ID", conflicts_with_all = ["near", "class", "geojson"])]
    pub history: Option<u64>,
    /// At most this many.
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    pub limit: usize,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Print GeoJSON (longitude, latitude) instead of a table.
    #[arg(long, conflicts_with = "json")]
    pub geojson: bool,
    /// Name of the graph whose store is meant, running or not; needed only where several are running.
    #[arg(long, value_name = "NAME", value_parser = words::graph)]
    pub graph: Option<String>,
    /// The store's file, wherever it came from; it is read even where its graph runs.
    #[arg(long, value_name = "FILE", conflicts_with = "graph")]
    pub store: Option<PathBuf>,
}

/// An easting and a northing, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place([f64; 2]);

/// The classes by their names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ClassName {
    /// A tree with a trunk.
    Tree,
    /// A rock.
    Rock,
    /// An edge that falls away.
    Drop,
    /// A wall.
    Wall,
    /// A patch of brush.
    Brush,
}

impl ClassName {
    fn class(self) -> Class {
        match self {
            Self::Tree => Class::Tree,
            Self::Rock => Class::Rock,
            Self::Drop => Class::Drop,
            Self::Wall => Class::Wall,
            Self::Brush => Class::Brush,
        }
    }
}

fn place(text: &str) -> Result<Place, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    match numbers.as_deref() {
        Ok([e, n]) if [e, n].iter().all(|c| c.abs() <= COORDINATE_MAX_M) => Ok(Place([*e, *n])),
        _ => Err("two numbers are wanted: easting,northing in metres".into()),
    }
}

fn radius(text: &str) -> Result<f64, String> {
    let wanted = "a distance above 0 in metres is wanted";
    text.parse().ok().filter(|m: &f64| *m > 0.0 && m.is_finite()).ok_or_else(|| wanted.into())
}

/// Runs the command.
pub fn run(args: &ObjectsArgs) -> Outcome {
    let source = Source::of(args)?;
    if let Some(id) = args.history {
        return print(&show::history(args, id, &source.history(id)?)?);
    }
    let listing = source.listing(&query(args))?;
    tell(format_args!("tsense: {}", listing.origin));
    if listing.truncated {
        tell(format_args!("tsense: only {} objects are shown; raise --limit", listing.objects.len()));
    }
    print(&show::text(args, &listing)?)
}

fn query(args: &ObjectsArgs) -> Query {
    let all = match args.near {
        Some(Place(place)) => Query::near(place, args.radius, args.limit),
        None => Query::all(args.limit),
    };
    let class = args.class.map(ClassName::class);
    Query { class, confidence_min: args.min_confidence, unreported: args.unreported, ..all }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_distances_read_as_people_write_them() {
        assert_eq!(place("1, -2.5"), Ok(Place([1.0, -2.5])));
        assert!(place("1").is_err() && place("1,nan").is_err() && radius("0").is_err() && radius("inf").is_err());
    }
}
