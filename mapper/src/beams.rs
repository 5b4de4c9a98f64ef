//! A scan becomes beams in the world: each beam with the pose and the pan-tilt angles of its own time.
//!
//! In: returns of one mirror turn (device angles, millimetres), the mount, and where the ladar is at any instant.
//! Out: [`Beam`]s in `Global`, metres, and the same as a `points` message. It decides what a return says
//! (hit, free space, nothing); it does not wait for data (see `placer`), allocates nothing once its buffers have grown, and
//! touches no voxel.
//! Source: thesis (2-9), (2-10).

use crate::ladar_mount::LadarMount;
use crate::motion::Stretch;
use bytemuck::Zeroable;
use nalgebra::{Point3, Vector3};
use std::ops::Range;
use tsense_contract::{PlacedReturn, PointsHeader, Return, ReturnKind, ScanHeader};
use tsense_geometry::{Global, Ladar, NoValue, Point, Timestamp, Transform, Vector, beam_direction};

/// What the end of a beam is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BeamKind {
    /// Something is there.
    Hit,
    /// Nothing is known beyond; the way up to it is free.
    NoReturn,
}

/// How much a beam counts against one of a ladar of weight 1: quarters, 1 to 4. Coarse, so that the marks of a voxel
/// hold the largest weight of its misses and of its hits in one byte, and merge by a single instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Weight(u8);

impl Weight {
    /// Weight 1.
    pub const FULL: Self = Self(4);

    /// The nearest quarter, at least one.
    pub fn new(weight: f64) -> Self {
        // NaN casts to 0, and so becomes the least weight.
        Self(((weight * 4.0).round().clamp(0.0, 4.0) as u8).max(1))
    }
    /// In quarters.
    pub const fn quarters(self) -> u8 {
        self.0
    }
}

/// One beam in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// The ladar at the beam's time.
    pub origin: Point<Global>,
    /// The echo, or the end of what the beam shows to be free.
    pub end: Point<Global>,
    /// What the end is.
    pub kind: BeamKind,
    /// How much it counts.
    pub weight: Weight,
}

/// A scan whose beams are in the world. Its memory is used again for the next one.
#[derive(Clone, Debug)]
pub struct PlacedScan {
    /// Index of the ladar in the list of mounts.
    pub ladar: usize,
    /// Instant of the first beam.
    pub stamp: Timestamp,
    /// Instant of the last beam.
    pub last: Timestamp,
    /// The nod in which the scan was taken; nothing for a ladar that does not nod.
    pub sweep: Option<u32>,
    /// Beams that say something about voxels.
    pub beams: Vec<Beam>,
    /// Header of the `points` message; the zone is the placer's to fill in.
    pub points_header: PointsHeader,
    /// All returns, placed.
    pub points: Vec<PlacedReturn>,
}

impl Default for PlacedScan {
    /// No scan yet.
    fn default() -> Self {
        Self {
            ladar: 0,
            stamp: Timestamp::from_ns(0),
            last: Timestamp::from_ns(0),
            sweep: None,
            beams: Vec::new(),
            points_header: PointsHeader::zeroed(),
            points: Vec::new(),
        }
    }
}

/// Instant of beam `i` of a scan.
pub fn beam_stamp(header: &ScanHeader, i: usize) -> Timestamp {
    Timestamp::from_ns(header.stamp_ns).plus_ns((header.beam_interval_ns * i as f64).round() as i64)
}

/// How far a placed point may lie from where its own pose would put it, metres: half of what is promised, 0.1 mm.
const PLACE_ERROR_MAX_M: f64 = 5e-5;

/// The farthest point that this holds for, metres: the longest range that a mount may be given.
const REACH_M: f64 = 200.0;

