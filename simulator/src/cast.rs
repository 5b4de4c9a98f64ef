//! One beam of the scanner: a cone of light, the echoes it makes, and what the device reports of them.
//!
//! In: origin and direction in the scene, a number for chance. Out: up to two ranges in metres, or a code below 16.
//! A beam is 15 mrad wide, so it is cast as seven rays: one in the middle, six on a ring. Rays that end within a
//! pulse length of each other make one echo at their energy's mean: that is the mixed pixel at an edge. The
//! strongest echo above the receiver's threshold is the range; what stays below it is lost, as dark bark is.
//! Figures: shared protocol notes on the LMS-151 (15 mrad, 12 mm, 18 m at 10 % remission, codes 0, 1, 3).

use crate::rng::{fraction, mix, normal};
use crate::scene::{Figure, Ray, Scene};
use crate::trace::{Hit, Kind};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// What the scanner's light can do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Optics {
    /// Full divergence of a beam, radians.
    pub divergence_rad: f64,
    /// Sigma of a range, metres.
    pub range_std_m: f64,
    /// Nothing is reported beyond, metres.
    pub range_max_m: f64,
    /// Nothing is reported nearer, metres: a real LMS111 reported 62 mm.
    pub range_min_m: f64,
    /// Range at which a tenth of the light coming back is just enough, metres.
    pub range_at_tenth_m: f64,
    /// Echoes nearer to each other than this merge into one, metres.
    pub merge_m: f64,
    /// Share of beams that are lost without a reason.
    pub lost_share: f64,
}

impl Default for Optics {
    fn default() -> Self {
        Self {
            divergence_rad: 0.015,
            range_std_m: 0.012,
            range_max_m: 50.0,
            range_min_m: 0.05,
            range_at_tenth_m: 18.0,
            merge_m: 0.6,
            lost_share: 0.002,
        }
    }
}

/// Something that came back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echo {
    /// Reported range, metres.
    pub range_m: f64,
    /// Light received, as a multiple of what is just enough.
    pub strength: f64,
    /// What most of it came from.
    pub kind: Kind,
}

/// What the device reports instead of a range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// Raw value 0.
    NoReturn,
    /// Raw value 1: the sun.
    Dazzled,
    /// Raw value 3: something, but too little or at an edge.
    TooWeak,
}

impl Code {
    /// The value on the wire.
    pub fn raw(self) -> u16 {
        match self {
            Self::NoReturn => 0,
            Self::Dazzled => 1,
            Self::TooWeak => 3,
        }
    }
}

/// What came of one beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BeamReturn {
    /// Nothing to measure.
    Nothing(Code),
    /// One or two echoes.
    Echoes {
        /// The nearest.
        first: Echo,
        /// The next, where there is one.
        second: Option<Echo>,
        /// The one with most light.
        strongest: Echo,
    },
}

impl BeamReturn {
    /// The range a one-echo device reports, metres.
    pub fn range_m(&self) -> Option<f64> {
        match self {
            Self::Nothing(_) => None,
            Self::Echoes { strongest, .. } => Some(strongest.range_m),
        }
    }
}

/// Rays a beam is cast as.
const RAYS: usize = 7;
/// Share of a beam's light in its middle ray; the six of the ring share the rest.
const MIDDLE_WEIGHT: f64 = 0.25;
/// Radius of the ring as a share of half the divergence.
const RING: f64 = 0.67;
/// Where the sun stands: azimuth 215 degrees, 28 degrees high.
const SUN: [f64; 3] = [-0.506_439, -0.723_270, 0.469_472];
/// Cosine of how near to the sun a beam is dazzled: 0.9 degrees.
const SUN_COSINE: f64 = 0.999_877;

impl Scene {
    /// Casts one beam from a place in the scene along a unit direction. `chance` decides noise and fate in leaves.
    pub fn cast(&self, optics: &Optics, beam: &Ray, chance: u64, figure: Option<&Figure>) -> BeamReturn {
        let figure = figure.filter(|f| f.near(beam, optics.divergence_rad));
        let mut hits = [None; RAYS];
        let mut count = 0;
        for (k, direction) in spread(beam.direction, optics.divergence_rad).into_iter().enumerate() {
            let ray = Ray { origin: beam.origin, direction };
            let weight = if k == 0 { MIDDLE_WEIGHT } else { (1.0 - MIDDLE_WEIGHT) / (RAYS - 1) as f64 };
            if let Some(hit) = self.trace(&ray, optics.range_max_m, mix(chance ^ k as u64), figure) {
                hits[count] = Some((hit, weight));
                count += 1;
            }
        }
        receive(optics, &mut hits[..count], beam, mix(chance ^ 0xEC40))
    }
}

