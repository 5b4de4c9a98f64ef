//! Stamped counts of both axes become joint angles.
//!
//! In: counts with the instants they were true. Out: [`Joint`] (radians, thesis theta1 and theta2). Where the axes are
//! asked one after the other, pan is moved along its own rate to tilt's instant.

use super::answer::Axis;
use super::unit::Plan;
use std::collections::VecDeque;
use tsense_contract::Joint;
use tsense_geometry::Timestamp;

/// Rates are taken over this long, seconds: one count in a poll of 12 ms would be 4 degrees a second.
const RATE_WINDOW_S: f64 = 0.06;
/// Samples kept an axis: the window at the fastest poll, twice.
const SAMPLES_MAX: usize = 128;
/// Farthest pan is moved along its rate, seconds.
const EXTRAPOLATION_MAX_S: f64 = 0.06;

#[derive(Debug, Default)]
struct AxisTrack {
    samples: VecDeque<(Timestamp, i32)>,
}

impl AxisTrack {
    fn push(&mut self, stamp: Timestamp, counts: i32) -> bool {
        if self.samples.back().is_some_and(|(newest, _)| stamp <= *newest) {
            return false;
        }
        let old = |sample: &(Timestamp, i32)| stamp.seconds_since(sample.0) > RATE_WINDOW_S;
        // Two samples stay however old: a slow line still gives a rate.
        while self.samples.len() >= SAMPLES_MAX || (self.samples.len() > 1 && self.samples.front().is_some_and(old)) {
            self.samples.pop_front();
        }
        self.samples.push_back((stamp, counts));
        true
    }

    fn rate_counts_s(&self) -> f64 {
        let (Some((t0, first)), Some((t1, last))) = (self.samples.front(), self.samples.back()) else { return 0.0 };
        let span_s = t1.seconds_since(*t0);
        if span_s > 0.0 { f64::from(last - first) / span_s } else { 0.0 }
    }

    fn at(&self, stamp: Timestamp) -> Option<f64> {
        let (newest, counts) = self.samples.back()?;
        let beyond_s = stamp.seconds_since(*newest).clamp(0.0, EXTRAPOLATION_MAX_S);
        Some(f64::from(*counts) + self.rate_counts_s() * beyond_s)
    }
}

/// The newest samples of both axes.
#[derive(Debug, Default)]
pub struct Track {
    pan: AxisTrack,
    tilt: AxisTrack,
}

impl Track {
    /// Takes a sample; false where its stamp does not advance.
    pub fn push(&mut self, axis: Axis, stamp: Timestamp, counts: i32) -> bool {
        match axis {
            Axis::Pan => self.pan.push(stamp, counts),
            Axis::Tilt => self.tilt.push(stamp, counts),
        }
    }

    /// The newest counts of an axis.
    pub fn newest(&self, axis: Axis) -> Option<i32> {
        let track = match axis {
            Axis::Pan => &self.pan,
            Axis::Tilt => &self.tilt,
        };
        track.samples.back().map(|(_, counts)| *counts)
    }

    /// The joint angles at the newest sample of tilt; none before both axes have one.
    pub fn joint(&self, plan: &Plan, stamp_std_s: f64, sweep: u32, flags: u8) -> Option<Joint> {
        let (stamp, tilt) = self.tilt.samples.back()?;
        let pan = self.pan.at(*stamp)?;
        Some(Joint {
            stamp_ns: stamp.ns,
            stamp_std_ns: (stamp_std_s * 1e9).round() as i64,
            pan_rad: plan.pan.angle_rad(pan),
            tilt_rad: plan.tilt.angle_rad(f64::from(*tilt)),
            pan_rate_rad_s: plan.pan.rate_rad_s(self.pan.rate_counts_s()) as f32,
            tilt_rate_rad_s: plan.tilt.rate_rad_s(self.tilt.rate_counts_s()) as f32,
            sweep,
            flags,
            reserved: [0; 3],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::Config;
    use super::super::unit::{AxisUnit, Unit};
    use super::*;

    #[test]
    fn pan_is_moved_to_the_instant_of_tilt_and_rates_are_those_of_the_window() {
        let axis = AxisUnit { resolution_arcsec: 3600.0, ..AxisUnit::default() };
        let plan = Plan::new(&Unit { pan: axis, tilt: axis, ..Unit::default() }, &Config::default());
        let mut track = Track::default();
        let ms = |ms: i64| Timestamp::from_ns(ms * 1_000_000);
        assert!(track.joint(&plan, 0.0, 0, 0).is_none());
        for (axis, at, counts) in
            [(Axis::Pan, 0, 10), (Axis::Tilt, 10, 5), (Axis::Pan, 20, 12), (Axis::Tilt, 30, 6), (Axis::Tilt, 50, 7)]
        {
            assert!(track.push(axis, ms(at), counts));
        }
        assert!(!track.push(Axis::Tilt, ms(50), 9), "the stamp does not advance");
        let joint = track.joint(&plan, 0.001, 3, 0).unwrap();
        assert_eq!((joint.stamp_ns, joint.stamp_std_ns, joint.sweep), (50_000_000, 1_000_000, 3));
        // 2 counts in 20 ms are 100 counts/s; 30 ms later 15 counts, to the left.
        assert!((joint.pan_rad + 15_f64.to_radians()).abs() < 1e-9);
        assert!((f64::from(joint.tilt_rate_rad_s) - 50_f64.to_radians()).abs() < 1e-6);
        assert!((joint.tilt_rad - 7_f64.to_radians()).abs() < 1e-12);
    }
}
