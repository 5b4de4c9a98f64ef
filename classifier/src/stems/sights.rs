//! What is seen of the space around a place: every beam towards it, in the coordinates of a stem that may stand there.
//!
//! In: the store of returns and a place. Out: a [`Sight`] per beam: how far beside the place it passes, at which height,
//! and where its echoes lie along its way. All echoes of one beam make one sight.

use super::background::narrow;
use super::config::StemsConfig;
use super::sight::{Place, Sight};
use crate::returns::{Beam, Returns, Station};

/// Beams whose directions differ by less than this are one beam with two echoes: sine of the angle.
const SAME_BEAM: f64 = 4e-4;
/// One sigma of the share of a beam's half width that sees edges, where the ladar sends several echoes: it changes with the
/// direction.
const SEEN_STD: f64 = 0.04;
/// Horizontal length below which a beam goes straight up or down, metres.
const PLUMB_M: f64 = 0.05;

/// Which beams of the store are wanted, and where they are wanted from.
pub struct Wanted<'a> {
    /// The store.
    pub returns: &'a Returns,
    /// The view's lowest corner in UTM, metres.
    pub corner_m: [f64; 3],
    /// How far beside the place, metres.
    pub aside_m: f64,
    /// How far apart above one another, metres: beams between are left out.
    pub spacing_m: f64,
    /// Widths and heights.
    pub config: &'a StemsConfig,
}

impl Wanted<'_> {
    /// The sights of a place from all stations.
    pub fn sights(&self, place: &Place) -> Vec<Sight> {
        let mut found = Vec::new();
        for station in self.returns.stations() {
            let base = station.base.to_array();
            let base_m: [f64; 3] = std::array::from_fn(|axis| base[axis] - self.corner_m[axis]);
            let away_m = (place.at_m[0] - base_m[0]).hypot(place.at_m[1] - base_m[1]);
            // Nearer than this the ladar would stand in the place itself.
            if (self.aside_m + 0.1..self.config.range_max_m).contains(&away_m) {
                self.of_station(&Seen { station, base_m }, place, &mut found);
            }
        }
        found
    }

    fn of_station(&self, seen: &Seen, place: &Place, found: &mut Vec<Sight>) {
        let [dx, dy] = [place.at_m[0] - seen.base_m[0], place.at_m[1] - seen.base_m[1]];
        let (away_m, azimuth) = (dx.hypot(dy), dy.atan2(dx));
        let half = (self.aside_m / away_m).min(1.0).asin();
        let height = |height_m: f64| (place.ground_m + height_m - seen.base_m[2]).atan2(away_m);
        let [low, high] = self.config.fit_m.map(height);
        let cells = self.returns.cells();
        let inside = |sight: &Sight| sight.is_inside(place, self.aside_m, self.config);
        let before = found.len();
        for beam in seen.station.towards(cells, azimuth - half..azimuth + half, low..high, self.step(away_m)) {
            let Some(sight) = seen.sight(beam, place, self.config) else { continue };
            match found[before..].last_mut() {
                Some(other) if same(other, &sight) => other.add_echo(sight.echoes_m[0]),
                _ => found.extend(Some(sight).filter(inside)),
            }
        }
        match self.returns.has_all_echoes(seen.station) {
            true => found[before..].iter_mut().for_each(|sight| {
                sight.half_std_m = SEEN_STD * sight.half_m;
                sight.half_m *= self.config.beam_seen_share;
            }),
            false => narrow(&mut found[before..], self.config),
        }
    }

    /// Every how many cells of elevation are enough at a distance: odd, so that no regular grid of beams is missed.
    fn step(&self, away_m: f64) -> u32 {
        (self.spacing_m / (away_m * self.returns.cells().edge_rad)) as u32 | 1
    }
}

/// A station, seen from the view.
struct Seen<'a> {
    station: &'a Station,
    /// Its base relative to the view's corner, metres.
    base_m: [f64; 3],
}

fn same(a: &Sight, b: &Sight) -> bool {
    (a.along[0] * b.along[1] - a.along[1] * b.along[0]).abs() < SAME_BEAM
        && (a.up_m - b.up_m).abs() < SAME_BEAM * a.ahead_m
        && (a.left_m - b.left_m).abs() < SAME_BEAM * a.ahead_m
}

impl Seen<'_> {
    fn sight(&self, beam: &Beam, place: &Place, config: &StemsConfig) -> Option<Sight> {
        let origin = self.station.origin_m(beam).map(f64::from);
        let way: [f64; 3] = std::array::from_fn(|axis| f64::from(beam.end_m[axis]) - origin[axis]);
        let length_m = (way[0] * way[0] + way[1] * way[1]).sqrt();
        if length_m < PLUMB_M {
            return None;
        }
        let per_m = 1.0 / length_m;
        let along = [way[0] * per_m, way[1] * per_m];
        let to: [f64; 2] = std::array::from_fn(|axis| place.at_m[axis] - self.base_m[axis] - origin[axis]);
        let ahead_m = along[0] * to[0] + along[1] * to[1];
        let rise = way[2] * per_m;
        let way_m = ahead_m * (1.0 + rise * rise).sqrt();
        let echo_m = if beam.is_return { length_m } else { f64::INFINITY };
        let half_m = (config.beam_exit_m + config.beam_divergence_rad * way_m) / 2.0;
        Some(Sight {
            along,
            ahead_m,
            left_m: along[0] * to[1] - along[1] * to[0],
            up_m: self.base_m[2] + origin[2] + rise * ahead_m - place.breast_m,
            half_m,
            spot_m: half_m,
            half_std_m: 0.0,
            echoes_m: [echo_m, f64::INFINITY],
        })
    }
}
