//! Scaled integers: a real range spread over all values of an unsigned integer (JSIDL), or of a signed one (RA 3.x).

/// A range of real values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
}

impl Scale {
    /// From `low`, which is integer 0, to `high`, which is the largest integer.
    pub const fn new(low: f64, high: f64) -> Self {
        Self { low, high }
    }

    /// The nearest of `1 + max` steps; beyond the range its end, and NaN the low end.
    fn integer(self, value: f64, max: f64) -> f64 {
        ((value - self.low) / (self.high - self.low) * max).round().clamp(0.0, max)
    }

    fn real(self, integer: f64, max: f64) -> f64 {
        self.low + integer * (self.high - self.low) / max
    }

    /// As 8 bits.
    pub fn to_u8(self, value: f64) -> u8 {
        self.integer(value, f64::from(u8::MAX)) as u8
    }

    /// As 16 bits.
    pub fn to_u16(self, value: f64) -> u16 {
        self.integer(value, f64::from(u16::MAX)) as u16
    }

    /// As 32 bits.
    pub fn to_u32(self, value: f64) -> u32 {
        self.integer(value, f64::from(u32::MAX)) as u32
    }

    /// From 8 bits.
    pub fn from_u8(self, integer: u8) -> f64 {
        self.real(f64::from(integer), f64::from(u8::MAX))
    }

    /// From 16 bits.
    pub fn from_u16(self, integer: u16) -> f64 {
        self.real(f64::from(integer), f64::from(u16::MAX))
    }

    /// From 32 bits.
    pub fn from_u32(self, integer: u32) -> f64 {
        self.real(f64::from(integer), f64::from(u32::MAX))
    }

    /// As RA 3.x writes it: zero in the middle of the range, and one value of the integer unused.
    pub fn to_signed(self, value: f64) -> i32 {
        let middle = (self.low + self.high) / 2.0;
        let half = f64::from(i32::MAX);
        ((value - middle) / (self.high - self.low) * (2.0 * half)).round().clamp(-half, half) as i32
    }

    /// From RA 3.x.
    pub fn from_signed(self, integer: i32) -> f64 {
        (self.low + self.high) / 2.0 + f64::from(integer) * (self.high - self.low) / (2.0 * f64::from(i32::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_and_beyond_are_the_ends_and_every_integer_returns() {
        let width = Scale::new(0.0, 10_000.0);
        assert_eq!((width.to_u16(0.0), width.to_u16(10_000.0), width.to_u16(1e9)), (0, 65535, 65535));
        assert_eq!((width.to_u16(f64::NAN), width.to_u16(-5.0)), (0, 0));
        // 30 m falls between steps of 0.1526 m.
        assert_eq!(width.to_u16(30.0), 197);
        assert!((width.from_u16(197) - 30.06).abs() < 0.001);
        let mut compared = 0;
        for integer in 0..=u16::MAX {
            assert_eq!(width.to_u16(width.from_u16(integer)), integer);
            compared += 1;
        }
        assert_eq!(compared, 65_536);
    }

    #[test]
    fn the_signed_form_has_its_zero_in_the_middle() {
        let latitude = Scale::new(-90.0, 90.0);
        assert_eq!((latitude.to_signed(0.0), latitude.to_signed(90.0)), (0, i32::MAX));
        assert_eq!((latitude.to_signed(-90.0), latitude.to_signed(f64::NAN)), (-i32::MAX, 0));
        assert!((latitude.from_signed(latitude.to_signed(29.7565)) - 29.7565).abs() < 5e-8);
    }
}
