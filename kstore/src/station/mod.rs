//! A control station's store: the objects of several vehicles merged into one GeoPackage, and their blocks in files.
//!
//! In: bytes off the link and the instant. Out: questions, and the store on disk. What a page brought and the cursor
//! behind it are written in one transaction, so a station that is killed at any instant asks for exactly what it does
//! not have. Bytes that are no answer to its questions are counted and change nothing. Knows no sockets and no clock.
//!
//! [`merge`] is which objects are one, [`peer`] what is asked and believed, [`book`] what lies in the file.

mod blocks;
pub mod book;
mod files;
mod forget;
pub mod merge;
#[cfg(test)]
mod merge_tests;
pub mod peer;
mod report;
mod source;

pub use forget::Forgotten;
pub use merge::Fleet;
pub use report::VehicleReport;

use crate::config::Config;
use crate::object::Refusal as ObjectRefusal;
use crate::persist::{FileFault, Room, Vault};
use crate::reproject::Reprojection;
use crate::zone::Zone;
use book::{BlockRow, VehicleRow};
use files::BlockFiles;
use merge::Batch;
use peer::{Cursor, Peer, Refusal};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tsense_contract::{
    BlockPlace, FleetFault, FleetList, FleetNews, FleetObject, FleetPage, VehicleName, fleet_decode, fleet_items,
};
use tsense_geometry::Timestamp;

/// Most objects of one vehicle, those it reported once included: as many as a vehicle's own store holds.
const OBJECTS_PER_VEHICLE_MAX: usize = 100_000;

/// Looks at a block's file: where it lies, or what is wrong with it. Given by who knows the format of map files.
pub type CheckBlock = fn(&[u8]) -> Result<BlockPlace, String>;

/// How a station works.
#[derive(Clone, Debug)]
pub struct Options {
    /// The store's file, a GeoPackage.
    pub store: PathBuf,
    /// The folder for blocks; nothing where they are not wanted.
    pub blocks: Option<PathBuf>,
    /// Blocks take no more of the disk than this, bytes.
    pub blocks_max_bytes: u64,
    /// The store takes no more of the disk than this, megabytes.
    pub store_max_mb: u32,
    /// Vehicles that are listened to; all where none is named.
    pub vehicles: Vec<VehicleName>,
    /// Most vehicles.
    pub vehicles_max: usize,
    /// Looks at a block's file.
    pub check_block: CheckBlock,
}

/// A vehicle at this station.
#[derive(Debug)]
struct Vehicle {
    number: u32,
    peer: Peer,
    /// Blocks whose newest file is not here, and not before which instant to ask.
    wanted: BTreeMap<BlockPlace, Timestamp>,
    counts: Counts,
}

/// What came of a vehicle since the station was started.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Counts {
    bytes: u64,
    pages: u64,
    objects: u64,
    files: u64,
    dropped: BTreeMap<&'static str, u64>,
}

/// See the head of this file.
pub struct Station {
    options: Options,
    config: Config,
    vault: Vault,
    fleet: Fleet,
    vehicles: BTreeMap<VehicleName, Vehicle>,
    blocks: BTreeMap<(u32, BlockPlace), BlockRow>,
    block_bytes: u64,
    files: Option<BlockFiles>,
    next_ask: u64,
    is_full: bool,
    strangers: u64,
}

impl Station {
    /// Takes possession of the store, and goes on where it was. Notes are what a person should know.
    pub fn open(options: Options) -> Result<(Self, Vec<String>), FileFault> {
        let config = Config { file_max_mb: options.store_max_mb, ..Config::default() };
        let (vault, loaded) = Vault::open(&options.store, &config)?;
        let book = match vault.gpkg() {
            Some(gpkg) => read_book(&options.store, gpkg, &config, loaded.objects.is_empty())?,
            None => book::Book::default(),
        };
        let vehicle = |row: VehicleRow| Vehicle {
            number: row.number,
            peer: Peer::new(row.objects, row.blocks),
            wanted: blocks::missing(&book.blocks, row.number),
            counts: Counts::default(),
        };
        let vehicles = book.vehicles.iter().map(|(name, row)| (name.clone(), vehicle(row.clone()))).collect();
        let block_bytes = book.blocks.values().filter_map(|row| row.here).map(|(_, bytes)| u64::from(bytes)).sum();
        let station = Self {
            files: options.blocks.as_ref().map(|root| BlockFiles::new(root, options.blocks_max_bytes)),
            fleet: Fleet::restore(config.clone(), loaded.zone, loaded.next_id, book.sources),
            options,
            config,
            vault,
            vehicles,
            blocks: book.blocks,
            block_bytes,
            next_ask: 1,
            is_full: false,
            strangers: 0,
        };
        Ok((station, loaded.notes))
    }

