//! `tsense objects`: what the knowledge store believes, read from its file, whether its graph runs or not.
//!
//! In: a store's file (GeoPackage), read only. Out: a table, JSON or GeoJSON on standard output, nearest first where a
//! place is given. Confidence is decayed to now; a running graph's clock says when that is.

use super::{Failure, Outcome, print};
use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tsense_contract::{Class, Object};
use tsense_geometry::{COORDINATE_MAX_M, NS_PER_S, Timestamp};
use tsense_kstore::persist::{FileFault, read_only};
use tsense_kstore::{Answer, KnowledgeStore, Query, Reprojection, Zone};
use tsense_ports::{Clock, Domain};

const EXAMPLE: &str = "Example:\n  tsense objects --near 500012.5,4000003 --radius 20 --class tree\n  \
tsense objects --geojson > trees.geojson";

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
    #[arg(long, value_name = "C", default_value_t = 0.0)]
    pub confidence: f64,
    /// Also what is not believed enough to be reported.
    #[arg(long)]
    pub unreported: bool,
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
    #[arg(long, value_name = "NAME")]
    pub graph: Option<String>,
    /// The store's file, wherever it came from.
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
    let loaded = read_only(&source.file).map_err(|fault| refused(&source.file, &fault))?;
    for note in &loaded.notes {
        eprintln!("tsense: {note}");
    }
    let store = loaded.into_store(source.config);
    let answer = store.query(&query(args), source.now);
    if answer.truncated {
        eprintln!("tsense: only {} objects are shown; raise --limit", answer.objects.len());
    }
    print(&text(args, &store, &answer, source.now)?)
}

fn refused(file: &Path, fault: &FileFault) -> Failure {
    if !file.exists() {
        let advice = "a graph makes it with its first detections; say --graph NAME or --store FILE for another";
        return Failure::new(1, format!("{}: there is no store yet; {advice}", file.display()));
    }
    Failure::new(if fault.is_damage() { 6 } else { 1 }, fault)
}

/// Where the store is, by which configuration it is judged, and what time it is for it.
struct Source {
    file: PathBuf,
    config: tsense_kstore::Config,
    now: Timestamp,
}

impl Source {
    fn of(args: &ObjectsArgs) -> Result<Self, Failure> {
        let wall_clock = Clock::start(1.0).now();
        if let Some(file) = &args.store {
            return Ok(Self { file: file.clone(), config: tsense_kstore::Config::default(), now: wall_clock });
        }
        let domain = match &args.graph {
            Some(name) => Domain::new(name).map_err(|e| Failure::new(2, e))?,
            None => super::status::find(None).or_else(default_graph)?,
        };
        // The resolved configuration is there while the graph runs; a stopped one is taken to have the defaults.
        let config = super::config::load(&domain.config_file()).unwrap_or_default();
        let section = config.kstore.unwrap_or_default();
        let facts = domain.facts().ok();
        let state_dir = facts.as_ref().map_or_else(|| default_state_dir(domain.name()), |f| f.state_dir.clone());
        let now = facts.map_or(wall_clock, |f| f.clock.now());
        Ok(Self { file: state_dir.join(&section.file), config: section, now })
    }
}

/// Where no graph runs, the store of the graph with the default name is meant; several running ones are a question.
fn default_graph(failure: Failure) -> Result<Domain, Failure> {
    if failure.code == 2 {
        return Err(failure);
    }
    Ok(Domain::new(&crate::config::GraphConfig::default().name)?)
}

fn default_state_dir(name: &str) -> PathBuf {
    crate::config::GraphConfig { name: name.into(), ..Default::default() }.state_dir()
}

fn query(args: &ObjectsArgs) -> Query {
    let all = match args.near {
        Some(Place(place)) => Query::near(place, args.radius, args.limit),
        None => Query::all(args.limit),
    };
    let class = args.class.map(ClassName::class);
    Query { class, confidence_min: args.confidence, unreported: args.unreported, ..all }
}

