//! Means over what is known: NaN stands for a value that is not.

/// Root mean square; nothing where nothing is known.
pub fn rms(errors: impl IntoIterator<Item = f64>) -> Option<f64> {
    mean(errors.into_iter().map(|e| e * e)).map(f64::sqrt)
}

/// Mean; nothing where nothing is known.
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let known = values.into_iter().filter(|v| !v.is_nan());
    let (sum, count) = known.fold((0.0, 0usize), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// The share of those that are true; nothing where there are none.
pub fn share(of: impl IntoIterator<Item = bool>) -> Option<f64> {
    mean(of.into_iter().map(|is| f64::from(u8::from(is))))
}

/// Linearly interpolated quantile (0 to 1) of what is known.
pub fn quantile(values: impl IntoIterator<Item = f64>, at: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = values.into_iter().filter(|v| !v.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let place = at * sorted.len().checked_sub(1)? as f64;
    let (low, high) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    Some(low + (high - low) * place.fract())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_values_do_not_count() {
        assert_eq!(rms([3.0, f64::NAN, -4.0]), Some(12.5f64.sqrt()));
        assert_eq!((mean([f64::NAN]), mean([1.0, 2.0, f64::NAN])), (None, Some(1.5)));
        assert_eq!(share([true, false, false, true]), Some(0.5));
        assert_eq!(quantile([4.0, 1.0, 2.0, f64::NAN, 3.0], 0.5), Some(2.5));
        assert_eq!(quantile([], 0.5), None);
    }
}
