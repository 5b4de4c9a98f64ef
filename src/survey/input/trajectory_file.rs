//! A trajectory file: where the sensor was, a line an instant.
//!
//! Each line: time (s, on the cloud's GPS clock), x, y, z (metres, in the cloud's coordinates), separated by blanks,
//! commas or semicolons; more columns are ignored; a heading line and lines that start with `#` are skipped.
#![allow(clippy::disallowed_methods, reason = "shell: the survey's input files")]

use super::InputError;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;
use tsense_geometry::{Global, Point};

/// Most lines that are read: a day at 200 Hz.
const LINES_MAX: usize = 17_280_000;

/// Sensor positions over time, sorted by it.
pub struct SensorPath {
    samples: Vec<(f64, Point<Global>)>,
}

impl SensorPath {
    /// Reads the file.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let file = File::open(path).map_err(|e| InputError::io(path, &e))?;
        let mut samples = Vec::new();
        for (index, line) in BufReader::new(file).lines().enumerate() {
            let line = line.map_err(|e| InputError::io(path, &e).at_line(index + 1))?;
            match numbers(&line) {
                Some([time, x, y, z]) => samples.push((time, Point::new(x, y, z))),
                None if index == 0 || line.trim().is_empty() || line.starts_with('#') => {}
                None => {
                    let seen = format!("'{}'", line.chars().take(60).collect::<String>());
                    return Err(InputError::new(path, &seen, "a line is: time x y z").at_line(index + 1));
                }
            }
            if samples.len() > LINES_MAX {
                return Err(InputError::new(path, "more lines than a day at 200 Hz", "split the survey"));
            }
        }
        if samples.is_empty() {
            return Err(InputError::new(path, "no position in it", "a line is: time x y z"));
        }
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Self { samples })
    }

    /// Where the sensor was at `time`; nothing outside of the file's span.
    pub fn at(&self, time: f64) -> Option<Point<Global>> {
        let later = self.samples.partition_point(|(t, _)| *t < time);
        let (t1, b) = *self.samples.get(later)?;
        if t1 == time {
            return Some(b);
        }
        let (t0, a) = *self.samples.get(later.checked_sub(1)?)?;
        Some(a + (b - a).scaled((time - t0) / (t1 - t0)))
    }
}

/// The first four numbers of a line, all finite.
fn numbers(line: &str) -> Option<[f64; 4]> {
    let mut out = [0.0; 4];
    let mut words = line.split(|c: char| c.is_whitespace() || c == ',' || c == ';').filter(|w| !w.is_empty());
    for slot in &mut out {
        *slot = words.next()?.parse().ok().filter(|v: &f64| v.is_finite())?;
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_between_lines_are_interpolated_and_none_are_invented_outside() {
        let path = std::env::temp_dir().join(format!("tsense-path-{}.txt", std::process::id()));
        std::fs::write(&path, "time,x,y,z\n# comment\n10, 0, 0, 1\n12; 4; 8; 1; 99\n").unwrap();
        let sensor = SensorPath::read(&path).unwrap();
        assert_eq!(sensor.at(11.0).unwrap().to_array(), [2.0, 4.0, 1.0]);
        assert_eq!(sensor.at(12.0).unwrap().to_array(), [4.0, 8.0, 1.0]);
        assert!(sensor.at(9.9).is_none() && sensor.at(12.1).is_none());
        std::fs::write(&path, "10 0 0 1\n11 nan 0 0\n").unwrap();
        let error = SensorPath::read(&path).err().unwrap().to_string();
        assert!(error.contains("line 2"), "{error}");
        std::fs::remove_file(&path).unwrap();
    }
}