fn text(args: &ObjectsArgs, store: &KnowledgeStore, answer: &Answer, now: Timestamp) -> Result<String, Failure> {
    let value = match (args.json, args.geojson) {
        (true, _) => as_json(store, answer),
        (_, true) => as_geojson(store.zone(), answer),
        _ => return Ok(table(store, answer, now)),
    };
    serde_json::to_string_pretty(&value).map(|text| text + "\n").map_err(|e| Failure::new(1, e))
}

/// A number, or null where it is none; to a tenth of a millimetre, which is finer than anything measured here.
fn number(x: impl Into<f64>) -> Value {
    let x = x.into();
    if x.is_finite() { json!((x * 1e4).round() / 1e4) } else { Value::Null }
}

fn properties(o: &Object) -> Value {
    json!({
        "class": Class::from_wire(o.class).as_str(),
        "reported": o.reported == 1,
        "confidence": number(o.confidence),
        "sightings": o.sightings,
        "easting_m": number(o.easting_m),
        "northing_m": number(o.northing_m),
        "ground_m": number(o.ground_m),
        "position_std_m": number(o.position_std_m),
        "dbh_m": number(o.dbh_m),
        "dbh_std_m": number(o.dbh_std_m),
        "height_m": number(o.height_m),
        "first_seen_ns": o.first_seen_ns,
        "last_seen_ns": o.last_seen_ns,
    })
}

fn as_json(store: &KnowledgeStore, answer: &Answer) -> Value {
    let objects = answer.objects.iter().map(|o| {
        let mut object = properties(o);
        object["id"] = json!(o.id);
        object
    });
    json!({
        "epsg": store.zone().map(Zone::epsg),
        "zone": store.zone().map(|z| z.to_string()),
        "stored": store.len(),
        "truncated": answer.truncated,
        "objects": objects.collect::<Vec<_>>(),
    })
}

/// Longitude and latitude on WGS 84, as GeoJSON demands; the UTM position stands in the properties.
fn as_geojson(zone: Option<Zone>, answer: &Answer) -> Value {
    let degrees = zone.and_then(Reprojection::to_degrees);
    let features = answer.objects.iter().map(|o| {
        let place = degrees.as_ref().and_then(|d| d.apply([o.easting_m, o.northing_m]));
        let geometry =
            place.map(|[longitude, latitude]| json!({"type": "Point", "coordinates": [longitude, latitude]}));
        json!({"type": "Feature", "id": o.id, "geometry": geometry, "properties": properties(o)})
    });
    json!({"type": "FeatureCollection", "features": features.collect::<Vec<_>>()})
}

/// Columns for people.
fn table(store: &KnowledgeStore, answer: &Answer, now: Timestamp) -> String {
    let head =
        ["id", "class", "easting m", "northing m", "+- m", "dbh m", "height m", "confidence", "seen", "last seen"];
    let mut rows = vec![head.map(str::to_owned)];
    rows.extend(answer.objects.iter().map(|o| row(o, now)));
    let widths: Vec<usize> =
        (0..head.len()).map(|i| rows.iter().map(|row| row[i].chars().count()).max().unwrap_or(0)).collect();
    let zone = store.zone().map_or_else(|| "no zone".into(), |z| format!("zone {z}, EPSG:{}", z.epsg()));
    let mut text = format!("{} of {} stored objects, {zone}\n", answer.objects.len(), store.len());
    for row in rows {
        let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:>width$}"));
        text.push_str(&cells.collect::<Vec<_>>().join("  "));
        text.push('\n');
    }
    text
}

fn row(o: &Object, now: Timestamp) -> [String; 10] {
    let metres = |x: f32| if x.is_finite() { format!("{x:.2}") } else { "-".into() };
    let mark = if o.reported == 1 { "" } else { "?" };
    [
        o.id.to_string(),
        format!("{}{mark}", Class::from_wire(o.class)),
        format!("{:.2}", o.easting_m),
        format!("{:.2}", o.northing_m),
        metres(o.position_std_m),
        metres(o.dbh_m),
        metres(o.height_m),
        format!("{:.2}", o.confidence),
        format!("{}x", o.sightings),
        age(now.ns.saturating_sub(o.last_seen_ns)),
    ]
}

