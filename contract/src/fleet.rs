//! Between a vehicle and a control station: what is asked, what is answered, and how that becomes bytes.
//!
//! This travels over a radio link (`bridge`'s `fleet` and `tsense station`), never through shared memory. A station
//! asks for what follows its cursor; a vehicle answers from its state and keeps nothing for a station that is away.
//! Bytes of a message: `tsfl`, a tag (CRC-32 of the header's versioned name, so that another version is refused), the
//! header, what follows it, CRC-32 of all before. Little-endian, as the machines at both ends are.

use crate::map::BlockKey;
use crate::message::{Message, message, wire_enum};
use crate::perception::Object;

/// First bytes of every message.
const MAGIC: [u8; 4] = *b"tsfl";
/// Bytes around header and payload: magic, tag, checksum.
const FRAME_BYTES: usize = 12;
/// Longest message: the largest block file that can be, 1.8 MB, with room. Both ends refuse more.
pub const FLEET_MESSAGE_BYTES_MAX: usize = 2 << 20;
/// Most items of one page: 98 kB of objects, so that a page passes a link of 1 Mbit/s within a second.
pub const FLEET_PAGE_MAX: u32 = 1024;
/// Ending of a block's file.
pub const BLOCK_EXTENSION: &str = "tsmap";
/// Longest name of a vehicle.
pub const VEHICLE_NAME_MAX: usize = 32;

wire_enum! {
    /// What a page lists.
    FleetList, unknown = Unknown {
        /// Not known.
        Unknown = 0 "unknown",
        /// Objects: items are [`FleetObject`].
        Objects = 1 "objects",
        /// Blocks of the map: items are [`FleetBlock`].
        Blocks = 2 "blocks",
    }
}

message! {
    /// A vehicle says that it is there and how far its lists go. Only wakes: a lost one costs nothing but time.
    FleetNews = "tsense.fleet_news.v1" {
        /// Instant, nanoseconds since the epoch, clock of the vehicle's graph.
        stamp_ns: i64,
        /// Epoch and newest number of the list of objects; epoch 0 while the vehicle does not know all of them yet.
        objects: [u64; 2],
        /// Epoch and newest number of the list of blocks.
        blocks: [u64; 2],
    }
}

message! {
    /// A station asks for the part of a list that follows its cursor.
    FleetAsk = "tsense.fleet_ask.v1" {
        /// Number of this question; the answer repeats it.
        ask: u64,
        /// Epoch of the cursor; where it is not the vehicle's, the answer starts at the beginning.
        epoch: u64,
        /// The cursor: number of the newest change that the station has.
        after: u64,
        /// Most items in the answer; at most [`FLEET_PAGE_MAX`].
        limit: u32,
        /// A [`FleetList`].
        list: u8,
        /// Zero.
        reserved: [u8; 3],
    }
}

message! {
    /// The answer: a page of a list, in the order of the numbers. Its items follow.
    FleetPage = "tsense.fleet_page.v1" {
        /// Number of the question.
        ask: u64,
        /// Epoch of the list: numbers of two epochs do not compare.
        epoch: u64,
        /// The cursor that this page follows: that of the question, or 0.
        after: u64,
        /// The cursor after this page.
        last: u64,
        /// Newest number of the list; where it is `last` the list is at its end.
        head: u64,
        /// Instant of the answer, nanoseconds since the epoch, clock of the vehicle's graph.
        stamp_ns: i64,
        /// Number of items.
        count: u32,
        /// A [`FleetList`].
        list: u8,
        /// UTM zone of objects; 0 where the store has none yet.
        zone: u8,
        /// 0 north, 1 south.
        south: u8,
        /// Zero.
        reserved: u8,
    }
}

message! {
    /// The newest change of one object.
    FleetObject = "tsense.fleet_object.v1" {
        /// Number of the change.
        number: u64,
        /// Instant for which the confidence is true, nanoseconds since the epoch.
        weighed_ns: i64,
        /// As it is now. Where it is not `reported` it is gone, and only its id means anything.
        object: Object,
    }
}

