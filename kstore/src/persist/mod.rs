//! The store on disk: a GeoPackage that survives being killed at any instant, and that QGIS opens.
//!
//! In: [`Changes`] of the store, committed as one transaction each (WAL, `synchronous = FULL`: what was committed is
//! on the disk). Out: the store as it was. A damaged file is set aside under another name, never deleted. Ids go on
//! even then: a small file beside the store keeps a bound on the ids that were given.
//! Files: `objects.gpkg` (with `-wal` and `-shm` while it is open), `objects.gpkg.lock`, `objects.gpkg.ids`.
#![allow(clippy::disallowed_methods, reason = "shell: this module owns the store's files")]

mod fault;
mod files;
mod history;
mod layout;
mod row_id;
mod style;

pub use fault::FileFault;
pub use history::Entry;

use crate::config::Config;
use crate::object::Known;
use crate::records::Changes;
use crate::store::KnowledgeStore;
use crate::zone::Zone;
use files::Files;
use geopackage::{GeoPackage, OpenOptions, Synchronous};
pub(crate) use row_id::id_of;
use rusqlite::Connection;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How long a commit waits for another program (QGIS saving an edit) before it is tried again later.
const BUSY_TIMEOUT: Duration = Duration::from_millis(500);
/// Ids are reserved by this many, so that the file of ids is written rarely.
const IDS_RESERVED: u64 = 1000;
/// Share of the largest file that is used before something is forgotten: a batch of changes fits into the rest.
const FULL_SHARE: f64 = 0.9;
/// The write-ahead log is cut back to this after a checkpoint, bytes: some seconds of changes.
const WAL_BYTES: u32 = 16 << 20;

/// What else is written in a transaction.
pub(crate) type Also<'a> = &'a dyn Fn(&GeoPackage) -> geopackage::Result<()>;

/// What was found on disk.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loaded {
    /// The zone of the positions; nothing in a new store.
    pub zone: Option<Zone>,
    /// The next id to be given.
    pub next_id: u64,
    /// The objects.
    pub objects: Vec<Known>,
    /// What a person should know: a file that was set aside, rows that were left out.
    pub notes: Vec<String>,
}

impl Loaded {
    /// The store that goes on from here.
    pub fn into_store(self, config: Config) -> KnowledgeStore {
        KnowledgeStore::restore(config, self.zone, self.next_id, self.objects)
    }
}

/// The store's file, open for writing by this process alone.
pub struct Vault {
    files: Files,
    gpkg: Option<GeoPackage>,
    /// Zone of the open file.
    zone: Option<Zone>,
    /// Ids below this may have been given, by the file of ids.
    ids_below: u64,
    config: Config,
}

/// How much room a file has after a commit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Room {
    /// Enough.
    Enough,
    /// Its largest size is near, and its history is cut already: objects must go.
    Little,
}

impl Vault {
    /// Takes possession of the store at `path` and loads it. A damaged file is set aside and said so in the notes.
    /// A fault is one that a person must mend.
    pub fn open(path: &Path, config: &Config) -> Result<(Self, Loaded), FileFault> {
        let files = Files::lock(path)?;
        let ids_below = ids_below(path);
        let mut vault = Self { files, gpkg: None, zone: None, ids_below, config: config.clone() };
        let mut loaded = match vault.load() {
            Ok(loaded) => loaded,
            Err(fault) if fault.is_damage() => vault.set_aside(&fault)?,
            Err(fault) => return Err(fault),
        };
        loaded.next_id = loaded.next_id.max(vault.ids_below).max(1);
        Ok((vault, loaded))
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.files.path
    }

    /// The open file, once there is one.
    pub(crate) fn gpkg(&self) -> Option<&GeoPackage> {
        self.gpkg.as_ref()
    }

