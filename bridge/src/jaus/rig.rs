//! What sits where on the vehicle: the ladars, and the pan-tilt unit that carries them, with its angles over time.
//!
//! In: the mounts, topic `joint`. Out: a ladar's place at an instant, and the AS6057 reports of a pan-tilt unit: pan is
//! joint 1, a right-handed turn about the base's z (down); tilt is joint 2, about the panned y (right).

use crate::ros2::Mount;
use tsense_contract::{JOINT_LIMIT_HIT, Joint};
use tsense_geometry::{
    Ladar, Limits, Mounting, PanTiltAngles, Timestamp, Trajectory, Transform, Vehicle, vehicle_from_ladar,
};
use tsense_jaus::Id;
use tsense_jaus::message::pose::{ReportPanTiltJointPositions, ReportPanTiltSpecifications};
use tsense_jaus::message::range::{OnJoint, Placement, SensorMount};
use tsense_jaus::message::scaled::{Angle32, JointBound, JointSpeed, Offset, Unit};

/// The joint that ladars move with: tilt.
const TILT_JOINT: u8 = 2;
/// Angles are taken at a scan's own time: between two readings that are no farther apart than the mapper allows by default.
const LIMITS: Limits = Limits { capacity: 512, gap_max_s: 0.25, extrapolation_max_s: 0.0 };

/// The pan-tilt unit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Head {
    /// Its base on the vehicle.
    pub mount: Mounting,
    /// Least and most pan that it is driven to, degrees.
    pub pan_deg: [f64; 2],
    /// Least and most tilt that it is driven to, degrees.
    pub tilt_deg: [f64; 2],
    /// Highest speeds that it is driven at, pan and tilt, degrees per second.
    pub speed_deg_s: [f64; 2],
}

/// Everything that is bolted to the vehicle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    /// The pan-tilt unit, where there is one; it carries all ladars.
    pub head: Option<Head>,
    /// The ladars, numbered from 1 in this order.
    pub ladars: Vec<Mount>,
}

/// The pan-tilt unit and its newest angles.
#[derive(Debug)]
pub struct PanTilt {
    head: Head,
    angles: Trajectory<PanTiltAngles>,
}

impl PanTilt {
    /// Before the first reading.
    pub fn new(head: Head) -> Self {
        Self { head, angles: Trajectory::new(LIMITS) }
    }

    /// Takes a reading; false where it is none or no newer.
    pub fn take(&mut self, joint: &Joint) -> bool {
        let good = joint.pan_rad.is_finite() && joint.tilt_rad.is_finite() && joint.flags & JOINT_LIMIT_HIT == 0;
        good && self.angles.push(Timestamp::from_ns(joint.stamp_ns), joint.angles())
    }

    /// Where it looks, by its newest reading.
    pub fn positions(&self) -> Option<ReportPanTiltJointPositions> {
        let PanTiltAngles { pan_rad, tilt_rad } = self.angles.last()?.1;
        Some(ReportPanTiltJointPositions { pan: Angle32(pan_rad), tilt: Angle32(tilt_rad) })
    }

    /// Where it sits and how far it is driven: what the unit could do beyond that is not known here.
    pub fn specifications(&self, wanted: u8) -> ReportPanTiltSpecifications {
        let place = placement(&self.head.mount);
        let has = |bit: u8| wanted >> bit & 1 == 1;
        let [pan_min, pan_max] = self.head.pan_deg.map(|deg| JointBound(deg.to_radians()));
        let [tilt_min, tilt_max] = self.head.tilt_deg.map(|deg| JointBound(deg.to_radians()));
        let [pan_speed, tilt_speed] = self.head.speed_deg_s.map(|deg| JointSpeed(deg.to_radians()));
        ReportPanTiltSpecifications {
            x: has(0).then_some(place.x),
            y: has(1).then_some(place.y),
            z: has(2).then_some(place.z),
            d: has(3).then_some(place.d),
            a: has(4).then_some(place.a),
            b: has(5).then_some(place.b),
            c: has(6).then_some(place.c),
            pan_min,
            pan_max,
            pan_speed,
            tilt_min,
            tilt_max,
            tilt_speed,
        }
    }
}

/// A ladar on the vehicle at an instant; none where its head's angles are not known there.
pub fn ladar_at(head: Option<&PanTilt>, mount: &Mount, at: Timestamp) -> Option<Transform<Vehicle, Ladar>> {
    let Some(unit) = head else { return Some(mount.tilt_from_ladar.transform()) };
    let angles = unit.angles.at(at).ok()?;
    Some(vehicle_from_ladar(unit.head.mount.transform(), angles, mount.tilt_from_ladar.transform()))
}

/// What a ladar is bolted to: the tilting part of the unit that `id` reports, or the vehicle where there is none.
pub fn sensor_mount(head: Option<&PanTilt>, mount: &Mount, id: Id) -> SensorMount {
    let place = placement(&mount.tilt_from_ladar);
    if head.is_none() {
        return SensorMount::OnVehicle(place);
    }
    let (subsystem, node, component) = (id.subsystem(), id.node(), id.component());
    SensorMount::OnJoint(OnJoint { subsystem, node, component, joint: TILT_JOINT, place })
}

fn placement(mounting: &Mounting) -> Placement {
    let to_parent = mounting.transform::<Vehicle, Ladar>().isometry;
    let ([x, y, z], q) = ([mounting.x_m, mounting.y_m, mounting.z_m].map(Offset), to_parent.rotation);
    Placement { x, y, z, d: Unit(q.w), a: Unit(q.i), b: Unit(q.j), c: Unit(q.k) }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use nalgebra::Point3;
    use tsense_jaus::message::range::RangePoint;

    /// One ladar 0.2 m ahead of and 0.1 m above the point where the axes of a head cross, 1 m ahead and 2 m up.
    pub fn rig() -> Rig {
        let tilt_from_ladar = Mounting { x_m: 0.2, z_m: -0.1, ..Mounting::default() };
        let ladar = Mount { name: "ladar".into(), range_min_m: 0.5, range_max_m: 50.0, tilt_from_ladar };
        let mount = Mounting { x_m: 1.0, z_m: -2.0, ..Mounting::default() };
        let head = Head { mount, pan_deg: [0.0; 2], tilt_deg: [-30.0, 15.0], speed_deg_s: [20.0, 40.0] };
        Rig { head: Some(head), ladars: vec![ladar] }
    }

    /// Where a point is, metres: what a peer makes of range, bearing and inclination.
    pub fn place(point: &RangePoint) -> Point3<f64> {
        let (r, b, i) = (point.range.0, point.bearing.0, point.inclination.0);
        Point3::new(r * i.cos() * b.cos(), r * i.cos() * b.sin(), -r * i.sin())
    }

    /// A reading.
    pub fn joint(stamp_ns: i64, pan_rad: f64, tilt_rad: f64) -> Joint {
        Joint { stamp_ns, pan_rad, tilt_rad, ..Joint::zeroed() }
    }

    #[test]
    fn readings_that_are_none_are_not_taken() {
        let mut unit = PanTilt::new(rig().head.unwrap());
        assert!(unit.take(&joint(10, 0.1, 0.2)));
        assert!(!unit.take(&joint(10, 0.1, 0.3)), "no newer");
        assert!(!unit.take(&joint(20, f64::NAN, 0.3)));
        assert!(!unit.take(&Joint { flags: JOINT_LIMIT_HIT, ..joint(30, 0.1, 0.3) }));
        assert_eq!(unit.positions().unwrap().tilt.0, 0.2);
    }
}
