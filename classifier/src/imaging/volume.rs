//! A dense box of values, one a voxel: what the imaging tools work on.
//!
//! In: blocks of bricks, or values. x runs fastest, then y, then z. Unknown voxels count 0, as undecided ones do.

use crate::columns::Window;
use tsense_contract::{BlockKey, Brick, locate};

/// Values of a box of voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Which voxels.
    pub window: Window,
    /// A value each: x fastest, then y, then z.
    pub values: Vec<f32>,
}

impl Volume {
    /// All values alike.
    pub fn filled(window: Window, value: f32) -> Self {
        Self { window, values: vec![value; window.size.iter().product()] }
    }

    /// The occupancy of every known voxel of a window, 0 elsewhere.
    pub fn of_blocks<'a>(window: Window, blocks: impl IntoIterator<Item = (BlockKey, &'a [Brick])>) -> Self {
        Self::of_known(window, blocks, |brick, i| f32::from(brick.occupancy[i]))
    }

    /// A value of every known voxel of a window, 0 elsewhere.
    pub fn of_known<'a>(
        window: Window,
        blocks: impl IntoIterator<Item = (BlockKey, &'a [Brick])>,
        value: impl Fn(&Brick, usize) -> f32,
    ) -> Self {
        let mut volume = Self::filled(window, 0.0);
        let blocks: std::collections::BTreeMap<_, _> = blocks.into_iter().collect();
        let [width, height, depth] = window.size;
        for i in 0..width * height * depth {
            let at = [i % width, i / width % height, i / (width * height)];
            let voxel = std::array::from_fn(|axis| window.first[axis] + at[axis] as i32);
            let (key, brick, inner) = locate(voxel);
            let brick = blocks.get(&key).and_then(|bricks| bricks.get(brick));
            if let Some(brick) = brick.filter(|brick| brick.confidence[inner] > 0) {
                volume.values[i] = value(brick, inner);
            }
        }
        volume
    }

    /// Position of a voxel of the window in `values`.
    pub fn offset(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.window.size[0] * (y + self.window.size[1] * z)
    }
}
