//! What a position system gets wrong: noise that changes from epoch to epoch, errors that wander, and drift.
//!
//! In: an instant. Out: offsets in metres and radians. Every error is a function of the seed and the instant, so it
//! is the same on every run and at any rate: wandering errors are sums of three slow waves with random phases.

use crate::rng::{fraction, hash, normal};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use tsense_geometry::Attitude;

/// How good the fix is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// No error at all.
    Exact,
    /// Real-time kinematic with fixed ambiguities: a centimetre or two.
    #[default]
    RtkFixed,
    /// Real-time kinematic with float ambiguities: decimetres.
    RtkFloat,
    /// A single receiver: metres.
    Single,
}

impl Quality {
    /// Sigma of a horizontal coordinate, of the height (metres), of roll and pitch, and of the heading (degrees).
    pub(crate) fn sigmas(self) -> [f64; 4] {
        match self {
            Self::Exact => [0.0; 4],
            Self::RtkFixed => [0.01, 0.015, 0.03, 0.08],
            Self::RtkFloat => [0.15, 0.25, 0.05, 0.15],
            Self::Single => [1.2, 2.0, 0.1, 0.4],
        }
    }

    /// The quality number of GGA.
    pub(crate) fn gga(self) -> u8 {
        match self {
            Self::Exact | Self::RtkFixed => 4,
            Self::RtkFloat => 5,
            Self::Single => 1,
        }
    }
}

/// Errors of the reported pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PoseErrors {
    /// How good the fix is.
    pub quality: Quality,
    /// How fast the reported position runs away horizontally, metres a minute.
    pub drift_m_per_min: f64,
    /// How fast the reported heading runs away, degrees a minute.
    pub heading_drift_deg_per_min: f64,
}

/// Offsets to add to the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Offset {
    pub position_m: [f64; 3],
    pub attitude: Attitude,
}

/// Share of an error that wanders; the rest changes from epoch to epoch. Squares add up to 1.
const WANDER_SHARE: f64 = 0.9;
const NOISE_SHARE: f64 = 0.435_889_894;
/// Periods of the waves an error wanders with, seconds.
const WAVES_S: [f64; 3] = [97.0, 37.0, 11.0];

impl PoseErrors {
    /// The error at an instant of world time.
    pub(crate) fn at(&self, seed: u64, world_s: f64) -> Offset {
        let [horizontal, height, level, heading] = self.quality.sigmas();
        let error = |channel: u64, sigma: f64| {
            // Three waves of equal amplitude a have sigma a * sqrt(3 / 2).
            let wave = |k: usize| {
                let phase = TAU * fraction(hash(&[seed, 21, channel, k as u64]));
                (TAU * world_s / WAVES_S[k] + phase).sin()
            };
            let wander = (wave(0) + wave(1) + wave(2)) / 1.5f64.sqrt();
            let noise = normal(hash(&[seed, 22, channel, (world_s * 1e3).round() as i64 as u64]));
            sigma * (WANDER_SHARE * wander + NOISE_SHARE * noise)
        };
        let (sin, cos) = (TAU * fraction(hash(&[seed, 23]))).sin_cos();
        let (minutes, drift) = (world_s / 60.0, self.drift_m_per_min);
        Offset {
            position_m: [
                error(0, horizontal) + drift * minutes * cos,
                error(1, horizontal) + drift * minutes * sin,
                error(2, height),
            ],
            attitude: Attitude {
                roll_rad: error(3, level).to_radians(),
                pitch_rad: error(4, level).to_radians(),
                yaw_rad: (error(5, heading) + self.heading_drift_deg_per_min * minutes).to_radians(),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_is_as_large_as_the_quality_says_and_the_same_again() {
        let errors = PoseErrors { quality: Quality::RtkFloat, ..PoseErrors::default() };
        // Long enough that the slow waves average out; several seeds for their phases.
        let mut squares = 0.0;
        for seed in 0..4 {
            squares += (0..20_000).map(|k| errors.at(seed, f64::from(k) * 0.5).position_m[0].powi(2)).sum::<f64>();
        }
        let sigma = (squares / 8e4).sqrt();
        assert!((sigma - 0.15).abs() < 0.01, "{sigma}");
        assert_eq!(errors.at(1, 7.0), errors.at(1, 7.0));
        assert_ne!(errors.at(1, 7.0), errors.at(2, 7.0));
    }

    #[test]
    fn drift_runs_away_evenly_and_exact_is_exact() {
        let errors = PoseErrors { quality: Quality::Exact, drift_m_per_min: 0.6, heading_drift_deg_per_min: 0.0 };
        let [east, north, up] = errors.at(3, 120.0).position_m;
        assert!((east.hypot(north) - 1.2).abs() < 1e-12 && up == 0.0);
        let exact = PoseErrors { quality: Quality::Exact, ..PoseErrors::default() };
        assert_eq!(exact.at(3, 99.0), Offset::default());
    }
}
