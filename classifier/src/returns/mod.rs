//! The store of returns: the beams behind the voxels, for fits finer than a voxel.
//!
//! In: beams (origin, end, whether something was there) in UTM, metres, in the order of arrival. Out: the returns of each
//! column ([`ReturnColumns`]) and the beams from each place towards a direction ([`Returns::stations`]), those that
//! pass beside a thing among them. Memory is bounded three times: beams in a cell of direction of one station, beams in
//! all, stations in all; the oldest station goes first, as the map behind a vehicle does, and everything that goes is
//! counted. The choice is by order of arrival, never random.

mod columns;
mod config;
mod points;
mod station;

pub use columns::{ColumnReturn, ReturnColumns};
pub use config::ReturnsConfig;
pub use points::Points;
pub use station::{Beam, Cells, Station};

use std::collections::{BTreeMap, VecDeque};
use tsense_geometry::{COORDINATE_MAX_M, Global, Point, Timestamp};

/// A beam as it comes in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedBeam {
    /// Index of the ladar.
    pub ladar: u8,
    /// When it was sent.
    pub stamp: Timestamp,
    /// The ladar at that time.
    pub origin: Point<Global>,
    /// The echo, or the end of what the beam shows to be free.
    pub end: Point<Global>,
    /// Whether something is there.
    pub is_return: bool,
}

/// How many beams are not in the store, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReturnDrops {
    /// Not finite, off the Earth, without a length, or one origin too many for a station.
    pub bad: u64,
    /// Their cell of direction was full.
    pub thinned: u64,
    /// Their station was the oldest when the store was full.
    pub full: u64,
    /// Their station was too old, or too far behind.
    pub left: u64,
}

/// The beams of the last while.
#[derive(Clone, Debug)]
pub struct Returns {
    config: ReturnsConfig,
    stations: VecDeque<Station>,
    /// Stations that went before the first of `stations`: numbers of stations never change.
    gone: u64,
    /// Number of the station that gathers, for each ladar and cube of origins.
    open: BTreeMap<(u8, [i64; 3]), u64>,
    beams: usize,
    points: Points,
    drops: ReturnDrops,
}

impl Returns {
    /// An empty store.
    pub fn new(config: &ReturnsConfig) -> Self {
        let (stations, open) = (VecDeque::new(), BTreeMap::new());
        let (points, drops) = (Points::default(), ReturnDrops::default());
        Self { config: config.clone(), stations, gone: 0, open, beams: 0, points, drops }
    }

    /// Takes a beam in.
    pub fn insert(&mut self, beam: &PlacedBeam) {
        let (origin, end) = (beam.origin.to_array(), beam.end.to_array());
        let on_earth = origin.iter().chain(&end).all(|c| c.abs() <= COORDINATE_MAX_M);
        if !on_earth || origin == end {
            self.drops.bad += 1;
            return;
        }
        let cells = self.cells();
        let number = self.station_of(beam);
        let station = &mut self.stations[(number - self.gone) as usize];
        match station.push(beam.stamp, beam.origin, beam.end, beam.is_return, cells) {
            true => self.beams += 1,
            false => self.drops.bad += 1,
        }
        self.make_room();
    }

    /// Takes in a return of which nobody knows where its beam came from.
    pub fn insert_point(&mut self, at: Point<Global>) {
        match at.to_array().iter().all(|c| c.abs() <= COORDINATE_MAX_M) {
            false => self.drops.bad += 1,
            true if self.points.ends_m.len() >= self.config.beams_max => self.drops.full += 1,
            true => self.points.push(at),
        }
    }

    /// Returns without a beam.
    pub fn points(&self) -> &Points {
        &self.points
    }

    /// The number of the station that gathers for this beam's ladar and place.
    fn station_of(&mut self, beam: &PlacedBeam) -> u64 {
        let cube = beam.origin.to_array().map(|c| floor(c / self.config.station_m));
        let key = (beam.ladar, cube);
        if let Some(&number) = self.open.get(&key).filter(|&&number| number >= self.gone) {
            let station = &self.stations[(number - self.gone) as usize];
            if beam.stamp.seconds_since(station.opened) <= self.config.station_s {
                return number;
            }
        }
        let number = self.gone + self.stations.len() as u64;
        self.stations.push_back(Station::new(beam.ladar, beam.origin, beam.stamp));
        self.open.insert(key, number);
        number
    }

    /// Thins what arrived since, then drops the oldest stations until the bounds hold; never the only one.
    fn make_room(&mut self) {
        if self.beams > self.config.beams_max {
            self.settle();
        }
        while self.stations.len() > 1
            && (self.beams > self.config.beams_max || self.stations.len() > self.config.stations_max)
        {
            self.drops.full += self.drop_oldest() as u64;
        }
        // The only station is full: it starts anew.
        if self.beams > self.config.beams_max {
            self.drops.full += self.drop_oldest() as u64;
        }
    }

    fn drop_oldest(&mut self) -> usize {
        let Some(station) = self.stations.pop_front() else { return 0 };
        self.gone += 1;
        self.beams -= station.beams().len();
        let gone = self.gone;
        self.open.retain(|_, number| *number >= gone);
        station.beams().len()
    }

    /// Forgets stations farther than `reach_m` from `center` on the ground, and those too old at `now`. Stations leave
    /// in the order in which they came: one that is needed keeps those after it.
    pub fn roll(&mut self, center: Point<Global>, reach_m: f64, now: Timestamp) {
        while let Some(oldest) = self.stations.front() {
            let away_m = (oldest.base.x() - center.x()).hypot(oldest.base.y() - center.y());
            if away_m <= reach_m && now.seconds_since(oldest.newest) <= self.config.age_max_s {
                break;
            }
            self.drops.left += self.drop_oldest() as u64;
        }
    }

    /// Forgets everything: another zone, or a jump of the pose.
    pub fn clear(&mut self) {
        self.drops.left += std::mem::take(&mut self.points).ends_m.len() as u64;
        while !self.stations.is_empty() {
            self.drops.left += self.drop_oldest() as u64;
        }
    }

    /// Sorts and thins what arrived since the last time: call it before beams are read.
    pub fn settle(&mut self) {
        let cells = self.cells();
        for station in &mut self.stations {
            let thinned = station.settle(self.config.per_cell_max, cells);
            self.beams -= thinned;
            self.drops.thinned += thinned as u64;
        }
    }

    /// All beams were looked at: those that come in from now on are fresh.
    pub fn seen(&mut self) {
        self.stations.iter_mut().for_each(Station::seen);
    }

    /// The stations, oldest first.
    pub fn stations(&self) -> impl ExactSizeIterator<Item = &Station> {
        self.stations.iter()
    }

    /// Whether the beams of a station come with all of their echoes; else each comes with its strongest.
    pub fn has_all_echoes(&self, station: &Station) -> bool {
        !self.config.single_echo && station.has_echo_pairs()
    }

    /// The cells of direction that stations are sorted by.
    pub fn cells(&self) -> Cells {
        Cells { edge_rad: self.config.cell_rad }
    }

    /// Number of beams.
    pub fn len(&self) -> usize {
        self.beams
    }

    /// True where there is no beam.
    pub fn is_empty(&self) -> bool {
        self.beams == 0
    }

    /// What is not in the store.
    pub fn drops(&self) -> ReturnDrops {
        self.drops
    }
}

/// The whole number at or below; written out, it needs no call.
fn floor(value: f64) -> i64 {
    let cut = value as i64;
    cut - i64::from(value < cut as f64)
}

#[cfg(test)]
mod tests;
