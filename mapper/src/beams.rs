//! A scan becomes beams in the world: each beam with the pose and the pan-tilt angles of its own time.
//!
//! In: returns of one mirror turn (device angles, millimetres), the mount, and where the ladar is at any instant.
//! Out: [`Beam`]s in `Global`, metres, and the same as a `points` message. It decides what a return says
//! (hit, free space, nothing); it does not wait for data (see `placer`) and touches no voxel.
//! Source: thesis (2-9), (2-10).

use crate::ladar_mount::LadarMount;
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

/// A scan whose beams are in the world.
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

/// Instant of beam `i` of a scan.
pub fn beam_stamp(header: &ScanHeader, i: usize) -> Timestamp {
    Timestamp::from_ns(header.stamp_ns).plus_ns((header.beam_interval_ns * i as f64).round() as i64)
}

/// Places a scan. `global_from_ladar` gives thesis (2-10) at an instant; its first refusal refuses the scan.
pub fn place_scan(
    ladar: usize,
    mount: &LadarMount,
    header: &ScanHeader,
    returns: &[Return],
    mut global_from_ladar: impl FnMut(Timestamp) -> Result<Transform<Global, Ladar>, NoValue>,
) -> Result<PlacedScan, NoValue> {
    let middle = global_from_ladar(beam_stamp(header, returns.len() / 2))?.origin();
    let points_header = points_header(ladar, header, middle);
    let weight = Weight::new(mount.weight);
    let mut scan = PlacedScan {
        ladar,
        stamp: beam_stamp(header, 0),
        last: beam_stamp(header, returns.len().saturating_sub(1)),
        sweep: None,
        beams: Vec::with_capacity(returns.len()),
        points_header,
        points: Vec::with_capacity(returns.len()),
    };
    for (i, item) in returns.iter().enumerate() {
        let here = global_from_ladar(beam_stamp(header, i))?;
        let direction = here * beam_direction(header.start_rad + header.step_rad * i as f64);
        let origin = here.origin();
        scan.beams.extend(beam_of(mount, item, origin, direction, weight));
        scan.points.push(placed_return(mount, item, origin, direction, scan.points_header.origin_m));
    }
    Ok(scan)
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
    use bytemuck::Zeroable;
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

    fn driving_east(t: Timestamp) -> Result<Transform<Global, Ladar>, NoValue> {
        Ok(Transform::new(UnitQuaternion::identity(), Point::new(500_000.25 + t.as_seconds(), 0.0, 0.0)))
    }

    fn place(returns: &[Return]) -> PlacedScan {
        place_scan(3, &LadarMount::default(), &header(), returns, driving_east).unwrap()
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
    fn weights_are_quarters_and_never_nothing() {
        assert_eq!(Weight::new(1.0), Weight::FULL);
        assert_eq!(Weight::new(0.5).quarters(), 2);
        assert_eq!(Weight::new(1e-9).quarters(), 1);
        assert_eq!(Weight::new(f64::NAN).quarters(), 1);
        assert_eq!(Weight::new(9.0), Weight::FULL);
    }
}
