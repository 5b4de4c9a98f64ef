//! LAS and LAZ point clouds: points become rays by a sensor origin, or by a trajectory over GPS time.
//!
//! A point cloud alone does not say where its beams came from: without origin and trajectory a ray begins where it ends,
//! and nothing is known to be free. Points flagged as withheld are skipped.

use super::trajectory_file::SensorPath;
use super::{Clock, InputError, InputOptions, Ray, Rays};
use std::path::{Path, PathBuf};
use tsense_geometry::{COORDINATE_MAX_M, Global, Point, Timestamp};

enum Sensor {
    Unknown,
    Standing(Point<Global>),
    Moving(SensorPath),
}

/// Points read from the file at a time.
const CHUNK: u64 = 50_000;

/// Opens a point cloud.
pub fn open(path: &Path, options: &InputOptions) -> Result<Rays, InputError> {
    let sensor = sensor_of(options)?;
    let reader = las::Reader::from_path(path)
        .map_err(|e| InputError::new(path, &e.to_string(), "check that this is a complete LAS or LAZ file"))?;
    let header = reader.header();
    let (total, has_time) = (header.number_of_points(), header.point_format().has_gps_time);
    if matches!(sensor, Sensor::Moving(_)) && !has_time {
        return Err(
            InputError::new(path, "points without GPS time", "a trajectory needs it; give --origin instead").of_usage()
        );
    }
    let epsg = header
        .get_geotiff_crs()
        .ok()
        .flatten()
        .and_then(|crs| crs.get_projected_crs_geo_key_value())
        .or_else(|| epsg_of_wkt(header.get_wkt_crs_bytes()?));
    let clock = match (has_time, header.gps_time_type()) {
        (false, _) => Clock::Unknown,
        (true, las::GpsTimeType::Standard) => Clock::GpsStandard,
        (true, las::GpsTimeType::Week) => Clock::Seconds,
    };
    let iter = Points { path: path.into(), reader, sensor, chunk: Vec::new().into_iter(), next: 0, total };
    Ok(Rays { total: Some(total), clock, epsg, iter: Box::new(iter) })
}

fn sensor_of(options: &InputOptions) -> Result<Sensor, InputError> {
    match (&options.trajectory, options.origin) {
        (Some(file), _) => Ok(Sensor::Moving(SensorPath::read(file)?)),
        (None, Some(origin)) => Ok(Sensor::Standing(origin)),
        (None, None) => Ok(Sensor::Unknown),
    }
}

/// The code of the last `AUTHORITY["EPSG","n"]` or `ID["EPSG",n]` of a WKT before its system of heights: the one of the
/// whole horizontal system.
fn epsg_of_wkt(wkt: &[u8]) -> Option<u16> {
    let text = String::from_utf8_lossy(wkt);
    let heights = ["VERTCRS[", "VERTICALCRS[", "VERT_CS["].iter().filter_map(|word| text.find(word)).min();
    let text = &text[..heights.unwrap_or(text.len())];
    let tail = &text[text.rfind("\"EPSG\"")? + 6..];
    let digits: String = tail.chars().skip_while(|c| !c.is_ascii_digit()).take_while(char::is_ascii_digit).collect();
    digits.parse().ok()
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
        let fault = |seen: &str| {
            let seen = format!("point {} of {}: {seen}", self.next, self.total);
            InputError::new(&self.path, &seen, "copy the file again; it is truncated or damaged")
        };
        let points = self.reader.read_points(CHUNK).map_err(|e| fault(&e.to_string()))?;
        let points: Result<Vec<_>, _> = points.points().collect();
        let points = points.map_err(|e| fault(&e.to_string()))?;
        if points.is_empty() {
            return Err(fault("the file ends"));
        }
        self.chunk = points.into_iter();
        Ok(())
    }

    fn ray(&self, point: &las::Point) -> Result<Ray, InputError> {
        let number = self.next - 1;
        if ![point.x, point.y, point.z].iter().all(|c| c.abs() <= COORDINATE_MAX_M) {
            let seen = format!("point {number} at {}, {}, {}", point.x, point.y, point.z);
            return Err(InputError::new(&self.path, &seen, "points must be finite and on the Earth"));
        }
        let time = point.gps_time.unwrap_or(number as f64 / 20_000.0);
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
    fn the_last_epsg_code_of_a_wkt_names_the_whole_system() {
        let wkt = br#"PROJCS["x",GEOGCS["y",AUTHORITY["EPSG","4326"]],AUTHORITY["EPSG","32612"]]"#;
        assert_eq!(super::epsg_of_wkt(wkt), Some(32612));
        assert_eq!(super::epsg_of_wkt(b"LOCAL_CS[]"), None);
        let compound = br#"COMPOUNDCRS["x",PROJCRS["y",ID["EPSG",32617]],VERTCRS["z",ID["EPSG",5773]]]"#;
        assert_eq!(super::epsg_of_wkt(compound), Some(32617));
    }
}
