//! Values over time: a bounded history of stamped samples, interpolated at a beam's own time.
//!
//! In: samples with non-decreasing stamps. Out: the value at an instant, or why there is none. It never
//! extrapolates beyond a stated limit and never interpolates across a gap wider than a stated one.

use crate::attitude::PanTiltAngles;
use crate::frame::Transform;
use crate::time::Timestamp;
use std::collections::VecDeque;

/// A value between two others.
pub trait Interpolate: Copy {
    /// The value at `fraction` of the way from `self` (0) to `other` (1); outside of [0, 1] it extrapolates.
    fn interpolate(&self, other: &Self, fraction: f64) -> Self;
}

impl<To: 'static, From: 'static> Interpolate for Transform<To, From> {
    fn interpolate(&self, other: &Self, fraction: f64) -> Self {
        let a = &self.isometry;
        let b = &other.isometry;
        let shift = a.translation.vector.lerp(&b.translation.vector, fraction);
        // Two nearly opposite rotations have no one way between them; half a turn between two samples is a fault
        // upstream, and the first sample's rotation is then the answer.
        let turn = a.rotation.try_slerp(&b.rotation, fraction, 1e-12).unwrap_or(a.rotation);
        Self::from_isometry(nalgebra::Isometry3::from_parts(shift.into(), turn))
    }
}

impl Interpolate for PanTiltAngles {
    fn interpolate(&self, other: &Self, fraction: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * fraction;
        Self { pan_rad: mix(self.pan_rad, other.pan_rad), tilt_rad: mix(self.tilt_rad, other.tilt_rad) }
    }
}

/// How far a [`Trajectory`] may be trusted between and beyond its samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Most samples kept; the oldest goes first.
    pub capacity: usize,
    /// Widest gap that is interpolated across, seconds.
    pub gap_max_s: f64,
    /// Farthest beyond the newest sample that is answered, seconds.
    pub extrapolation_max_s: f64,
}

/// Why a [`Trajectory`] has no value at an instant.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoValue {
    /// No sample at all.
    #[error("no sample yet")]
    Empty,
    /// The instant lies before the oldest sample.
    #[error("{before_s:.3} s before the oldest sample")]
    TooOld {
        /// How far before, seconds.
        before_s: f64,
    },
    /// The instant lies beyond the newest sample: wait, or give up.
    #[error("{beyond_s:.3} s beyond the newest sample")]
    NotYet {
        /// How far beyond, seconds.
        beyond_s: f64,
    },
    /// The samples around the instant are too far apart.
    #[error("inside a gap of {gap_s:.3} s between samples")]
    Gap {
        /// The gap's width, seconds.
        gap_s: f64,
    },
}

/// A bounded, stamped history of `T`.
#[derive(Clone, Debug)]
pub struct Trajectory<T> {
    samples: VecDeque<(Timestamp, T)>,
    limits: Limits,
}

impl<T: Interpolate> Trajectory<T> {
    /// An empty history.
    pub fn new(limits: Limits) -> Self {
        Self { samples: VecDeque::with_capacity(limits.capacity), limits }
    }

    /// Adds a sample. A stamp not later than the newest one is refused, and `false` says so.
    pub fn push(&mut self, stamp: Timestamp, value: T) -> bool {
        if self.newest().is_some_and(|newest| stamp <= newest) {
            return false;
        }
        if self.samples.len() >= self.limits.capacity.max(2) {
            self.samples.pop_front();
        }
        self.samples.push_back((stamp, value));
        true
    }

    /// Forgets everything: a source restarted or jumped.
    pub fn clear(&mut self) {
        self.samples.clear();
    }

    /// The newest stamp.
    pub fn newest(&self) -> Option<Timestamp> {
        self.samples.back().map(|(stamp, _)| *stamp)
    }

    /// The newest sample.
    pub fn last(&self) -> Option<(Timestamp, T)> {
        self.samples.back().copied()
    }

    /// The value at `stamp`.
    pub fn at(&self, stamp: Timestamp) -> Result<T, NoValue> {
        self.bracket(stamp).map(|bracket| bracket.at(stamp))
    }

    /// The samples that decide the value at `stamp`, and up to when.
    pub fn bracket(&self, stamp: Timestamp) -> Result<Bracket<T>, NoValue> {
        let later = self.samples.partition_point(|(t, _)| *t < stamp);
        match later {
            0 => self.before_all(stamp),
            n if n == self.samples.len() => self.beyond_all(stamp),
            n => self.between(n - 1, n, self.samples[n].0),
        }
    }

