//! `tsense imaging blur`: a map file with every voxel averaged over its neighbourhood.
//!
//! Blocks are blurred one by one, each with a rim of its neighbours, so that memory does not grow with the map and the
//! result is that of the whole map. Occupancies are rounded to whole numbers, as a map holds them.

use super::{Blocks, read_map, slices_of};
use crate::commands::{Failure, Outcome, print, tell};
use crate::mapfile;
use clap::{Args, ValueEnum};
use serde_json::json;
use std::path::PathBuf;
use tsense_classifier::Window;
use tsense_classifier::imaging::{Volume, blur, blur_known};
use tsense_contract::{BLOCK_VOXELS, BRICK_EDGE, BlockKey, Brick, VoxelState, first_voxel, locate};
use tsense_mapper::tsmap::StoredBlock;

/// Longest list of weights: a neighbourhood of 2.3 m at 0.15 m.
const WEIGHTS_MAX: usize = 8;

/// Average every voxel with its neighbours.
#[derive(Debug, Args)]
#[command(before_help = "Example:\n  tsense imaging blur now.tsmap --out soft.tsmap --weights 2,1")]
pub struct BlurArgs {
    /// The map file
    file: PathBuf,
    /// The map file to write
    #[arg(long, value_name = "FILE.tsmap")]
    out: PathBuf,
    /// Weights along each axis from the centre outwards, a voxel a step; 2,1 is 1-2-1
    #[arg(long, value_name = "W,W,...", value_delimiter = ',', default_value = "2,1")]
    weights: Vec<f32>,
    /// Which neighbours count; with `all` unknown voxels count as 0 and become known where enough spreads into them
    #[arg(long, value_enum, default_value_t = Neighbours::Known)]
    neighbours: Neighbours,
    /// Print counts before and after as JSON
    #[arg(long)]
    json: bool,
}

/// Which neighbours take part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Neighbours {
    /// Known ones; unknown voxels stay unknown.
    Known,
    /// All, as in the thesis.
    All,
}

/// Runs the command.
pub fn run(args: &BlurArgs) -> Outcome {
    let sound = args.weights.iter().all(|w| w.is_finite() && *w >= 0.0) && args.weights.iter().any(|w| *w > 0.0);
    if !sound || args.weights.len() > WEIGHTS_MAX {
        let message = format!("--weights: 1 to {WEIGHTS_MAX} numbers are wanted, none below 0 and one above");
        return Err(Failure::new(2, message));
    }
    let (header, blocks) = read_map(&args.file)?;
    let blurred = blur_map(&blocks, &args.weights, args.neighbours);
    let stored: Vec<StoredBlock> = blurred
        .iter()
        .map(|(key, bricks)| StoredBlock { stamp: header.stamp, ..StoredBlock::of(*key, bricks, &[]) })
        .filter(|block| !block.is_empty())
        .collect();
    let bytes = mapfile::write(&args.out, &header, &stored)?;
    tell(format_args!("tsense: {} blocks, {bytes} bytes in {}", stored.len(), args.out.display()));
    let (before, after) = (occupied(&blocks), occupied(&blurred));
    if args.json {
        return print(&format!("{}\n", json!({ "occupied_before": before, "occupied_after": after })));
    }
    print(&format!("{before} voxels occupied before, {after} after\n"))
}

fn occupied(blocks: &Blocks) -> usize {
    let states = blocks.values().flatten().flat_map(|brick| (0..64).map(|i| brick.state(i)));
    states.filter(|state| *state == VoxelState::Occupied).count()
}

/// A map with every voxel blurred.
pub fn blur_map(blocks: &Blocks, weights: &[f32], neighbours: Neighbours) -> Blocks {
    blocks.keys().map(|key| (*key, blur_block(blocks, *key, weights, neighbours))).collect()
}

