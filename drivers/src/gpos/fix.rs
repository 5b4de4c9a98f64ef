//! What a source says at one instant, before it is put on the map: a [`Fix`].

use super::calendar::SourceTime;
use tsense_contract::PoseQuality;

/// Position, attitude and velocity of one instant, in the source's own terms and signs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// When it was true, on the source's timeline.
    pub time: SourceTime,
    /// Latitude, longitude, degrees.
    pub position_deg: [f64; 2],
    /// Height above the ellipsoid, metres.
    pub height_m: f64,
    /// How far it may be trusted.
    pub quality: PoseQuality,
    /// One sigma of east, north, height, metres; NaN where the source does not say.
    pub position_std_m: [f64; 3],
    /// Speed towards true east, true north, up, metres per second; up is NaN where the source does not say.
    pub velocity_m_s: Option<[f64; 3]>,
    /// Roll and pitch, degrees, in the source's signs.
    pub tilt_deg: [f64; 2],
    /// Heading, degrees from true north.
    pub heading_deg: f64,
    /// One sigma of roll, pitch, heading, degrees; NaN where the source does not say.
    pub attitude_std_deg: [f64; 3],
}
