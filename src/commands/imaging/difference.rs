//! `tsense imaging difference`: what came and what went between two map files of one place.

use super::{Blocks, has_extension, read_map, slices_of};
use crate::commands::{Failure, Outcome, print, words};
use crate::files::{OutputError, write_whole};
use crate::mapfile::{ply, system_of};
use clap::Args;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};
use tsense_classifier::imaging::{Changes, Mover, MoverSize, difference, movers};
use tsense_classifier::{ColumnBits, View, Window};
use tsense_geometry::VoxelGrid;
use tsense_mapper::tsmap::MapFileHeader;

/// Find what moved between two maps of one place.
#[derive(Debug, Args)]
#[command(before_help = "Example:\n  tsense imaging difference before.tsmap after.tsmap --out moved.csv")]
pub struct DifferenceArgs {
    /// The earlier map file
    before: PathBuf,
    /// The later map file
    after: PathBuf,
    /// Write the things (.csv) or the changed voxels (.ply; scalar_change is 1 appeared, 2 vanished)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Smallest group of touching voxels that is no flicker, voxels
    #[arg(long, value_name = "N", default_value_t = 4)]
    touching: usize,
    /// Smallest group that is a thing, voxels
    #[arg(long, value_name = "N", default_value_t = MoverSize::default().voxels_min)]
    voxels_min: usize,
    /// Least height of a thing, metres
    #[arg(long, value_name = "M", default_value_t = MoverSize::default().height_min_m, value_parser = words::within(0.0, 1000.0))]
    height_min: f64,
    /// Largest share of a thing's voxels that touch what is in both maps, 0 to 1: crowns and grass flicker
    #[arg(long, value_name = "SHARE", default_value_t = MoverSize::default().beside_max, value_parser = words::within(0.0, 1.0))]
    beside_max: f64,
    /// Least confidence of a voxel that counts as known, updates
    #[arg(long, value_name = "N", default_value_t = 1)]
    confidence_min: u8,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &DifferenceArgs) -> Outcome {
    let wanted = args.out.as_deref().is_none_or(|out| has_extension(out, "csv") || has_extension(out, "ply"));
    if !wanted {
        return Err(Failure::new(2, "--out: a name that ends in .csv or .ply is wanted"));
    }
    let (other, before) = read_map(&args.before)?;
    let (header, after) = read_map(&args.after)?;
    let place = |h: &MapFileHeader| (h.epsg, h.zone, h.south, h.voxel_size_m.to_bits());
    if place(&other) != place(&header) {
        let words = |h: &MapFileHeader| format!("{}, voxels of {} m", system_of(h), h.voxel_size_m);
        return Err(Failure::new(2, format!("the maps do not compare: {} against {}", words(&other), words(&header))));
    }
    let [before, after] = views([&before, &after], &header, args.confidence_min)?;
    let changes =
        difference(&before, &after, args.touching).ok_or_else(|| Failure::new(2, "the maps show different windows"))?;
    let size = MoverSize { voxels_min: args.voxels_min, height_min_m: args.height_min, beside_max: args.beside_max };
    let things = movers(&changes, [&before, &after], &size);
    match args.out.as_deref() {
        Some(out) if has_extension(out, "csv") => write_csv(out, &things)?,
        Some(out) => write_ply(out, &changes, &after, &header)?,
        None => {}
    }
    let [appeared, vanished] = [&changes.appeared, &changes.vanished].map(|bits| count(bits, &after));
    if args.json {
        let things: Vec<_> = things.iter().map(thing_json).collect();
        return print(&format!("{}\n", json!({ "appeared": appeared, "vanished": vanished, "things": things })));
    }
    print(&text(appeared, vanished, &things))
}

/// Both maps in the window that covers them.
fn views(maps: [&Blocks; 2], header: &MapFileHeader, confidence_min: u8) -> Result<[View; 2], Failure> {
    let too_large = || Failure::new(2, "the maps cover too large a box to be compared; cut them to one place");
    let window = Window::covering(maps.iter().flat_map(|map| map.keys().copied())).ok_or_else(too_large)?;
    let grid = VoxelGrid::new(header.voxel_size_m).ok_or_else(too_large)?;
    Ok(maps.map(|map| View::of_blocks(window, grid, slices_of(map), confidence_min)))
}

fn count(bits: &ColumnBits, view: &View) -> usize {
    (0..bits.columns()).map(|column| bits.count(column, 0, view.levels)).sum()
}

fn thing_json(thing: &Mover) -> serde_json::Value {
    json!({
        "came": thing.came, "easting_m": thing.at_m[0], "northing_m": thing.at_m[1],
        "low_m": thing.span_m[0], "high_m": thing.span_m[1], "voxels": thing.voxels,
    })
}

fn text(appeared: usize, vanished: usize, things: &[Mover]) -> String {
    let mut text = format!("{appeared} voxels appeared, {vanished} vanished; {} things moved\n", things.len());
    for thing in things {
        let ([east, north], [low, high]) = (thing.at_m, thing.span_m);
        let what = if thing.came { "came to " } else { "left    " };
        let size = format!("{:.2} m high, {} voxels", high - low, thing.voxels);
        text.push_str(&format!("{what} {east:.2} {north:.2}, from {low:.2} m up, {size}\n"));
    }
    text
}

fn write_csv(path: &Path, things: &[Mover]) -> Result<(), OutputError> {
    write_whole(path, |writer| {
        writeln!(writer, "came,easting_m,northing_m,low_m,high_m,voxels")?;
        for t in things {
            let ([east, north], [low, high]) = (t.at_m, t.span_m);
            writeln!(writer, "{},{east:.3},{north:.3},{low:.3},{high:.3},{}", u8::from(t.came), t.voxels)?;
        }
        Ok::<(), std::io::Error>(())
    })
}

fn write_ply(path: &Path, changes: &Changes, view: &View, header: &MapFileHeader) -> Result<(), OutputError> {
    let kinds = [(1, [220, 30, 30], &changes.appeared), (2, [40, 80, 230], &changes.vanished)];
    let points: usize = kinds.iter().map(|(.., bits)| count(bits, view)).sum();
    write_whole(path, |writer| {
        ply::write_head(writer, header, points as u64, &[("uchar", "scalar_change")])?;
        for (code, color, bits) in kinds {
            for (column, level) in (0..bits.columns()).flat_map(|c| (0..view.levels).map(move |l| (c, l))) {
                if bits.contains(column, level) {
                    let [x, y] = view.shape.center_of(column % view.shape.width, column / view.shape.width);
                    let z = view.level_bottom_m(level) + view.shape.cell_m / 2.0;
                    ply::write_point(writer, [x, y, z], color, &[code])?;
                }
            }
        }
        Ok::<(), std::io::Error>(())
    })
}
