//! Freiburg Campus scans: text files `scan_NNN_points.dat`, a line a return.
//!
//! A line holds the sensor's x y z and then the point's x y z, metres, separated by blanks. The files have no time:
//! scan `NNN` is given second `NNN`, its lines follow each other within it. The format has no missing returns.
#![allow(clippy::disallowed_methods, reason = "shell: the survey's input files")]

use super::{Clock, InputError, Ray, Rays, System};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use tsense_geometry::{COORDINATE_MAX_M, Point, Timestamp};

/// Between two lines of a scan: 20,000 rays a second, as a nodding SICK ladar roughly gives.
const LINE_NS: i64 = 50_000;

/// Opens a folder of scans, or one scan.
pub fn open(path: &Path) -> Result<Rays, InputError> {
    let files = if path.is_dir() { scans_in(path)? } else { vec![path.to_owned()] };
    if files.is_empty() {
        return Err(InputError::new(path, "no scan_NNN_points.dat in this folder", "give the folder of the scans"));
    }
    let iter = files.into_iter().enumerate().flat_map(|(index, file)| lines_of(index, file));
    Ok(Rays { total: None, clock: Clock::Unknown, system: System::Unknown, iter: Box::new(iter) })
}

fn scans_in(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let entries = std::fs::read_dir(folder).map_err(|e| InputError::io(folder, &e))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| InputError::io(folder, &e))?.path();
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        if name.starts_with("scan_") && name.ends_with("_points.dat") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

fn lines_of(index: usize, path: PathBuf) -> Box<dyn Iterator<Item = Result<Ray, InputError>>> {
    let file = match File::open(&path) {
        Ok(file) => file,
        Err(error) => return Box::new(std::iter::once(Err(InputError::io(&path, &error)))),
    };
    let start = Timestamp::from_seconds(index as f64);
    let lines = BufReader::with_capacity(1 << 20, file).lines().enumerate();
    Box::new(lines.filter_map(move |(number, line)| match line {
        Err(error) => Some(Err(InputError::io(&path, &error).at_line(number + 1))),
        Ok(line) if line.trim().is_empty() || line.starts_with('#') => None,
        Ok(line) => Some(ray_of(&line, start.plus_ns(number as i64 * LINE_NS)).ok_or_else(|| {
            let seen = format!("'{}'", line.chars().take(80).collect::<String>());
            InputError::new(&path, &seen, "a line is: sensor x y z, point x y z").at_line(number + 1)
        })),
    }))
}

fn ray_of(line: &str, stamp: Timestamp) -> Option<Ray> {
    let mut words = line.split_whitespace();
    let mut next = || words.next()?.parse::<f64>().ok().filter(|v| v.abs() <= COORDINATE_MAX_M);
    let origin = Point::new(next()?, next()?, next()?);
    let end = Point::new(next()?, next()?, next()?);
    Some(Ray { origin, end, is_return: true, stamp })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_scans_reads_in_order_and_a_bad_line_is_named() {
        let folder = std::env::temp_dir().join(format!("tsense-freiburg-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("scan_002_points.dat"), "0 0 1 9 9 9\n").unwrap();
        std::fs::write(folder.join("scan_001_points.dat"), "0 0 1 2 3 0\n0 0 1 x 3 0\n").unwrap();
        let rays: Vec<_> = open(&folder).unwrap().collect();
        assert_eq!(rays[0].as_ref().unwrap().end.to_array(), [2.0, 3.0, 0.0]);
        assert!(rays[1].as_ref().unwrap_err().to_string().contains("line 2"));
        assert_eq!(rays[2].as_ref().unwrap().end.to_array(), [9.0, 9.0, 9.0]);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
