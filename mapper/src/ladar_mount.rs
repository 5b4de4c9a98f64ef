//! Where a ladar sits and how far it is to be believed: what the mapper takes from a `[[ladar]]` section.

use tsense_contract::{Checks, Fault};
use tsense_geometry::{Ladar, Mounting, PanTiltAngles, PanTiltBase, Tilt, Transform, Vehicle, vehicle_from_ladar};

/// One ladar. The root program builds a list of these; a ladar's index in it is its number in messages.
#[derive(Clone, Debug, PartialEq)]
pub struct LadarMount {
    /// Name, the instance of its `scan` topic.
    pub name: String,
    /// Sits on the pan-tilt unit; otherwise its angles are always zero.
    pub on_pan_tilt: bool,
    /// The pan-tilt unit's base in the vehicle (T_base^V).
    pub vehicle_from_base: Mounting,
    /// The ladar in the tilting body (T_L^tilt).
    pub tilt_from_ladar: Mounting,
    /// Echoes nearer than this are the vehicle itself or the window: they count for nothing, metres.
    pub range_min_m: f64,
    /// Echoes farther than this show free space up to here and no more, metres.
    pub range_max_m: f64,
    /// A beam without an echo shows free space up to here, metres: a dark surface beyond returns nothing.
    pub no_return_range_m: f64,
    /// How much its evidence counts, above 0 to 1, in quarters.
    pub weight: f64,
}

impl Default for LadarMount {
    fn default() -> Self {
        Self {
            name: "ladar".into(),
            on_pan_tilt: true,
            vehicle_from_base: Mounting::default(),
            tilt_from_ladar: Mounting::default(),
            range_min_m: 0.5,
            range_max_m: 20.0,
            no_return_range_m: 10.0,
            weight: 1.0,
        }
    }
}

/// The constant transforms of a mount, computed once.
#[derive(Clone, Copy, Debug)]
pub struct Extrinsics {
    on_pan_tilt: bool,
    vehicle_from_base: Transform<Vehicle, PanTiltBase>,
    tilt_from_ladar: Transform<Tilt, Ladar>,
}

impl Extrinsics {
    /// Whether the angles of the pan-tilt unit matter.
    pub fn on_pan_tilt(&self) -> bool {
        self.on_pan_tilt
    }

    /// Farthest that the ladar's own origin can be from the vehicle's, metres.
    pub fn lever_m(&self) -> f64 {
        let origin_m = |xyz: [f64; 3]| xyz.iter().map(|c| c * c).sum::<f64>().sqrt();
        origin_m(self.vehicle_from_base.origin().to_array()) + origin_m(self.tilt_from_ladar.origin().to_array())
    }

    /// Thesis (2-9) at given angles.
    pub fn vehicle_from_ladar(&self, angles: PanTiltAngles) -> Transform<Vehicle, Ladar> {
        vehicle_from_ladar(self.vehicle_from_base, angles, self.tilt_from_ladar)
    }
}

impl LadarMount {
    /// The constant transforms of this mount.
    pub fn extrinsics(&self) -> Extrinsics {
        Extrinsics {
            on_pan_tilt: self.on_pan_tilt,
            vehicle_from_base: self.vehicle_from_base.transform(),
            tilt_from_ladar: self.tilt_from_ladar.transform(),
        }
    }

    /// All faults of the figures the mapper uses.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        let (min, max) = (self.range_min_m, self.range_max_m);
        check.require((0.0..10.0).contains(&min), "range_min_m", min, "from 0 to below 10 m");
        check.require(max > min && max <= 200.0, "range_max_m", max, "above range_min_m, up to 200 m");
        let clear = self.no_return_range_m;
        check.require(clear >= 0.0 && clear <= max, "no_return_range_m", clear, "from 0 to range_max_m");
        check.require(self.weight > 0.0 && self.weight <= 1.0, "weight", self.weight, "above 0, up to 1");
        check.into_faults()
    }
}
