//! The blocks of a station: which are missing, what is asked for, and what a file must be to be kept.
//!
//! In: pages that list a vehicle's blocks, and files of blocks off the link. Out: questions, files, rows of the book. A
//! file that is damaged, or for which there is no room, is counted and asked for again later.

use super::book::{BlockRow, VehicleRow};
use super::peer::{ANSWER_S, Refusal};
use super::{Station, Taken, Vehicle};
use crate::zone::Zone;
use std::collections::BTreeMap;
use tsense_contract::{
    BlockKey, BlockPlace, FleetBlock, FleetBlockAsk, FleetBlockFile, FleetPage, VehicleName, fleet_decode,
    fleet_encode, fleet_items,
};
use tsense_geometry::Timestamp;

/// Most blocks of one vehicle: 22 square kilometres of one layer.
const BLOCKS_PER_VEHICLE_MAX: usize = 100_000;

/// A block that failed its check is asked for again after this, seconds.
const FILE_AGAIN_S: f64 = 60.0;

/// The first of all places.
const PLACE_MIN: BlockPlace = (0, 0, 0, [i32::MIN; 3]);

impl Station {
    pub(super) fn block_list(&mut self, name: &VehicleName, page: &FleetPage, items: &[u8], now: Timestamp) -> Taken {
        let Some(vehicle) = self.vehicles.get_mut(name) else { return Ok(Err(Refusal::Unasked)) };
        let items = match fleet_items::<FleetBlock>(items, page.count) {
            Ok(items) => items,
            Err(fault) => return Ok(Err(Refusal::Bytes(fault))),
        };
        let cursor = match vehicle.peer.blocks.check(page, now) {
            Ok(cursor) => cursor,
            Err(refusal) => return Ok(Err(refusal)),
        };
        vehicle.counts.pages += 1;
        let held = self.blocks.range((vehicle.number, PLACE_MIN)..).take_while(|((n, _), _)| *n == vehicle.number);
        let mut room = BLOCKS_PER_VEHICLE_MAX.saturating_sub(held.count());
        let mut rows = Vec::new();
        for block in items {
            let at = (vehicle.number, block.place());
            let old = self.blocks.get(&at).copied();
            if !block.is_possible() || (old.is_none() && room == 0) {
                vehicle.drop_for(if block.is_possible() { "too many blocks" } else { "senseless block" });
                continue;
            }
            room -= usize::from(old.is_none());
            let row = BlockRow { crc: block.crc, bytes: block.bytes, here: old.and_then(|row| row.here) };
            if row.here == Some((row.crc, row.bytes)) {
                vehicle.wanted.remove(&block.place());
            } else {
                vehicle.wanted.insert(block.place(), now);
            }
            if old != Some(row) {
                rows.push((at.1, row));
            }
        }
        let before = vehicle.peer.blocks.cursor();
        vehicle.peer.blocks.advance(cursor);
        if cursor == before && rows.is_empty() {
            return Ok(Ok(()));
        }
        self.commit_blocks(name, rows)
    }

