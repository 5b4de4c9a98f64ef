//! The survey: recorded rays in, ground, brush, trees and a report out; one thread, deterministic, no graph.
//!
//! In: an input file and what it does not say by itself. Out: a [`Survey`], metres, in the input's coordinates. The
//! cores are those of the live system: the mapper's voxel map and the classifier's chain.

mod extent;
pub mod input;
pub mod output;
mod report;

pub use report::Report;

use extent::Extent;
use input::{InputError, InputOptions, Ray};
use std::path::{Path, PathBuf};
use tsense_classifier::{Classification, PlacedBeam, Returns, ReturnsConfig, View, Window, classify};
use tsense_geometry::Raster;
use tsense_mapper::{Beam, BeamKind, MapError, VoxelMap, Weight};

/// What is to be surveyed, and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// The file or folder of rays.
    pub input: PathBuf,
    /// What the file does not say by itself.
    pub input_options: InputOptions,
    /// EPSG code of the coordinates, where the caller knows better than the file.
    pub epsg: Option<u16>,
    /// Edge of a voxel, metres.
    pub voxel_size_m: f64,
    /// How far around the sensor's positions the map reaches, metres.
    pub reach_m: f64,
    /// Length of a window of evidence, in which a hit protects its voxel, seconds.
    pub window_s: f64,
    /// What is kept of the rays, for fits finer than a voxel.
    pub returns: ReturnsConfig,
    /// How the map is classified.
    pub classifier: tsense_classifier::Config,
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
    /// The plot is too large for one map.
    #[error("{0}; survey a part of the plot, use larger voxels (--voxel), or a shorter --reach")]
    Map(#[from] MapError),
    /// The classified window is too large.
    #[error(
        "a map of {blocks} blocks is too large to classify at once; use larger voxels (--voxel) or a shorter --reach"
    )]
    View {
        /// Blocks of the map.
        blocks: usize,
    },
    /// An output could not be written.
    #[error(transparent)]
    Output(#[from] output::OutputError),
}

/// What a survey found.
pub struct Survey {
    /// Rays read, returns among them, and where they lie.
    pub extent: Extent,
    /// EPSG code of the coordinates, where it is known.
    pub epsg: Option<u16>,
    /// The chain's results.
    pub classification: Classification,
    /// Blocks that rays reached.
    pub blocks: usize,
    /// Voxels that rays crossed, each crossing counted.
    pub voxel_visits: u64,
    /// The voxel map itself.
    pub map: VoxelMap,
}

/// Surveys a file. `progress` is told the share done, 0 to 1.
pub fn survey(options: &Options, mut progress: impl FnMut(f64)) -> Result<Survey, SurveyError> {
    let extent = measure(options, |share| progress(0.2 * share))?;
    let (map, returns) = trace(options, &extent, |share| progress(0.2 + 0.7 * share))?;
    let view = view_of(&map, &options.classifier)?;
    let classification = classify(&view, Some(&returns), None, &options.classifier);
    progress(1.0);
    let rays = input::open(&options.input, &options.input_options)?;
    Ok(Survey {
        extent,
        epsg: options.epsg.or(rays.epsg),
        classification,
        blocks: map.blocks().count(),
        voxel_visits: map.voxel_visits(),
        map,
    })
}

/// Reads all rays and hands them to `take`, telling `progress` the share done.
fn each_ray(options: &Options, mut progress: impl FnMut(f64), mut take: impl FnMut(Ray)) -> Result<u64, InputError> {
    let rays = input::open(&options.input, &options.input_options)?;
    let total = rays.total;
    let mut count: u64 = 0;
    for ray in rays {
        take(ray?);
        count += 1;
        if let (0, Some(total)) = (count % 16_384, total) {
            progress(count as f64 / total.max(1) as f64);
        }
    }
    Ok(count)
}

/// First reading: where the rays are.
fn measure(options: &Options, progress: impl FnMut(f64)) -> Result<Extent, SurveyError> {
    let mut extent = Extent::default();
    let rays = each_ray(options, progress, |ray| extent.add(&ray))?;
    match extent.returns {
        0 => Err(SurveyError::Empty { input: options.input.clone(), rays }),
        _ => Ok(extent),
    }
}

/// Second reading: every ray through the voxels and into the store of returns.
fn trace(options: &Options, extent: &Extent, progress: impl FnMut(f64)) -> Result<(VoxelMap, Returns), SurveyError> {
    let (low, high) = extent.space(options.reach_m);
    let config = tsense_mapper::Survey::config_for(low, high, options.voxel_size_m, options.window_s);
    let mut survey = tsense_mapper::Survey::new(&config, low + (high - low).scaled(0.5))?;
    let mut returns = Returns::new(&options.returns);
    each_ray(options, progress, |ray| {
        returns.insert(&placed(&ray));
        // A ray that lies outside of the space says nothing about it.
        let _ = survey.insert(ray.stamp, &beam_of(&ray));
    })?;
    returns.settle();
    Ok((survey.finish(), returns))
}

fn placed(ray: &Ray) -> PlacedBeam {
    PlacedBeam { ladar: 0, stamp: ray.stamp, origin: ray.origin, end: ray.end, is_return: ray.is_return }
}

fn beam_of(ray: &Ray) -> Beam {
    let kind = if ray.is_return { BeamKind::Hit } else { BeamKind::NoReturn };
    Beam { origin: ray.origin, end: ray.end, kind, weight: Weight::FULL }
}

fn view_of(map: &VoxelMap, config: &tsense_classifier::Config) -> Result<View, SurveyError> {
    let window = Window::covering(map.blocks().map(|(key, _)| key))
        .ok_or_else(|| SurveyError::View { blocks: map.blocks().count() })?;
    Ok(View::of_blocks(window, map.grid(), map.blocks(), config.voxel_confidence_min))
}

/// Writes `trees.csv`, `rejected.csv`, the rasters and `report.json` into a folder.
pub fn write(survey: &Survey, report: &Report, folder: &Path) -> Result<(), SurveyError> {
    let found = &survey.classification;
    let base_m = found.ground.base_m as f32;
    output::make_folder(folder)?;
    output::write_trees(&folder.join("trees.csv"), &found.trees)?;
    output::write_rejected(&folder.join("rejected.csv"), &found.rejected)?;
    let rasters: [(&str, Raster<f32>); 3] = [
        ("dtm.tif", found.ground.height_m.map(|z| base_m + z)),
        ("brush.tif", found.brush_m.clone()),
        ("traversability.tif", found.costs.map(report::traversability_value)),
    ];
    for (name, raster) in rasters {
        output::write_geotiff(&folder.join(name), &raster, survey.epsg)?;
    }
    output::write_json(&folder.join("report.json"), report)?;
    Ok(())
}