    /// The merged objects.
    pub fn fleet(&self) -> &Fleet {
        &self.fleet
    }

    /// The file.
    pub fn path(&self) -> &Path {
        self.vault.path()
    }

    /// Makes the file a single one again.
    pub fn close(self) -> Result<(), FileFault> {
        self.vault.close()
    }

    /// A vehicle says that it is there, and how far its lists go.
    pub fn hear(&mut self, name: &str, news: &[u8], now: Timestamp) {
        let is_news = fleet_decode::<FleetNews>(news).is_ok();
        let Some(vehicle) = self.vehicle(name, is_news) else { return };
        vehicle.counts.bytes += news.len() as u64;
        if let Err(refusal) = vehicle.peer.tell(news, now) {
            vehicle.drop_for(refusal.as_str());
        }
    }

    /// What to ask of whom now.
    pub fn questions(&mut self, now: Timestamp) -> Vec<(VehicleName, Vec<u8>)> {
        let mut questions = Vec::new();
        // A vehicle that is away could not answer.
        for (name, vehicle) in self.vehicles.iter_mut().filter(|(_, v)| v.peer.is_near(now)) {
            let mut ask = |question: Option<Vec<u8>>| {
                self.next_ask += u64::from(question.is_some());
                questions.extend(question.map(|bytes| (name.clone(), bytes)));
                self.next_ask
            };
            let mut number = ask(None);
            if !self.is_full {
                number = ask(vehicle.peer.objects.question(number, now));
            }
            if self.files.is_some() {
                number = ask(vehicle.peer.blocks.question(number, now));
                ask(vehicle.file_question(number, now));
            }
        }
        questions
    }

    /// Takes an answer of a vehicle. A fault is one of the disk: nothing of the answer counts then, and the station is
    /// to be opened anew.
    pub fn take(&mut self, name: &str, answer: &[u8], now: Timestamp) -> Result<(), FileFault> {
        let Some(vehicle) = self.vehicle(name, false) else { return Ok(()) };
        vehicle.counts.bytes += answer.len() as u64;
        vehicle.peer.heard(now);
        let name = VehicleName::new(name).unwrap_or_else(|| unreachable!("it is in the list"));
        let outcome = match fleet_decode::<FleetPage>(answer) {
            Ok((page, items)) => match FleetList::from_wire(page.list) {
                FleetList::Objects => self.objects(&name, &page, items, now),
                FleetList::Blocks => self.block_list(&name, &page, items, now),
                FleetList::Unknown => Ok(Err(Refusal::Senseless)),
            },
            Err(FleetFault::Version | FleetFault::Length) => self.block_file(&name, answer, now),
            Err(fault) => Ok(Err(Refusal::Bytes(fault))),
        }?;
        if let (Err(refusal), Some(vehicle)) = (outcome, self.vehicles.get_mut(&name)) {
            vehicle.drop_for(refusal.as_str());
        }
        Ok(())
    }

    /// The vehicle of a name, which is new here only where it says something sensible; nothing where it is not listened
    /// to.
    fn vehicle(&mut self, name: &str, may_be_new: bool) -> Option<&mut Vehicle> {
        let allowed = |name: &VehicleName| self.options.vehicles.is_empty() || self.options.vehicles.contains(name);
        let Some(name) = VehicleName::new(name).filter(allowed) else {
            self.strangers += 1;
            return None;
        };
        if !self.vehicles.contains_key(&name) {
            if !may_be_new || self.vehicles.len() >= self.options.vehicles_max {
                self.strangers += 1;
                return None;
            }
            let number = self.vehicles.values().map(|v| v.number).max().unwrap_or(0) + 1;
            let peer = Peer::new(Cursor::default(), Cursor::default());
            let fresh = Vehicle { number, peer, wanted: BTreeMap::new(), counts: Counts::default() };
            self.vehicles.insert(name.clone(), fresh);
        }
        self.vehicles.get_mut(&name)
    }