/// Places a scan into the memory of an earlier one. `stretch_at` gives thesis (2-10) from an instant on; its first
/// refusal refuses the scan. `lever_m` is how far the ladar is from the vehicle's origin at most.
///
/// Poses are computed at the ends of short spans, and between them the ladar's origin and its two axes in the scan plane
/// follow straight lines. Over a span of `h` seconds in which the ladar turns with `w` radians a second, a point at `r`
/// metres then errs by at most `(w h)^2 / 8 * (r + lever)`: the second derivative of a product of turns is bounded by the
/// square of their added rates. `h` is chosen to keep that below [`PLACE_ERROR_MAX_M`].
pub fn place_scan<F: Fn(Timestamp) -> Transform<Global, Ladar>>(
    scan: &mut PlacedScan,
    mount: &LadarMount,
    (header, returns): (&ScanHeader, &[Return]),
    (fan, lever_m): (&Fan, f64),
    mut stretch_at: impl FnMut(Timestamp) -> Result<Stretch<F>, NoValue>,
) -> Result<(), NoValue> {
    let middle = beam_stamp(header, returns.len() / 2);
    let middle = (stretch_at(middle)?.global_from_ladar)(middle).origin();
    (scan.stamp, scan.last) = (beam_stamp(header, 0), beam_stamp(header, returns.len().saturating_sub(1)));
    scan.points_header = points_header(scan.ladar, header, middle);
    scan.beams.clear();
    scan.points.clear();
    let mut first = 0;
    while first < returns.len() {
        let stretch = stretch_at(beam_stamp(header, first))?;
        let end = first + beams_until(header, first..returns.len(), stretch.until);
        let intervals = span_intervals(stretch.turn_rad_s, lever_m, header.beam_interval_ns);
        while first < end {
            let last = (end - 1).min(first.saturating_add(intervals));
            let ends = [first, last].map(|i| Axes::of(&(stretch.global_from_ladar)(beam_stamp(header, i))));
            place_span(scan, mount, (&returns[first..=last], &fan.directions[first..=last]), &ends);
            first = last + 1;
        }
    }
    Ok(())
}

/// How many beams of a range are not later than an instant: the first one at least.
fn beams_until(header: &ScanHeader, beams: Range<usize>, until: Timestamp) -> usize {
    let (mut sure, mut open) = (beams.start + 1, beams.end);
    while sure < open {
        let middle = sure + (open - sure) / 2;
        if beam_stamp(header, middle) <= until { sure = middle + 1 } else { open = middle }
    }
    sure - beams.start
}

/// Beam intervals of the longest span that is exact enough: at least one.
fn span_intervals(turn_rad_s: f64, lever_m: f64, interval_ns: f64) -> usize {
    let turn_max_rad = (8.0 * PLACE_ERROR_MAX_M / (REACH_M + lever_m)).sqrt();
    // A quotient by zero is infinite, and the cast saturates; NaN is 0.
    ((turn_max_rad / turn_rad_s / (interval_ns * 1e-9)) as usize).max(1)
}

/// Where the ladar is: its origin, and the axes that span its scan plane, in `Global`.
struct Axes {
    origin: Vector3<f64>,
    ahead: Vector3<f64>,
    right: Vector3<f64>,
}

impl Axes {
    fn of(here: &Transform<Global, Ladar>) -> Self {
        let axis = |x, y| (*here * Vector::<Ladar>::new(x, y, 0.0)).xyz;
        Self { origin: here.origin().xyz.coords, ahead: axis(1.0, 0.0), right: axis(0.0, 1.0) }
    }

    fn minus(&self, other: &Self) -> Self {
        Self { origin: self.origin - other.origin, ahead: self.ahead - other.ahead, right: self.right - other.right }
    }
}

/// Places the beams of one span, whose first and last leave the ladar at its two `ends`.
fn place_span(
    scan: &mut PlacedScan,
    mount: &LadarMount,
    (returns, directions): (&[Return], &[[f64; 2]]),
    [from, to]: &[Axes; 2],
) {
    let (weight, base_m) = (Weight::new(mount.weight), scan.points_header.origin_m);
    let (way, share) = (to.minus(from), 1.0 / (returns.len().max(2) - 1) as f64);
    for (i, (item, [x, y])) in returns.iter().zip(directions).enumerate() {
        let done = i as f64 * share;
        let origin = from.origin + way.origin * done;
        let direction = (from.ahead + way.ahead * done) * *x + (from.right + way.right * done) * *y;
        let (origin, direction) = (Point::from(Point3::from(origin)), Vector::from(direction));
        if let Some(beam) = beam_of(mount, item, origin, direction, weight) {
            scan.beams.push(beam);
        }
        scan.points.push(placed_return(mount, item, origin, direction, base_m));
    }
}