fn blur_block(blocks: &Blocks, key: BlockKey, weights: &[f32], neighbours: Neighbours) -> Vec<Brick> {
    let rim = weights.len().next_multiple_of(BRICK_EDGE);
    let first = first_voxel(key).map(|voxel| voxel - rim as i32);
    let window = Window { first, size: BLOCK_VOXELS.map(|voxels| voxels + 2 * rim) };
    let around: Vec<(BlockKey, &[Brick])> =
        slices_of(blocks).filter(|(other, _)| (0..3).all(|axis| other[axis].abs_diff(key[axis]) <= 1)).collect();
    let of = |value: fn(&Brick, usize) -> f32| Volume::of_known(window, around.iter().copied(), value);
    let values = Volume::of_blocks(window, around.iter().copied());
    let confidence = of(|brick, i| f32::from(brick.confidence[i]));
    let (occupancy, confidence) = match neighbours {
        Neighbours::Known => (blur_known(&values, &of(|_, _| 1.0), weights), confidence),
        Neighbours::All => (blur(&values, weights), blur(&confidence, weights)),
    };
    let mut bricks = blocks.get(&key).cloned().unwrap_or_default();
    for i in 0..BLOCK_VOXELS.iter().product() {
        let [width, height, _] = BLOCK_VOXELS;
        let at = [i % width, i / width % height, i / (width * height)];
        let voxel = std::array::from_fn(|axis| first_voxel(key)[axis] + at[axis] as i32);
        let ((_, place, inner), source) = (locate(voxel), occupancy.offset(at.map(|a| a + rim)));
        if let Some(brick) = bricks.get_mut(place) {
            set(brick, inner, occupancy.values[source], confidence.values[source]);
        }
    }
    bricks
}

/// A voxel that was known stays so; one that was not becomes so where whole evidence came to it.
fn set(brick: &mut Brick, inner: usize, occupancy: f32, confidence: f32) {
    let was_known = brick.confidence[inner] > 0;
    let occupancy = occupancy.round().clamp(-128.0, 127.0) as i8;
    if was_known || occupancy != 0 {
        brick.occupancy[inner] = occupancy;
        brick.confidence[inner] = confidence.round().clamp(1.0, 255.0) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_contract::BRICKS_PER_BLOCK;

    fn put(blocks: &mut Blocks, voxel: [i32; 3], occupancy: i8) {
        let (key, place, inner) = locate(voxel);
        let bricks = blocks.entry(key).or_insert_with(|| vec![Brick::UNKNOWN; BRICKS_PER_BLOCK]);
        (bricks[place].occupancy[inner], bricks[place].confidence[inner]) = (occupancy, 10);
    }

    fn get(blocks: &Blocks, voxel: [i32; 3]) -> (i8, u8) {
        let (key, place, inner) = locate(voxel);
        (blocks[&key][place].occupancy[inner], blocks[&key][place].confidence[inner])
    }

    #[test]
    fn a_blur_crosses_the_border_of_two_blocks() {
        let mut blocks = Blocks::new();
        // Voxel 99 is the last of its block along x; 100 the first of the next.
        put(&mut blocks, [99, 5, 5], 64);
        put(&mut blocks, [100, 5, 5], 0);
        let all = blur_map(&blocks, &[2.0, 1.0], Neighbours::All);
        assert_eq!((get(&all, [99, 5, 5]).0, get(&all, [100, 5, 5]).0, get(&all, [100, 6, 6]).0), (8, 4, 1));
        assert_eq!(get(&all, [101, 5, 5]), (0, 0), "two steps off nothing comes");
        let known = blur_map(&blocks, &[2.0, 1.0], Neighbours::Known);
        // (2 * 64 + 1 * 0) / 3 and (1 * 64 + 2 * 0) / 3.
        assert_eq!((get(&known, [99, 5, 5]), get(&known, [100, 5, 5])), ((43, 10), (21, 10)));
        assert_eq!(get(&known, [100, 6, 6]), (0, 0), "unknown stays unknown");
    }
}
