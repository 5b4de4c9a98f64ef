//! Frames of the voxel map: one block's visible voxels, and the table of blocks that ends a snapshot.
//!
//! The origin of a block frame is the block's lower corner. A client drops every block that the newest table does
//! not list: there is no frame for removal, because a table is state and a removal is history.

use super::{Frame, Header, Kind, Writer};
use crate::web::surface::Surface;
use tsense_contract::{BLOCK_VOXELS, BlockKey, MapHeader};

/// The visible voxels of a block. Payload: `i32[3]` key, `u32` version, `f32` voxel size, `u32` count, then the
/// words of [`crate::web::surface`].
pub fn block_frame(map: &MapHeader, surface: &Surface) -> Frame {
    let mut writer = Writer::new(&header(map, Kind::Block, corner_m(map)), 24 + 4 * surface.words.len());
    writer.i32s(&map.key);
    writer.u32(map.version);
    writer.f32s(&[map.voxel_size_m as f32]);
    writer.u32(surface.words.len() as u32);
    surface.words.iter().for_each(|word| writer.u32(*word));
    writer.finish()
}

/// The table of a complete snapshot. Payload: `u64` epoch, `u64` snapshot, `u32` blocks, `u32` visible voxels of all
/// blocks, then `i32[3]` key and `u32` version a block.
pub fn commit_frame(map: &MapHeader, blocks: &[(BlockKey, u32)], voxels: usize) -> Frame {
    let vehicle_m = [map.pose.easting_m, map.pose.northing_m, map.pose.altitude_m];
    let mut writer = Writer::new(&header(map, Kind::Commit, vehicle_m), 24 + 16 * blocks.len());
    writer.u64(map.epoch);
    writer.u64(map.snapshot);
    writer.u32(blocks.len() as u32);
    writer.u32(voxels as u32);
    for (key, version) in blocks {
        writer.i32s(key);
        writer.u32(*version);
    }
    writer.finish()
}

fn header(map: &MapHeader, kind: Kind, origin_m: [f64; 3]) -> Header {
    Header { kind, zone: map.pose.zone, south: map.pose.south, stamp_ns: map.stamp_ns, origin_m }
}

/// The block's lower corner. Key and block size multiply in `i64`: a key from a broken peer must not overflow.
fn corner_m(map: &MapHeader) -> [f64; 3] {
    std::array::from_fn(|axis| (i64::from(map.key[axis]) * BLOCK_VOXELS[axis] as i64) as f64 * map.voxel_size_m)
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;
    use bytemuck::Zeroable;

    fn map() -> MapHeader {
        let mut map = MapHeader::zeroed();
        (map.key, map.version, map.voxel_size_m, map.stamp_ns) = ([24_600, -3, 7], 9, 0.15, 5);
        (map.epoch, map.snapshot, map.pose.zone) = (2, 41, 17);
        map
    }

    #[test]
    fn a_block_starts_with_its_corner_in_utm_and_its_key() {
        let frame = block_frame(&map(), &Surface { words: vec![0x01020304, 5], cut: 0 });
        let (header, payload) = parse(&frame).unwrap();
        assert_eq!((header.kind, header.zone, header.stamp_ns), (Kind::Block, 17, 5));
        // 24600 blocks of 100 voxels of 0.15 m; 40 voxels in height.
        for (found, expected) in header.origin_m.iter().zip([369_000.0, -45.0, 42.0]) {
            assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
        }
        assert_eq!(payload[..4], 24_600i32.to_le_bytes());
        assert_eq!(payload[12..16], [9, 0, 0, 0]);
        assert_eq!(payload[16..20], 0.15f32.to_le_bytes());
        assert_eq!(payload[20..], [2, 0, 0, 0, 4, 3, 2, 1, 5, 0, 0, 0]);
    }

    #[test]
    fn a_key_at_the_end_of_the_integers_does_not_overflow() {
        let mut far = map();
        far.key = [i32::MAX, i32::MIN, i32::MAX];
        assert!(parse(&block_frame(&far, &Surface::default())).unwrap().0.origin_m[0] > 3.2e10);
    }

    #[test]
    fn a_commit_lists_every_block() {
        let frame = commit_frame(&map(), &[([1, 2, 3], 4), ([-1, 0, 0], 5)], 77);
        let (header, payload) = parse(&frame).unwrap();
        assert_eq!(header.kind, Kind::Commit);
        assert_eq!(payload[..24], [2, 0, 0, 0, 0, 0, 0, 0, 41, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 77, 0, 0, 0]);
        assert_eq!(payload[40..44], [255; 4]);
        assert_eq!(payload.len(), 24 + 2 * 16);
    }
}
