//! Whether beams were aimed at a place on the ground and went on behind it: ground that is not where it was expected.
//!
//! In: the store of beams and a place on the expected ground, relative to the view's corner, metres. Out: yes or no. It
//! looks at some stations alone: live at the newest, a nod and a half of a vehicle that drives.

use crate::returns::{Beam, Returns, Station};
use std::ops::Range;

/// Stations that are looked at: three seconds at 1 m/s.
pub const STATIONS: usize = 12;
/// A beam is aimed at a place when it passes this near beside and above it, metres: less than a row of voxels.
const ASIDE_M: f64 = 0.15;
const ABOVE_M: f64 = 0.12;
/// It went on when it ended this far behind, metres.
const BEHIND_M: f64 = 0.3;
/// Origins of a station lie this near to its base, metres.
const ORIGINS_M: f64 = 0.3;
/// Nearer and farther places are not looked for, metres: beams farther away graze.
const RANGE_M: Range<f64> = 1.0..12.0;

/// The beams, and what was asked of them.
pub struct Aimed<'a> {
    returns: &'a Returns,
    corner_m: [f64; 3],
    stations: Range<usize>,
    /// By column: many walks ask of the same one.
    answers: Vec<Option<bool>>,
}

impl<'a> Aimed<'a> {
    /// Nothing was asked yet of so many columns. The store is settled; the corner is the view's lowest in UTM, metres.
    pub fn new(returns: &'a Returns, corner_m: [f64; 3], columns: usize, stations: Range<usize>) -> Self {
        Self { returns, corner_m, stations, answers: vec![None; columns] }
    }

    /// Whether some beam was aimed at the ground of a column and went on behind it.
    pub fn went_on_behind(&mut self, column: usize, place_m: [f64; 3]) -> bool {
        if let Some(answer) = self.answers[column] {
            return answer;
        }
        let mut stations = self.returns.stations().skip(self.stations.start).take(self.stations.len());
        let answer = stations.any(|station| self.of_station(station, place_m));
        self.answers[column] = Some(answer);
        answer
    }

    fn of_station(&self, station: &Station, place_m: [f64; 3]) -> bool {
        let base = station.base.to_array();
        let to: [f64; 3] = std::array::from_fn(|axis| place_m[axis] + self.corner_m[axis] - base[axis]);
        let (away_m, azimuth) = (to[0].hypot(to[1]), to[1].atan2(to[0]));
        if !RANGE_M.contains(&away_m) {
            return false;
        }
        let (half, elevation) = ((ORIGINS_M + ASIDE_M) / away_m, to[2].atan2(away_m));
        let (azimuths, elevations) = (azimuth - half..azimuth + half, elevation - half..elevation + half);
        station.towards(self.returns.cells(), azimuths, elevations, 1).any(|beam| passes(station, beam, to))
    }
}

/// Whether a beam passes close to a place, relative to the station's base, and ends behind it.
fn passes(station: &Station, beam: &Beam, to: [f64; 3]) -> bool {
    let origin = station.origin_m(beam).map(f64::from);
    let way: [f64; 3] = std::array::from_fn(|axis| f64::from(beam.end_m[axis]) - origin[axis]);
    let length_m = (way[0] * way[0] + way[1] * way[1]).sqrt().max(1e-6);
    let [x, y] = [way[0] / length_m, way[1] / length_m];
    let [dx, dy, dz] = [0, 1, 2].map(|axis| to[axis] - origin[axis]);
    let (ahead_m, aside_m) = (x * dx + y * dy, x * dy - y * dx);
    let above_m = way[2] / length_m * ahead_m - dz;
    aside_m.abs() <= ASIDE_M && above_m.abs() <= ABOVE_M && length_m >= ahead_m + BEHIND_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::returns::{PlacedBeam, ReturnsConfig};
    use tsense_geometry::{Point, Timestamp};

    #[test]
    fn a_beam_into_a_ditch_went_on_behind_its_edge_and_one_that_met_ground_did_not() {
        let corner_m = [369_000.0, 3_279_000.0, 30.0];
        let mut returns = Returns::new(&ReturnsConfig::default());
        let at = |[x, y, z]: [f64; 3]| Point::new(corner_m[0] + x, corner_m[1] + y, corner_m[2] + z);
        // From 2 m above the ground at 1 m; it passes the ground at 6 m and ends 0.4 m deeper at 7 m. Beside it ground is met.
        for end in [[7.0, 5.0, 0.6], [6.0, 6.0, 1.0]] {
            let (origin, end) = (at([1.0, 5.0, 3.0]), at(end));
            returns.insert(&PlacedBeam { ladar: 0, stamp: Timestamp::default(), origin, end, is_return: true });
        }
        returns.settle();
        let mut aimed = Aimed::new(&returns, corner_m, 4, 0..1);
        assert!(aimed.went_on_behind(0, [6.0, 5.0, 1.0]));
        assert!(!aimed.went_on_behind(1, [6.0, 6.0, 1.0]), "it ends there");
        assert!(!aimed.went_on_behind(2, [6.0, 5.6, 1.0]), "no beam went there");
        assert!(!aimed.went_on_behind(3, [3.0, 5.0, 1.0]), "the beam is a metre higher there");
    }
}
