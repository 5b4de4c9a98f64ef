//! LAS and LAZ point clouds: points become rays by a sensor origin, or by a trajectory over GPS time.
//!
//! A point cloud alone does not say where its beams came from: without origin and trajectory a ray begins where it ends,
//! and nothing is known to be free. Points flagged as withheld are skipped.
#![allow(clippy::disallowed_methods, reason = "shell: the survey's input files")]

use super::trajectory_file::SensorPath;
use super::{Clock, InputError, InputOptions, Ray, Rays, TIME_MAX_S, las_crs};
use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::path::{Path, PathBuf};
use tsense_geometry::{COORDINATE_MAX_M, Global, Point, Timestamp};

enum Sensor {
    Unknown,
    Standing(Point<Global>),
    Moving(SensorPath),
}

/// Where the scales of x, y and z stand in a file, doubles: LAS 1.0 to 1.4.
const SCALES_BYTE: u64 = 131;
/// Points read from the file at a time.
const CHUNK: u64 = 50_000;

/// Opens a point cloud.
pub fn open(path: &Path, options: &InputOptions) -> Result<Rays, InputError> {
    let sensor = sensor_of(options)?;
    let file = File::open(path).map_err(|e| InputError::io(path, &e))?;
    let reader = las::Reader::new(BufReader::new(file)).map_err(|e| {
        fault(path, "its head or the list of its parts", &e, "check that this is a complete LAS or LAZ file")
    })?;
    let header = reader.header();
    check_scales(path, header)?;
    let (total, has_time) = (header.number_of_points(), header.point_format().has_gps_time);
    if matches!(sensor, Sensor::Moving(_)) && !has_time {
        return Err(
            InputError::new(path, "points without GPS time", "a trajectory needs it; give --origin instead").of_usage()
        );
    }
    let system = las_crs::system_of(header);
    let clock = match (has_time, header.gps_time_type()) {
        (false, _) => Clock::Unknown,
        (true, las::GpsTimeType::Standard) => Clock::GpsStandard,
        (true, las::GpsTimeType::Week) => Clock::Seconds,
    };
    let iter = Points { path: path.into(), reader, sensor, chunk: Vec::new().into_iter(), next: 0, total };
    Ok(Rays { total: Some(total), clock, system, iter: Box::new(iter) })
}

/// What the library says, in words that say what it means.
fn fault(path: &Path, place: &str, error: &las::Error, remedy: &str) -> InputError {
    match error {
        las::Error::Io(error) if !matches!(error.kind(), ErrorKind::UnexpectedEof | ErrorKind::InvalidData) => {
            InputError::io(path, error)
        }
        // So ends a read beyond the end of the file, also where the library's LAZ part wraps it.
        error if error.to_string().ends_with("failed to fill whole buffer") => {
            cut(path, &format!("the file ends within {place}"), remedy)
        }
        error => InputError::new(path, &format!("{place}: {error}"), remedy),
    }
}

/// A file that ends too early, with the byte that it ends at.
fn cut(path: &Path, seen: &str, remedy: &str) -> InputError {
    let fault = InputError::new(path, seen, remedy);
    match std::fs::metadata(path) {
        Ok(file) => fault.at_byte(file.len()),
        Err(_) => fault,
    }
}

/// Coordinates are whole numbers times a scale: with none, or with a negative one, they mean nothing.
fn check_scales(path: &Path, header: &las::Header) -> Result<(), InputError> {
    let transforms = header.transforms();
    let scales = [("x", transforms.x.scale), ("y", transforms.y.scale), ("z", transforms.z.scale)];
    for (axis, (name, scale)) in (0..).zip(scales) {
        if !(scale > 0.0 && scale.is_finite()) {
            let seen = format!("the scale of {name} is {scale:?}, so that no {name} of a point can be read");
            let remedy = "a scale is above 0 (0.001 for millimetres); write the file anew from its source";
            return Err(InputError::new(path, &seen, remedy).at_byte(SCALES_BYTE + 8 * axis));
        }
    }
    Ok(())
}

fn sensor_of(options: &InputOptions) -> Result<Sensor, InputError> {
    match (&options.trajectory, options.origin) {
        (Some(file), _) => Ok(Sensor::Moving(SensorPath::read(file)?)),
        (None, Some(origin)) => Ok(Sensor::Standing(origin)),
        (None, None) => Ok(Sensor::Unknown),
    }
}

