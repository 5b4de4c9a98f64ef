//! The shape of a scan: how often the mirror turns, how many beams a turn has, and when and where each one flies.

/// The measuring range is fixed, 1/10000 degrees.
pub(crate) const RANGE_E4DEG: [i32; 2] = [-450_000, 2_250_000];

/// Frequency and resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanShape {
    /// Nominal frequency, 1/100 Hz.
    pub frequency_centihz: u32,
    /// Angle between beams, 1/10000 degrees.
    pub step_e4deg: u32,
}

/// How much longer a turn takes than its nominal frequency says.
const TRUE_PER_NOMINAL_PERIOD: f64 = 0.020_114_5 / 0.02;
impl ScanShape {
    /// Number of beams: 541 or 1081.
    pub fn beams(&self) -> usize {
        ((RANGE_E4DEG[1] - RANGE_E4DEG[0]) as u32 / self.step_e4deg.max(1)) as usize + 1
    }
    /// Time of a turn of the mirror, seconds.
    pub fn period_s(&self) -> f64 {
        100.0 / f64::from(self.frequency_centihz.max(1)) * TRUE_PER_NOMINAL_PERIOD
    }
    /// Time from a beam to the next, seconds.
    pub fn beam_interval_s(&self) -> f64 {
        self.period_s() * f64::from(self.step_e4deg) / 3_600_000.0
    }
    /// Time from the first beam to the last, seconds.
    pub fn sweep_s(&self) -> f64 {
        self.beam_interval_s() * (self.beams() - 1) as f64
    }
    /// Device angle of a beam, radians.
    pub fn angle_rad(&self, index: usize) -> f64 {
        (f64::from(RANGE_E4DEG[0]) + f64::from(self.step_e4deg) * index as f64).to_radians() / 1e4
    }
}
