//! What a map file holds: counts, extent, sizes, and whether every block checks.
//!
//! In: a file's bytes. Out: [`Info`], lengths in metres, for people or as JSON. Damaged blocks are listed, not hidden.

use serde::Serialize;
use tsense_contract::VoxelState;
use tsense_kstore::{Reprojection, Zone};
use tsense_mapper::tsmap::{BlockCheck, MapFileHeader, Reader, StoredBlock};

use super::points::voxels_of;
use super::system_of;

/// All there is to say about a file.
#[derive(Clone, Debug, Serialize)]
pub struct Info {
    /// The file as given.
    pub file: String,
    /// Its size.
    pub bytes: usize,
    /// Edge of a voxel.
    pub voxel_size_m: f64,
    /// UTM zone; 0 for none.
    pub zone: u8,
    /// South of the equator.
    pub south: bool,
    /// EPSG code; null where nobody knows.
    pub epsg: Option<u16>,
    /// Instant of the newest beam, nanoseconds since 1970.
    pub stamp_ns: i64,
    /// Blocks that checked.
    pub blocks: usize,
    /// Blocks that did not.
    pub damaged_blocks: usize,
    /// Bricks that hold anything.
    pub bricks: usize,
    /// Voxels by state; unknown ones of the blocks in the file.
    pub voxels: Voxels,
    /// Smallest and largest coordinates of known voxels; null where nothing is known.
    pub extent_m: Option<[[f64; 3]; 2]>,
    /// West, south, east, north in degrees on WGS 84; null where the zone is unknown.
    pub extent_deg: Option<[f64; 4]>,
    /// Each block.
    pub block_list: Vec<Block>,
}

/// Counts by state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Voxels {
    /// Beams end here.
    pub occupied: u64,
    /// Beams pass.
    pub free: u64,
    /// Never measured, or faded.
    pub unknown: u64,
}

/// One block of the file.
#[derive(Clone, Debug, Serialize)]
pub struct Block {
    /// Its key; null where it could not be read.
    pub key: Option<[i32; 3]>,
    /// Where it starts in the file.
    pub at: usize,
    /// Its size in the file; null where its end was not found.
    pub bytes: Option<usize>,
    /// Its voxels by state; null where it is damaged.
    pub voxels: Option<Voxels>,
    /// `good`, or what is wrong.
    pub state: String,
}

/// Looks at every block.
pub fn info(file: &str, bytes: &[u8], reader: Reader<'_>) -> Info {
    let header = reader.header();
    let mut info = Info {
        file: file.into(),
        bytes: bytes.len(),
        voxel_size_m: header.voxel_size_m,
        zone: header.zone,
        south: header.south,
        epsg: (header.epsg != 0).then_some(header.epsg),
        stamp_ns: header.stamp.ns,
        blocks: 0,
        damaged_blocks: 0,
        bricks: 0,
        voxels: Voxels::default(),
        extent_m: None,
        extent_deg: None,
        block_list: Vec::new(),
    };
    let mut extent = None;
    reader.check(|check, block| info.add(check, block.as_ref(), &mut extent));
    info.extent_m = extent.map(|[low, high]| in_metres(&header, low, high));
    info.extent_deg = info.extent_m.and_then(|[low, high]| in_degrees(&header, low, high));
    info
}

impl Info {
    fn add(&mut self, check: BlockCheck, block: Option<&StoredBlock>, extent: &mut Option<[[i32; 3]; 2]>) {
        let voxels = block.map(|block| count(block, extent));
        match (block, voxels) {
            (Some(block), Some(voxels)) => {
                self.blocks += 1;
                self.bricks += block.bricks.len();
                self.voxels.occupied += voxels.occupied;
                self.voxels.free += voxels.free;
                self.voxels.unknown += voxels.unknown;
            }
            _ => self.damaged_blocks += 1,
        }
        let state = check.fault.map_or_else(|| "good".to_owned(), |fault| fault.to_string());
        self.block_list.push(Block { key: check.key, at: check.at, bytes: check.bytes, voxels, state });
    }

    /// For people.
    pub fn to_text(&self, header: &MapFileHeader) -> String {
        let Voxels { occupied, free, unknown } = self.voxels;
        let mut text = format!(
            "{}: {} blocks, {} bytes, voxels of {} m, {}\n{occupied} voxels occupied, {free} free, {unknown} unknown\n",
            self.file,
            self.blocks,
            self.bytes,
            self.voxel_size_m,
            system_of(header)
        );
        if let Some([low, high]) = self.extent_m {
            let [x, y, z] = std::array::from_fn(|axis| format!("{:.2} to {:.2}", low[axis], high[axis]));
            text.push_str(&format!("easting {x} m\nnorthing {y} m\nheight {z} m\n"));
        }
        if let Some([west, south, east, north]) = self.extent_deg {
            text.push_str(&format!("longitude {west:.7} to {east:.7}, latitude {south:.7} to {north:.7} degrees\n"));
        }
        text.push_str(&format!("newest beam {} ns since 1970\n", self.stamp_ns));
        for block in self.block_list.iter().filter(|block| block.voxels.is_none()) {
            text.push_str(&format!("damaged: {}\n", block.state));
        }
        text
    }
}

fn count(block: &StoredBlock, extent: &mut Option<[[i32; 3]; 2]>) -> Voxels {
    let mut voxels = Voxels::default();
    for (voxel, state, ..) in voxels_of(block) {
        match state {
            VoxelState::Occupied => voxels.occupied += 1,
            _ => voxels.free += 1,
        }
        let [low, high] = extent.get_or_insert([voxel, voxel]);
        for axis in 0..3 {
            low[axis] = low[axis].min(voxel[axis]);
            high[axis] = high[axis].max(voxel[axis]);
        }
    }
    let all: usize = tsense_contract::BLOCK_VOXELS.iter().product();
    voxels.unknown = all as u64 - voxels.occupied - voxels.free;
    voxels
}

fn in_metres(header: &MapFileHeader, low: [i32; 3], high: [i32; 3]) -> [[f64; 3]; 2] {
    let size_m = header.voxel_size_m;
    [low.map(|v| f64::from(v) * size_m), high.map(|v| (f64::from(v) + 1.0) * size_m)]
}

/// The four corners on the ground, in degrees: the smallest box that holds them.
fn in_degrees(header: &MapFileHeader, low: [f64; 3], high: [f64; 3]) -> Option<[f64; 4]> {
    let degrees = Reprojection::to_degrees(Zone::from_wire(header.zone, header.south.into())?)?;
    let mut box_deg = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for corner in [[low[0], low[1]], [low[0], high[1]], [high[0], low[1]], [high[0], high[1]]] {
        let [longitude, latitude] = degrees.apply(corner)?;
        box_deg =
            [box_deg[0].min(longitude), box_deg[1].min(latitude), box_deg[2].max(longitude), box_deg[3].max(latitude)];
    }
    Some(box_deg)
}