    /// Writes a block's file, then that it is here.
    pub(super) fn block_file(&mut self, name: &VehicleName, answer: &[u8], now: Timestamp) -> Taken {
        let (Some(vehicle), Some(files)) = (self.vehicles.get_mut(name), &self.files) else {
            return Ok(Err(Refusal::Unasked));
        };
        let (head, file) = match fleet_decode::<FleetBlockFile>(answer) {
            Ok(decoded) => decoded,
            Err(fault) => return Ok(Err(Refusal::Bytes(fault))),
        };
        let place = head.block.place();
        if vehicle.peer.open_file.is_none_or(|(ask, _)| ask != head.ask) || !vehicle.wanted.contains_key(&place) {
            return Ok(Err(Refusal::Unasked));
        }
        vehicle.peer.open_file = None;
        let Some(row) = self.blocks.get(&(vehicle.number, place)).copied() else { return Ok(Err(Refusal::Unasked)) };
        if file.is_empty() {
            // It made room for others on the vehicle.
            vehicle.wanted.remove(&place);
            vehicle.drop_for("block gone before it was sent");
            return Ok(Ok(()));
        }
        let (crc, bytes) = (crc32fast::hash(file), file.len() as u32);
        let total_bytes = self.block_bytes - row.here.map_or(0, |here| u64::from(here.1)) + u64::from(bytes);
        let refusal = if (self.options.check_block)(file) != Ok(place) || crc != head.block.crc {
            Some("block damaged")
        } else if !files.has_room(total_bytes) {
            Some("block folder full")
        } else {
            files.write(&files.path(name, place), file).err().map(|error| {
                tracing::error!(vehicle = name.as_str(), %error, "a block was not written");
                "block not written"
            })
        };
        if let Some(refusal) = refusal {
            vehicle.wanted.insert(place, now.plus_seconds(FILE_AGAIN_S));
            vehicle.drop_for(refusal);
            return Ok(Ok(()));
        }
        let here = Some((crc, bytes));
        if here == Some((row.crc, row.bytes)) {
            vehicle.wanted.remove(&place);
        } else {
            // Older than a list that came meanwhile, or newer than the last one: the next list tells, or it is asked again.
            vehicle.wanted.insert(place, now.plus_seconds(2.0 * ANSWER_S));
        }
        vehicle.counts.files += 1;
        self.block_bytes = total_bytes;
        self.commit_blocks(name, vec![(place, BlockRow { here, ..row })])
    }

    fn commit_blocks(&mut self, name: &VehicleName, rows: Vec<(BlockPlace, BlockRow)>) -> Taken {
        let Some(vehicle) = self.vehicles.get(name) else { return Ok(Err(Refusal::Unasked)) };
        self.blocks.extend(rows.iter().map(|(place, row)| ((vehicle.number, *place), *row)));
        let first = rows.first().and_then(|((zone, south, ..), _)| Zone::from_wire(*zone, *south));
        let Some(zone) = first.map(|zone| self.fleet.settle_zone(zone)).or(self.fleet.zone()) else {
            return Ok(Ok(()));
        };
        let (objects, blocks) = (vehicle.peer.objects.cursor(), vehicle.peer.blocks.cursor());
        let row = VehicleRow { number: vehicle.number, objects, blocks };
        let batch = self.fleet.take_batch();
        self.commit(zone, &batch, name, &row, &rows)?;
        Ok(Ok(()))
    }
}

impl Vehicle {
    /// Asks for the file of a block, one at a time.
    pub(super) fn file_question(&mut self, ask: u64, now: Timestamp) -> Option<Vec<u8>> {
        let is_open = |at: Timestamp| (0.0..2.0 * ANSWER_S).contains(&now.seconds_since(at));
        if self.peer.open_file.is_some_and(|(_, at)| is_open(at)) {
            return None;
        }
        let (place, _) = self.wanted.iter().find(|(_, not_before)| **not_before <= now)?;
        self.peer.open_file = Some((ask, now));
        let (zone, south, voxel_size, key): (u8, u8, u64, BlockKey) = *place;
        let block =
            FleetBlock { zone, south, voxel_size_m: f64::from_bits(voxel_size), key, ..bytemuck::Zeroable::zeroed() };
        Some(fleet_encode(&FleetBlockAsk { ask, block }, &[]))
    }
}

/// Blocks of a vehicle whose newest file is not here.
pub(super) fn missing(blocks: &BTreeMap<(u32, BlockPlace), BlockRow>, number: u32) -> BTreeMap<BlockPlace, Timestamp> {
    let of_it = blocks.iter().filter(|((n, _), row)| *n == number && row.here != Some((row.crc, row.bytes)));
    of_it.map(|((_, place), _)| (*place, Timestamp::default())).collect()
}
