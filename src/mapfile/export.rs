//! A map file as points for other programs: LAS, LAZ or PLY by the name of the output.
//!
//! In: the blocks of a map file, read twice (how many points between which values, then the points). Out: a file
//! written aside and renamed.

use super::damaged;
use super::las::LasFile;
use super::ply;
use super::points::{Scale, Shade, VoxelPoint, What, points_of};
use crate::commands::Failure;
use crate::files::write_whole;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use tsense_geometry::VoxelGrid;
use tsense_mapper::tsmap::Reader;

/// Kind of output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// LAS 1.4.
    Las,
    /// LAS 1.4, compressed.
    Laz,
    /// PLY, binary.
    Ply,
}

impl Kind {
    /// The kind that a name asks for.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "las" => Some(Self::Las),
            "laz" => Some(Self::Laz),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }
}

/// A map file to be turned into points.
pub struct Export<'a> {
    /// Its path, for messages.
    pub path: &'a Path,
    /// Its blocks.
    pub reader: Reader<'a>,
    /// Which voxels.
    pub what: What,
    /// What the colour shows.
    pub shade: Shade,
}

/// What the first reading found.
struct Survey {
    points: u64,
    corner_m: [f64; 3],
    scale: Scale,
}

impl Export<'_> {
    /// Writes the points; how many. Nothing to write is a failure: an empty cloud helps nobody.
    pub fn write(&self, out: &Path, kind: Kind) -> Result<u64, Failure> {
        let mut found = Survey { points: 0, corner_m: [f64::INFINITY; 3], scale: Scale::new(self.shade) };
        self.each(|point| {
            found.points += 1;
            found.corner_m = std::array::from_fn(|axis| found.corner_m[axis].min(point.at_m[axis]));
            found.scale.add(point);
            Ok(())
        })?;
        if found.points == 0 {
            return Err(Failure::new(1, format!("{}: no voxel of that kind to export", self.path.display())));
        }
        write_whole(out, |writer| match kind {
            Kind::Ply => self.write_ply(writer, &found).map_err(|e| e.message),
            _ => {
                let file = writer.get_ref().try_clone().map_err(|e| e.to_string())?;
                self.write_las(file, &found, kind == Kind::Laz).map_err(|e| e.message)
            }
        })?;
        Ok(found.points)
    }

    fn write_ply(&self, writer: &mut BufWriter<File>, found: &Survey) -> Result<(), Failure> {
        let failed = |e: std::io::Error| Failure::new(1, e);
        let properties = [("char", "scalar_occupancy"), ("uchar", "scalar_confidence")];
        ply::write_head(writer, &self.reader.header(), found.points, &properties).map_err(failed)?;
        self.each(|point| {
            let further = [point.occupancy as u8, point.confidence];
            ply::write_point(writer, point.at_m, found.scale.color(point), &further).map_err(failed)
        })?;
        writer.flush().map_err(failed)
    }

    fn write_las(&self, file: File, found: &Survey, is_laz: bool) -> Result<(), Failure> {
        let failed = |e: ::las::Error| Failure::new(1, e);
        let mut las = LasFile::new(file, &self.reader.header(), found.corner_m, is_laz).map_err(failed)?;
        self.each(|point| las.add(point, found.scale.color(point)).map_err(failed))?;
        las.close().map_err(failed)
    }

    fn each(&self, mut take: impl FnMut(&VoxelPoint) -> Result<(), Failure>) -> Result<(), Failure> {
        let size_m = self.reader.header().voxel_size_m;
        let grid = VoxelGrid::new(size_m).ok_or_else(|| Failure::new(6, format!("voxels of {size_m} m")))?;
        for block in self.reader.clone() {
            let block = block.map_err(|fault| damaged(self.path, &fault))?;
            points_of(&block, grid, self.what).try_for_each(|point| take(&point))?;
        }
        Ok(())
    }
}