/// The directions of a ladar's beams in its own scan plane, ahead and right: computed when its angles change.
#[derive(Clone, Debug, Default)]
pub struct Fan {
    angles: [u64; 2],
    directions: Vec<[f64; 2]>,
}

impl Fan {
    /// Makes sure that it has the directions of the first `beams` beams of a scan.
    pub fn prepare(&mut self, header: &ScanHeader, beams: usize) {
        let angles = [header.start_rad.to_bits(), header.step_rad.to_bits()];
        if self.angles != angles {
            self.angles = angles;
            self.directions.clear();
        }
        for i in self.directions.len()..beams {
            let direction = beam_direction(header.start_rad + header.step_rad * i as f64);
            self.directions.push([direction.xyz.x, direction.xyz.y]);
        }
    }
}

/// What one return says, if anything. Dazzled and uncertain beams say nothing.
fn beam_of(
    mount: &LadarMount,
    item: &Return,
    origin: Point<Global>,
    direction: Vector<Global>,
    weight: Weight,
) -> Option<Beam> {
    let range_m = f64::from(item.distance_mm) / 1e3;
    let (kind, length_m) = match item.kind() {
        ReturnKind::Echo if range_m < mount.range_min_m => return None,
        ReturnKind::Echo if range_m > mount.range_max_m => (BeamKind::NoReturn, mount.range_max_m),
        ReturnKind::Echo => (BeamKind::Hit, range_m),
        ReturnKind::NoReturn => (BeamKind::NoReturn, mount.no_return_range_m),
        ReturnKind::Dazzled | ReturnKind::TooWeak | ReturnKind::Reserved => return None,
    };
    Some(Beam { origin, end: origin + direction.scaled(length_m), kind, weight })
}

fn placed_return(
    mount: &LadarMount,
    item: &Return,
    origin: Point<Global>,
    direction: Vector<Global>,
    base_m: [f64; 3],
) -> PlacedReturn {
    let echo = item.kind() == ReturnKind::Echo;
    let range_m = if echo { f64::from(item.distance_mm) / 1e3 } else { mount.no_return_range_m };
    let end = (origin + direction.scaled(range_m)).to_array();
    let xyz_m = std::array::from_fn(|axis| (end[axis] - base_m[axis]) as f32);
    PlacedReturn { xyz_m, remission: item.remission, kind: item.kind, reserved: 0 }
}

