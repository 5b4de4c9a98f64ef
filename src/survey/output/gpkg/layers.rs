//! The layers of `objects.gpkg`: their columns, how rows are made, geometries as ISO WKB.

use crate::survey::shapes::Ring;
use crate::survey::thing::{Kind, Thing};
use geopackage::core::types::{ColumnType, GeometryType, ZmFlag};
use geopackage::{ColumnSpec, GeoPackage, GeometrySpec, TableSchemaBuilder, ValueRef};
use tsense_contract::Detection;

/// One layer.
pub struct Layer {
    /// Name of the table.
    pub name: &'static str,
    /// In words.
    pub description: &'static str,
    /// Whether its points have heights.
    pub has_heights: bool,
    geometry: GeometryType,
    columns: &'static [&'static str],
}

/// Trees; the position is that of the axis at 1.3 m above ground, its height that of the ground.
pub const TREES: Layer = Layer {
    name: "trees",
    description: "Stems: diameter at 1.3 m (dbh), position at 1.3 m, height, lean, each std one sigma",
    has_heights: true,
    geometry: GeometryType::Point,
    columns: &[
        "dbh_m",
        "dbh_std_m",
        "position_std_m",
        "height_m",
        "ground_m",
        "lean_deg",
        "lean_east_deg",
        "lean_north_deg",
        "arc_share",
        "confidence_share",
    ],
};

/// Candidates that are no trees, each with its reason.
pub const REJECTED: Layer = Layer {
    name: "rejected",
    description: "Candidates that are no trees: why, and the figure that decided, in the unit of the limit it missed",
    has_heights: false,
    geometry: GeometryType::Point,
    columns: &["reason_text", "value"],
};

/// Drops.
pub const DROPS: Layer = Layer {
    name: "drops",
    description: "The ground falls away, or was expected and never seen; depths are below the rim",
    has_heights: false,
    geometry: GeometryType::MultiPolygon,
    columns: &["area_m2", "length_m", "width_m", "depth_max_m", "depth_mean_m", "ground_m", "ground_std_m"],
};

const STANDING: &[&str] =
    &["area_m2", "length_m", "width_m", "height_max_m", "height_mean_m", "ground_m", "ground_std_m"];

/// Rocks, walls, brush.
pub const SOLID: [Layer; 3] = [
    Layer {
        name: "rocks",
        description: "Solid things that are neither trunk nor wall: rocks, logs, stumps",
        has_heights: false,
        geometry: GeometryType::MultiPolygon,
        columns: STANDING,
    },
    Layer {
        name: "walls",
        description: "Solid things at least 3 m long and 1 m high: walls, sides of buildings",
        has_heights: false,
        geometry: GeometryType::MultiPolygon,
        columns: STANDING,
    },
    Layer {
        name: "brush",
        description: "Patches of vegetation that can be pushed through, from 0.2 m of height",
        has_heights: false,
        geometry: GeometryType::MultiPolygon,
        columns: STANDING,
    },
];

impl Layer {
    /// Makes the table.
    pub fn create(&self, gpkg: &GeoPackage, srs: i32) -> geopackage::Result<()> {
        let z = if self.has_heights { ZmFlag::Mandatory } else { ZmFlag::Prohibited };
        let table = TableSchemaBuilder::new(self.name)
            .primary_key("id")
            .identifier(self.name)
            .description(self.description)
            .geometry(GeometrySpec::new(self.geometry, srs).z(z));
        let kind = |name: &str| if name.ends_with("_text") { ColumnType::Text(None) } else { ColumnType::Double };
        let table = self.columns.iter().fold(table, |table, name| table.column(ColumnSpec::new(*name, kind(name))));
        gpkg.create_layer(&table).map(drop)
    }
}

fn number(value: f64) -> ValueRef<'static> {
    // Tenths of a millimetre are beyond what is measured; without this, f32 values end in noise.
    if value.is_finite() { ValueRef::Float((value * 1e4).round() / 1e4) } else { ValueRef::Null }
}

/// The row of a thing.
pub fn values_of(thing: &Thing) -> [ValueRef<'static>; 7] {
    debug_assert!(STANDING.len() == 7 && DROPS.columns.len() == 7);
    let ([length_m, width_m], [most_m, mean_m], [ground_m, std_m]) =
        (thing.length_width_m, thing.height_m, thing.ground_m);
    // Ground below a drop that was not seen is what lies around it.
    let sigma_m = if thing.kind == Kind::Drop && most_m.is_nan() { f64::NAN } else { std_m };
    [thing.area_m2, length_m, width_m, most_m, mean_m, ground_m, sigma_m].map(number)
}

/// The row of a tree.
pub fn values_of_tree(tree: &Detection) -> [ValueRef<'static>; 10] {
    let [east, north] = tree.lean_rad.map(|rad| f64::from(rad).to_degrees());
    let lean = f64::from(tree.lean_rad[0]).tan().hypot(f64::from(tree.lean_rad[1]).tan()).atan().to_degrees();
    [
        tree.dbh_m.into(),
        tree.dbh_std_m.into(),
        tree.position_std_m.into(),
        tree.height_m.into(),
        tree.ground_m,
        lean,
        east,
        north,
        tree.arc_coverage.into(),
        tree.confidence.into(),
    ]
    .map(number)
}

/// A point, little-endian.
pub fn point_wkb(at_m: [f64; 2]) -> Vec<u8> {
    [&[1u8, 1, 0, 0, 0][..], at_m.map(f64::to_le_bytes).as_flattened()].concat()
}

/// A point with a height (type 1001).
pub fn tree_wkb(tree: &Detection) -> Vec<u8> {
    let at_m = [tree.easting_m, tree.northing_m, tree.ground_m];
    [&[1u8, 0xe9, 3, 0, 0][..], at_m.map(f64::to_le_bytes).as_flattened()].concat()
}

/// Polygons with holes (types 6 and 3).
pub fn multipolygon_wkb(polygons: &[Vec<Ring>]) -> Vec<u8> {
    // A raster has fewer cells than 32 bits count.
    let head = |kind: u32, count: usize| [&[1u8][..], &kind.to_le_bytes(), &(count as u32).to_le_bytes()].concat();
    let mut wkb = head(6, polygons.len());
    for rings in polygons {
        wkb.extend(head(3, rings.len()));
        for ring in rings {
            wkb.extend((ring.len() as u32).to_le_bytes());
            ring.iter().for_each(|corner| wkb.extend(corner.map(f64::to_le_bytes).as_flattened()));
        }
    }
    wkb
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn geometries_have_the_lengths_that_the_standard_gives_them() {
        assert_eq!(point_wkb([1.0, 2.0]).len(), 21);
        let ring = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]];
        let wkb = multipolygon_wkb(&[vec![ring.clone(), ring.clone()], vec![ring]]);
        assert_eq!(wkb.len(), 9 + 2 * 9 + 3 * (4 + 4 * 16));
        assert_eq!(wkb[..10], [1, 6, 0, 0, 0, 2, 0, 0, 0, 1]);
    }

    #[test]
    fn what_was_not_measured_is_null() {
        assert_eq!((number(f64::NAN), number(0.312_345_6)), (ValueRef::Null, ValueRef::Float(0.3123)));
    }
}
