//! Voxels against point clouds, as the thesis compares them: to insert a beam, to fetch a neighbourhood, memory.
//!
//! In: a recording, repeated with fresh noise until there are returns enough. Out: a [`Row`] for each store and number
//! of returns. To insert a beam means all that it says: the way is free, the end is occupied; so in a cloud the points
//! near the beam are found and lose (thesis (2-1) to (2-3)). Times are processor time of this thread.
#![allow(clippy::disallowed_methods, reason = "shell: measures processor time")]

mod stores;
mod way;

use super::measure::seconds;
use super::recording::Recording;
use serde::Serialize;
use stores::{List, Regions, Store, Tree, Voxels};
use tsense_geometry::{Global, Point};
use tsense_mapper::{Beam, BeamKind, MapError};
use tsense_simulator::Rng;

/// Radius of a neighbourhood, metres.
pub const NEAR_M: f64 = 0.5;
/// Neighbourhoods fetched for one figure.
const PLACES: usize = 100;
/// Processor time after which enough beams were timed, seconds; a scan is timed at least, a window at most.
const BUDGET_S: f64 = 0.3;
/// Scans of a window of evidence: a nod of 2.7 s.
const SCANS_A_WINDOW: usize = 68;
/// Noise of a repeated return, metres, as an LMS-151 has.
const NOISE_M: f64 = 0.012;
/// One beam in so many is timed in the clouds: spread over a scan, so that none profits from its neighbour.
const STRIDE: usize = 27;

/// What one store does with so many returns in it.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Which store.
    pub store: &'static str,
    /// Returns in it.
    pub returns: usize,
    /// To insert a beam, microseconds: the mean.
    pub insert_us: f64,
    /// To fetch what lies within [`NEAR_M`] of a return, microseconds: the mean.
    pub fetch_us: f64,
    /// Points or occupied voxels that such a neighbourhood holds: the mean.
    pub found: f64,
    /// Memory that it holds, megabytes.
    pub memory_mb: f64,
}

/// All stores, one after the other, each fed until it holds the last number of returns.
pub fn compare(recording: &Recording, returns: &[usize]) -> Result<Vec<Row>, MapError> {
    let middle = recording.low + (recording.high - recording.low).scaled(0.5);
    let mut rows = Vec::new();
    grow(&mut Voxels::new(middle)?, recording, returns, &mut rows);
    grow(&mut List::new(middle), recording, returns, &mut rows);
    grow(&mut Regions::new(middle, recording.low, recording.high), recording, returns, &mut rows);
    grow(&mut Tree::new(middle), recording, returns, &mut rows);
    Ok(rows)
}

fn grow(store: &mut dyn Store, recording: &Recording, returns: &[usize], rows: &mut Vec<Row>) {
    let mut stream = Stream { recording, scans: 0, returns: 0, random: Rng::new(7) };
    for wanted in returns {
        while stream.returns < *wanted {
            let (beams, ends_window) = stream.next_scan();
            if ends_window {
                store.end_window();
            }
            beams.iter().for_each(|beam| store.keep(beam));
        }
        let (held, memory_mb) = (stream.returns, store.bytes() as f64 / 1e6);
        let insert_us = time_inserts(store, &mut stream);
        let (fetch_us, found) = time_fetches(store, &stream.places());
        rows.push(Row { store: store.name(), returns: held, insert_us, fetch_us, found, memory_mb });
    }
}

/// Microseconds a beam; the ends of windows are included.
fn time_inserts(store: &mut dyn Store, stream: &mut Stream<'_>) -> f64 {
    let stride = if store.is_cloud() { STRIDE } else { 1 };
    let (mut spent_s, mut timed) = (0.0, 0);
    for _ in 0..SCANS_A_WINDOW {
        let (beams, ends_window) = stream.next_scan();
        let start = seconds();
        if ends_window {
            store.end_window();
        }
        for beam in beams.iter().step_by(stride) {
            store.insert(beam);
            timed += 1;
        }
        spent_s += seconds() - start;
        beams.iter().enumerate().filter(|(i, _)| i % stride != 0).for_each(|(_, beam)| store.keep(beam));
        if store.is_cloud() && spent_s > BUDGET_S {
            break;
        }
    }
    spent_s * 1e6 / f64::from(timed.max(1))
}

/// Microseconds a neighbourhood, and how much one holds.
fn time_fetches(store: &dyn Store, places: &[Point<Global>]) -> (f64, f64) {
    let (mut found, mut fetched, start) = (0, 0, seconds());
    loop {
        for place in places {
            found += store.near(*place);
        }
        fetched += places.len().max(1);
        let spent_s = seconds() - start;
        if spent_s > BUDGET_S / 10.0 || places.is_empty() {
            return (spent_s * 1e6 / fetched as f64, found as f64 / fetched as f64);
        }
    }
}

/// The recording without end.
struct Stream<'a> {
    recording: &'a Recording,
    scans: usize,
    returns: usize,
    random: Rng,
}

impl Stream<'_> {
    /// The next scan, and whether a window of evidence ends before it. The first time as recorded, then with new noise.
    fn next_scan(&mut self) -> (Vec<Beam>, bool) {
        let count = self.recording.scans.len();
        let mut beams = self.recording.scans[self.scans % count].beams.clone();
        if self.scans >= count {
            beams.iter_mut().filter(|beam| beam.kind == BeamKind::Hit).for_each(|beam| {
                let way = beam.end - beam.origin;
                let noise = self.random.normal(NOISE_M) / way.xyz.norm().max(0.1);
                beam.end = beam.end + way.scaled(noise);
            });
        }
        self.returns += beams.iter().filter(|beam| beam.kind == BeamKind::Hit).count();
        self.scans += 1;
        (beams, self.scans.is_multiple_of(SCANS_A_WINDOW))
    }

    /// Where neighbourhoods are fetched: at returns, as classification does, over all of the recording.
    fn places(&mut self) -> Vec<Point<Global>> {
        let returns = |scan: &super::recording::Scan| {
            let ends: Vec<_> = scan.beams.iter().filter(|b| b.kind == BeamKind::Hit).map(|b| b.end).collect();
            ends
        };
        let all: Vec<_> = self.recording.scans.iter().flat_map(returns).collect();
        (0..PLACES).filter_map(|_| all.get(self.random.bits() as usize % all.len().max(1)).copied()).collect()
    }
}
