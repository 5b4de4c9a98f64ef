//! Recorded rays: from a file to beams in UTM, one at a time.
//!
//! In: a ray-cloud PLY, a LAS or LAZ file (with an origin or a trajectory, where they are known), or Freiburg `scan_NNN_points.dat` files.
//! Out: [`Ray`]s, metres, in the file's own coordinates, in the file's order. Nothing is held in memory beyond a
//! read buffer (and the trajectory). A bad file ends with an error that names the byte or the line.

mod error;
mod freiburg;
mod las_crs;
mod las_file;
mod ply;
mod trajectory_file;

pub use error::InputError;

use std::path::{Path, PathBuf};
use tsense_geometry::{Global, Point, Timestamp};

/// One laser ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where the sensor was; where that is not known, the end.
    pub origin: Point<Global>,
    /// Where the beam ended; for a ray without return, how far it was known to be free.
    pub end: Point<Global>,
    /// False where nothing came back.
    pub is_return: bool,
    /// When, on the file's clock.
    pub stamp: Timestamp,
}

impl Ray {
    /// A point of which nobody knows where its beam came from.
    pub fn is_point(&self) -> bool {
        self.origin == self.end
    }
}

/// What nanoseconds in 64 bits hold, seconds.
const TIME_MAX_S: f64 = 9.2e9;

/// What a file does not say by itself.
#[derive(Clone, Debug, Default)]
pub struct InputOptions {
    /// Sensor position for point clouds of a standing scanner.
    pub origin: Option<Point<Global>>,
    /// Sensor positions over time for point clouds of a moving scanner.
    pub trajectory: Option<PathBuf>,
}

/// What the stamps of an input count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// Nothing: the file has no time; stamps follow the order of the rays.
    Unknown,
    /// Seconds of a clock that the file does not name, or of the GPS week.
    Seconds,
    /// GPS time less 10^9 s ("adjusted standard").
    GpsStandard,
}

/// EPSG codes that a file carries, as they stand there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Codes {
    /// Of easting and northing.
    pub horizontal: u16,
    /// Of the heights.
    pub vertical: Option<u16>,
}

/// What a file says of its coordinates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum System {
    /// Nothing that names a system.
    Unknown,
    /// Which system it is.
    Codes(Codes),
    /// That easting and northing, or heights, are no metres but these.
    NotMetres(String),
}

/// Rays of one input, with what its header tells.
pub struct Rays {
    /// Number of rays where the header knows it.
    pub total: Option<u64>,
    /// What the stamps count.
    pub clock: Clock,
    /// What the file says of its coordinates.
    pub system: System,
    iter: Box<dyn Iterator<Item = Result<Ray, InputError>>>,
}

impl Iterator for Rays {
    type Item = Result<Ray, InputError>;
    fn next(&mut self) -> Option<Self::Item> {
        self.iter.next()
    }
}

/// Opens an input; the format follows from the name.
pub fn open(path: &Path, options: &InputOptions) -> Result<Rays, InputError> {
    let kind = kind_of(path)?;
    if !matches!(kind, Kind::Las) && (options.origin.is_some() || options.trajectory.is_some()) {
        let remedy = "leave out --origin and --trajectory";
        return Err(InputError::new(path, "its rays say where they came from", remedy).of_usage());
    }
    match kind {
        Kind::Ply => ply::open(path),
        Kind::Las => las_file::open(path, options),
        Kind::Freiburg => freiburg::open(path),
    }
}

/// Reads a ray cloud (PLY) from memory; `name` is what errors call it.
pub fn read_ply(name: &str, bytes: Vec<u8>) -> Result<Rays, InputError> {
    ply::read(Path::new(name), bytes.len() as u64, std::io::Cursor::new(bytes))
}

enum Kind {
    Ply,
    Las,
    Freiburg,
}

fn kind_of(path: &Path) -> Result<Kind, InputError> {
    if path.is_dir() {
        return Ok(Kind::Freiburg);
    }
    if !path.exists() {
        return Err(InputError::new(path, "no such file", "check the path").of_usage());
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "ply" => Ok(Kind::Ply),
        "las" | "laz" => Ok(Kind::Las),
        "dat" => Ok(Kind::Freiburg),
        other => Err(InputError::new(
            path,
            &format!("unknown kind of file '.{other}'"),
            "give a ray cloud (.ply), a point cloud (.las, .laz) or Freiburg scans (a folder, or .dat)",
        )
        .of_usage()),
    }
}
