//! Blur: every voxel becomes the weighted average of its neighbourhood.
//!
//! In: a volume and the weights along one axis, from the centre outwards (`[2, 1]` is 1-2-1). Out: the blurred volume.
//! The neighbourhood is a cube whose weights are products of those along the axes, so three passes along the axes do
//! it. At the rim the average is taken over what is inside. [`blur`] is the thesis's: unknown voxels count 0 and take part.
//! [`blur_known`] averages over the known neighbours of known voxels, so that the rim of what was seen does not fade.

use crate::imaging::Volume;

/// Blurs along x, y and z. Without any weight above zero the volume comes back unchanged.
pub fn blur(volume: &Volume, weights: &[f32]) -> Volume {
    let mut blurred = volume.clone();
    let sum: f32 = weights.iter().sum();
    if sum > 0.0 && sum.is_finite() {
        let [width, height, depth] = volume.window.size;
        along(&mut blurred.values, [width, 1], weights);
        along(&mut blurred.values, [height, width], weights);
        along(&mut blurred.values, [depth, width * height], weights);
    }
    blurred
}

/// Blurs the voxels that are known (1 in `known`, 0 elsewhere) over their known neighbours; the others stay 0.
pub fn blur_known(volume: &Volume, known: &Volume, weights: &[f32]) -> Volume {
    let mut seen = volume.clone();
    seen.values.iter_mut().zip(&known.values).for_each(|(value, is_known)| *value *= is_known);
    let (mut blurred, shares) = (blur(&seen, weights), blur(known, weights));
    for (i, value) in blurred.values.iter_mut().enumerate() {
        *value = if known.values[i] > 0.0 && shares.values[i] > 0.0 { *value / shares.values[i] } else { 0.0 };
    }
    blurred
}

/// One pass along lines of `count` values that lie `stride` apart.
fn along(values: &mut [f32], [count, stride]: [usize; 2], weights: &[f32]) {
    let mut line = vec![0.0; count];
    for first in (0..values.len()).filter(|i| i / stride % count == 0) {
        for (i, value) in line.iter_mut().enumerate() {
            *value = values[first + i * stride];
        }
        for i in 0..count {
            values[first + i * stride] = average_at(&line, i, weights);
        }
    }
}

fn average_at(line: &[f32], i: usize, weights: &[f32]) -> f32 {
    let (mut sum, mut weight_sum) = (0.0, 0.0);
    for (distance, weight) in weights.iter().enumerate() {
        let sides = [i.checked_sub(distance), Some(i + distance).filter(|_| distance > 0)];
        for value in sides.into_iter().flatten().filter_map(|i| line.get(i)) {
            (sum, weight_sum) = (sum + weight * value, weight_sum + weight);
        }
    }
    // A centre weight of zero may leave a line of one voxel without any neighbour.
    if weight_sum > 0.0 { sum / weight_sum } else { line[i] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;

    fn volume() -> Volume {
        Volume::filled(Window { first: [0; 3], size: [5, 5, 5] }, 0.0)
    }

    #[test]
    fn one_voxel_spreads_by_the_product_of_the_weights() {
        let mut one = volume();
        let centre = one.offset([2, 2, 2]);
        one.values[centre] = 64.0;
        let blurred = blur(&one, &[2.0, 1.0]);
        let at = |x, y, z| blurred.values[blurred.offset([x, y, z])];
        assert_eq!((at(2, 2, 2), at(1, 2, 2), at(1, 1, 2), at(1, 1, 3)), (8.0, 4.0, 2.0, 1.0));
        assert_eq!(at(0, 2, 2), 0.0);
        assert_eq!(blurred.values.iter().sum::<f32>(), 64.0);
    }

    #[test]
    fn an_even_volume_stays_even_up_to_its_rim_and_no_weights_change_nothing() {
        let even = Volume { values: vec![3.0; 125], ..volume() };
        assert!(blur(&even, &[4.0, 2.0, 1.0]).values.iter().all(|v| (v - 3.0).abs() < 1e-6));
        assert_eq!(blur(&even, &[]), even);
    }

    #[test]
    fn known_voxels_do_not_fade_beside_unknown_ones() {
        let (mut half, mut known) = (volume(), volume());
        for i in (0..125).filter(|i| i % 5 < 2) {
            (half.values[i], known.values[i]) = (8.0, 1.0);
        }
        let blurred = blur_known(&half, &known, &[2.0, 1.0]);
        assert!(blurred.values.iter().enumerate().all(|(i, v)| (v - if i % 5 < 2 { 8.0 } else { 0.0 }).abs() < 1e-5));
        assert!((blur(&half, &[2.0, 1.0]).values[1] - 6.0).abs() < 1e-5, "the thesis's blur fades at the rim");
    }
}