    fn objects(&mut self, name: &VehicleName, page: &FleetPage, items: &[u8], now: Timestamp) -> Taken {
        let Some(vehicle) = self.vehicles.get_mut(name) else { return Ok(Err(Refusal::Unasked)) };
        let items = match fleet_items::<FleetObject>(items, page.count) {
            Ok(items) => items,
            Err(fault) => return Ok(Err(Refusal::Bytes(fault))),
        };
        let cursor = match vehicle.peer.objects.check(page, now) {
            Ok(cursor) => cursor,
            Err(refusal) => return Ok(Err(refusal)),
        };
        (vehicle.counts.pages, vehicle.counts.objects) =
            (vehicle.counts.pages + 1, vehicle.counts.objects + items.len() as u64);
        let before = vehicle.peer.objects.cursor();
        self.merge(name, page, &items, now);
        let Some(vehicle) = self.vehicles.get_mut(name) else { return Ok(Err(Refusal::Unasked)) };
        if cursor.listed && !(before.listed && before.epoch == cursor.epoch) {
            self.fleet.end_listing(vehicle.number, cursor.epoch);
        }
        vehicle.peer.objects.advance(cursor);
        let batch = self.fleet.take_batch();
        // Without a zone there is nothing to write yet, and nothing to lose.
        if let Some(zone) = self.fleet.zone()
            && (cursor != before || !batch.sources.is_empty())
        {
            let row = VehicleRow { number: vehicle.number, objects: cursor, blocks: vehicle.peer.blocks.cursor() };
            self.commit(zone, &batch, name, &row, &[])?;
        }
        Ok(Ok(()))
    }

    /// Takes the items of a page into the merged store, in memory.
    fn merge(&mut self, name: &VehicleName, page: &FleetPage, items: &[FleetObject], now: Timestamp) {
        let Some(vehicle) = self.vehicles.get_mut(name) else { return };
        let from = Zone::from_wire(page.zone, page.south);
        let to = from.map(|zone| self.fleet.settle_zone(zone));
        let reprojection = from.zip(to).filter(|(a, b)| a != b).and_then(|(a, b)| Reprojection::between(a, b));
        let mut room = OBJECTS_PER_VEHICLE_MAX.saturating_sub(self.fleet.count_of(vehicle.number).1);
        for item in items {
            let key = (vehicle.number, item.object.id);
            if item.object.reported != 1 {
                self.fleet.withdraw(key);
                continue;
            }
            let mut known = match source::parse(item, now, &self.config) {
                Ok(known) => known,
                Err(refusal) => {
                    vehicle.drop_for(word(refusal));
                    self.fleet.withdraw(key);
                    continue;
                }
            };
            if from != to || from.is_none() {
                let Some(place_m) = reprojection.as_ref().and_then(|r| r.apply(known.place_m)) else {
                    vehicle.drop_for("out of utm zone");
                    self.fleet.withdraw(key);
                    continue;
                };
                (known.place_m, known.noted_m) = (place_m, place_m);
            }
            if self.fleet.source(key).is_none() {
                if room == 0 {
                    vehicle.drop_for("too many objects");
                    continue;
                }
                room -= 1;
            }
            self.fleet.take(key, page.epoch, known);
        }
    }

    /// Everything that an answer brought, in one transaction.
    fn commit(
        &mut self,
        zone: Zone,
        batch: &Batch,
        name: &VehicleName,
        row: &VehicleRow,
        blocks: &[(BlockPlace, BlockRow)],
    ) -> Result<(), FileFault> {
        let also = |gpkg: &geopackage::GeoPackage| {
            book::create(gpkg)?;
            let connection = gpkg.connection();
            book::write_vehicle(connection, name, row)?;
            book::write_sources(connection, name, &batch.sources)?;
            blocks.iter().try_for_each(|(place, block)| book::write_block(connection, row.number, *place, block))?;
            Ok(())
        };
        let room = self.vault.commit_with(zone, &batch.changes, &also)?;
        self.is_full = room == Room::Little;
        Ok(())
    }
}

/// A fault of the disk; or whether the answer was believed.
type Taken = Result<Result<(), Refusal>, FileFault>;

impl Vehicle {
    fn drop_for(&mut self, cause: &'static str) {
        *self.counts.dropped.entry(cause).or_default() += 1;
    }
}

fn read_book(
    path: &Path,
    gpkg: &geopackage::GeoPackage,
    config: &Config,
    is_empty: bool,
) -> Result<book::Book, FileFault> {
    let failed = |e: rusqlite::Error| FileFault::of_sqlite(path, &e);
    match book::exists(gpkg.connection()).map_err(failed)? {
        true => book::read(gpkg.connection(), config).map_err(failed),
        false if is_empty => Ok(book::Book::default()),
        false => {
            let seen = "it is a vehicle's own store, not a station's; give the station a file of its own".into();
            Err(FileFault::Other { path: path.into(), seen })
        }
    }
}

/// The cause for counters.
fn word(refusal: ObjectRefusal) -> &'static str {
    match refusal {
        ObjectRefusal::NotFinite => "not finite",
        ObjectRefusal::OffMap | ObjectRefusal::FarAway => "off the map",
        ObjectRefusal::Unsure => "senseless deviation",
        ObjectRefusal::AbsurdSize => "absurd size",
        ObjectRefusal::UnknownClass => "unknown class",
    }
}
