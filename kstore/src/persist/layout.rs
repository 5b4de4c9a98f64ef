//! How objects lie in the file: a GeoPackage with one layer `objects` and one table `kstore` of facts.
//!
//! Layer `objects`: a point a row in the store's UTM zone (EPSG 326xx, 327xx), primary key = the object's id, an
//! R-tree; QGIS opens it. Instants are nanoseconds since the epoch. NULL is "not measured".
//! Table `history`: what became of each object. Table `layer_styles`: how QGIS draws the layer.
//! Table `kstore`: `key`, `value` as text: `layout` (the version of this layout), `next_id`.
//! `user_version` belongs to the GeoPackage standard (10400), so the layout's version is a fact of its own.

use super::{history, style};
use crate::object::{Estimate, Known};
use geopackage::core::types::{ColumnType, GeometryType};
use geopackage::{ColumnSpec, GeoPackage, GeometrySpec, TableSchemaBuilder, ValueRef};
use rusqlite::{Connection, OptionalExtension, Row};
use tsense_contract::Class;
use tsense_geometry::Timestamp;

/// The layer of objects.
pub const OBJECTS: &str = "objects";
/// The table of facts about the store.
const FACTS: &str = "kstore";
/// Version of this layout. A store of a higher one is refused.
pub const LAYOUT: u32 = 2;

/// The columns beside id and geometry, in the order values are written.
const COLUMNS: [(&str, ColumnType); 16] = [
    ("class", ColumnType::Text(None)),
    ("reported", ColumnType::Boolean),
    ("confidence", ColumnType::Double),
    ("sightings", ColumnType::Integer),
    ("independent_sightings", ColumnType::Integer),
    ("ground_m", ColumnType::Double),
    ("height_m", ColumnType::Double),
    ("dbh_m", ColumnType::Double),
    ("dbh_std_m", ColumnType::Double),
    ("position_std_m", ColumnType::Double),
    ("first_seen_ns", ColumnType::Integer),
    ("last_seen_ns", ColumnType::Integer),
    ("confidence_at_ns", ColumnType::Integer),
    ("independent_at_ns", ColumnType::Integer),
    // Ids of the objects that were seen beside this one, with blanks between them.
    ("beside", ColumnType::Text(None)),
    // For people: the class and the id.
    ("label", ColumnType::Text(None)),
];

/// Makes the tables of a new file.
pub fn create(gpkg: &GeoPackage, epsg: i32) -> geopackage::Result<()> {
    gpkg.add_epsg_srs(epsg)?;
    let layer = TableSchemaBuilder::new(OBJECTS)
        .primary_key("id")
        .identifier("Objects")
        .description("What the knowledge store of the Terrain Smart Sensor believes")
        .geometry(GeometrySpec::new(GeometryType::Point, epsg));
    let layer = COLUMNS.into_iter().fold(layer, |layer, (name, kind)| layer.column(ColumnSpec::new(name, kind)));
    gpkg.create_layer(&layer)?;
    let facts = TableSchemaBuilder::new(FACTS)
        .column(ColumnSpec::new("key", ColumnType::Text(None)).not_null().unique())
        .column(ColumnSpec::new("value", ColumnType::Text(None)).not_null());
    gpkg.create_attributes_table(&facts)?;
    complete(gpkg)
}

/// Makes what layout 1 did not have.
fn complete(gpkg: &GeoPackage) -> geopackage::Result<()> {
    history::create(gpkg)?;
    style::create(gpkg, OBJECTS)?;
    set_fact(gpkg.connection(), "layout", &LAYOUT.to_string())?;
    Ok(())
}

/// Brings a file of an older layout up to this one, whole or not at all.
pub fn upgrade(gpkg: &GeoPackage) -> geopackage::Result<()> {
    if fact(gpkg.connection(), "layout")?.as_deref() == Some("1") {
        let transaction = gpkg.connection().unchecked_transaction()?;
        complete(gpkg)?;
        transaction.commit()?;
    }
    Ok(())
}

/// Empties the layer and gives it another zone.
pub fn move_to(gpkg: &GeoPackage, epsg: i32) -> geopackage::Result<()> {
    gpkg.add_epsg_srs(epsg)?;
    let connection = gpkg.connection();
    connection.execute("DELETE FROM objects", [])?;
    connection.execute("UPDATE gpkg_geometry_columns SET srs_id = ?1 WHERE table_name = 'objects'", [epsg])?;
    let sql = "UPDATE gpkg_contents SET srs_id = ?1, min_x = NULL, min_y = NULL, max_x = NULL, max_y = NULL \
               WHERE table_name = 'objects'";
    connection.execute(sql, [epsg])?;
    Ok(())
}

/// A fact by its key.
pub fn fact(connection: &Connection, key: &str) -> rusqlite::Result<Option<String>> {
    let mut statement = connection.prepare_cached("SELECT value FROM kstore WHERE key = ?1")?;
    statement.query_row([key], |row| row.get(0)).optional()
}

