//! What stands on the ground, and where a ray meets it: closed formulas, no meshes.
//!
//! In: rays with unit direction, metres in the scene's frame. Out: the distance along the ray where it first
//! meets a solid from outside, with the cosine of incidence; for porous bodies the interval inside.

use nalgebra::Vector3;

/// A half line with unit direction.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts, metres.
    pub origin: Vector3<f64>,
    /// Its direction, length 1.
    pub direction: Vector3<f64>,
}

impl Ray {
    /// The place at a distance along the ray.
    #[inline]
    pub fn at(&self, range_m: f64) -> Vector3<f64> {
        self.origin + self.direction * range_m
    }
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Distance along the ray, metres.
    pub range_m: f64,
    /// Cosine of the angle between the ray and the surface normal, 0 to 1.
    pub cosine: f64,
}

/// A round body with a straight axis and a radius that changes linearly: a trunk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Centre of the lower end, metres.
    pub base: Vector3<f64>,
    /// Direction of the axis, length 1.
    pub axis: Vector3<f64>,
    /// Length along the axis, metres.
    pub length_m: f64,
    /// Radius at the lower end, metres.
    pub radius_m: f64,
    /// Change of the radius per metre along the axis.
    pub taper: f64,
}

impl Cone {
    /// Where a ray first enters the side of the cone. The ends are open: a trunk's are in the ground and the crown.
    pub fn meet(&self, ray: &Ray) -> Option<Meeting> {
        let w = ray.origin - self.base;
        let (d_axis, w_axis) = (ray.direction.dot(&self.axis), w.dot(&self.axis));
        let (radius, radius_rate) = (self.radius_m + self.taper * w_axis, self.taper * d_axis);
        let a = 1.0 - d_axis * d_axis - radius_rate * radius_rate;
        let b = w.dot(&ray.direction) - w_axis * d_axis - radius * radius_rate;
        let c = w.norm_squared() - w_axis * w_axis - radius * radius;
        let discriminant = b * b - a * c;
        if discriminant <= 0.0 || a < 1e-9 {
            return None;
        }
        let range_m = (-b - discriminant.sqrt()) / a;
        let along = w_axis + d_axis * range_m;
        if range_m <= 0.0 || !(0.0..=self.length_m).contains(&along) {
            return None;
        }
        let outward = w + ray.direction * range_m - self.axis * along;
        let cosine = -outward.dot(&ray.direction) / (self.radius_m + self.taper * along);
        Some(Meeting { range_m, cosine: cosine.clamp(0.0, 1.0) })
    }

    /// Corners of a box around it.
    pub fn bounds(&self) -> [Vector3<f64>; 2] {
        let top = self.base + self.axis * self.length_m;
        let r = Vector3::repeat(self.radius_m.max(self.radius_m + self.taper * self.length_m));
        [self.base.inf(&top) - r, self.base.sup(&top) + r]
    }
}

/// An ellipsoid with axes along east, north and up: a rock (solid), a bush or a crown (porous).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipsoid {
    /// Its centre, metres.
    pub center: Vector3<f64>,
    /// Half axes along east, north, up, metres.
    pub radii_m: Vector3<f64>,
}

impl Ellipsoid {
    /// The distances where a ray enters and leaves; the first may be negative when the ray starts inside.
    #[inline]
    pub fn span(&self, ray: &Ray) -> Option<(f64, f64)> {
        let w = (ray.origin - self.center).component_div(&self.radii_m);
        let d = ray.direction.component_div(&self.radii_m);
        let (a, b, c) = (d.norm_squared(), w.dot(&d), w.norm_squared() - 1.0);
        let discriminant = b * b - a * c;
        if discriminant <= 0.0 {
            return None;
        }
        let root = discriminant.sqrt();
        Some(((-b - root) / a, (-b + root) / a))
    }

    /// Where a ray first enters it.
    pub fn meet(&self, ray: &Ray) -> Option<Meeting> {
        let (range_m, _) = self.span(ray)?;
        if range_m <= 0.0 {
            return None;
        }
        let outward = (ray.at(range_m) - self.center).component_div(&self.radii_m.component_mul(&self.radii_m));
        Some(Meeting { range_m, cosine: (-outward.normalize().dot(&ray.direction)).clamp(0.0, 1.0) })
    }

    /// Height of its top above the scene origin over a place, metres; nothing beside it.
    pub fn top_m(&self, x: f64, y: f64) -> Option<f64> {
        let (u, v) = ((x - self.center.x) / self.radii_m.x, (y - self.center.y) / self.radii_m.y);
        let inside = 1.0 - u * u - v * v;
        (inside > 0.0).then(|| self.center.z + self.radii_m.z * inside.sqrt())
    }

    /// Corners of a box around it.
    pub fn bounds(&self) -> [Vector3<f64>; 2] {
        [self.center - self.radii_m, self.center + self.radii_m]
    }
}

/// An upright box turned about the vertical: a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slab {
    /// Its centre, metres.
    pub center: Vector3<f64>,
    /// Half its length, thickness and height, metres.
    pub half_m: Vector3<f64>,
    /// Direction of its length, radians counter-clockwise from east.
    pub along_rad: f64,
}

