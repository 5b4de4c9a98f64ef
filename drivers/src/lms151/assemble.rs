//! From a scan telegram to a stamped scan: duplicates dropped, the first beam's time found, codes told from distances.
//!
//! In: [`ScanData`] and the host's time of receipt. Out: a `ScanHeader` (graph clock, radians from the device's zero) and one
//! `Return` a beam (millimetres along the beam). Every beam is kept, whatever came back. It does not cut at a range and does not
//! turn points into any frame. Source: protocol notes 1.5.

use super::clock_fit::{ClockFit, Fitted, RotationPeriod};
use super::config::{Config, Echo};
use super::counters::{Counters, Step, Totals};
use super::scan_data::{CODES_END, Channel, ScanData};
use tsense_contract::{Return, ReturnKind, Scan, ScanHeader, Topic};
use tsense_geometry::Timestamp;

/// From the end of the sweep to the time of transmission on an LMS111, seconds: 3.067 to 3.272 ms.
pub const SWEEP_END_TO_TX_S: f64 = 0.0031;

/// A scan ready to be published.
#[derive(Clone, Debug, PartialEq)]
pub struct AssembledScan {
    /// When and where.
    pub header: ScanHeader,
    /// What came back of each beam.
    pub returns: Vec<Return>,
}

/// Why a telegram became no scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dropped {
    /// The same telegram again.
    Duplicate,
    /// No distances in it.
    NoDistances,
    /// More beams than this device family has.
    TooManyBeams,
    /// A scale or an angle that makes no sense.
    BadScale,
}

impl Dropped {
    /// In words, for the drop counters.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Duplicate => "duplicate telegram",
            Self::NoDistances => "telegram without distances",
            Self::TooManyBeams => "telegram with too many beams",
            Self::BadScale => "telegram with a bad scale",
        }
    }
}

/// Turns one device's telegrams into scans.
#[derive(Clone, Debug)]
pub struct Assembler {
    echo: Echo,
    first_beam_to_tx_s: Option<f64>,
    counters: Counters,
    fit: ClockFit,
    rotation: RotationPeriod,
    newest: Option<Fitted>,
    sequence: u64,
}

impl Assembler {
    /// An assembler for the configured ladar.
    pub fn new(config: &Config) -> Self {
        Self {
            echo: config.echo,
            first_beam_to_tx_s: config.first_beam_to_tx_s,
            counters: Counters::default(),
            fit: ClockFit::default(),
            rotation: RotationPeriod::default(),
            newest: None,
            sequence: 0,
        }
    }

    /// Totals of the telegram counter.
    pub fn totals(&self) -> Totals {
        self.counters.totals()
    }

    /// The clock fit at the newest telegram.
    pub fn clock(&self) -> Option<Fitted> {
        self.newest
    }

    /// The measured period of the mirror, seconds, once known.
    pub fn period_s(&self) -> Option<f64> {
        self.rotation.seconds()
    }

    /// Makes a scan of a telegram received at `received`.
    pub fn take(&mut self, data: &ScanData, received: Timestamp, contamination: u8) -> Result<AssembledScan, Dropped> {
        match self.counters.observe(data.telegram_counter, data.scan_counter, data.transmission_time_us) {
            Step::Duplicate => return Err(Dropped::Duplicate),
            Step::Restart => {
                self.fit.reset();
                self.rotation.reset();
            }
            Step::First | Step::Next | Step::Gap { .. } => {}
        }
        self.rotation.observe(data.scan_counter, data.scan_time_us);
        let fitted = self.fit.observe(data.transmission_time_us, received);
        self.newest = Some(fitted);
        let distances = checked(data)?;
        let returns = returns(data, distances, self.echo);
        let header = self.header(data, distances, fitted, contamination);
        self.sequence += 1;
        Ok(AssembledScan { header, returns })
    }