/// Writes a fact.
pub fn set_fact(connection: &Connection, key: &str, value: &str) -> rusqlite::Result<()> {
    let sql = "INSERT INTO kstore (key, value) VALUES (?1, ?2) ON CONFLICT (key) DO UPDATE SET value = excluded.value";
    connection.prepare_cached(sql)?.execute([key, value]).map(drop)
}

/// The EPSG code of the layer.
pub fn epsg(connection: &Connection) -> rusqlite::Result<i32> {
    let sql = "SELECT srs_id FROM gpkg_geometry_columns WHERE table_name = 'objects'";
    connection.query_row(sql, [], |row| row.get(0))
}

/// Texts of a row that live as long as it is written.
pub struct RowTexts {
    beside: String,
    label: String,
}

impl RowTexts {
    /// The texts of an object's row.
    pub fn of(known: &Known) -> Self {
        let beside: Vec<String> = known.companions.iter().map(u64::to_string).collect();
        Self { beside: beside.join(" "), label: format!("{} {}", known.class, known.id) }
    }

    /// The values of the row, in the order of the columns.
    pub fn values<'a>(&'a self, known: &Known) -> [ValueRef<'a>; COLUMNS.len()] {
        let number = |x: Option<f64>| x.map_or(ValueRef::Null, ValueRef::Float);
        let instant = |t: Timestamp| ValueRef::Integer(t.ns);
        [
            ValueRef::Text(known.class.as_str()),
            ValueRef::Boolean(known.reported),
            ValueRef::Float(known.confidence),
            ValueRef::Integer(known.sightings.into()),
            ValueRef::Integer(known.independent.into()),
            ValueRef::Float(known.ground_m),
            number(known.height_m),
            number(known.dbh.map(|d| d.value)),
            number(known.dbh.map(|d| d.std)),
            ValueRef::Float(known.position_std_m),
            instant(known.first_seen),
            instant(known.last_seen),
            instant(known.weighed),
            instant(known.independent_at),
            ValueRef::Text(&self.beside),
            ValueRef::Text(&self.label),
        ]
    }
}

/// A point as well-known binary: little endian, type 1, x, y.
pub fn point_wkb([east_m, north_m]: [f64; 2]) -> [u8; 21] {
    let mut wkb = [0; 21];
    wkb[0] = 1;
    wkb[1..5].copy_from_slice(&1u32.to_le_bytes());
    wkb[5..13].copy_from_slice(&east_m.to_le_bytes());
    wkb[13..21].copy_from_slice(&north_m.to_le_bytes());
    wkb
}

/// Reads every object; the second value counts rows that make no sense and are left out.
pub fn read_objects(connection: &Connection) -> rusqlite::Result<(Vec<Known>, u64)> {
    let names: Vec<&str> = COLUMNS.iter().map(|(name, _)| *name).collect();
    let sql = format!("SELECT id, ST_MinX(geom), ST_MinY(geom), {} FROM objects ORDER BY id", names.join(", "));
    let mut statement = connection.prepare(&sql)?;
    let mut rows = statement.query([])?;
    let (mut objects, mut senseless) = (Vec::new(), 0);
    while let Some(row) = rows.next()? {
        match read_object(row) {
            Some(known) => objects.push(known),
            None => senseless += 1,
        }
    }
    Ok((objects, senseless))
}

fn read_object(row: &Row<'_>) -> Option<Known> {
    let number = |name: &str| row.get::<_, Option<f64>>(name).ok().flatten().filter(|x| x.is_finite());
    let count = |name: &str| u32::try_from(row.get::<_, i64>(name).ok()?).ok();
    let instant = |name: &str| row.get(name).ok().map(Timestamp::from_ns);
    let class: String = row.get("class").ok()?;
    let beside: String = row.get::<_, Option<String>>("beside").ok().flatten().unwrap_or_default();
    let place = |column: usize| row.get::<_, f64>(column).ok().filter(|x| x.is_finite());
    let mut known = Known {
        id: u64::try_from(row.get::<_, i64>(0).ok()?).ok().filter(|id| *id > 0)?,
        class: *Class::ALL.iter().find(|c| **c != Class::Unknown && c.as_str() == class)?,
        first_seen: instant("first_seen_ns")?,
        last_seen: instant("last_seen_ns")?,
        weighed: instant("confidence_at_ns")?,
        confidence: number("confidence").filter(|c| *c >= 0.0)?,
        sightings: count("sightings")?,
        independent: count("independent_sightings")?,
        independent_at: instant("independent_at_ns")?,
        place_m: [place(1)?, place(2)?],
        ground_m: number("ground_m")?,
        position_std_m: number("position_std_m").filter(|s| *s > 0.0)?,
        dbh: number("dbh_m").zip(number("dbh_std_m")).map(|(value, std)| Estimate { value, std }),
        height_m: number("height_m"),
        companions: Vec::new(),
        reported: row.get("reported").ok()?,
        noted_m: [place(1)?, place(2)?],
    };
    known.dbh = known.dbh.filter(|d| d.std > 0.0);
    beside.split_whitespace().filter_map(|id| id.parse().ok()).for_each(|id| known.accompany(id));
    Some(known)
}
