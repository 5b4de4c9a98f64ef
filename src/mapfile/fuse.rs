//! Two map files of one place become one, by the rule of evidence of the live map.
//!
//! In: a map, and another that is taken as one window's word of a sensor of some weight. Out: the map with that counted in:
//! where only one of them knows a voxel it is as that one says, elsewhere the weight decides.

use super::diff::{all, one_place};
use super::points::voxels_of;
use crate::commands::Failure;
use std::collections::BTreeSet;
use std::path::Path;
use tsense_contract::{BLOCK_VOXELS, BlockKey, first_voxel};
use tsense_mapper::tsmap::{FILE_BLOCKS_MAX, MapFileHeader, Reader, StoredBlock};
use tsense_mapper::{Config, Moment, Scheme, VoxelMap, Weight};

/// Fuses the second file into the first.
pub fn fuse(
    map: (&Path, Reader<'_>),
    told: (&Path, Reader<'_>),
    weight: f64,
) -> Result<(MapFileHeader, Vec<StoredBlock>), Failure> {
    let (header, other) = (map.1.header(), told.1.header());
    one_place(&header, &other)?;
    let (map, told) = (all(map)?, all(told)?);
    let keys: BTreeSet<BlockKey> = map.keys().chain(told.keys()).copied().collect();
    if keys.len() > FILE_BLOCKS_MAX {
        let message = format!("together they are {} blocks; a map file has at most {FILE_BLOCKS_MAX}", keys.len());
        return Err(Failure::new(2, message));
    }
    let counted = map.values().any(|block| !block.counters.is_empty());
    let config = config_of(header.voxel_size_m, if counted { Scheme::HitRatio } else { Scheme::Confidence });
    let blocks = keys.into_iter().map(|key| match (map.get(&key), told.get(&key)) {
        (Some(block), None) => Ok(block.clone()),
        (block, told) => fuse_block(&config, key, (block, told), Weight::new(weight)),
    });
    let blocks = blocks.collect::<Result<Vec<_>, _>>()?;
    Ok((MapFileHeader { stamp: header.stamp.max(other.stamp), ..header }, blocks))
}

/// A map whose working space is one block.
fn config_of(voxel_size_m: f64, scheme: Scheme) -> Config {
    let working_space_m = BLOCK_VOXELS.map(|voxels| voxels as f64 * voxel_size_m);
    let mut config = Config { voxel_size_m, working_space_m, ..Config::default() };
    config.scheme.scheme = scheme;
    config
}

fn fuse_block(
    config: &Config,
    key: BlockKey,
    (block, told): (Option<&StoredBlock>, Option<&StoredBlock>),
    weight: Weight,
) -> Result<StoredBlock, Failure> {
    let mut map = VoxelMap::new(config).map_err(|e| Failure::new(2, e))?;
    let middle = first_voxel(key);
    let middle: [i32; 3] = std::array::from_fn(|axis| middle[axis] + BLOCK_VOXELS[axis] as i32 / 2);
    map.center_on(map.grid().center_of(middle));
    let stamp = block.into_iter().chain(told).map(|block| block.stamp).max().unwrap_or_default();
    if let Some(block) = block {
        // It does not age here: that is for whoever takes it back into a live map.
        map.restore(block, &Moment { epoch: 0, faded: 0, stamp: block.stamp });
    }
    let voxels = told.into_iter().flat_map(voxels_of).map(|(voxel, state, ..)| (voxel, state));
    map.fuse(voxels, weight);
    let fused = map.copy_all().into_iter().find(|fused| fused.key == key);
    let fused = fused.ok_or_else(|| Failure::new(1, format!("block {key:?} holds nothing")))?;
    Ok(StoredBlock { stamp, ..fused })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_contract::{BRICKS_PER_BLOCK, Brick};
    use tsense_geometry::Timestamp;
    use tsense_mapper::tsmap;

    /// A file of blocks, each with the given occupancies in the first voxels of its last brick; confidence 8.
    fn file(voxel_size_m: f64, blocks: &[(BlockKey, &[i8])]) -> Vec<u8> {
        let block = |(key, occupancies): &(BlockKey, &[i8])| {
            let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
            let last = &mut bricks[BRICKS_PER_BLOCK - 1];
            last.occupancy[..occupancies.len()].copy_from_slice(occupancies);
            last.confidence[..occupancies.len()].fill(8);
            StoredBlock::of(*key, &bricks, &[])
        };
        let header = MapFileHeader::in_zone(voxel_size_m, Timestamp::from_seconds(1e9), 32, false);
        tsmap::encode(&header, &blocks.iter().map(block).collect::<Vec<_>>())
    }

    fn fused(map: &[u8], told: &[u8], weight: f64) -> Result<Vec<StoredBlock>, Failure> {
        let path = Path::new("a");
        let readers = [map, told].map(|bytes| Reader::new(bytes).unwrap());
        let [map, told] = readers;
        fuse((path, map), (path, told), weight).map(|(_, blocks)| blocks)
    }

    #[test]
    fn where_both_know_a_voxel_the_weight_decides_and_else_it_is_as_the_one_says() {
        let far = [24_600, 218_600, -7];
        let map = file(0.15, &[(far, &[8, 8, -8, -8]), ([0, 0, 0], &[5])]);
        // Unknown in the map, as a block and as voxels; then occupied and free where the map is free and occupied.
        let told = file(0.15, &[(far, &[-8, 8, 8, -8, 8, -8]), ([-1, 0, 0], &[8, -8])]);
        let blocks = fused(&map, &told, 0.5).unwrap();
        let of = |key: BlockKey| {
            let block = blocks.iter().find(|block| block.key == key).unwrap();
            let brick = block.brick(BRICKS_PER_BLOCK - 1);
            (brick.occupancy[..7].to_vec(), brick.confidence[..7].to_vec())
        };
        // Half of 12 and of 4, and of 8.
        assert_eq!(of(far), (vec![6, 8, -2, -8, 6, -2, 0], vec![12, 12, 12, 12, 4, 4, 0]));
        assert_eq!(of([-1, 0, 0]), (vec![6, -2, 0, 0, 0, 0, 0], vec![4, 4, 0, 0, 0, 0, 0]));
        assert_eq!(of([0, 0, 0]).0[0], 5, "nobody else was there");
        assert_eq!(blocks.len(), 3);
        assert_eq!(fused(&map, &file(0.2, &[]), 0.5).unwrap_err().code, 2);
    }
}
