//! Poses that cannot be true: frozen, jumping. In: poses in order. Out: the same with flags and a full velocity.
//!
//! A source that repeats one position while it reports speed is frozen. A pose farther from the last than speed, time
//! and deviations explain has jumped. Where the source does not say its velocity, it is the difference of two poses.

use super::config::Config;
use tsense_contract::{POSE_FROZEN, POSE_JUMPED, Pose, PoseQuality};

/// Speed above which a position must change, metres per second.
const MOVING_M_S: f64 = 0.3;
/// Sigmas of position a pose may be off.
const SIGMAS: f64 = 5.0;
/// A vehicle may change its speed by this much between two fixes without saying so, metres per second squared.
const ACCELERATION_M_S2: f64 = 5.0;
/// Longest gap over which two poses give a velocity, seconds.
const VELOCITY_GAP_S: f64 = 1.0;

/// One sigma of a position whose source does not say, metres.
fn usual_std_m(quality: PoseQuality) -> f64 {
    match quality {
        PoseQuality::RtkFixed => 0.03,
        PoseQuality::RtkFloat => 0.3,
        PoseQuality::Differential => 0.8,
        PoseQuality::Single | PoseQuality::Degraded | PoseQuality::Invalid => 3.0,
    }
}

/// Watches one source.
#[derive(Debug)]
pub struct Watch {
    frozen_repeats: u32,
    jump_margin_m: f64,
    last: Option<Pose>,
    repeats: u32,
}

impl Watch {
    /// Nothing seen yet.
    pub fn new(config: &Config) -> Self {
        Self { frozen_repeats: config.frozen_repeats, jump_margin_m: config.jump_margin_m, last: None, repeats: 0 }
    }

    /// Forgets the last pose: the line was opened anew.
    pub fn clear(&mut self) {
        self.last = None;
    }

    /// Flags a pose and fills its velocity in.
    pub fn check(&mut self, mut pose: Pose) -> Pose {
        let said_speed_m_s = f64::from(pose.velocity_m_s[0].hypot(pose.velocity_m_s[1]));
        let derived = self.last.map_or([0.0; 3], |last| difference_m_s(&last, &pose));
        for (velocity, derived) in pose.velocity_m_s.iter_mut().zip(derived) {
            if !velocity.is_finite() {
                *velocity = derived;
            }
        }
        if let Some(last) = self.last {
            let same = position(&last) == position(&pose);
            // NaN where the source says no speed: never frozen then.
            self.repeats = if same && said_speed_m_s > MOVING_M_S { self.repeats + 1 } else { 0 };
            if self.repeats >= self.frozen_repeats {
                pose.flags |= POSE_FROZEN;
            }
            if self.jumped(&last, &pose) {
                pose.flags |= POSE_JUMPED;
            }
        }
        self.last = Some(pose);
        pose
    }

    fn jumped(&self, last: &Pose, pose: &Pose) -> bool {
        let dt_s = (pose.stamp_ns - last.stamp_ns) as f64 / 1e9;
        let off: Vec<f64> = position(pose).iter().zip(position(last)).map(|(now, before)| now - before).collect();
        let distance_m = off.iter().map(|d| d * d).sum::<f64>().sqrt();
        let speed = |pose: &Pose| pose.velocity_m_s.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
        // A velocity that was derived from this very step explains nothing; the one before does.
        let explained_m = speed(last) * dt_s + ACCELERATION_M_S2 * dt_s * dt_s;
        let allowed_m = explained_m + SIGMAS * (std_m(last) + std_m(pose)) + self.jump_margin_m;
        distance_m > allowed_m
    }
}

fn position(pose: &Pose) -> [f64; 3] {
    [pose.easting_m, pose.northing_m, pose.altitude_m]
}

fn std_m(pose: &Pose) -> f64 {
    let said = pose.position_std_m.iter().map(|std| f64::from(*std).powi(2)).sum::<f64>().sqrt();
    if said.is_finite() { said } else { usual_std_m(pose.quality()) }
}

fn difference_m_s(last: &Pose, pose: &Pose) -> [f32; 3] {
    let dt_s = (pose.stamp_ns - last.stamp_ns) as f64 / 1e9;
    if dt_s <= 0.0 || dt_s > VELOCITY_GAP_S {
        return [0.0; 3];
    }
    let (now, before) = (position(pose), position(last));
    std::array::from_fn(|i| ((now[i] - before[i]) / dt_s) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(ms: i64, easting_m: f64, speed_m_s: f32) -> Pose {
        Pose {
            stamp_ns: ms * 1_000_000,
            easting_m,
            northing_m: 0.0,
            altitude_m: 0.0,
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rad: 0.0,
            convergence_rad: 0.0,
            velocity_m_s: [speed_m_s, 0.0, f32::NAN],
            position_std_m: [0.01; 3],
            attitude_std_rad: [0.0; 3],
            zone: 17,
            south: 0,
            quality: PoseQuality::RtkFixed.to_wire(),
            flags: 0,
        }
    }

    fn flags(poses: &[Pose]) -> Vec<u8> {
        let mut watch = Watch::new(&Config::default());
        poses.iter().map(|pose| watch.check(*pose).flags).collect()
    }

    #[test]
    fn a_position_that_stands_while_the_source_says_speed_is_frozen() {
        let repeated: Vec<Pose> = (0..8).map(|i| pose(i * 100, 5.0, 2.0)).collect();
        assert_eq!(flags(&repeated), [0, 0, 0, 0, 0, POSE_FROZEN, POSE_FROZEN, POSE_FROZEN]);
        let standing: Vec<Pose> = (0..8).map(|i| pose(i * 100, 5.0, 0.0)).collect();
        assert_eq!(flags(&standing), [0; 8]);
        let silent: Vec<Pose> = (0..8).map(|i| pose(i * 100, 5.0, f32::NAN)).collect();
        assert_eq!(flags(&silent), [0; 8]);
    }

    #[test]
    fn a_jump_is_flagged_once_and_driving_is_none() {
        let at = [0.0, 0.2, 0.4, 2.4, 2.6];
        let poses: Vec<Pose> = (0..5).map(|i| pose(i * 100, at[i as usize], 2.0)).collect();
        assert_eq!(flags(&poses), [0, 0, 0, POSE_JUMPED, 0]);
    }

    #[test]
    fn the_velocity_is_the_difference_of_poses_where_the_source_does_not_say() {
        let mut watch = Watch::new(&Config::default());
        assert_eq!(watch.check(pose(0, 0.0, f32::NAN)).velocity_m_s, [0.0; 3]);
        assert_eq!(watch.check(pose(100, 0.2, f32::NAN)).velocity_m_s, [2.0, 0.0, 0.0]);
    }
}