    fn load(&mut self) -> Result<Loaded, FileFault> {
        self.files.remove_unfinished();
        if !self.files.path.exists() {
            return Ok(Loaded::default());
        }
        // Looked at as it is, before the journal mode is written into its head: a damaged file stays as it was found.
        let options = OpenOptions::new().busy_timeout(BUSY_TIMEOUT);
        let found = options.open(&self.files.path).map_err(|e| FileFault::of_geopackage(&self.files.path, &e))?;
        let loaded = read(&found, &self.files.path)?;
        drop(found);
        (self.zone, self.gpkg) = (loaded.zone, Some(open_for_writing(&self.files.path, &self.config)?));
        Ok(loaded)
    }

    fn set_aside(&mut self, fault: &FileFault) -> Result<Loaded, FileFault> {
        let to = self.files.set_aside()?;
        let note = format!("{fault}; it was set aside as {} and the store starts empty", to.display());
        Ok(Loaded { notes: vec![note], ..Loaded::default() })
    }

    /// Writes changes down; when this returns they survive a loss of power. Changes of another zone than the file's are
    /// taken for the whole store, as [`KnowledgeStore::take_changes`] gives it when the zone changed.
    pub fn commit(&mut self, zone: Zone, changes: &Changes) -> Result<Room, FileFault> {
        self.commit_with(zone, changes, &|_| Ok(()))
    }

    /// The same, with something else in the same transaction.
    pub(crate) fn commit_with(&mut self, zone: Zone, changes: &Changes, also: Also<'_>) -> Result<Room, FileFault> {
        self.reserve_ids(changes.next_id)?;
        self.make(zone)?;
        let seen = || "the file vanished while it was opened".into();
        let gpkg =
            self.gpkg.as_ref().ok_or_else(|| FileFault::Other { path: self.files.path.clone(), seen: seen() })?;
        let moves = self.zone.is_some_and(|old| old != zone);
        let written = write(gpkg, changes, &self.config, moves.then_some(zone), also);
        let outcome = written.map(|()| make_room(gpkg).unwrap_or(Room::Enough));
        if outcome.is_err() && !gpkg.connection().is_autocommit() {
            // Some failures end the transaction by themselves, some do not.
            let _ = gpkg.connection().execute_batch("ROLLBACK");
        }
        let room = outcome.map_err(|e| FileFault::of_geopackage(&self.files.path, &e))?;
        self.zone = Some(zone);
        Ok(room)
    }

    /// Lets the file grow to this many pages and no farther: what a full disk is to SQLite, for tests.
    pub fn limit_pages(&self, pages: u32) {
        if let Some(gpkg) = &self.gpkg {
            let _ = gpkg.connection().query_row(&format!("PRAGMA max_page_count = {pages}"), [], |_| Ok(()));
        }
    }

    /// Makes the file a single one again, without its write-ahead log, unless somebody still reads it: then the last
    /// reader does that.
    pub fn close(mut self) -> Result<(), FileFault> {
        let Some(gpkg) = self.gpkg.take() else { return Ok(()) };
        let failed = |e: rusqlite::Error| FileFault::of_sqlite(&self.files.path, &e);
        let connection = gpkg.connection();
        let blocked: bool =
            connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |r| r.get(0)).map_err(failed)?;
        if !blocked {
            // Fails where somebody has it open; the file stays in its present mode then, and whole.
            let _ = connection.query_row("PRAGMA journal_mode = DELETE", [], |_| Ok(()));
        }
        gpkg.close().map_err(|e| FileFault::of_geopackage(&self.files.path, &e))
    }

    /// Ids up to `next_id` are about to be told: remember it outside of the database, which might be damaged later.
    fn reserve_ids(&mut self, next_id: u64) -> Result<(), FileFault> {
        if next_id > self.ids_below {
            let below = next_id.saturating_add(IDS_RESERVED);
            self.files.write_ids_below(below)?;
            self.ids_below = below;
        }
        Ok(())
    }

    /// Makes the file where there is none: under another name, renamed when it is whole. Opens it.
    fn make(&mut self, zone: Zone) -> Result<(), FileFault> {
        if self.gpkg.is_none() {
            if !self.files.path.exists() {
                self.files.create(|path| create(path, zone))?;
            }
            self.gpkg = Some(open_for_writing(&self.files.path, &self.config)?);
        }
        Ok(())
    }
}

