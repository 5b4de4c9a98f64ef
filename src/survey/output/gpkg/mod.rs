//! `objects.gpkg`: trees, candidates that are none, drops, rocks, walls and brush patches as layers of a GeoPackage.
//!
//! In: things tile by tile, trees at the end. Out: a file whose layers QGIS draws in its own styles at once (table
//! `layer_styles`). Every attribute has its unit in its name; NULL is "not measured". Trees and candidates are points, trees with
//! the height of the ground at the stem; all else are polygons along the cells' edges. Source: OGC 12-128r19.

mod layers;
mod styles;

use crate::files::{Aside, OutputError};
use crate::survey::Crs;
use crate::survey::thing::{Kind, Thing};
use geopackage::{GeoPackage, OpenOptions, Srs, Synchronous, ValueRef};
use layers::{DROPS, Layer, REJECTED, SOLID, TREES};
use std::path::Path;
use tsense_classifier::Rejected;
use tsense_contract::Detection;

/// The system of a GeoPackage for plane coordinates that nobody named.
const UNDEFINED: i32 = -1;
/// The number of a compound system in this file: the register has no code for every pair.
const COMPOUND: i32 = 100_001;

/// The file, not whole yet.
pub struct ObjectsFile {
    aside: Aside,
    gpkg: GeoPackage,
}

impl ObjectsFile {
    /// Makes the file aside, with its layers and their styles.
    pub fn create(path: &Path, crs: Option<Crs>) -> Result<Self, OutputError> {
        let aside = Aside::new(path)?;
        // The file has no name yet: nobody needs it after a crash, and its last step flushes it.
        let options = OpenOptions::new().synchronous(Synchronous::Off);
        let gpkg = options.create(aside.part()).map_err(|e| aside.fault(e))?;
        make(&gpkg, crs).map_err(|e| aside.fault(e))?;
        Ok(Self { aside, gpkg })
    }

    /// Adds things.
    pub fn add(&mut self, things: &[Option<Thing>]) -> Result<(), OutputError> {
        self.add_things(things).map_err(|e| self.aside.fault(e))
    }

    fn add_things(&self, things: &[Option<Thing>]) -> geopackage::Result<()> {
        for (kind, layer) in
            [(Kind::Drop, &DROPS), (Kind::Rock, &SOLID[0]), (Kind::Wall, &SOLID[1]), (Kind::Brush, &SOLID[2])]
        {
            let layer = self.gpkg.layer(layer.name)?;
            let mut writer = layer.writer()?;
            for thing in things.iter().flatten().filter(|thing| thing.kind == kind) {
                writer.insert_wkb(None, &layers::multipolygon_wkb(&thing.outline), &layers::values_of(thing))?;
            }
            writer.commit()?;
        }
        Ok(())
    }

    /// Adds the trees, numbered from 1 as in `trees.csv`, and the candidates, and closes the file.
    pub fn finish(self, trees: &[Detection], rejected: &[Rejected]) -> Result<Aside, OutputError> {
        let put = || {
            let layer = self.gpkg.layer(TREES.name)?;
            let mut writer = layer.writer()?;
            for (id, tree) in (1..).zip(trees) {
                writer.insert_wkb(Some(id), &layers::tree_wkb(tree), &layers::values_of_tree(tree))?;
            }
            writer.commit()?;
            let layer = self.gpkg.layer(REJECTED.name)?;
            let mut writer = layer.writer()?;
            for candidate in rejected {
                let values = [ValueRef::Text(candidate.reason.as_str()), ValueRef::Float(candidate.value)];
                writer.insert_wkb(None, &layers::point_wkb(candidate.at_m), &values)?;
            }
            writer.commit()
        };
        put().map_err(|e: geopackage::Error| self.aside.fault(e))?;
        self.gpkg.close().map_err(|e| self.aside.fault(e))?;
        Ok(self.aside)
    }
}

/// Makes the layers.
fn make(gpkg: &GeoPackage, crs: Option<Crs>) -> geopackage::Result<()> {
    let flat = match crs {
        None => UNDEFINED,
        Some(crs) => {
            gpkg.add_epsg_srs(crs.horizontal.into())?;
            crs.horizontal.into()
        }
    };
    let high = match crs.filter(|crs| crs.vertical.is_some()) {
        None => flat,
        Some(crs) => {
            gpkg.add_srs(&compound(crs))?;
            COMPOUND
        }
    };
    for layer in layers_of_file() {
        layer.create(gpkg, if layer.has_heights { high } else { flat })?;
    }
    styles::write(gpkg, layers_of_file())
}

fn layers_of_file() -> impl Iterator<Item = &'static Layer> {
    // QGIS draws what comes first at the bottom when it adds a whole file.
    SOLID.iter().rev().chain([&DROPS, &REJECTED, &TREES])
}

/// Both parts have codes, the pair has none; WKT 2 says it in full.
fn compound(crs: Crs) -> Srs {
    Srs {
        name: crs.name(),
        srs_id: COMPOUND,
        organization: "NONE".into(),
        organization_coordsys_id: COMPOUND,
        definition: "undefined".into(),
        description: Some(crs.to_string()),
        definition_wkt2: Some(crs.wkt()),
        epoch: None,
    }
}