message! {
    /// The newest version of one block of the map.
    FleetBlock = "tsense.fleet_block.v1" {
        /// Number of the change.
        number: u64,
        /// Instant it was written, nanoseconds since the epoch, clock of the vehicle's graph.
        stamp_ns: i64,
        /// Edge of a voxel, metres.
        voxel_size_m: f64,
        /// Which block.
        key: [i32; 3],
        /// Bytes of its file.
        bytes: u32,
        /// CRC-32 of its file.
        crc: u32,
        /// UTM zone.
        zone: u8,
        /// 0 north, 1 south.
        south: u8,
        /// Zero.
        reserved: [u8; 2],
    }
}

message! {
    /// A station asks for the file of a block; of `block` only the place counts.
    FleetBlockAsk = "tsense.fleet_block_ask.v1" {
        /// Number of this question; the answer repeats it.
        ask: u64,
        /// Which block.
        block: FleetBlock,
    }
}

message! {
    /// The answer: the file follows, as it is now. No bytes follow where there is none any more.
    FleetBlockFile = "tsense.fleet_block_file.v1" {
        /// Number of the question.
        ask: u64,
        /// Which block, its length and its checksum.
        block: FleetBlock,
    }
}

/// Where a block lies: zone, hemisphere, size of a voxel (its bits), key.
pub type BlockPlace = (u8, u8, u64, BlockKey);

impl FleetBlock {
    /// Where it lies.
    pub fn place(&self) -> BlockPlace {
        (self.zone, self.south, self.voxel_size_m.to_bits(), self.key)
    }

    /// Whether its place can be: a zone of UTM and a size of voxels that a map may have.
    pub fn is_possible(&self) -> bool {
        (1..=60).contains(&self.zone) && self.south <= 1 && (0.01..=10.0).contains(&self.voxel_size_m)
    }
}

/// Where the file of a block lies below the folder of all, such as `17N-0.15m/24600_218600_-7.tsmap`.
pub fn block_path((zone, south, voxel_size, [x, y, z]): BlockPlace) -> String {
    let side = if south == 1 { 'S' } else { 'N' };
    format!("{zone}{side}-{}m/{x}_{y}_{z}.{BLOCK_EXTENSION}", f64::from_bits(voxel_size))
}

/// Why bytes off the link are no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FleetFault {
    /// They are longer than any message, or shorter.
    Length,
    /// They do not start as a message does.
    Foreign,
    /// They are another message, or another version of it.
    Version,
    /// They were changed on the way.
    Checksum,
}

impl FleetFault {
    /// The reason for counters.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Length => "wrong length",
            Self::Foreign => "not of this protocol",
            Self::Version => "another version",
            Self::Checksum => "wrong checksum",
        }
    }
}

fn tag<H: Message>() -> [u8; 4] {
    crc32fast::hash(H::TYPE_NAME.as_bytes()).to_le_bytes()
}

/// A message as bytes.
pub fn fleet_encode<H: Message>(header: &H, payload: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(FRAME_BYTES + size_of::<H>() + payload.len());
    bytes.extend(MAGIC);
    bytes.extend(tag::<H>());
    bytes.extend(bytemuck::bytes_of(header));
    bytes.extend(payload);
    let checksum = crc32fast::hash(&bytes);
    bytes.extend(checksum.to_le_bytes());
    bytes
}

/// A message and what follows its header; nothing is believed before the checksum is right.
pub fn fleet_decode<H: Message>(bytes: &[u8]) -> Result<(H, &[u8]), FleetFault> {
    if !(FRAME_BYTES + size_of::<H>()..=FLEET_MESSAGE_BYTES_MAX).contains(&bytes.len()) {
        // A shorter message is most likely another one.
        return Err(if is_foreign(bytes) { FleetFault::Foreign } else { FleetFault::Length });
    }
    if is_foreign(bytes) {
        return Err(FleetFault::Foreign);
    }
    let (content, checksum) = bytes.split_last_chunk().ok_or(FleetFault::Length)?;
    if u32::from_le_bytes(*checksum) != crc32fast::hash(content) {
        return Err(FleetFault::Checksum);
    }
    if content[MAGIC.len()..][..4] != tag::<H>() {
        return Err(FleetFault::Version);
    }
    let (header, payload) = content[MAGIC.len() + 4..].split_at(size_of::<H>());
    Ok((bytemuck::pod_read_unaligned(header), payload))
}

