//! The survey: recorded rays in, a folder of georeferenced results out; one thread, deterministic, no graph.
//!
//! In: an input file and what it does not say by itself. Out: rasters, objects, a classified cloud, tables and a report,
//! metres, in the input's coordinates. The cores are those of the live system: the mapper's voxel map and the
//! classifier's chain. A long input is surveyed tile by tile, so that memory does not grow with it.

mod crs;
mod extent;
pub mod input;
mod objects;
pub mod output;
mod page;
mod piece;
mod plan;
mod report;
mod seams;
mod shapes;
mod slope;
mod spill;
mod stages;
mod thing;
mod tile;
mod timeline;
mod totals;

pub use crs::Crs;
pub use extent::Extent;
pub use report::Report;

use crate::files::OutputError;
use input::{Clock, InputError, InputOptions, Ray};
use objects::parts;
use output::{Products, Stems};
use page::Page;
use plan::{Plan, TooLong};
use seams::Seams;
use stages::Stages;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tile::Rays;
use timeline::Timeline;
use totals::Totals;
use tsense_geometry::Timestamp;
use tsense_mapper::{MapError, VoxelMap};

/// Most rays that wait in memory between the readings of a plot of one tile, 128 MB; a longer input is read again.
const HELD_MAX: usize = 2_000_000;

/// What is to be surveyed, and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// The file or folder of rays.
    pub input: PathBuf,
    /// What the file does not say by itself.
    pub input_options: InputOptions,
    /// The coordinate system, where the caller knows better than the file.
    pub crs: Option<Crs>,
    /// Edge of a voxel, metres.
    pub voxel_size_m: f64,
    /// How far around the sensor's positions the map reaches, metres.
    pub reach_m: f64,
    /// Length of a window of evidence, in which a hit protects its voxel, seconds.
    pub window_s: f64,
    /// Edge of the tiles that a long plot is cut into, metres.
    pub tile_m: f64,
    /// How the map is classified, and what is kept of the rays for fits finer than a voxel.
    pub classifier: tsense_classifier::Config,
    /// The command as it was given, for the report.
    pub command: String,
}

