//! `tsense survey`: ground, brush, trees and a report from recorded rays.

use super::{Failure, Outcome, config, print, tell, words};
use crate::config::survey::SurveyConfig;
use crate::files::can_be_written;
use crate::mapfile;
use crate::survey::input::InputOptions;
use crate::survey::{Crs, Options, Report, Survey, SurveyError, survey};
use clap::Args as ClapArgs;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::path::PathBuf;
use tsense_classifier::config::{Config, Detector, GroundMethod};
use tsense_geometry::{COORDINATE_MAX_M, Global, Point};
use tsense_mapper::tsmap::MapFileHeader;

const EXAMPLE: &str = "Example:\n  tsense survey plot.ply --out results --crs EPSG:32617\n  \
tsense survey tls.laz --origin 470640,3810235,2281 --out results\n  tsense survey mls.laz --out results\n\n\
Reads ray clouds (.ply), point clouds (.las, .laz) and Freiburg scans (a folder of scan_NNN_points.dat). Give point\n\
clouds --origin or --trajectory where the sensor's positions are known; without, stems are fitted to points alone and\n\
no space is known to be free. Writes cloud-optimised GeoTIFFs (dtm, dtm_sd, chm, slope, brush, brush_density, evidence,\n\
traversability), objects.gpkg, cloud.laz, trees.csv, rejected.csv, report.json and report.html. Files have their names\n\
only when all of them are whole. A long plot is surveyed in tiles (--tile): memory is that of one tile and 64 MB, however\n\
long the input; its rays wait in an unlinked file in the output folder, 33 bytes for each tile that a ray touches.";

/// Ground, brush, trees and a report from recorded rays.
#[derive(Debug, ClapArgs)]
#[command(before_help = EXAMPLE)]
pub struct Args {
    /// Ray cloud, point cloud or folder of scans
    input: PathBuf,
    /// Folder for the results; made where it does not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Position of a standing scanner, metres, in the input's coordinates
    #[arg(long, value_name = "E,N,Z", value_parser = position, allow_hyphen_values = true)]
    origin: Option<Point<Global>>,
    /// Positions of a moving scanner: a line is time (s) x y z (m)
    #[arg(long, value_name = "FILE", conflicts_with = "origin")]
    trajectory: Option<PathBuf>,
    /// Coordinate system of the input, where the file does not say
    #[arg(long, value_name = "EPSG:n[+m]")]
    crs: Option<Crs>,
    /// Edge of a voxel, metres
    #[arg(long, value_name = "M", default_value_t = 0.15, value_parser = words::within(0.01, 10.0))]
    voxel: f64,
    /// How far around the scanner the map reaches, metres
    #[arg(long, value_name = "M", default_value_t = 30.0, value_parser = words::within(1.0, 10_000.0))]
    reach: f64,
    /// Time over which a return protects its voxel from being cleared, seconds
    #[arg(long, value_name = "S", default_value_t = 15.0, value_parser = words::within(0.1, 1e6))]
    window: f64,
    /// Edge of the tiles that a plot longer than one and a half of them is cut into, metres; memory is bounded by it
    #[arg(long, value_name = "M", default_value_t = 76.8, value_parser = words::within(1.0, 10_000.0))]
    tile: f64,
    /// Write the voxel map as well, for `tsense map`
    #[arg(long, value_name = "FILE.tsmap")]
    map: Option<PathBuf>,
    /// Settings of the classifier that differ from a survey's own, TOML; `tsense config show --survey` prints all
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// How trees are found: stems fitted to beams (or points, without sensor positions), or the thesis's convolution
    /// [default: what --settings says, or stems]
    #[arg(long, value_name = "NAME", value_parser = detector)]
    detector: Option<Detector>,
    /// How the ground is found: a surface below all that was seen (surface), or from voxels as in the thesis:
    /// by interpolation, or by the average of coarse tiles (tiles) [default: what --settings says, or surface]
    #[arg(long, value_name = "NAME", value_parser = ground)]
    ground: Option<GroundMethod>,
    /// Print the report as JSON on stdout, with processor seconds by stage
    #[arg(long)]
    json: bool,
    /// No progress on stderr
    #[arg(short, long)]
    quiet: bool,
}

fn position(text: &str) -> Result<Point<Global>, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    match numbers.as_deref() {
        Ok([e, n, z]) if [e, n, z].iter().all(|c| c.abs() <= COORDINATE_MAX_M) => Ok(Point::new(*e, *n, *z)),
        _ => Err("three numbers are wanted: easting,northing,height in metres".into()),
    }
}