/// Reads a store without possessing it, also while a graph writes to it.
pub fn read_only(path: &Path) -> Result<Loaded, FileFault> {
    reading(path, |gpkg| read(gpkg, path))
}

/// What became of one object, oldest first, as it is on disk.
pub fn history_of(path: &Path, id: u64) -> Result<Vec<Entry>, FileFault> {
    reading(path, |gpkg| {
        check_layout(gpkg.connection(), path)?;
        history::read(gpkg.connection(), id).map_err(|e| FileFault::of_sqlite(path, &e))
    })
}

/// Opens a store for reading. Where nothing can be written SQLite cannot read a log that was left behind, so a copy is
/// read there.
fn reading<T>(path: &Path, read: impl Fn(&GeoPackage) -> Result<T, FileFault>) -> Result<T, FileFault> {
    let open = |at: &Path| {
        let options = OpenOptions::new().busy_timeout(BUSY_TIMEOUT);
        options.open_read_only(at).map_err(|e| FileFault::of_geopackage(path, &e)).and_then(|gpkg| read(&gpkg))
    };
    match open(path) {
        Err(FileFault::NotWritable { .. }) if path.exists() => open(&files::Copy::of(path)?.file),
        outcome => outcome,
    }
}

/// A bound on the ids that a store at this path may have given; 1 where nothing is known.
pub fn ids_below(path: &Path) -> u64 {
    files::ids_below(path)
}

/// The write-ahead log is chosen here and not by the GeoPackage library, which removes the log when it closes the file
/// without asking whether a reader kept it from being written back.
fn open_for_writing(path: &Path, config: &Config) -> Result<GeoPackage, FileFault> {
    let options = OpenOptions::new().synchronous(Synchronous::Full).busy_timeout(BUSY_TIMEOUT);
    let gpkg = options.open(path).map_err(|e| FileFault::of_geopackage(path, &e))?;
    layout::upgrade(&gpkg).map_err(|e| FileFault::of_geopackage(path, &e))?;
    set_up(gpkg.connection(), config).map_err(|e| FileFault::of_sqlite(path, &e))?;
    Ok(gpkg)
}

fn set_up(connection: &Connection, config: &Config) -> rusqlite::Result<()> {
    connection.set_prepared_statement_cache_capacity(32);
    connection.query_row("PRAGMA journal_mode = WAL", [], |_| Ok(()))?;
    connection.pragma_update(None, "journal_size_limit", WAL_BYTES)?;
    let page_bytes = pragma(connection, "page_size")?.max(1);
    let pages = i64::from(config.file_max_mb) * 1_000_000 / page_bytes;
    connection.query_row(&format!("PRAGMA max_page_count = {pages}"), [], |_| Ok(()))
}

/// A number that SQLite knows of the file.
fn pragma(connection: &Connection, name: &str) -> rusqlite::Result<i64> {
    connection.query_row(&format!("PRAGMA {name}"), [], |row| row.get(0))
}

/// Near the largest size of the file the older half of the history goes; where that is not enough, objects must.
fn make_room(gpkg: &GeoPackage) -> rusqlite::Result<Room> {
    let connection = gpkg.connection();
    let is_full = || -> rusqlite::Result<bool> {
        let used = pragma(connection, "page_count")? - pragma(connection, "freelist_count")?;
        Ok(used as f64 > FULL_SHARE * pragma(connection, "max_page_count")? as f64)
    };
    if !is_full()? {
        return Ok(Room::Enough);
    }
    history::keep_newest(connection, history::span(connection)? / 2)?;
    Ok(if is_full()? { Room::Little } else { Room::Enough })
}