struct Points {
    path: PathBuf,
    reader: las::Reader,
    sensor: Sensor,
    chunk: std::vec::IntoIter<las::Point>,
    next: u64,
    total: u64,
}

impl Iterator for Points {
    type Item = Result<Ray, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.chunk.next() {
                Some(point) => {
                    self.next += 1;
                    if !point.is_withheld {
                        return Some(self.ray(&point));
                    }
                }
                None if self.next >= self.total => return None,
                None => {
                    if let Err(error) = self.fill() {
                        self.next = self.total;
                        return Some(Err(error));
                    }
                }
            }
        }
    }
}

impl Points {
    fn fill(&mut self) -> Result<(), InputError> {
        let remedy = "copy the file again; it is truncated or damaged";
        let place = format!("points {} to {} of {}", self.next, (self.next + CHUNK).min(self.total) - 1, self.total);
        let points = self.reader.read_points(CHUNK).and_then(|points| points.points().collect::<Result<Vec<_>, _>>());
        let points = points.map_err(|e| fault(&self.path, &place, &e, remedy))?;
        if points.is_empty() {
            return Err(cut(&self.path, &format!("the file ends before {place}"), remedy));
        }
        self.chunk = points.into_iter();
        Ok(())
    }

    fn ray(&self, point: &las::Point) -> Result<Ray, InputError> {
        let number = self.next - 1;
        let time = point.gps_time.unwrap_or(number as f64 / 20_000.0);
        let is_somewhere = [point.x, point.y, point.z].iter().all(|c| c.abs() <= COORDINATE_MAX_M);
        let is_sound = is_somewhere && time.abs() <= TIME_MAX_S;
        if !is_sound {
            let seen = format!("point {number} at {:?}, {:?}, {:?}, time {time:?}", point.x, point.y, point.z);
            return Err(InputError::new(
                &self.path,
                &seen,
                "points must be finite, on the Earth and before the year 2262",
            ));
        }
        let end = Point::new(point.x, point.y, point.z);
        let origin = match &self.sensor {
            Sensor::Unknown => end,
            Sensor::Standing(origin) => *origin,
            Sensor::Moving(path) => path.at(time).ok_or_else(|| {
                let seen = format!("point {number} at time {time} s lies outside of the trajectory");
                InputError::new(&self.path, &seen, "give a trajectory that covers the whole cloud")
            })?,
        };
        Ok(Ray { origin, end, is_return: true, stamp: Timestamp::from_seconds(time) })
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_file_that_ends_too_early_is_said_to_and_one_that_cannot_be_read_is_the_systems() {
        let path = std::path::Path::new("a.laz");
        let told = |kind: std::io::ErrorKind| {
            let error = super::fault(path, "points 0 to 9 of 12", &las::Error::Io(kind.into()), "copy it again");
            (error.exit_code(), error.to_string())
        };
        let mut nothing = std::io::empty();
        let early = std::io::Read::read_exact(&mut nothing, &mut [0; 4]).unwrap_err();
        let early = super::fault(path, "points 0 to 9 of 12", &las::Error::Io(early), "copy it again");
        assert_eq!(early.to_string(), "a.laz: the file ends within points 0 to 9 of 12; copy it again");
        assert_eq!(early.exit_code(), 6);
        assert_eq!(told(std::io::ErrorKind::PermissionDenied).0, 1);
        assert!(told(std::io::ErrorKind::InvalidData).1.starts_with("a.laz: points 0 to 9 of 12: "));
    }

    #[test]
    fn a_scale_that_is_no_length_is_told_by_its_byte() {
        let path = std::path::Path::new("a.las");
        for (scale, told) in [(0.0, Some("0.0")), (-0.01, Some("-0.01")), (f64::NAN, Some("NaN")), (0.01, None)] {
            let mut builder = las::Builder::default();
            builder.transforms.y.scale = scale;
            let error = super::check_scales(path, &builder.into_header().unwrap()).err();
            assert_eq!(error.as_ref().map(super::InputError::exit_code), told.map(|_| 6));
            let seen = told.map(|scale| format!("a.las byte 139: the scale of y is {scale}, "));
            assert!(seen.is_none_or(|seen| error.unwrap().to_string().starts_with(&seen)), "{scale}");
        }
    }
}
