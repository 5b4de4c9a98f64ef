//! Frames as types: a point says where it is, a transform says from where to where.
//!
//! In and out: metres, `f64`, in the frame named by the type parameter. A mixed frame does not compile:
//! `global_from_vehicle * vehicle_from_ladar * p` is a [`Point<Global>`], any other order is a type error.
//! What the types cannot promise: that two `Global` points share one UTM zone (the zone travels with every
//! pose), and that two `Vehicle` points belong to the same instant (that is what [`crate::Trajectory`] is for).
//!
//! Source: thesis section on coordinate systems, equations (2-7) to (2-10); axes in `docs/frames.md`.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::marker::PhantomData;
use std::ops::{Add, Mul, Sub};

/// A coordinate frame. Implemented by the tag types of this module only.
pub trait Frame: Copy + Send + Sync + 'static {
    /// The frame's name in logs and error messages.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident),+ $(,)?) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct $name;
        impl Frame for $name {
            const NAME: &'static str = stringify!($name);
        }
    )+};
}

frames! {
    /// UTM: x east, y north, z up, metres.
    Global,
    /// JAUS vehicle frame: x forward, y right, z down.
    Vehicle,
    /// The pan-tilt unit's fixed base: axes parallel to the vehicle's when the mount has no rotation.
    PanTiltBase,
    /// The tilting body that carries the ladar; equal to the base at pan 0, tilt 0.
    Tilt,
    /// The ladar: x straight ahead, y right, z down; the scan plane is z = 0.
    Ladar,
}

/// A position in frame `F`, metres.
#[derive(Debug, PartialEq)]
pub struct Point<F> {
    /// Coordinates in metres.
    pub xyz: Point3<f64>,
    frame: PhantomData<F>,
}

/// A difference of two positions in frame `F`, metres: turned by a transform, never shifted.
#[derive(Debug, PartialEq)]
pub struct Vector<F> {
    /// Components in metres.
    pub xyz: Vector3<f64>,
    frame: PhantomData<F>,
}

/// The rigid transform that takes coordinates of `From` to coordinates of `To`.
#[derive(Debug, PartialEq)]
pub struct Transform<To, From> {
    /// Rotation and translation; the translation is the origin of `From` in `To`, metres.
    pub isometry: Isometry3<f64>,
    frames: PhantomData<(To, From)>,
}

// Derived `Clone` and `Copy` would demand them of the tag; these do not.
impl<F> Clone for Point<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F> Copy for Point<F> {}
impl<F> Clone for Vector<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F> Copy for Vector<F> {}
impl<To, From> Clone for Transform<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To, From> Copy for Transform<To, From> {}

impl<F> Point<F> {
    /// A point from its coordinates, metres.
    pub fn new(x: f64, y: f64, z: f64) -> Self {
        Self::from(Point3::new(x, y, z))
    }
    /// The frame's x, metres.
    pub fn x(&self) -> f64 {
        self.xyz.x
    }
    /// The frame's y, metres.
    pub fn y(&self) -> f64 {
        self.xyz.y
    }
    /// The frame's z, metres.
    pub fn z(&self) -> f64 {
        self.xyz.z
    }
    /// The three coordinates, metres.
    pub fn to_array(self) -> [f64; 3] {
        [self.xyz.x, self.xyz.y, self.xyz.z]
    }
    /// False where a coordinate is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.xyz.iter().all(|c| c.is_finite())
    }
}

impl<F> From<Point3<f64>> for Point<F> {
    fn from(xyz: Point3<f64>) -> Self {
        Self { xyz, frame: PhantomData }
    }
}

impl<F> Vector<F> {
    /// A vector from its components, metres.
    pub fn new(x: f64, y: f64, z: f64) -> Self {
        Self::from(Vector3::new(x, y, z))
    }
    /// Euclidean length, metres.
    pub fn length(&self) -> f64 {
        self.xyz.norm()
    }
    /// This vector times a number.
    pub fn scaled(self, factor: f64) -> Self {
        Self::from(self.xyz * factor)
    }
}

impl<F> From<Vector3<f64>> for Vector<F> {
    fn from(xyz: Vector3<f64>) -> Self {
        Self { xyz, frame: PhantomData }
    }
}

impl<F> Sub for Point<F> {
    type Output = Vector<F>;
    fn sub(self, other: Self) -> Vector<F> {
        Vector::from(self.xyz - other.xyz)
    }
}

impl<F> Add<Vector<F>> for Point<F> {
    type Output = Self;
    fn add(self, step: Vector<F>) -> Self {
        Self::from(self.xyz + step.xyz)
    }
}

impl<To, From> Transform<To, From> {
    /// A transform from its rotation and the origin of `From` in `To`.
    pub fn new(rotation: UnitQuaternion<f64>, origin: Point<To>) -> Self {
        Self::from_isometry(Isometry3::from_parts(origin.xyz.coords.into(), rotation))
    }
    /// A transform from a nalgebra isometry whose frames the caller vouches for.
    pub fn from_isometry(isometry: Isometry3<f64>) -> Self {
        Self { isometry, frames: PhantomData }
    }
    /// The two frames coincide.
    pub fn identity() -> Self {
        Self::from_isometry(Isometry3::identity())
    }
    /// The transform the other way.
    pub fn inverse(&self) -> Transform<From, To> {
        Transform::from_isometry(self.isometry.inverse())
    }
    /// Where the origin of `From` lies in `To`.
    pub fn origin(&self) -> Point<To> {
        Point::from(Point3::from(self.isometry.translation.vector))
    }
    /// False where a component is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.origin().is_finite() && self.isometry.rotation.coords.iter().all(|c| c.is_finite())
    }
}

impl<A, B, C> Mul<Transform<B, C>> for Transform<A, B> {
    type Output = Transform<A, C>;
    fn mul(self, right: Transform<B, C>) -> Transform<A, C> {
        Transform::from_isometry(self.isometry * right.isometry)
    }
}

impl<To, From> Mul<Point<From>> for Transform<To, From> {
    type Output = Point<To>;
    fn mul(self, point: Point<From>) -> Point<To> {
        Point::from(self.isometry * point.xyz)
    }
}

impl<To, From> Mul<Vector<From>> for Transform<To, From> {
    type Output = Vector<To>;
    fn mul(self, vector: Vector<From>) -> Vector<To> {
        Vector::from(self.isometry.rotation * vector.xyz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y_and_the_inverse_takes_it_back() {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2);
        let tilt_from_ladar = Transform::<Tilt, Ladar>::new(turn, Point::new(1.0, 2.0, 3.0));
        let p = tilt_from_ladar * Point::<Ladar>::new(1.0, 0.0, 0.0);
        assert!((p.xyz - Point3::new(1.0, 3.0, 3.0)).norm() < 1e-12);
        let back = tilt_from_ladar.inverse() * p;
        assert!((back.xyz - Point3::new(1.0, 0.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn a_vector_is_turned_but_not_shifted() {
        let shift = Transform::<Vehicle, PanTiltBase>::new(UnitQuaternion::identity(), Point::new(5.0, 0.0, 0.0));
        assert_eq!((shift * Vector::<PanTiltBase>::new(1.0, 1.0, 1.0)).xyz, Vector3::new(1.0, 1.0, 1.0));
    }
}
