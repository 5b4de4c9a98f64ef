//! What a station writes beside its objects, in the same transaction: what each vehicle says (`sources`), how far its
//! lists were read (`vehicles`), and which blocks it has (`blocks`).
//!
//! Attribute tables of the GeoPackage, so that QGIS shows them and joins `sources` by `object_id`: which vehicle saw
//! what, and where. SQLite's integers are signed; epochs keep their bits.

use super::merge::{Source, SourceKey};
use super::peer::Cursor;
use super::source::establish;
use crate::config::Config;
use crate::object::{Estimate, Known};
use crate::persist::id_of;
use geopackage::core::types::ColumnType;
use geopackage::{ColumnSpec, GeoPackage, TableSchemaBuilder};
use rusqlite::{Connection, OptionalExtension, Row, params};
use std::collections::BTreeMap;
use tsense_contract::{BlockPlace, Class, VehicleName};
use tsense_geometry::Timestamp;

/// A vehicle in the book.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleRow {
    /// Its number here.
    pub number: u32,
    /// How far its objects were read.
    pub objects: Cursor,
    /// How far its blocks were read.
    pub blocks: Cursor,
}

/// A block of a vehicle: what its list says, and what lies on disk here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockRow {
    /// Checksum of the newest file that the vehicle has.
    pub crc: u32,
    /// Its bytes.
    pub bytes: u32,
    /// Checksum and bytes of the file that lies here.
    pub here: Option<(u32, u32)>,
}

/// Everything in the book.
#[derive(Clone, Debug, Default)]
pub struct Book {
    /// By name.
    pub vehicles: BTreeMap<VehicleName, VehicleRow>,
    /// What each of them says.
    pub sources: Vec<(SourceKey, Source)>,
    /// By number of the vehicle and place.
    pub blocks: BTreeMap<(u32, BlockPlace), BlockRow>,
}

/// Makes the tables where there are none.
pub fn create(gpkg: &GeoPackage) -> geopackage::Result<()> {
    if exists(gpkg.connection())? {
        return Ok(());
    }
    let integer = |name: &str| ColumnSpec::new(name, ColumnType::Integer);
    let number = |name: &str| ColumnSpec::new(name, ColumnType::Double);
    let text = |name: &str| ColumnSpec::new(name, ColumnType::Text(None));
    let table = |name: &str, description: &str| {
        TableSchemaBuilder::new(name).primary_key("id").identifier(name).description(description)
    };
    let columns = |table: TableSchemaBuilder, columns: Vec<ColumnSpec>| {
        columns.into_iter().fold(table, TableSchemaBuilder::column)
    };
    let of = |cursor: &str| ["epoch", "after", "listed"].map(|fact| integer(&format!("{cursor}_{fact}")));
    let vehicles = table("vehicles", "Vehicles that report to this station, and how far their lists were read");
    let facts = [vec![text("vehicle").not_null().unique()], of("objects").into(), of("blocks").into()];
    gpkg.create_attributes_table(&columns(vehicles, facts.concat()))?;
    let sources = table("sources", "Which vehicle saw which object, and where");
    let facts = ["vehicle_id", "vehicle_object_id", "object_id", "present", "epoch"].map(integer);
    let words = [text("vehicle"), text("class")];
    let measured =
        ["easting_m", "northing_m", "position_std_m", "ground_m", "dbh_m", "dbh_std_m", "height_m", "confidence"];
    let counted = ["sightings", "first_seen_ns", "last_seen_ns", "confidence_at_ns"];
    let all = [facts.into(), words.into(), measured.map(number).into(), counted.map(integer).to_vec()].concat();
    gpkg.create_attributes_table(&columns(sources, all))?;
    let blocks = table("blocks", "Blocks of the vehicles' maps: what they have, and what lies here");
    let facts = ["vehicle_id", "zone", "south", "x", "y", "z", "crc", "bytes", "here_crc", "here_bytes"].map(integer);
    gpkg.create_attributes_table(&columns(blocks, [facts.into(), vec![number("voxel_size_m")]].concat()))?;
    gpkg.connection().execute_batch(
        "CREATE UNIQUE INDEX sources_by_vehicle ON sources (vehicle_id, vehicle_object_id);
         CREATE INDEX sources_by_object ON sources (object_id);
         CREATE UNIQUE INDEX blocks_by_place ON blocks (vehicle_id, zone, south, voxel_size_m, x, y, z);",
    )?;
    Ok(())
}

