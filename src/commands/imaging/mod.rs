//! `tsense imaging blur|difference|planes|study`: the thesis's imaging tools on map files.
//!
//! In: map files (`.tsmap`; `tsense map save` and `tsense survey --map` write them). Out: a map file, points (PLY), tables
//! (CSV), JSON or text. The tools themselves are library calls, `tsense_classifier::imaging`.

mod blur;
mod difference;
mod moving;
mod planes;
mod slices;
mod study;

pub use moving::{MovingRow, moving};

use super::{Failure, Outcome};
use crate::mapfile;
use clap::{Args, Subcommand};
use std::collections::BTreeMap;
use std::path::Path;
use tsense_contract::{BlockKey, Brick};
use tsense_mapper::tsmap::MapFileHeader;

/// Imaging tools on map files: blur, what moved between two of them, planes.
#[derive(Debug, Args)]
#[command(
    arg_required_else_help = true,
    before_help = "Example:\n  tsense survey plot.ply --out results --map plot.tsmap\n  \
        tsense imaging planes plot.tsmap --count 3 --out planes.csv"
)]
pub struct ImagingArgs {
    #[command(subcommand)]
    command: ImagingCommand,
}

#[derive(Debug, Subcommand)]
enum ImagingCommand {
    Blur(blur::BlurArgs),
    Difference(difference::DifferenceArgs),
    Planes(planes::PlanesArgs),
    Study(study::StudyArgs),
}

/// Runs the command.
pub fn run(args: &ImagingArgs) -> Outcome {
    match &args.command {
        ImagingCommand::Blur(args) => blur::run(args),
        ImagingCommand::Difference(args) => difference::run(args),
        ImagingCommand::Planes(args) => planes::run(args),
        ImagingCommand::Study(args) => study::run(args),
    }
}

/// The blocks of a map, dense.
type Blocks = BTreeMap<BlockKey, Vec<Brick>>;

/// A map file whole: 0.8 MB a block, at most 4096 blocks.
fn read_map(path: &Path) -> Result<(MapFileHeader, Blocks), Failure> {
    let bytes = mapfile::read(path)?;
    let reader = mapfile::blocks_of(path, &bytes)?;
    let header = reader.header();
    let dense = reader.map(|block| block.map(|block| (block.key, block.to_bricks())));
    let blocks: Blocks = dense.collect::<Result<_, _>>().map_err(|fault| mapfile::damaged(path, &fault))?;
    if blocks.is_empty() {
        return Err(Failure::new(6, format!("{}: the map holds no block; nothing can be seen in it", path.display())));
    }
    Ok((header, blocks))
}

/// A dense map as the library calls take it.
fn slices_of(blocks: &Blocks) -> impl Iterator<Item = (BlockKey, &[Brick])> {
    blocks.iter().map(|(key, bricks)| (*key, bricks.as_slice()))
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().and_then(|e| e.to_str()).is_some_and(|e| e.eq_ignore_ascii_case(wanted))
}