fn is_foreign(bytes: &[u8]) -> bool {
    !bytes.starts_with(&MAGIC)
}

/// The items after a page's header; they must be as many as it says, and no more than a page may have.
pub fn fleet_items<I: Message>(payload: &[u8], count: u32) -> Result<Vec<I>, FleetFault> {
    let fits = count <= FLEET_PAGE_MAX && payload.len() == count as usize * size_of::<I>();
    let items = payload.chunks_exact(size_of::<I>()).map(bytemuck::pod_read_unaligned);
    if fits { Ok(items.collect()) } else { Err(FleetFault::Length) }
}

/// The name of a vehicle: part of keys on the link, of files and of tables.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VehicleName(String);

impl VehicleName {
    /// What a name may be, for people.
    pub const ALLOWED: &'static str = "1 to 32 ASCII letters, digits, - and _";

    /// A name, if it is one.
    pub fn new(name: &str) -> Option<Self> {
        let plain = |b: u8| b.is_ascii_alphanumeric() || b == b'-' || b == b'_';
        ((1..=VEHICLE_NAME_MAX).contains(&name.len()) && name.bytes().all(plain)).then(|| Self(name.to_owned()))
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for VehicleName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn ask() -> FleetAsk {
        FleetAsk { ask: 7, epoch: 8, after: 9, limit: 10, list: 1, reserved: [0; 3] }
    }

    #[test]
    fn a_message_survives_the_wire_with_what_follows() {
        let bytes = fleet_encode(&ask(), b"and more");
        assert_eq!(bytes.len(), 12 + 32 + 8);
        assert_eq!(fleet_decode::<FleetAsk>(&bytes), Ok((ask(), b"and more".as_slice())));
        assert_eq!(fleet_decode::<FleetNews>(&bytes), Err(FleetFault::Version));
    }

    #[test]
    fn every_flipped_bit_and_every_cut_is_refused() {
        let bytes = fleet_encode(&ask(), b"and more");
        let mut tried = 0;
        for bit in 0..bytes.len() * 8 {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(fleet_decode::<FleetAsk>(&changed).is_err(), "bit {bit}");
            tried += 1;
        }
        for end in 0..bytes.len() {
            assert!(fleet_decode::<FleetAsk>(&bytes[..end]).is_err(), "cut at {end}");
            tried += 1;
        }
        assert_eq!(tried, 52 * 9);
        assert_eq!(fleet_decode::<FleetAsk>(&vec![0; FLEET_MESSAGE_BYTES_MAX + 1]), Err(FleetFault::Foreign));
    }

    #[test]
    fn a_page_has_as_many_items_as_it_says() {
        let items = [FleetBlock::zeroed(); 3];
        let payload = bytemuck::cast_slice(&items);
        assert_eq!(fleet_items::<FleetBlock>(payload, 3), Ok(items.to_vec()));
        assert_eq!(fleet_items::<FleetBlock>(payload, 2), Err(FleetFault::Length));
        assert_eq!(fleet_items::<FleetBlock>(payload, u32::MAX), Err(FleetFault::Length));
    }

    #[test]
    fn a_name_is_plain_so_that_it_can_be_part_of_a_key_and_of_a_path() {
        assert_eq!(VehicleName::new("mule-7_B").unwrap().as_str(), "mule-7_B");
        for bad in ["", "a/b", "..", "*", "a b", "ö", "123456789012345678901234567890123"] {
            assert_eq!(VehicleName::new(bad), None, "{bad}");
        }
    }
}
