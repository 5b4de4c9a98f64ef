//! The names of the scenes, how each is meant to be driven, and what its position system gets wrong.
//!
//! What a scene holds is in `layout`.

use crate::gpos::PoseErrors;
use serde::{Deserialize, Serialize};

/// A walker's pace: slow enough for a nod to cover the ground ahead, metres per second.
pub const DRIVE_M_S: f64 = 0.7;

/// The scenes that have a name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneName {
    /// The default: trees of 0.15 to 0.45 m, brush patches, some grass, a ditch, rocks, a gentle slope.
    #[default]
    Forest,
    /// Flat ground and a few trees.
    Flat,
    /// A slope of one in four with trees and brush.
    Slope,
    /// Tall grass over rolling ground, a few trees.
    Grass,
    /// A ditch across the way.
    Ditch,
    /// The side of a building.
    Wall,
    /// A person who walks to and fro in front of the vehicle.
    Person,
    /// A dense stand of young trees: 1500 stems a hectare.
    Young,
    /// Rocks on level ground.
    Rocks,
    /// Bumpy ground that is driven over at 2.2 m/s (5 mph).
    Bumps,
    /// The forest, with a position system that drifts away.
    Drift,
}

impl SceneName {
    /// Every scene.
    pub const ALL: [Self; 11] = [
        Self::Forest,
        Self::Flat,
        Self::Slope,
        Self::Grass,
        Self::Ditch,
        Self::Wall,
        Self::Person,
        Self::Young,
        Self::Rocks,
        Self::Bumps,
        Self::Drift,
    ];

    /// The name as a user writes it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Forest => "forest",
            Self::Flat => "flat",
            Self::Slope => "slope",
            Self::Grass => "grass",
            Self::Ditch => "ditch",
            Self::Wall => "wall",
            Self::Person => "person",
            Self::Young => "young",
            Self::Rocks => "rocks",
            Self::Bumps => "bumps",
            Self::Drift => "drift",
        }
    }

    /// Speed at which the scene is meant to be driven, metres per second.
    pub fn speed_m_s(self) -> f64 {
        match self {
            Self::Bumps => 2.2,
            _ => DRIVE_M_S,
        }
    }

    /// What the position system gets wrong in this scene.
    pub fn pose_errors(self) -> PoseErrors {
        match self {
            Self::Drift => PoseErrors { drift_m_per_min: 0.4, heading_drift_deg_per_min: 0.5, ..PoseErrors::default() },
            _ => PoseErrors::default(),
        }
    }
}

impl std::str::FromStr for SceneName {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let names = || Self::ALL.map(Self::as_str).join(", ");
        Self::ALL
            .into_iter()
            .find(|name| name.as_str() == text)
            .ok_or_else(|| format!("no scene is called '{text}'; there are {}", names()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_reads_back_and_an_unknown_one_lists_them() {
        for name in SceneName::ALL {
            assert_eq!(name.as_str().parse(), Ok(name));
        }
        assert!("moon".parse::<SceneName>().unwrap_err().contains("forest, flat"));
    }

    #[test]
    fn bumps_are_driven_fast_and_only_drift_drifts() {
        assert_eq!(SceneName::ALL.iter().filter(|name| name.speed_m_s() > 2.0).count(), 1);
        assert_eq!(SceneName::ALL.iter().filter(|name| name.pose_errors() != PoseErrors::default()).count(), 1);
    }
}