impl Slab {
    /// A vector of the scene in the slab's own axes.
    fn turned(&self, v: Vector3<f64>) -> Vector3<f64> {
        let (sin, cos) = self.along_rad.sin_cos();
        Vector3::new(v.x * cos + v.y * sin, v.y * cos - v.x * sin, v.z)
    }

    /// Where a ray first enters it.
    pub fn meet(&self, ray: &Ray) -> Option<Meeting> {
        let (w, d) = (self.turned(ray.origin - self.center), self.turned(ray.direction));
        let (mut near, mut far, mut face) = (f64::NEG_INFINITY, f64::INFINITY, 0);
        for axis in 0..3 {
            let (a, b) = ((-self.half_m[axis] - w[axis]) / d[axis], (self.half_m[axis] - w[axis]) / d[axis]);
            // A ray along a face divides zero by zero; min and max then keep the other bound.
            let (low, high) = (a.min(b), a.max(b));
            if low > near {
                (near, face) = (low, axis);
            }
            far = far.min(high);
        }
        (near > 0.0 && near <= far).then(|| Meeting { range_m: near, cosine: d[face].abs() })
    }

    /// True where a place lies on its footprint.
    pub fn covers(&self, x: f64, y: f64) -> bool {
        let p = self.turned(Vector3::new(x, y, 0.0) - self.center);
        p.x.abs() <= self.half_m.x && p.y.abs() <= self.half_m.y
    }

    /// Corners of a box around it.
    pub fn bounds(&self) -> [Vector3<f64>; 2] {
        let (sin, cos) = (self.along_rad.sin().abs(), self.along_rad.cos().abs());
        let h = self.half_m;
        let half = Vector3::new(h.x * cos + h.y * sin, h.x * sin + h.y * cos, h.z);
        [self.center - half, self.center + half]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: origin.into(), direction: Vector3::from(direction).normalize() }
    }

    #[test]
    fn an_upright_cylinder_is_met_one_radius_before_its_axis() {
        let trunk =
            Cone { base: [5.0, 0.0, 0.0].into(), axis: Vector3::z(), length_m: 10.0, radius_m: 0.2, taper: 0.0 };
        let meeting = trunk.meet(&ray([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])).unwrap();
        assert!((meeting.range_m - 4.8).abs() < 1e-12 && (meeting.cosine - 1.0).abs() < 1e-12);
        // 0.12 m off the axis: sqrt(0.2^2 - 0.12^2) = 0.16 m before it.
        let aside = trunk.meet(&ray([0.0, 0.12, 1.0], [1.0, 0.0, 0.0])).unwrap();
        assert!((aside.range_m - 4.84).abs() < 1e-12 && (aside.cosine - 0.8).abs() < 1e-12);
        assert!(trunk.meet(&ray([0.0, 0.21, 1.0], [1.0, 0.0, 0.0])).is_none());
        assert!(trunk.meet(&ray([0.0, 0.0, 10.1], [1.0, 0.0, 0.0])).is_none(), "above its top");
        assert!(trunk.meet(&ray([9.0, 0.0, 1.0], [1.0, 0.0, 0.0])).is_none(), "behind the ray");
    }

    #[test]
    fn a_tapering_trunk_is_thinner_higher_up() {
        let trunk =
            Cone { base: [5.0, 0.0, 0.0].into(), axis: Vector3::z(), length_m: 10.0, radius_m: 0.3, taper: -0.02 };
        let meeting = trunk.meet(&ray([0.0, 0.0, 5.0], [1.0, 0.0, 0.0])).unwrap();
        assert!((meeting.range_m - 4.8).abs() < 1e-12);
    }

    #[test]
    fn a_leaning_trunk_is_met_on_its_axis_as_far_as_it_leans() {
        let axis = Vector3::new(0.1, 0.0, 1.0).normalize();
        let trunk = Cone { base: [5.0, 0.0, 0.0].into(), axis, length_m: 10.0, radius_m: 0.2, taper: 0.0 };
        let meeting = trunk.meet(&ray([0.0, 0.0, 2.0], [1.0, 0.0, 0.0])).unwrap();
        // The horizontal radius of an inclined cylinder is r / cos(lean) in the direction of the lean.
        assert!((meeting.range_m - (5.2 - 0.2 / axis.z)).abs() < 1e-9, "{}", meeting.range_m);
    }

    #[test]
    fn a_ball_and_a_wall_are_met_where_they_begin() {
        let ball = Ellipsoid { center: [4.0, 0.0, 0.0].into(), radii_m: [1.0, 2.0, 0.5].into() };
        assert_eq!(ball.span(&ray([0.0; 3], [1.0, 0.0, 0.0])), Some((3.0, 5.0)));
        assert_eq!(ball.top_m(4.0, 0.0), Some(0.5));
        let along_rad = std::f64::consts::FRAC_PI_2;
        let wall = Slab { center: [6.0, 0.0, 1.0].into(), half_m: [5.0, 0.15, 1.0].into(), along_rad };
        let meeting = wall.meet(&ray([0.0, 1.0, 1.0], [1.0, 0.0, 0.0])).unwrap();
        assert!((meeting.range_m - 5.85).abs() < 1e-9 && (meeting.cosine - 1.0).abs() < 1e-9);
        assert!(wall.meet(&ray([0.0, 5.1, 1.0], [1.0, 0.0, 0.0])).is_none());
        assert!(wall.covers(6.1, 4.9) && !wall.covers(6.2, 0.0));
    }
}