/// Why there is no survey.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// The input is bad.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The input holds nothing to map.
    #[error("{}: {rays} rays and no return among them; there is nothing to map", .input.display())]
    Empty {
        /// The input.
        input: PathBuf,
        /// Rays read.
        rays: u64,
    },
    /// The rays are too far apart for one survey.
    #[error(
        "the sensor's positions span {:.0} x {:.0} m; is one of them wrong, or missing (0, 0)? Else survey it in parts, \
         or use larger voxels (--voxel)", .0[0], .0[1]
    )]
    TooLong([f64; 2]),
    /// The sensor was nowhere near a return.
    #[error(
        "no return lies within {reach_m} m of where the sensor was: are --origin or --trajectory in the input's own \
         coordinates? Else give a larger --reach"
    )]
    OutOfReach {
        /// How far the map reaches, metres.
        reach_m: f64,
    },
    /// The plot is too large for one map.
    #[error("{0}; use smaller tiles (--tile), larger voxels (--voxel), or a shorter --reach")]
    Map(#[from] MapError),
    /// The classified window is too large.
    #[error("a map of {blocks} blocks is too large to classify at once; use smaller tiles (--tile) or larger voxels")]
    View {
        /// Blocks of the map.
        blocks: usize,
    },
    /// The voxel map of several tiles was asked for.
    #[error("the voxel map of a plot in {0} tiles does not fit one file; leave out --map, or give a larger --tile")]
    ManyTiles(usize),
    /// The rays cannot be sorted into tiles.
    #[error("{}: {cause}; the rays of a plot in tiles wait there: look at the space left (df)", .folder.display())]
    Spill {
        /// Where they are kept.
        folder: PathBuf,
        /// What the system said.
        cause: std::io::Error,
    },
    /// An output could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

impl From<TooLong> for SurveyError {
    fn from(TooLong(span_m): TooLong) -> Self {
        Self::TooLong(span_m)
    }
}

/// What a survey leaves behind beside its files.
pub struct Survey {
    /// What is in `report.json`.
    pub report: Report,
    /// The coordinate system, where it is known.
    pub crs: Option<Crs>,
    /// Stamp of the last ray.
    pub last: Timestamp,
    /// The voxel map, where the plot is one tile and it was asked for.
    pub map: Option<VoxelMap>,
    /// Processor seconds by stage; all outputs are among them.
    pub processor_s: BTreeMap<&'static str, f64>,
}

/// Surveys a file into a folder. `progress` is told the share done, 0 to 1. Files have their names only when all of them
/// are whole.
pub fn survey(
    options: &Options,
    folder: &Path,
    keep_map: bool,
    mut progress: impl FnMut(f64),
) -> Result<Survey, SurveyError> {
    let mut stages = Stages::begin();
    let Measured { extent, crs, overruled, clock, held } = measure(options, |share| progress(0.15 * share))?;
    let space = extent.space(options.reach_m).ok_or(SurveyError::OutOfReach { reach_m: options.reach_m })?;
    let plan = Plan::new(space, options.voxel_size_m, options.tile_m)?;
    if keep_map && plan.tile_count() > 1 {
        return Err(SurveyError::ManyTiles(plan.tile_count()));
    }
    let _held = output::take_folder(folder)?;
    let mut products = Products::create(folder, &plan, crs, clock)?;
    let mut rays = Rays::sort(options, held, &plan, folder, |share| progress(0.15 + 0.2 * share))?;
    stages.end("reading: where the rays are");
    let (first, last) = extent.times.unwrap_or_default();
    let mut totals = Totals::new(extent, Timeline::new(first, last));
    let (mut done, mut map, mut seams) = (0, None, Seams::default());
    for tile in plan.tiles() {
        let count = rays.count(&tile, &totals.extent);
        let surveyed = rays.survey(options, &tile, &totals.extent, &mut totals.timeline, &mut stages)?;
        let parts = surveyed.iter().flat_map(|surveyed| parts(&surveyed.piece));
        let things = seams.add(parts, &plan, &tile);
        totals.add_things(&things);
        products.add_things(&things)?;
        if let Some(surveyed) = surveyed {
            totals.add(&surveyed);
            products.add(&surveyed.piece)?;
            stages.end("things and cells of rasters");
            let stems = Stems::around(&totals.trees, tile.around_m);
            rays.each_return(options, &tile, |ray| Ok(products.add_return(ray, &surveyed.piece, &stems)?))?;
            stages.end("reading again, cloud.laz");
            map = keep_map.then_some(surveyed.map);
        }
        done += count;
        progress(0.35 + 0.6 * done as f64 / rays.total(&totals.extent).max(1) as f64);
    }
    let report = Report::of(&totals, &plan, (crs, overruled), options);
    let page = Page { totals: &totals, report: &report, plan: &plan, options };
    products.finish(&page)?;
    stages.end("other files, report");
    progress(1.0);
    Ok(Survey { report, crs, last, map, processor_s: stages.seconds() })
}

/// All rays of an input, where they fit the memory.
type Held = Option<Vec<Ray>>;

/// Hands all rays to `take`, telling `progress` the share done; they are read where they are not held.
fn each_ray(
    options: &Options,
    held: &Held,
    mut progress: impl FnMut(f64),
    mut take: impl FnMut(Ray) -> Result<(), SurveyError>,
) -> Result<u64, SurveyError> {
    if let Some(rays) = held {
        rays.iter().try_for_each(|ray| take(*ray))?;
        return Ok(rays.len() as u64);
    }
    let rays = input::open(&options.input, &options.input_options)?;
    let total = rays.total;
    let mut count: u64 = 0;
    for ray in rays {
        take(ray?)?;
        count += 1;
        if let (0, Some(total)) = (count % 16_384, total) {
            progress(count as f64 / total.max(1) as f64);
        }
    }
    Ok(count)
}

/// What the first reading tells.
struct Measured {
    extent: Extent,
    crs: Option<Crs>,
    /// What the file says itself, where the caller says otherwise.
    overruled: Option<String>,
    clock: Clock,
    held: Held,
}

fn wrong_system(options: &Options, why: &str) -> InputError {
    InputError::new(&options.input, why, "give the right --crs EPSG:n, if the file is wrong, or reproject it")
}

/// First reading: where the rays are, and in which coordinates.
fn measure(options: &Options, progress: impl FnMut(f64)) -> Result<Measured, SurveyError> {
    let input::Rays { system, clock, total, .. } = input::open(&options.input, &options.input_options)?;
    let (crs, overruled) = match options.crs {
        Some(crs) => (Some(crs), crs.overrules(&system)),
        None => (Crs::of_file(&system).map_err(|why| wrong_system(options, &why))?, None),
    };
    let mut extent = Extent::default();
    let expected = total.unwrap_or(0) as usize;
    let mut held = (expected <= HELD_MAX).then(|| Vec::with_capacity(expected));
    let rays = each_ray(options, &None, progress, |ray| {
        extent.add(&ray);
        held = held.take().filter(|rays| rays.len() < HELD_MAX);
        held.iter_mut().for_each(|rays| rays.push(ray));
        Ok(())
    })?;
    match extent.returns {
        0 => Err(SurveyError::Empty { input: options.input.clone(), rays }),
        _ => Ok(Measured { extent, crs, overruled, clock, held }),
    }
}
