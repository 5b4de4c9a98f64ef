//! Vertical profiles: at which heights above ground something was seen in and around each column.
//!
//! In: heights above ground of what was seen in a column. Out: for each column and its neighbours, the layers of 0.1 m
//! that hold at least one, two or three things. Counts stop at three: three words of 64 layers a column are then enough,
//! and two columns add with seven logic operations. It does not know what the things are.

/// Thickness of a layer, metres: less than the gap below a crown, more than the noise of a return.
pub const LAYER_M: f32 = 0.1;
/// Layers of a profile: up to 6.4 m above ground.
pub const LAYERS: usize = 64;

/// How many things each layer holds, up to three.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Profile {
    /// Layers with at least one, two, three things.
    at_least: [u64; 3],
}

impl Profile {
    /// Adds a thing at a height above ground; below the ground and above the profile it is left out.
    pub fn add(&mut self, height_m: f32) {
        let layer = height_m / LAYER_M;
        if (0.0..LAYERS as f32).contains(&layer) {
            *self = self.with(&Self::of_layers(1 << layer as u32));
        }
    }

    /// One thing in each of these layers: bit `k` is the layer from `k` to `k + 1` times [`LAYER_M`].
    pub fn of_layers(layers: u64) -> Self {
        Self { at_least: [layers, 0, 0] }
    }

    /// The layers that hold anything, as for [`Profile::of_layers`].
    pub fn layers(&self) -> u64 {
        self.at_least[0]
    }

    /// Both profiles together.
    pub fn with(&self, other: &Self) -> Self {
        let ([a1, a2, a3], [b1, b2, b3]) = (self.at_least, other.at_least);
        Self { at_least: [a1 | b1, a2 | b2 | a1 & b1, a3 | b3 | a2 & b1 | a1 & b2] }
    }

    /// Whether a layer holds at least `count` things, one to three.
    pub fn holds(&self, layer: usize, count: usize) -> bool {
        self.at_least[count.clamp(1, 3) - 1] >> layer & 1 == 1
    }
}

impl Profile {
    /// Whether anything lies in a layer or above it.
    pub fn holds_from(&self, layer: usize) -> bool {
        self.at_least[0].checked_shr(layer as u32).unwrap_or(0) != 0
    }
}

/// Each column's profile together with those of the columns within a radius of it, a square: worked out where it is asked for.
pub struct Around {
    along_rows: Vec<Profile>,
    width: usize,
    radius: usize,
}

impl Around {
    /// Of all columns, row by row.
    pub fn of(profiles: &[Profile], width: usize, radius: usize) -> Self {
        let mut along_rows = Vec::with_capacity(profiles.len());
        for row in profiles.chunks(width.max(1)) {
            along_rows.extend((0..row.len()).map(|column| sum(row[span(column, radius, row.len())].iter())));
        }
        Self { along_rows, width, radius }
    }

    /// What lies around a column.
    pub fn at(&self, column: usize) -> Profile {
        let (x, y) = (column % self.width, column / self.width);
        let rows = span(y, self.radius, self.along_rows.len() / self.width);
        sum(rows.map(|row| &self.along_rows[row * self.width + x]))
    }
}

fn span(at: usize, radius: usize, count: usize) -> std::ops::Range<usize> {
    at.saturating_sub(radius)..(at + radius + 1).min(count)
}

fn sum<'a>(profiles: impl Iterator<Item = &'a Profile>) -> Profile {
    profiles.fold(Profile::default(), |sum, profile| sum.with(profile))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_counts_to_three_in_each_layer() {
        let mut profile = Profile::default();
        for height_m in [0.05, 0.31, 0.32, 0.39, 0.35, -0.01, 6.41, f32::NAN] {
            profile.add(height_m);
        }
        assert!(profile.holds(0, 1) && !profile.holds(0, 2) && profile.holds(3, 3) && !profile.holds(4, 1));
    }

    /// The plain version: every neighbour's things, one at a time.
    #[test]
    fn the_neighbourhood_holds_what_its_columns_hold() {
        let (width, height) = (9, 7);
        let things = |i: usize| (0..i % 4).map(move |k| 0.1 * ((i * 7 + k * 3) % 11) as f32 + 0.05);
        let mut profiles = vec![Profile::default(); width * height];
        for (i, profile) in profiles.iter_mut().enumerate() {
            things(i).for_each(|height_m| profile.add(height_m));
        }
        let around = Around::of(&profiles, width, 2);
        for (i, profile) in (0..width * height).map(|i| (i, around.at(i))) {
            let mut counts = [0; 11];
            for j in (0..width * height)
                .filter(|j| (j % width).abs_diff(i % width).max((j / width).abs_diff(i / width)) <= 2)
            {
                things(j).for_each(|height_m| counts[(height_m / LAYER_M) as usize] += 1);
            }
            for (layer, count) in counts.iter().enumerate() {
                (1..=3).for_each(|k| assert_eq!(profile.holds(layer, k), *count >= k, "column {i}, layer {layer}"));
            }
        }
    }
}