/// Unit directions of a beam's rays: the middle, then the ring.
fn spread(direction: Vector3<f64>, divergence_rad: f64) -> [Vector3<f64>; RAYS] {
    let helper = if direction.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    let radius = RING * divergence_rad / 2.0;
    let u = direction.cross(&helper).normalize() * radius;
    let v = direction.cross(&u);
    let (half, tall) = (0.5, 3.0f64.sqrt() / 2.0);
    // The ring is so narrow that directions keep length 1 to 1.3e-5; ranges err by 0.6 mm at 50 m without this.
    let shrink = 1.0 / (1.0 + radius * radius).sqrt();
    let on = |a: f64, b: f64| (direction + u * a + v * b) * shrink;
    [direction, on(1.0, 0.0), on(half, tall), on(-half, tall), on(-1.0, 0.0), on(-half, -tall), on(half, -tall)]
}

/// What the receiver makes of the light that comes back.
fn receive(optics: &Optics, hits: &mut [Option<(Hit, f64)>], beam: &Ray, chance: u64) -> BeamReturn {
    let range_of = |h: &Option<(Hit, f64)>| h.map_or(f64::INFINITY, |(hit, _)| hit.range_m);
    hits.sort_by(|a, b| range_of(a).total_cmp(&range_of(b)));
    let mut echoes: [Option<Echo>; 2] = [None; 2];
    let (mut strongest, mut seen, mut best_lost): (Option<Echo>, usize, f64) = (None, 0, 0.0);
    let mut rest = hits.iter().flatten().peekable();
    while let Some(first) = rest.next() {
        let mut pulse = Pulse::new(first, optics);
        let mut last_m = first.0.range_m;
        while let Some(next) = rest.next_if(|n| n.0.range_m - last_m < optics.merge_m) {
            last_m = next.0.range_m;
            pulse.add(next, optics);
        }
        let echo = pulse.echo(optics, mix(chance ^ seen as u64));
        let usable = echo.strength >= 1.0 && (optics.range_min_m..optics.range_max_m).contains(&echo.range_m);
        if !usable {
            best_lost = echo.strength.max(best_lost);
            continue;
        }
        if let Some(place) = echoes.get_mut(seen) {
            *place = Some(echo);
        }
        seen += 1;
        if strongest.is_none_or(|s| echo.strength > s.strength) {
            strongest = Some(echo);
        }
    }
    let lost = fraction(mix(chance ^ 0x1057)) < optics.lost_share;
    match (echoes[0], strongest) {
        (Some(first), Some(strongest)) if !lost => BeamReturn::Echoes { first, second: echoes[1], strongest },
        _ => BeamReturn::Nothing(code_of(beam, best_lost, lost, chance)),
    }
}

fn code_of(beam: &Ray, best_lost: f64, lost: bool, chance: u64) -> Code {
    if !lost && beam.direction.dot(&Vector3::from(SUN)) > SUN_COSINE {
        return Code::Dazzled;
    }
    // A weak echo is noticed half of the time; the other half nothing is.
    if best_lost > 0.5 && fraction(mix(chance ^ 0xDA4)) < 0.5 { Code::TooWeak } else { Code::NoReturn }
}

/// Light of rays that end close together.
struct Pulse {
    energy: f64,
    moment: f64,
    brightest: f64,
    kind: Kind,
}

impl Pulse {
    fn new(part: &(Hit, f64), optics: &Optics) -> Self {
        let mut pulse = Self { energy: 0.0, moment: 0.0, brightest: 0.0, kind: part.0.kind };
        pulse.add(part, optics);
        pulse
    }

    fn add(&mut self, (hit, weight): &(Hit, f64), optics: &Optics) {
        // Light falls with the square of the range; nearer than a metre the receiver's optics cut it.
        let ratio = optics.range_at_tenth_m / hit.range_m.max(1.0);
        let energy = weight * hit.reflectance / 0.1 * ratio * ratio;
        self.energy += energy;
        self.moment += energy * hit.range_m;
        if energy > self.brightest {
            (self.brightest, self.kind) = (energy, hit.kind);
        }
    }