    fn header(&self, data: &ScanData, distances: &Channel, fitted: Fitted, contamination: u8) -> ScanHeader {
        let nominal_s = 100.0 / f64::from(data.scan_frequency_centihz.max(1));
        let step_deg = f64::from(distances.step_e4_deg) / 1e4;
        let beam_interval_s = step_deg / 360.0 * self.rotation.seconds().unwrap_or(nominal_s);
        let sweep_s = distances.raw.len().saturating_sub(1) as f64 * beam_interval_s;
        let first_beam_to_tx_s = self.first_beam_to_tx_s.unwrap_or(sweep_s + SWEEP_END_TO_TX_S);
        ScanHeader {
            stamp_ns: fitted.transmitted.plus_seconds(-first_beam_to_tx_s).ns,
            stamp_std_ns: (fitted.std_s * 1e9).round() as i64,
            beam_interval_ns: beam_interval_s * 1e9,
            start_rad: (f64::from(distances.start_e4_deg) / 1e4).to_radians(),
            step_rad: step_deg.to_radians(),
            sequence: self.sequence,
            telegram_counter: data.telegram_counter,
            scan_counter: data.scan_counter,
            device_status: data.status,
            contamination,
            has_remission: u8::from(data.channel(b"RSSI1").is_some()),
            reserved: [0; 8],
        }
    }
}

fn checked(data: &ScanData) -> Result<&Channel, Dropped> {
    let distances = data.channel(b"DIST1").filter(|c| !c.raw.is_empty()).ok_or(Dropped::NoDistances)?;
    if distances.raw.len() > Scan::ITEMS_MAX {
        return Err(Dropped::TooManyBeams);
    }
    let channels = data.channels_16.iter().chain(&data.channels_8);
    let scales = channels.flat_map(|c| [c.scale, c.offset]);
    // 100 m at 16 bits needs a scale of 1.5; a thousand leaves room for any relative.
    let sane = scales.into_iter().all(|v| v.is_finite() && v.abs() <= 1e6) && distances.scale > 0.0;
    let turn = i64::from(distances.step_e4_deg) * distances.raw.len() as i64;
    if sane && distances.step_e4_deg > 0 && turn <= 3_700_000 { Ok(distances) } else { Err(Dropped::BadScale) }
}

fn returns(data: &ScanData, first: &Channel, echo: Echo) -> Vec<Return> {
    let last = data.channel(b"DIST2").filter(|_| echo == Echo::Last);
    let (first_strength, last_strength) = (data.channel(b"RSSI1"), data.channel(b"RSSI2"));
    let at = |channel: Option<&Channel>, i: usize| channel.and_then(|c| c.raw.get(i)).copied();
    (0..first.raw.len())
        .map(|i| match (last, at(last, i)) {
            (Some(last), Some(raw)) if raw >= CODES_END => measured(last, raw, at(last_strength, i)),
            _ => measured(first, first.raw[i], at(first_strength, i)),
        })
        .collect()
}

fn measured(channel: &Channel, raw: u16, strength: Option<u16>) -> Return {
    let kind = match raw {
        0 => ReturnKind::NoReturn,
        1 => ReturnKind::Dazzled,
        3 => ReturnKind::TooWeak,
        raw if raw < CODES_END => ReturnKind::Reserved,
        _ => ReturnKind::Echo,
    };
    let is_echo = kind == ReturnKind::Echo;
    Return {
        distance_mm: if is_echo { millimetres(channel, raw) } else { 0 },
        remission: strength.unwrap_or(0),
        kind: kind.to_wire(),
        code: if is_echo { 0 } else { raw as u8 },
    }
}

