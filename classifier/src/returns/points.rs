//! Returns of which nobody knows where their beams came from: those of a cloud without sensor positions.
//!
//! In: ends in UTM, metres. Out: the same relative to the first one, so that an `f32` keeps a tenth of a millimetre.

use tsense_geometry::{Global, Point};

/// Ends of beams, 12 bytes each, in the order of arrival.
#[derive(Clone, Debug)]
pub struct Points {
    /// What they are relative to: the first one.
    pub base: Point<Global>,
    /// East, north, up of the base, metres.
    pub ends_m: Vec<[f32; 3]>,
}

impl Default for Points {
    fn default() -> Self {
        Self { base: Point::new(0.0, 0.0, 0.0), ends_m: Vec::new() }
    }
}

impl Points {
    /// Adds a point.
    pub fn push(&mut self, at: Point<Global>) {
        if self.ends_m.is_empty() {
            self.base = at;
        }
        let way = (at - self.base).xyz;
        self.ends_m.push([way.x as f32, way.y as f32, way.z as f32]);
    }
}