    fn echo(&self, optics: &Optics, chance: u64) -> Echo {
        let mean_m = if self.energy > 0.0 { self.moment / self.energy } else { 0.0 };
        Echo { range_m: mean_m + optics.range_std_m * normal(chance), strength: self.energy, kind: self.kind }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use crate::scene::{Ellipsoid, Rock, Slab, Terrain, TerrainSpec, Wall};

    fn walls(places: &[(f64, f64, f64)]) -> Scene {
        let spec = TerrainSpec {
            slope: 0.0,
            uphill_rad: 0.0,
            rolling_m: 0.0,
            roughness_m: 0.0,
            grass_cover: 0.0,
            grass_m: 0.0,
            ditch: None,
        };
        let wall = |&(x, from_y, reflectance): &(f64, f64, f64)| Wall {
            body: Slab {
                center: Vector3::new(x + 0.1, from_y + 20.0, 5.0),
                half_m: Vector3::new(0.1, 20.0, 5.0),
                along_rad: 0.0,
            },
            reflectance,
        };
        Scene::from_parts(Terrain::new(&spec, 1), vec![], vec![], vec![], places.iter().map(wall).collect())
    }

    fn beam(y: f64) -> Ray {
        Ray { origin: Vector3::new(0.0, y, 2.0), direction: Vector3::x() }
    }

    fn ranges(scene: &Scene, y: f64) -> Vec<f64> {
        let optics = Optics { lost_share: 0.0, ..Optics::default() };
        let mut rng = Rng::new(9);
        (0..2000).filter_map(|_| scene.cast(&optics, &beam(y), rng.bits(), None).range_m()).collect()
    }

    fn mean(values: &[f64]) -> f64 {
        values.iter().sum::<f64>() / values.len() as f64
    }

    #[test]
    fn a_wall_is_measured_at_its_range_with_12_mm_of_noise() {
        let measured = ranges(&walls(&[(10.0, -20.0, 0.5)]), 0.0);
        assert_eq!(measured.len(), 2000);
        let m = mean(&measured);
        let sigma = (measured.iter().map(|r| (r - m).powi(2)).sum::<f64>() / 2000.0).sqrt();
        // The ring's rays run 5 mrad aside: 10 / cos(0.005) is 0.1 mm longer.
        assert!((m - 10.0).abs() < 0.001 && (sigma - 0.012).abs() < 0.001, "{m} {sigma}");
    }

    #[test]
    fn an_edge_within_a_pulse_length_gives_a_range_that_nothing_has() {
        // The near wall covers y > 0, the far one everything: a beam along the edge sees both.
        let scene = walls(&[(10.0, 0.0, 0.5), (10.4, -20.0, 0.5)]);
        let m = mean(&ranges(&scene, -0.001));
        assert!(m > 10.1 && m < 10.35, "{m}");
    }

    #[test]
    fn an_edge_beyond_a_pulse_length_gives_two_echoes_and_the_stronger_is_the_range() {
        let scene = walls(&[(10.0, 0.0, 0.2), (12.0, -20.0, 0.9)]);
        let back = scene.cast(&Optics::default(), &beam(-0.001), 4, None);
        let BeamReturn::Echoes { first, second: Some(second), strongest } = back else { panic!("{back:?}") };
        assert!((first.range_m - 10.0).abs() < 0.06 && (second.range_m - 12.0).abs() < 0.06);
        assert_eq!(strongest, second);
    }

    #[test]
    fn a_dark_wall_is_lost_beyond_18_m_and_a_bright_one_is_not() {
        assert_eq!(ranges(&walls(&[(19.0, -20.0, 0.1)]), 0.0).len(), 0);
        assert_eq!(ranges(&walls(&[(17.0, -20.0, 0.1)]), 0.0).len(), 2000);
        assert_eq!(ranges(&walls(&[(35.0, -20.0, 0.5)]), 0.0).len(), 2000);
    }

    #[test]
    fn the_sun_dazzles_and_the_sky_is_empty() {
        let scene = walls(&[]);
        let look = |d: Vector3<f64>| {
            scene.cast(&Optics::default(), &Ray { origin: Vector3::z() * 2.0, direction: d.normalize() }, 1, None)
        };
        assert_eq!(look(Vector3::from(SUN)), BeamReturn::Nothing(Code::Dazzled));
        assert_eq!(look(Vector3::new(0.5, 0.5, 0.5)), BeamReturn::Nothing(Code::NoReturn));
    }

    #[test]
    fn a_rock_hides_the_ground_behind_it() {
        let flat = walls(&[]);
        let rock = Rock {
            body: Ellipsoid { center: Vector3::new(6.0, 0.0, 0.0), radii_m: Vector3::repeat(0.5) },
            reflectance: 0.4,
        };
        let scene = Scene::from_parts(flat.terrain.clone(), vec![], vec![], vec![rock], vec![]);
        let down = Ray { origin: Vector3::z() * 1.5, direction: Vector3::new(6.0, 0.0, -1.3).normalize() };
        let optics = Optics::default();
        let (with, without) = (scene.cast(&optics, &down, 2, None), flat.cast(&optics, &down, 2, None));
        assert!(with.range_m().unwrap() < without.range_m().unwrap() - 0.5);
    }
}
