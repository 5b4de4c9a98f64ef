//! Rays sorted by tile: in memory while they are few, in one temporary file when they are many.
//!
//! In: rays in the order of the input, each for the tiles that it touches. Out: the rays of a tile in the same order.
//! Beams are kept relative to the tile's corner as `f32`: a hundredth of a millimetre at 100 m. The file is unlinked as
//! soon as it is made: the system frees it however this process ends. Memory is bounded by [`BUFFERED_MAX`] and 16 bytes
//! for each chunk of the file.
#![allow(clippy::disallowed_methods, reason = "shell: the survey's temporary file")]

use super::input::Ray;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Error, Read, Seek, SeekFrom, Write};
use std::path::Path;
use tsense_geometry::{Global, Point, Timestamp, Vector};

/// Bytes of rays that wait in memory until they are written together.
const BUFFERED_MAX: usize = 64 << 20;
/// Bytes of a record: origin and end as six `f32`, the stamp, what it is.
const RECORD: usize = 33;
/// A record that is no ray: a window of evidence ended at its stamp.
const WINDOW_ENDS: u8 = 2;

/// Rays by tile.
pub struct Spill {
    file: File,
    length: u64,
    tiles: BTreeMap<[usize; 2], TileRays>,
    buffered: usize,
}

/// What is known of a tile's rays.
#[derive(Default)]
struct TileRays {
    /// What coordinates are relative to: where the first ray ended.
    base: Option<Point<Global>>,
    waiting: Vec<u8>,
    /// Offset and length of what was written.
    chunks: Vec<(u64, u32)>,
    rays: u64,
    /// The end of a window that was noted last.
    noted: Option<Timestamp>,
}

/// What a tile's file says.
pub enum Entry {
    /// A ray.
    Ray(Ray),
    /// A window of evidence ended before the next ray: at this stamp the whole input began another.
    WindowEnds(Timestamp),
}

impl Spill {
    /// An empty store whose file lies in a folder, without a name.
    pub fn new(folder: &Path) -> Result<Self, Error> {
        let path = folder.join(format!(".rays-{}.part", std::process::id()));
        let file = File::options().create(true).truncate(true).read(true).write(true).open(&path)?;
        std::fs::remove_file(&path)?;
        Ok(Self { file, length: 0, tiles: BTreeMap::new(), buffered: 0 })
    }

    /// Adds a ray to a tile; `window` is the stamp at which the open window of evidence began.
    pub fn add(&mut self, tile: [usize; 2], ray: &Ray, window: Timestamp) -> Result<(), Error> {
        let rays = self.tiles.entry(tile).or_default();
        let before = rays.waiting.len();
        let base = *rays.base.get_or_insert(ray.end);
        if rays.noted != Some(window) {
            rays.noted = Some(window);
            put(&mut rays.waiting, [Vector::new(0.0, 0.0, 0.0); 2], window, WINDOW_ENDS);
        }
        put(&mut rays.waiting, [ray.origin - base, ray.end - base], ray.stamp, u8::from(ray.is_return));
        rays.rays += 1;
        self.buffered += rays.waiting.len() - before;
        if self.buffered > BUFFERED_MAX { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.file.seek(SeekFrom::Start(self.length))?;
        for rays in self.tiles.values_mut().filter(|rays| !rays.waiting.is_empty()) {
            self.file.write_all(&rays.waiting)?;
            // At most BUFFERED_MAX and a record, so 32 bits hold it.
            rays.chunks.push((self.length, rays.waiting.len() as u32));
            self.length += rays.waiting.len() as u64;
            rays.waiting = Vec::new();
        }
        self.buffered = 0;
        Ok(())
    }

    /// Number of a tile's rays.
    pub fn rays(&self, tile: [usize; 2]) -> u64 {
        self.tiles.get(&tile).map_or(0, |rays| rays.rays)
    }

    /// Number of rays of all tiles.
    pub fn total(&self) -> u64 {
        self.tiles.values().map(|rays| rays.rays).sum()
    }

    /// Reads a tile's rays back, in the order in which they came.
    pub fn each(&mut self, tile: [usize; 2], mut take: impl FnMut(Entry)) -> Result<(), Error> {
        let Some(rays) = self.tiles.get(&tile) else { return Ok(()) };
        let Some(base) = rays.base else { return Ok(()) };
        let mut bytes = Vec::new();
        for (offset, length) in &rays.chunks {
            self.file.seek(SeekFrom::Start(*offset))?;
            bytes.clear();
            Read::by_ref(&mut self.file).take(u64::from(*length)).read_to_end(&mut bytes)?;
            bytes.chunks_exact(RECORD).for_each(|record| take(read(record, base)));
        }
        rays.waiting.chunks_exact(RECORD).for_each(|record| take(read(record, base)));
        Ok(())
    }
}

fn put(to: &mut Vec<u8>, ends: [Vector<Global>; 2], stamp: Timestamp, kind: u8) {
    for way in ends {
        [way.xyz.x, way.xyz.y, way.xyz.z].iter().for_each(|c| to.extend((*c as f32).to_le_bytes()));
    }
    to.extend(stamp.ns.to_le_bytes());
    to.push(kind);
}

/// A record of [`RECORD`] bytes.
fn read(record: &[u8], base: Point<Global>) -> Entry {
    let number = |i: usize| f64::from(f32::from_le_bytes(std::array::from_fn(|k| record[4 * i + k])));
    let stamp = Timestamp::from_ns(i64::from_le_bytes(std::array::from_fn(|k| record[24 + k])));
    let at = |i: usize| base + Vector::new(number(i), number(i + 1), number(i + 2));
    match record[32] {
        WINDOW_ENDS => Entry::WindowEnds(stamp),
        kind => Entry::Ray(Ray { origin: at(0), end: at(3), is_return: kind == 1, stamp }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_come_back_by_tile_in_their_order_from_memory_and_from_the_file() {
        let mut spill = Spill::new(&std::env::temp_dir()).unwrap();
        let ray = |i: usize| Ray {
            origin: Point::new(500_000.0, 5_000_000.0 + i as f64, 100.0),
            end: Point::new(500_010.5, 5_000_000.25, 99.0),
            is_return: !i.is_multiple_of(3),
            stamp: Timestamp::from_ns(i as i64),
        };
        for i in 0..1000 {
            spill.add([i % 2, 7], &ray(i), Timestamp::from_ns((i / 600) as i64)).unwrap();
            if i == 500 {
                spill.flush().unwrap();
            }
        }
        for odd in 0..2 {
            let (mut found, mut windows) = (Vec::new(), Vec::new());
            let take = |entry| match entry {
                Entry::Ray(ray) => found.push(ray),
                Entry::WindowEnds(stamp) => windows.push((found.len(), stamp.ns)),
            };
            spill.each([odd, 7], take).unwrap();
            assert_eq!(found, (0..500).map(|i| ray(2 * i + odd)).collect::<Vec<_>>());
            assert_eq!(windows, [(0, 0), (300, 1)]);
        }
        assert_eq!((spill.rays([0, 7]), spill.rays([5, 5])), (500, 0));
    }
}
