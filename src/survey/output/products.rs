//! All files of a survey: opened aside when it begins, given tile after tile, named when every one of them is whole.

use super::rasters::Rasters;
use super::{Aside, OutputError, rejected_csv, trees_csv};
use crate::survey::piece::Piece;
use crate::survey::plan::Plan;
use crate::survey::totals::Totals;
use crate::survey::{Crs, Report};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// The files of a survey, not whole yet.
pub struct Products {
    folder: PathBuf,
    rasters: Rasters,
}

impl Products {
    /// Opens the files that are written tile by tile.
    pub fn create(folder: &Path, plan: &Plan, crs: Option<Crs>) -> Result<Self, OutputError> {
        Ok(Self { folder: folder.into(), rasters: Rasters::create(folder, plan, crs)? })
    }

    /// Writes what a tile found.
    pub fn add(&mut self, piece: &Piece) -> Result<(), OutputError> {
        self.rasters.add(piece)
    }

    /// Writes the rest, then gives all files their names.
    pub fn finish(self, totals: &Totals, report: &Report) -> Result<(), OutputError> {
        let folder = self.folder;
        let mut files = self.rasters.finish()?;
        files.push(text(&folder.join("trees.csv"), |to| trees_csv::put(to, &totals.trees))?);
        files.push(text(&folder.join("rejected.csv"), |to| rejected_csv::put(to, &totals.rejected))?);
        files.push(text(&folder.join("report.json"), |to| {
            serde_json::to_writer_pretty(&mut *to, report)?;
            to.write_all(b"\n")
        })?);
        files.into_iter().try_for_each(Aside::commit)
    }
}

/// Writes a file aside.
fn text(path: &Path, fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<Aside, OutputError> {
    let aside = Aside::new(path);
    let mut to = BufWriter::new(aside.create()?);
    fill(&mut to).and_then(|()| to.flush()).map_err(|e| aside.fault(e))?;
    Ok(aside)
}
