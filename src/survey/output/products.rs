//! All files of a survey: opened aside when it begins, given tile after tile, named when every one of them is whole.

use super::cloud::CloudFile;
use super::gpkg::ObjectsFile;
use super::rasters::Rasters;
use super::{Stems, rejected_csv, trees_csv};
use crate::files::{Aside, OutputError, write_aside};
use crate::survey::Crs;
use crate::survey::input::{Clock, Ray};
use crate::survey::page::{Page, Picture, Section};
use crate::survey::piece::Piece;
use crate::survey::plan::Plan;
use crate::survey::thing::Thing;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The files of a survey, not whole yet.
pub struct Products {
    folder: PathBuf,
    rasters: Rasters,
    objects: ObjectsFile,
    cloud: CloudFile,
    picture: Picture,
    section: Option<Section>,
    /// The section runs through the tile that was added last.
    is_section_here: bool,
}

impl Products {
    /// Opens the files that are written tile by tile.
    pub fn create(folder: &Path, plan: &Plan, crs: Option<Crs>, clock: Clock) -> Result<Self, OutputError> {
        Ok(Self {
            folder: folder.into(),
            rasters: Rasters::create(folder, plan, crs)?,
            objects: ObjectsFile::create(&folder.join("objects.gpkg"), crs)?,
            cloud: CloudFile::create(&folder.join("cloud.laz"), crs, clock, plan.low_m)?,
            picture: Picture::new(plan),
            section: None,
            is_section_here: false,
        })
    }

    /// Writes what a tile found.
    pub fn add(&mut self, piece: &Piece) -> Result<(), OutputError> {
        self.rasters.add(piece)?;
        self.picture.add(piece);
        let better = Section::of(piece, self.section.as_ref());
        self.is_section_here = better.is_some();
        self.section = better.or(self.section.take());
        Ok(())
    }

    /// Writes things that are whole.
    pub fn add_things(&mut self, things: &[Option<Thing>]) -> Result<(), OutputError> {
        self.objects.add(things)
    }

    /// Writes a return of a tile.
    pub fn add_return(&mut self, ray: &Ray, piece: &Piece, stems: &Stems) -> Result<(), OutputError> {
        let is_stem = self.cloud.add(ray, piece, stems)?;
        if let Some(section) = self.section.as_mut().filter(|_| self.is_section_here) {
            section.add(ray.end.to_array(), is_stem);
        }
        Ok(())
    }

    /// Writes the rest, then gives all files their names.
    pub fn finish(self, page: &Page) -> Result<(), OutputError> {
        let Page { totals, report, .. } = page;
        let folder = self.folder;
        let mut files = self.rasters.finish()?;
        files.push(self.objects.finish(&totals.trees, &totals.rejected)?);
        files.push(self.cloud.finish()?);
        files.push(write_aside(&folder.join("trees.csv"), |to| trees_csv::put(to, &totals.trees))?);
        files.push(write_aside(&folder.join("rejected.csv"), |to| rejected_csv::put(to, &totals.rejected))?);
        files.push(write_aside(&folder.join("report.json"), |to| {
            serde_json::to_writer_pretty(&mut *to, report)?;
            to.write_all(b"\n")
        })?);
        let html = folder.join("report.html");
        let page = page.html(&self.picture, self.section.as_ref()).map_err(|e| OutputError::new(&html, e))?;
        files.push(write_aside(&html, |to| to.write_all(page.as_bytes()))?);
        files.into_iter().try_for_each(Aside::commit)
    }
}
