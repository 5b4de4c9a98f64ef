//! One block of a map as the bytes of a map file, and back: what a vehicle sends a station, and what that checks.

use tsense_contract::{BlockKey, BlockPlace, Brick, MapHeader};
use tsense_geometry::Timestamp;
use tsense_mapper::tsmap::{MapFileHeader, StoredBlock, decode, encode as encode_file};

/// A block of a snapshot as a file; nothing where nothing is known of it.
pub fn encode(header: &MapHeader, key: BlockKey, bricks: &[Brick]) -> Option<Vec<u8>> {
    let stamp = Timestamp::from_ns(header.stamp_ns);
    let file = MapFileHeader::in_zone(header.voxel_size_m, stamp, header.pose.zone, header.pose.south == 1);
    let block = StoredBlock { stamp, epoch: header.epoch, ..StoredBlock::of(key, bricks, &[]) };
    (!block.is_empty()).then(|| encode_file(&file, &[block]))
}

/// Where the one block of a file lies; or what is wrong with the file.
pub fn check(bytes: &[u8]) -> Result<BlockPlace, String> {
    let (header, blocks) = decode(bytes).map_err(|fault| fault.to_string())?;
    match blocks.as_slice() {
        [block] => Ok((header.zone, u8::from(header.south), header.voxel_size_m.to_bits(), block.key)),
        others => Err(format!("{} blocks instead of one", others.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use tsense_contract::{BRICKS_PER_BLOCK, Pose};

    #[test]
    fn a_block_says_where_it_lies_and_a_changed_byte_is_no_block() {
        let pose = Pose { zone: 17, ..Pose::zeroed() };
        let header = MapHeader { voxel_size_m: 0.15, pose, ..MapHeader::zeroed() };
        let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
        assert_eq!(encode(&header, [1, -2, 3], &bricks), None);
        bricks[7].confidence[1] = 1;
        let mut bytes = encode(&header, [1, -2, 3], &bricks).unwrap();
        assert_eq!(check(&bytes), Ok((17, 0, 0.15_f64.to_bits(), [1, -2, 3])));
        bytes[60] ^= 1;
        assert!(check(&bytes).is_err());
    }
}
