//! A vehicle that is gone for good: what it reported, its blocks and its place in the book are taken away.
//!
//! In: a name. Out: a store as if it had never been heard. Objects that others report as well stay, as those say. The
//! book is written first, files go after: killed in between, files are left that nobody counts.

use super::book::{self, BlockRow};
use super::{Station, Vehicle};
use crate::persist::FileFault;
use tsense_contract::{BlockPlace, VehicleName};

/// What a forgotten vehicle had here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Forgotten {
    /// Objects that it reported now.
    pub objects: usize,
    /// Files of its blocks.
    pub blocks: usize,
}

impl Station {
    /// Forgets a vehicle; nothing where it is not known. Should it report again, it is a new one.
    pub fn forget(&mut self, name: &VehicleName) -> Result<Option<Forgotten>, FileFault> {
        let Some(Vehicle { number, .. }) = self.vehicles.remove(name) else { return Ok(None) };
        let objects = self.fleet.count_of(number).0;
        self.fleet.forget(number);
        let of_it = |(n, _): &(u32, BlockPlace), _: &mut BlockRow| *n == number;
        let blocks: Vec<BlockRow> = self.blocks.extract_if(.., of_it).map(|(_, row)| row).collect();
        let here = blocks.iter().filter_map(|row| row.here);
        let (files, bytes) = here.fold((0, 0), |(n, sum), (_, bytes)| (n + 1, sum + u64::from(bytes)));
        self.block_bytes -= bytes;
        if let Some(zone) = self.fleet.zone() {
            let changes = self.fleet.take_batch().changes;
            self.vault.commit_with(zone, &changes, &|gpkg| Ok(book::forget(gpkg.connection(), number)?))?;
        }
        if let Some(files) = &self.files {
            files.forget(name)?;
        }
        Ok(Some(Forgotten { objects, blocks: files }))
    }
}
