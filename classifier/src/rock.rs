//! What of the solid things is as large as a rock: one rule for the live classifier and for surveys.

use std::ops::Range;

/// What is lower is no rock, what is taller or wider is none either, metres.
const ROCK_M: Range<f64> = 0.25..1.3;
const ROCK_REACH_MAX_M: f64 = 2.2;
/// What reaches across more of its heights is a rise of the ground, a log or a bank.
const ROCK_REACH_MAX_HEIGHTS: f64 = 4.5;

/// Largest share of brush among the cells around a rock: a smooth piece of a bush has bush around it.
pub const ROCK_IN_BRUSH_MAX: f64 = 0.2;

/// Whether something solid of this height and this longer side, metres, is as large as a rock.
pub fn is_rock_size(height_m: f64, reach_m: f64) -> bool {
    ROCK_M.contains(&height_m) && reach_m <= ROCK_REACH_MAX_M.min(ROCK_REACH_MAX_HEIGHTS * height_m)
}