/// Whether the file is a station's.
pub fn exists(connection: &Connection) -> rusqlite::Result<bool> {
    let found =
        connection.query_row("SELECT 1 FROM sqlite_master WHERE name = 'sources'", [], |_| Ok(())).optional()?;
    Ok(found.is_some())
}

/// Reads everything; rows that make no sense are left out, so that the vehicle's next listing brings them anew.
pub fn read(connection: &Connection, config: &Config) -> rusqlite::Result<Book> {
    let mut book = Book::default();
    let mut statement = connection.prepare("SELECT * FROM vehicles")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let row_of =
            VehicleRow { number: row.get("id")?, objects: cursor(row, "objects")?, blocks: cursor(row, "blocks")? };
        if let Some(name) = VehicleName::new(&row.get::<_, String>("vehicle")?) {
            book.vehicles.insert(name, row_of);
        }
    }
    let mut statement = connection.prepare("SELECT * FROM sources")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        book.sources.extend(source(row, config));
    }
    let mut statement = connection.prepare("SELECT * FROM blocks")?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let key = [row.get("x")?, row.get("y")?, row.get("z")?];
        let place = (row.get("zone")?, row.get("south")?, row.get::<_, f64>("voxel_size_m")?.to_bits(), key);
        let here: (Option<u32>, Option<u32>) = (row.get("here_crc")?, row.get("here_bytes")?);
        let block = BlockRow { crc: row.get("crc")?, bytes: row.get("bytes")?, here: here.0.zip(here.1) };
        book.blocks.insert((row.get("vehicle_id")?, place), block);
    }
    Ok(book)
}

fn cursor(row: &Row<'_>, list: &str) -> rusqlite::Result<Cursor> {
    let number = |fact: &str| row.get::<_, Option<i64>>(format!("{list}_{fact}").as_str()).map(|n| n.unwrap_or(0));
    Ok(Cursor { epoch: number("epoch")? as u64, after: number("after")? as u64, listed: number("listed")? == 1 })
}

fn source(row: &Row<'_>, config: &Config) -> Option<(SourceKey, Source)> {
    let integer = |name: &str| row.get::<_, i64>(name).ok();
    let number = |name: &str| row.get::<_, Option<f64>>(name).ok().flatten().filter(|x| x.is_finite());
    let instant = |name: &str| integer(name).map(Timestamp::from_ns);
    let id = u64::try_from(integer("vehicle_object_id")?).ok()?;
    let class: String = row.get("class").ok()?;
    let place_m = [number("easting_m")?, number("northing_m")?];
    let mut known = Known {
        id,
        class: *Class::ALL.iter().find(|c| **c != Class::Unknown && c.as_str() == class)?,
        first_seen: instant("first_seen_ns")?,
        last_seen: instant("last_seen_ns")?,
        weighed: instant("confidence_at_ns")?,
        confidence: number("confidence")?,
        sightings: u32::try_from(integer("sightings")?).ok()?,
        independent: 0,
        independent_at: Timestamp::default(),
        place_m,
        ground_m: number("ground_m")?,
        position_std_m: number("position_std_m").filter(|std| *std > 0.0)?,
        dbh: number("dbh_m").zip(number("dbh_std_m")).map(|(value, std)| Estimate { value, std }),
        height_m: number("height_m"),
        companions: Vec::new(),
        reported: true,
        noted_m: place_m,
    };
    establish(&mut known, config);
    let object = u64::try_from(integer("object_id")?).ok()?;
    let vehicle = u32::try_from(integer("vehicle_id")?).ok()?;
    let (epoch, present) = (integer("epoch")? as u64, integer("present")? == 1);
    Some(((vehicle, id), Source { object, epoch, present, known }))
}