fn create(path: &Path, zone: Zone) -> Result<(), FileFault> {
    let failed = |e: geopackage::Error| FileFault::of_geopackage(path, &e);
    let gpkg = OpenOptions::new().synchronous(Synchronous::Full).create(path).map_err(failed)?;
    layout::create(&gpkg, zone.epsg()).map_err(failed)?;
    gpkg.close().map_err(failed)
}

fn read(gpkg: &GeoPackage, path: &Path) -> Result<Loaded, FileFault> {
    let failed = |e: rusqlite::Error| FileFault::of_sqlite(path, &e);
    let damaged = |seen: String| FileFault::Damaged { path: path.to_path_buf(), seen };
    let connection = gpkg.connection();
    check_layout(connection, path)?;
    let checked: String = connection.query_row("PRAGMA quick_check(1)", [], |row| row.get(0)).map_err(failed)?;
    if checked != "ok" {
        return Err(damaged(checked));
    }
    let epsg = layout::epsg(connection).map_err(failed)?;
    let zone = Zone::from_epsg(epsg).ok_or_else(|| damaged(format!("EPSG:{epsg} is no UTM zone")))?;
    let (objects, senseless) = layout::read_objects(connection).map_err(failed)?;
    let next_id = layout::fact(connection, "next_id").map_err(failed)?.and_then(|id| id.parse().ok()).unwrap_or(1);
    let last_id = objects.last().map_or(0, |o| o.id);
    let notes = match senseless {
        0 => Vec::new(),
        n => vec![format!("{}: {n} objects make no sense and were left out", path.display())],
    };
    Ok(Loaded { zone: Some(zone), next_id: next_id.max(last_id.saturating_add(1)), objects, notes })
}

fn check_layout(connection: &Connection, path: &Path) -> Result<(), FileFault> {
    let found = layout::fact(connection, "layout").map_err(|e| FileFault::of_sqlite(path, &e))?;
    let path = path.to_path_buf();
    match found.as_deref().map(str::parse::<u32>) {
        Some(Ok(version)) if version <= layout::LAYOUT => Ok(()),
        Some(Ok(version)) => Err(FileFault::TooNew { path, found: version.to_string(), known: layout::LAYOUT }),
        other => Err(FileFault::Damaged { path, seen: format!("the version of its layout is {other:?}") }),
    }
}

/// All changes in one transaction. Where the store moves to another zone, they are all of its objects.
fn write(
    gpkg: &GeoPackage,
    changes: &Changes,
    config: &Config,
    moves_to: Option<Zone>,
    also: Also<'_>,
) -> geopackage::Result<()> {
    let transaction = gpkg.connection().unchecked_transaction()?;
    if let Some(zone) = moves_to {
        layout::move_to(gpkg, zone.epsg())?;
    }
    let layer = gpkg.layer(layout::OBJECTS)?;
    let mut writer = layer.writer()?;
    for known in &changes.changed {
        let (id, texts) = (id_of(known.id), layout::RowTexts::of(known));
        let (wkb, values) = (layout::point_wkb(known.place_m), texts.values(known));
        if !writer.update_wkb(id, &wkb, &values)? {
            writer.insert_wkb(Some(id), &wkb, &values)?;
        }
    }
    for id in &changes.removed {
        writer.delete(id_of(*id))?;
    }
    writer.commit()?; // Joins the transaction above: nothing is committed yet.
    history::write(gpkg.connection(), &changes.events, config)?;
    layout::set_fact(gpkg.connection(), "next_id", &changes.next_id.to_string())?;
    also(gpkg)?;
    transaction.commit()?;
    Ok(())
}

/// Where the store's file lies, given the graph's state folder.
pub fn path_in(state_dir: &Path, config: &Config) -> PathBuf {
    state_dir.join(&config.file)
}