/// The origin is the ladar's place rounded down to whole metres, so that f32 keeps tenths of millimetres.
fn points_header(ladar: usize, header: &ScanHeader, middle: Point<Global>) -> PointsHeader {
    let at_m = middle.to_array();
    let origin_m = at_m.map(f64::floor);
    PointsHeader {
        stamp_ns: header.stamp_ns,
        origin_m,
        ladar_m: std::array::from_fn(|axis| (at_m[axis] - origin_m[axis]) as f32),
        zone: 0,
        south: 0,
        ladar: ladar as u8,
        reserved: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    fn echo(distance_mm: u32) -> Return {
        Return { distance_mm, remission: 7, kind: ReturnKind::Echo.to_wire(), code: 0 }
    }

    fn coded(kind: ReturnKind) -> Return {
        Return { distance_mm: 0, remission: 0, kind: kind.to_wire(), code: 1 }
    }

    /// Three beams to the right, ahead, left; the ladar moves 1 m east a second.
    fn header() -> ScanHeader {
        ScanHeader {
            stamp_ns: 0,
            beam_interval_ns: 1e9,
            start_rad: 0.0,
            step_rad: std::f64::consts::FRAC_PI_2,
            ..ScanHeader::zeroed()
        }
    }

    fn driving_east(t: Timestamp) -> Transform<Global, Ladar> {
        Transform::new(UnitQuaternion::identity(), Point::new(500_000.25 + t.as_seconds(), 0.0, 0.0))
    }

    fn place(returns: &[Return]) -> PlacedScan {
        let (mut scan, mut fan) = (PlacedScan { ladar: 3, ..PlacedScan::default() }, Fan::default());
        fan.prepare(&header(), returns.len());
        let stretch = |stamp: Timestamp| {
            let until = stamp.plus_ns(500_000_000);
            Ok(Stretch { until, turn_rad_s: 0.0, global_from_ladar: driving_east })
        };
        place_scan(&mut scan, &LadarMount::default(), (&header(), returns), (&fan, 0.0), stretch).unwrap();
        scan
    }

    #[test]
    fn every_beam_leaves_from_where_the_ladar_is_at_its_own_time() {
        let scan = place(&[echo(2000), echo(3000), echo(4000)]);
        let origins: Vec<_> = scan.beams.iter().map(|b| b.origin.x()).collect();
        assert_eq!(origins, vec![500_000.25, 500_001.25, 500_002.25]);
        assert!((scan.beams[1].end.x() - 500_004.25).abs() < 1e-9, "x of the ladar is straight ahead");
        assert!((scan.beams[2].end.y() + 4.0).abs() < 1e-9, "y of the ladar is to the right");
        assert_eq!(scan.last, Timestamp::from_seconds(2.0));
    }

    #[test]
    fn points_are_relative_to_whole_metres_at_the_middle_of_the_scan() {
        let scan = place(&[echo(2000), echo(3000), coded(ReturnKind::NoReturn)]);
        assert_eq!(scan.points_header.origin_m, [500_001.0, 0.0, 0.0]);
        assert_eq!(scan.points_header.ladar_m, [0.25, 0.0, 0.0]);
        assert_eq!(scan.points_header.ladar, 3);
        assert_eq!(scan.points[1].xyz_m[0], 3.25);
        assert_eq!(scan.points[1].remission, 7);
        assert!((scan.points[2].xyz_m[1] + 10.0).abs() < 1e-6, "without an echo it ends at the usable range");
    }

    #[test]
    fn a_return_is_a_hit_free_space_or_nothing() {
        let kind = |item| place(&[item, item, item]).beams.first().map(|b| (b.kind, (b.end - b.origin).length()));
        let near = |found: Option<(BeamKind, f64)>, kind, length: f64| {
            let (k, l) = found.unwrap();
            assert!(k == kind && (l - length).abs() < 1e-6, "{k:?} {l}");
        };
        near(kind(echo(19_999)), BeamKind::Hit, 19.999);
        near(kind(echo(25_000)), BeamKind::NoReturn, 20.0);
        near(kind(coded(ReturnKind::NoReturn)), BeamKind::NoReturn, 10.0);
        assert_eq!(kind(echo(400)), None, "the vehicle itself");
        assert_eq!(kind(coded(ReturnKind::Dazzled)), None);
        assert_eq!(kind(coded(ReturnKind::TooWeak)), None);
    }

    #[test]
    fn a_stretch_ends_with_its_last_beam_and_a_span_before_it_turns_too_far() {
        let until = |s: f64| beams_until(&header(), 1..5, Timestamp::from_seconds(s));
        assert_eq!([until(0.0), until(1.0), until(2.9), until(3.0), until(99.0)], [1, 1, 2, 3, 4]);
        // sqrt(8 * 0.05 mm / 200 m) = 1.414 mrad: at 1 rad/s 1.414 ms, 50 intervals of 28 us.
        assert_eq!(span_intervals(1.0, 0.0, 28_000.0), 50);
        assert_eq!(span_intervals(1e9, 0.0, 28_000.0), 1);
        assert!(span_intervals(0.0, 0.0, 28_000.0) > 1081 && span_intervals(0.0, 0.0, 0.0) >= 1);
    }

    #[test]
    fn weights_are_quarters_and_never_nothing() {
        assert_eq!(Weight::new(1.0), Weight::FULL);
        assert_eq!(Weight::new(0.5).quarters(), 2);
        assert_eq!(Weight::new(1e-9).quarters(), 1);
        assert_eq!(Weight::new(f64::NAN).quarters(), 1);
        assert_eq!(Weight::new(9.0), Weight::FULL);
    }
}