/// Writes how far a vehicle's lists were read.
pub fn write_vehicle(connection: &Connection, name: &VehicleName, row: &VehicleRow) -> rusqlite::Result<()> {
    let sql = "INSERT INTO vehicles (id, vehicle, objects_epoch, objects_after, objects_listed, blocks_epoch, \
               blocks_after, blocks_listed) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8) ON CONFLICT (id) DO UPDATE SET \
               objects_epoch = ?3, objects_after = ?4, objects_listed = ?5, blocks_epoch = ?6, blocks_after = ?7, \
               blocks_listed = ?8";
    let (o, b) = (row.objects, row.blocks);
    connection.prepare_cached(sql)?.execute(params![
        row.number,
        name.as_str(),
        o.epoch as i64,
        o.after as i64,
        o.listed,
        b.epoch as i64,
        b.after as i64,
        b.listed
    ])?;
    Ok(())
}

/// Takes away every row of a vehicle.
pub fn forget(connection: &Connection, number: u32) -> rusqlite::Result<()> {
    for sql in [
        "DELETE FROM sources WHERE vehicle_id = ?1",
        "DELETE FROM blocks WHERE vehicle_id = ?1",
        "DELETE FROM vehicles WHERE id = ?1",
    ] {
        connection.execute(sql, [number])?;
    }
    Ok(())
}

/// Writes what a vehicle says of its objects.
pub fn write_sources(
    connection: &Connection,
    vehicle: &VehicleName,
    sources: &[(SourceKey, Source)],
) -> rusqlite::Result<()> {
    let sql = "INSERT INTO sources (vehicle_id, vehicle_object_id, object_id, present, epoch, vehicle, class, easting_m, \
               northing_m, position_std_m, ground_m, dbh_m, dbh_std_m, height_m, confidence, sightings, first_seen_ns, \
               last_seen_ns, confidence_at_ns) \
               VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, ?18, ?19) \
               ON CONFLICT (vehicle_id, vehicle_object_id) DO UPDATE SET object_id = ?3, present = ?4, epoch = ?5, \
               class = ?7, easting_m = ?8, northing_m = ?9, position_std_m = ?10, ground_m = ?11, dbh_m = ?12, \
               dbh_std_m = ?13, height_m = ?14, confidence = ?15, sightings = ?16, first_seen_ns = ?17, \
               last_seen_ns = ?18, confidence_at_ns = ?19";
    let mut statement = connection.prepare_cached(sql)?;
    for ((number, id), source) in sources {
        let k = &source.known;
        statement.execute(params![
            number,
            id_of(*id),
            id_of(source.object),
            source.present,
            source.epoch as i64,
            vehicle.as_str(),
            k.class.as_str(),
            k.place_m[0],
            k.place_m[1],
            k.position_std_m,
            k.ground_m,
            k.dbh.map(|d| d.value),
            k.dbh.map(|d| d.std),
            k.height_m,
            k.confidence,
            k.sightings,
            k.first_seen.ns,
            k.last_seen.ns,
            k.weighed.ns
        ])?;
    }
    Ok(())
}

/// Writes which block a vehicle has, and which lies here.
pub fn write_block(
    connection: &Connection,
    number: u32,
    (zone, south, voxel_size, key): BlockPlace,
    row: &BlockRow,
) -> rusqlite::Result<()> {
    let sql = "INSERT INTO blocks (vehicle_id, zone, south, voxel_size_m, x, y, z, crc, bytes, here_crc, here_bytes) \
               VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11) \
               ON CONFLICT (vehicle_id, zone, south, voxel_size_m, x, y, z) DO UPDATE SET crc = ?8, bytes = ?9, \
               here_crc = ?10, here_bytes = ?11";
    let (crc, bytes) = (row.here.map(|h| h.0), row.here.map(|h| h.1));
    connection.prepare_cached(sql)?.execute(params![
        number,
        zone,
        south,
        f64::from_bits(voxel_size),
        key[0],
        key[1],
        key[2],
        row.crc,
        row.bytes,
        crc,
        bytes
    ])?;
    Ok(())
}