    fn before_all(&self, stamp: Timestamp) -> Result<Bracket<T>, NoValue> {
        let (oldest, value) = *self.samples.front().ok_or(NoValue::Empty)?;
        if oldest == stamp {
            return Ok(Bracket { from: (oldest, value), to: (oldest, value), until: oldest });
        }
        Err(NoValue::TooOld { before_s: oldest.seconds_since(stamp) })
    }

    fn beyond_all(&self, stamp: Timestamp) -> Result<Bracket<T>, NoValue> {
        let newest = self.newest().ok_or(NoValue::Empty)?;
        let beyond_s = stamp.seconds_since(newest);
        if beyond_s > self.limits.extrapolation_max_s || self.samples.len() < 2 {
            return Err(NoValue::NotYet { beyond_s });
        }
        // What lies beyond is asked for anew: it may be too far.
        self.between(self.samples.len() - 2, self.samples.len() - 1, stamp)
    }

    fn between(&self, earlier: usize, later: usize, until: Timestamp) -> Result<Bracket<T>, NoValue> {
        let (from, to) = (self.samples[earlier], self.samples[later]);
        let gap_s = to.0.seconds_since(from.0);
        if gap_s > self.limits.gap_max_s {
            return Err(NoValue::Gap { gap_s });
        }
        Ok(Bracket { from, to, until })
    }
}

/// Two samples of a [`Trajectory`] with what lies between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bracket<T> {
    /// The earlier one.
    pub from: (Timestamp, T),
    /// The later one; the same where the oldest sample itself was asked for.
    pub to: (Timestamp, T),
    /// The last instant for which these two decide, from the one that was asked for.
    pub until: Timestamp,
}

impl<T: Interpolate> Bracket<T> {
    /// The value at an instant.
    pub fn at(&self, stamp: Timestamp) -> T {
        let gap_s = self.gap_s();
        if gap_s == 0.0 {
            return self.from.1;
        }
        self.from.1.interpolate(&self.to.1, stamp.seconds_since(self.from.0) / gap_s)
    }

    /// Seconds between the two.
    pub fn gap_s(&self) -> f64 {
        self.to.0.seconds_since(self.from.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joint(tilt_rad: f64) -> PanTiltAngles {
        PanTiltAngles { pan_rad: 0.0, tilt_rad }
    }

    fn nodding() -> Trajectory<PanTiltAngles> {
        let mut t = Trajectory::new(Limits { capacity: 3, gap_max_s: 0.1, extrapolation_max_s: 0.02 });
        for (ms, tilt) in [(0, 9.0), (10, 1.0), (20, 2.0), (30, 4.0)] {
            assert!(t.push(Timestamp::from_ns(ms * 1_000_000), joint(tilt)));
        }
        t
    }

    fn at(ms: f64) -> Result<f64, NoValue> {
        nodding().at(Timestamp::from_seconds(ms / 1e3)).map(|j| j.tilt_rad)
    }

    #[test]
    fn interpolates_between_and_a_little_beyond_and_says_why_not() {
        assert!((at(25.0).unwrap() - 3.0).abs() < 1e-12);
        assert!((at(20.0).unwrap() - 2.0).abs() < 1e-12);
        assert!((at(40.0).unwrap() - 6.0).abs() < 1e-9);
        assert!(matches!(at(51.0), Err(NoValue::NotYet { .. })));
        assert!(matches!(at(5.0), Err(NoValue::TooOld { .. })), "capacity 3 dropped the first sample");
    }

    #[test]
    fn a_bracket_decides_up_to_its_later_sample_and_beyond_the_newest_for_one_instant() {
        let bracket = |ms: i64| nodding().bracket(Timestamp::from_ns(ms * 1_000_000));
        let until = |ms| bracket(ms).map(|b| b.until.ns / 1_000_000);
        assert_eq!((until(10), until(11), until(20), until(21)), (Ok(10), Ok(20), Ok(20), Ok(30)));
        assert_eq!((until(35), until(45)), (Ok(35), Ok(45)));
        let (oldest, first) = (bracket(10).unwrap(), bracket(15).unwrap());
        assert_eq!((oldest.at(Timestamp::from_ns(10_000_000)).tilt_rad, oldest.gap_s()), (1.0, 0.0));
        assert_eq!(first.at(Timestamp::from_ns(18_000_000)).tilt_rad, 1.8);
    }

    #[test]
    fn refuses_stamps_that_do_not_advance_and_gaps_that_are_too_wide() {
        let mut t = nodding();
        assert!(!t.push(Timestamp::from_ns(30_000_000), joint(0.0)));
        assert!(t.push(Timestamp::from_ns(200_000_000), joint(0.0)));
        assert!(matches!(t.at(Timestamp::from_ns(100_000_000)), Err(NoValue::Gap { .. })));
    }
}