/// How long ago, in the unit that fits.
fn age(ns: i64) -> String {
    match ns / NS_PER_S {
        i64::MIN..0 => "in the future".into(),
        s @ 0..120 => format!("{s} s ago"),
        s @ 120..7_200 => format!("{} min ago", s / 60),
        s @ 7_200..172_800 => format!("{} h ago", s / 3_600),
        s => format!("{} d ago", s / 86_400),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_kstore::{Known, View};

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(seconds)
    }

    /// Three trees seen four times, one of them twenty metres off.
    fn store() -> KnowledgeStore {
        let mut store = KnowledgeStore::new(tsense_kstore::Config::default());
        let zone = Zone::from_epsg(32_617).unwrap();
        let tree = |east: f64| tsense_contract::Detection {
            easting_m: 500_000.0 + east,
            northing_m: 0.0,
            ground_m: 100.0,
            position_std_m: 0.05,
            dbh_m: 0.3,
            dbh_std_m: 0.02,
            height_m: f32::NAN,
            confidence: 0.9,
            arc_coverage: 0.4,
            lean_rad: [0.0; 2],
            class: Class::Tree.to_wire(),
            reserved: [0; 7],
        };
        for i in 0..4 {
            let snapshot = tsense_kstore::Snapshot { stamp: at(2.0 * f64::from(i)), vehicle_m: [500_000.0, 0.0], zone };
            store.take(&snapshot, &[0.0, 3.0, 20.0].map(tree), |_| View::Unseen);
        }
        assert!(store.objects().all(|o: &Known| o.is_reported(at(6.0), store.config())));
        store
    }

    fn args(words: &[&str]) -> ObjectsArgs {
        #[derive(clap::Parser)]
        struct Command {
            #[command(flatten)]
            args: ObjectsArgs,
        }
        let words = ["objects"].iter().chain(words);
        <Command as clap::Parser>::try_parse_from(words).unwrap().args
    }

    fn said(words: &[&str]) -> String {
        let (args, store) = (args(words), store());
        let answer = store.query(&query(&args), at(66.0));
        text(&args, &store, &answer, at(66.0)).unwrap()
    }

    #[test]
    fn the_table_names_the_zone_and_the_nearest_object_first() {
        let table = said(&["--near", "500003,0", "--radius", "10"]);
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[0], "2 of 3 stored objects, zone 17N, EPSG:32617");
        let words: Vec<&str> = lines[2].split_whitespace().collect();
        assert_eq!(words[..4], ["2", "tree", "500003.00", "0.00"]);
        assert!(lines[2].ends_with("60 s ago") && lines[2].contains("4x") && lines.len() == 4, "{table}");
    }

    #[test]
    fn json_has_null_where_nothing_was_measured() {
        let json: Value = serde_json::from_str(&said(&["--json", "--class", "tree"])).unwrap();
        assert_eq!((json["epsg"].as_i64(), json["stored"].as_i64()), (Some(32_617), Some(3)));
        let tree = &json["objects"][0];
        assert_eq!((&tree["id"], &tree["height_m"], &tree["dbh_m"]), (&json!(1), &Value::Null, &json!(0.3)));
        let rocks: Value = serde_json::from_str(&said(&["--json", "--class", "rock"])).unwrap();
        assert_eq!(rocks["objects"], json!([]));
    }

    /// The central meridian of zone 17 is 81 degrees west.
    #[test]
    fn geojson_is_in_degrees() {
        let json: Value = serde_json::from_str(&said(&["--geojson", "--near", "500000,0", "--radius", "1"])).unwrap();
        let at = &json["features"][0]["geometry"]["coordinates"];
        assert!((at[0].as_f64().unwrap() + 81.0).abs() < 1e-6 && at[1].as_f64().unwrap().abs() < 1e-6, "{json}");
    }

    #[test]
    fn places_and_ages_read_as_people_write_them() {
        assert_eq!(place("1, -2.5"), Ok(Place([1.0, -2.5])));
        assert!(place("1").is_err() && place("1,nan").is_err() && radius("0").is_err() && radius("inf").is_err());
        assert_eq!(
            [59, 150, 7_300, 200_000].map(|s| age(s * NS_PER_S)),
            ["59 s ago", "2 min ago", "2 h ago", "2 d ago"]
        );
    }
}
