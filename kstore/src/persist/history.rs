//! The table `history`: what became of each object, newest last, bounded for each object and in all.
//!
//! An attribute table of the GeoPackage, so that QGIS shows it and joins it by `object_id`. Places are in the zone of
//! their own row (`epsg`): an object's history may cross a zone border. Rows of objects that are gone stay until the
//! bound of the whole table reaches them.

use super::row_id::id_of;
use crate::config::Config;
use crate::history::Event;
use crate::zone::Zone;
use geopackage::core::types::ColumnType;
use geopackage::{ColumnSpec, GeoPackage, TableSchemaBuilder};
use rusqlite::{Connection, OptionalExtension, Row, params};
use std::collections::BTreeSet;
use tsense_geometry::Timestamp;

/// One row of the history.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// When.
    pub stamp: Timestamp,
    /// Why, in a few words.
    pub reason: String,
    /// The other object, where there is one.
    pub other: Option<u64>,
    /// EPSG code of the place's zone, 0 where it is not known.
    pub epsg: i32,
    /// Where the object was afterwards, metres.
    pub place_m: [f64; 2],
    /// What was believed of it afterwards.
    pub confidence: f64,
    /// How often it had been seen.
    pub sightings: u32,
}

/// Makes the table.
pub fn create(gpkg: &GeoPackage) -> geopackage::Result<()> {
    let integer = |name: &str| ColumnSpec::new(name, ColumnType::Integer);
    let number = |name: &str| ColumnSpec::new(name, ColumnType::Double);
    let table = TableSchemaBuilder::new("history")
        .primary_key("id")
        .identifier("History")
        .description("What became of each object, and why")
        .column(integer("object_id").not_null())
        .column(integer("stamp_ns").not_null())
        .column(ColumnSpec::new("reason", ColumnType::Text(None)).not_null())
        .column(integer("other_id"))
        .column(integer("epsg"))
        .column(number("easting_m"))
        .column(number("northing_m"))
        .column(number("confidence"))
        .column(integer("sightings"));
    gpkg.create_attributes_table(&table)?;
    gpkg.connection().execute("CREATE INDEX history_by_object ON history (object_id, id)", [])?;
    Ok(())
}

/// Adds events and forgets what is beyond the bounds.
pub fn write(connection: &Connection, events: &[Event], config: &Config) -> rusqlite::Result<()> {
    let sql = "INSERT INTO history (object_id, stamp_ns, reason, other_id, epsg, easting_m, northing_m, confidence, \
               sightings) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)";
    let mut insert = connection.prepare_cached(sql)?;
    for e in events {
        let (id, other) = (id_of(e.id), e.reason.other().map(id_of));
        let (epsg, [east, north]) = (e.zone.map(Zone::epsg), e.place_m);
        insert.execute(params![
            id,
            e.stamp.ns,
            e.reason.as_str(),
            other,
            epsg,
            east,
            north,
            e.confidence,
            e.sightings
        ])?;
    }
    let sql = "DELETE FROM history WHERE object_id = ?1 AND id <= \
               (SELECT id FROM history WHERE object_id = ?1 ORDER BY id DESC LIMIT 1 OFFSET ?2)";
    let mut trim = connection.prepare_cached(sql)?;
    for id in events.iter().map(|e| e.id).collect::<BTreeSet<_>>() {
        trim.execute(params![id_of(id), config.history_per_object_max])?;
    }
    if events.is_empty() { Ok(()) } else { keep_newest(connection, config.history_max) }
}

/// Forgets the oldest rows of the whole table.
pub fn keep_newest(connection: &Connection, rows: u32) -> rusqlite::Result<()> {
    let sql = "DELETE FROM history WHERE id <= (SELECT max(id) FROM history) - ?1";
    connection.prepare_cached(sql)?.execute([rows]).map(drop)
}

/// Rows that the bound of the whole table counts: the newest id less the oldest one.
pub fn span(connection: &Connection) -> rusqlite::Result<u32> {
    connection.query_row("SELECT coalesce(max(id) - min(id) + 1, 0) FROM history", [], |row| row.get(0))
}

/// What is known of one object, oldest first; nothing in a file from before there was a history.
pub fn read(connection: &Connection, id: u64) -> rusqlite::Result<Vec<Entry>> {
    let table =
        connection.query_row("SELECT 1 FROM sqlite_master WHERE name = 'history'", [], |_| Ok(())).optional()?;
    if table.is_none() {
        return Ok(Vec::new());
    }
    let sql = "SELECT stamp_ns, reason, other_id, epsg, easting_m, northing_m, confidence, sightings FROM history \
               WHERE object_id = ?1 ORDER BY id";
    connection.prepare(sql)?.query_map([id_of(id)], entry)?.collect()
}

fn entry(row: &Row<'_>) -> rusqlite::Result<Entry> {
    let number = |i: usize| row.get::<_, Option<f64>>(i).map(|x| x.unwrap_or(f64::NAN));
    Ok(Entry {
        stamp: Timestamp::from_ns(row.get(0)?),
        reason: row.get(1)?,
        other: row.get::<_, Option<i64>>(2)?.and_then(|id| u64::try_from(id).ok()),
        epsg: row.get::<_, Option<i32>>(3)?.unwrap_or(0),
        place_m: [number(4)?, number(5)?],
        confidence: number(6)?,
        sightings: row.get::<_, Option<u32>>(7)?.unwrap_or(0),
    })
}
