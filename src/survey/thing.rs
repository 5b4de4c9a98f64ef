//! What stands or gapes in a plot besides trees: drops, rocks, walls and brush patches, each with its measures. Metres.

use super::shapes::Ring;

/// What a thing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// The ground falls away, or was expected and never seen.
    Drop,
    /// Something solid, neither trunk nor wall.
    Rock,
    /// Something solid, long and high.
    Wall,
    /// Vegetation to push through.
    Brush,
}

impl Kind {
    /// The layer's name.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Drop => "drops",
            Self::Rock => "rocks",
            Self::Wall => "walls",
            Self::Brush => "brush",
        }
    }
}

/// One thing.
#[derive(Clone, Debug, PartialEq)]
pub struct Thing {
    /// What it is.
    pub kind: Kind,
    /// Its outline: polygons, each an outer ring and its holes.
    pub outline: Vec<Vec<Ring>>,
    /// Area, square metres.
    pub area_m2: f64,
    /// Extent along its principal axes, metres.
    pub length_width_m: [f64; 2],
    /// Greatest and mean height above ground, or, of a drop, depth below its rim, metres; NaN where not known.
    pub height_m: [f64; 2],
    /// Height of the ground and one sigma of it, means over its cells, metres; NaN where unknown.
    pub ground_m: [f64; 2],
}
