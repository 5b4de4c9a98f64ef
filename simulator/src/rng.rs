//! Seeded randomness: the same seed gives the same bits on every run.
//!
//! [`Rng`] is xoshiro256++ (Blackman and Vigna, 2019) seeded through splitmix64; [`hash`] is splitmix64's
//! finaliser chained over words, for randomness that must not depend on the order of questions: noise of the
//! ground at a place, the fate of one sub-ray. Not for secrets.

/// The golden ratio times 2^64, splitmix64's increment.
const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

/// splitmix64's finaliser: every input bit reaches every output bit.
#[inline]
pub fn mix(word: u64) -> u64 {
    let z = word.wrapping_add(GOLDEN);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// One number from several words.
pub fn hash(words: &[u64]) -> u64 {
    words.iter().fold(0, |state, word| mix(state ^ *word))
}

/// 53 bits of a number as a fraction in [0, 1).
#[inline]
pub fn fraction(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// A draw from the exponential distribution with mean 1.
#[inline]
pub fn exponential(bits: u64) -> f64 {
    -(1.0 - fraction(bits)).ln()
}

/// A draw from the standard normal distribution (Box and Muller), from one number.
pub fn normal(bits: u64) -> f64 {
    let radius = (-2.0 * (1.0 - fraction(bits)).ln()).sqrt();
    radius * (std::f64::consts::TAU * fraction(mix(bits))).cos()
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Rng {
    state: [u64; 4],
}

impl Rng {
    /// A stream from a seed.
    pub fn new(seed: u64) -> Self {
        let word = |i: u64| mix(seed.wrapping_add(GOLDEN.wrapping_mul(i)));
        Self { state: [word(0), word(1), word(2), word(3)] }
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        let [a, b, c, d] = self.state;
        let out = a.wrapping_add(d).rotate_left(23).wrapping_add(a);
        let (c, d) = (c ^ a, d ^ b);
        self.state = [a ^ d, b ^ c, c ^ (b << 17), d.rotate_left(45)];
        out
    }

    /// A number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        fraction(self.bits())
    }

    /// A number in [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A number from the normal distribution with mean 0 and this sigma.
    pub fn normal(&mut self, sigma: f64) -> f64 {
        sigma * normal(self.bits())
    }

    /// A whole number in [low, high].
    pub fn count(&mut self, low: u32, high: u32) -> u32 {
        low + (self.unit() * f64::from(high - low + 1)) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_of_xoshiro_follows_its_definition() {
        // By hand from state (1, 2, 3, 4): rotl(1 + 4, 23) + 1 = 5 * 2^23 + 1 = 41943041.
        let mut rng = Rng { state: [1, 2, 3, 4] };
        assert_eq!(rng.bits(), 41_943_041);
        // Then s2 ^= s0 -> 2, s3 ^= s1 -> 6, s1 ^= s2 -> 0, s0 ^= s3 -> 7, s2 ^= 2 << 17, s3 = rotl(6, 45).
        assert_eq!(rng.state, [7, 0, 2 ^ (2 << 17), 6u64.rotate_left(45)]);
    }

    #[test]
    fn the_normal_draw_has_mean_0_and_sigma_1() {
        let mut rng = Rng::new(5);
        let draws: Vec<f64> = (0..20_000).map(|_| rng.normal(1.0)).collect();
        let mean = draws.iter().sum::<f64>() / 2e4;
        let variance = draws.iter().map(|x| x * x).sum::<f64>() / 2e4;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04, "{mean} {variance}");
    }

    #[test]
    fn the_same_seed_gives_the_same_bits_and_another_seed_others() {
        let draw = |seed| {
            let mut rng = Rng::new(seed);
            [rng.bits(), rng.bits(), rng.bits()]
        };
        assert_eq!(draw(7), draw(7));
        assert_ne!(draw(7), draw(8));
    }
}