/// A raw value in whole millimetres; codes below 16 as they came.
pub fn millimetres(channel: &Channel, raw: u16) -> u32 {
    channel.scaled(raw).round().max(0.0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(name: &[u8; 5], raw: &[u16]) -> Channel {
        let start_e4_deg = -450_000;
        Channel { name: *name, scale: 1.0, offset: 0.0, start_e4_deg, step_e4_deg: 5000, raw: raw.to_vec() }
    }

    fn scan(telegram: u16, raw: &[u16]) -> ScanData {
        ScanData {
            telegram_counter: telegram,
            scan_counter: telegram,
            scan_time_us: u32::from(telegram) * 20_114,
            transmission_time_us: u32::from(telegram) * 20_114 + 3_100,
            scan_frequency_centihz: 5000,
            channels_16: vec![channel(b"DIST1", raw)],
            ..ScanData::default()
        }
    }

    fn take(config: &Config, data: &ScanData) -> Result<AssembledScan, Dropped> {
        Assembler::new(config).take(data, Timestamp::from_ns(1_000_000_000), 0)
    }

    #[test]
    fn codes_are_kept_apart_from_distances() {
        let assembled = take(&Config::default(), &scan(1, &[0, 1, 3, 15, 16, 5000])).unwrap();
        let seen: Vec<_> = assembled.returns.iter().map(|r| (r.kind(), r.distance_mm, r.code)).collect();
        use ReturnKind::*;
        let expected = [(NoReturn, 0, 0), (Dazzled, 0, 1), (TooWeak, 0, 3), (Reserved, 0, 15), (Echo, 16, 0)];
        assert_eq!(seen[..5], expected);
        assert_eq!(seen[5], (Echo, 5000, 0));
    }

    #[test]
    fn scale_and_offset_apply_to_distances_only() {
        let mut data = scan(1, &[3, 1000]);
        (data.channels_16[0].scale, data.channels_16[0].offset) = (2.0, 5.0);
        let assembled = take(&Config::default(), &data).unwrap();
        assert_eq!((assembled.returns[0].code, assembled.returns[1].distance_mm), (3, 2005));
    }

    #[test]
    fn the_last_echo_is_taken_where_there_is_one_and_brings_its_own_strength() {
        let mut data = scan(1, &[700, 800, 0]);
        data.channels_16.push(channel(b"DIST2", &[0, 2800, 900]));
        data.channels_8 = vec![channel(b"RSSI1", &[11, 12, 13]), channel(b"RSSI2", &[21, 22, 23])];
        let taken = |echo| {
            let assembled = take(&Config { echo, ..Config::default() }, &data).unwrap();
            assert_eq!(assembled.header.has_remission, 1);
            assembled.returns.iter().map(|r| (r.distance_mm, r.remission)).collect::<Vec<_>>()
        };
        assert_eq!(taken(Echo::First), [(700, 11), (800, 12), (0, 13)]);
        assert_eq!(taken(Echo::Last), [(700, 11), (2800, 22), (900, 23)]);
    }

    #[test]
    fn the_first_beam_lies_a_sweep_and_3_1_ms_before_transmission() {
        let mut assembler = Assembler::new(&Config::default());
        let mut last = None;
        for i in 1..=20u16 {
            let received = Timestamp::from_ns(i64::from(i) * 20_114_000);
            last = Some((received, assembler.take(&scan(i, &[1000; 541]), received, 2).unwrap()));
        }
        let (received, scan) = last.unwrap();
        // 540 steps of 0.5 degrees are 3/4 of the measured 20.114 ms.
        let expected_s = 0.75 * 0.020_114 + 0.0031;
        let seen_s = received.seconds_since(Timestamp::from_ns(scan.header.stamp_ns));
        assert!((seen_s - expected_s).abs() < 1e-8, "{seen_s}");
        assert!((scan.header.beam_interval_ns - 20_114_000.0 / 720.0).abs() < 1e-6);
        assert!((scan.header.start_rad + std::f64::consts::FRAC_PI_4).abs() < 1e-12);
        assert_eq!((scan.header.sequence, scan.header.contamination), (19, 2));
        let calibrated = Config { first_beam_to_tx_s: Some(0.0415), ..Config::default() };
        let scan = take(&calibrated, &self::scan(1, &[1000; 541])).unwrap();
        assert_eq!(scan.header.stamp_ns, 1_000_000_000 - 41_500_000);
    }

    #[test]
    fn telegrams_that_make_no_scan_say_why() {
        let config = Config::default();
        let mut assembler = Assembler::new(&config);
        let at = Timestamp::from_ns(0);
        assert!(assembler.take(&scan(1, &[1000; 3]), at, 0).is_ok());
        assert_eq!(assembler.take(&scan(1, &[1000; 3]), at, 0), Err(Dropped::Duplicate));
        assert_eq!(take(&config, &scan(1, &[])), Err(Dropped::NoDistances));
        assert_eq!(take(&config, &scan(1, &[1000; 1082])), Err(Dropped::TooManyBeams));
        for scale in [f32::NAN, f32::INFINITY, -1.0, 0.0] {
            let mut data = scan(1, &[1000; 3]);
            data.channels_16[0].scale = scale;
            assert_eq!(take(&config, &data), Err(Dropped::BadScale), "{scale}");
        }
    }
}