fn detector(text: &str) -> Result<Detector, String> {
    match text {
        "stems" => Ok(Detector::Stems),
        "thesis" => Ok(Detector::Thesis),
        _ => Err("there are stems and thesis".into()),
    }
}

fn ground(text: &str) -> Result<GroundMethod, String> {
    match text {
        "surface" => Ok(GroundMethod::Surface),
        "interpolation" => Ok(GroundMethod::Interpolation),
        "tiles" => Ok(GroundMethod::Tiles),
        _ => Err("there are surface, interpolation and tiles".into()),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    if let Some(file) = args.map.as_deref().filter(|file| file.parent() != Some(&args.out)) {
        can_be_written(file)?;
    }
    let options = options(args)?;
    let bar = progress_bar(args.quiet);
    let surveyed = survey(&options, &args.out, args.map.is_some(), |share| bar.set_position((share * 1000.0) as u64));
    bar.finish_and_clear();
    let surveyed = surveyed.map_err(|error| Failure::new(exit_code(&error), error))?;
    let Survey { report, crs, last, map, processor_s } = surveyed;
    if report.stems_from == "points" && !args.quiet {
        tell("tsense: no sensor positions; stems were fitted to points alone");
    }
    let text = match args.json {
        true => json(&Printed { report: &report, processor_s: &processor_s })?,
        false => summary(&report),
    };
    print(&text)?;
    if let Some((file, map)) = args.map.as_ref().zip(map) {
        let header = MapFileHeader::in_epsg(map.grid().size_m(), last, crs.map_or(0, |crs| crs.horizontal));
        mapfile::write(file, &header, &mapfile::blocks_in(&map, last))?;
    }
    Ok(0)
}

fn exit_code(error: &SurveyError) -> u8 {
    match error {
        SurveyError::Input(fault) => fault.exit_code(),
        SurveyError::Empty { .. } | SurveyError::TooLong(_) => 6,
        SurveyError::OutOfReach { .. } | SurveyError::Map(_) | SurveyError::View { .. } | SurveyError::ManyTiles(_) => {
            2
        }
        SurveyError::Output(fault) => fault.exit_code(),
        SurveyError::Spill { .. } => 1,
    }
}

fn options(args: &Args) -> Result<Options, Failure> {
    Ok(Options {
        input: args.input.clone(),
        input_options: InputOptions { origin: args.origin, trajectory: args.trajectory.clone() },
        crs: args.crs,
        voxel_size_m: args.voxel,
        reach_m: args.reach,
        window_s: args.window,
        tile_m: args.tile,
        classifier: classifier(args)?,
        command: std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" "),
    })
}

/// Options win against the file of settings, and that against a survey's defaults.
fn classifier(args: &Args) -> Result<Config, Failure> {
    let mut settings: SurveyConfig = args.settings.as_deref().map(config::read).transpose()?.unwrap_or_default();
    let classifier = &mut settings.classifier;
    classifier.detector = args.detector.unwrap_or(classifier.detector);
    classifier.ground.method = args.ground.unwrap_or(classifier.ground.method);
    Ok(settings.classifier)
}

fn progress_bar(is_quiet: bool) -> ProgressBar {
    if is_quiet || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("survey {bar:40} {percent} %  {elapsed} of about {duration}") {
        bar.set_style(style);
    }
    bar
}

/// The report and what differs from run to run.
#[derive(Serialize)]
struct Printed<'a> {
    #[serde(flatten)]
    report: &'a Report,
    /// By stage; the whole process, outputs included.
    processor_s: &'a BTreeMap<&'static str, f64>,
}

fn json(printed: &Printed) -> Result<String, Failure> {
    Ok(serde_json::to_string(printed).map_err(|e| Failure::new(1, e))? + "\n")
}

fn summary(report: &Report) -> String {
    let mut text = format!("{} rays, {} returns, {} trees\n", report.rays, report.returns, report.trees);
    if let Some(dbh_m) = report.dbh_mean_m {
        text.push_str(&format!("mean DBH {dbh_m:.3} m\n"));
    }
    for (evidence, cells) in &report.ground_cells {
        text.push_str(&format!("ground {evidence}: {cells} cells\n"));
    }
    for note in &report.notes {
        text.push_str(&format!("note: {note}\n"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_read_as_people_write_them() {
        assert_eq!(position("1, -2,3.5").unwrap().to_array(), [1.0, -2.0, 3.5]);
        assert!(position("1,2").is_err() && position("1,2,nan").is_err());
    }
}
