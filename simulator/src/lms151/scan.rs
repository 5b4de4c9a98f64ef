//! The measured-data telegram `LMDscandata`: what the device says about one turn of its mirror.
//!
//! In: a scan's counters, times and values. Out: the body in either dialect. Layout: shared protocol notes, 1.4.

use super::cola::{Dialect, Writer};

/// One channel of 16-bit or 8-bit values.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Channel {
    /// Five characters: `DIST1`, `DIST2`, `RSSI1`, `RSSI2`.
    pub name: &'static str,
    /// One value a beam.
    pub values: Vec<u16>,
}

/// One scan as the device measured it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ScanTelegram {
    pub status: [u8; 2],
    pub telegram_counter: u16,
    pub scan_counter: u16,
    pub scan_time_us: u32,
    pub transmission_time_us: u32,
    pub frequency_centihz: u32,
    pub measurement_frequency_100hz: u32,
    pub start_e4deg: i32,
    pub step_e4deg: u16,
    pub channels_16: Vec<Channel>,
    pub channels_8: Vec<Channel>,
    pub device_name: Option<String>,
    /// Milliseconds since 1970 on the device's clock, where the time block is on.
    pub clock_ms: Option<u64>,
}

/// Serial number of the simulated device.
pub(crate) const SERIAL: u32 = 15_110_001;

impl ScanTelegram {
    /// The telegram in its envelope; `word` is `sSN` for the stream, `sRA` for an answer.
    pub fn framed(&self, dialect: Dialect, word: &str) -> Vec<u8> {
        let mut out = Writer::new(dialect, word, "LMDscandata");
        out.u16(1).u16(1).u32(SERIAL).u8(self.status[0]).u8(self.status[1]);
        out.u16(self.telegram_counter).u16(self.scan_counter);
        out.u32(self.scan_time_us).u32(self.transmission_time_us);
        // Digital inputs, outputs, reserved.
        out.u8(0).u8(0).u8(7).u8(0).u16(0);
        out.u32(self.frequency_centihz).u32(self.measurement_frequency_100hz);
        // No encoders.
        out.u16(0);
        self.channels(&mut out, &self.channels_16, |out, v| {
            out.u16(v);
        });
        self.channels(&mut out, &self.channels_8, |out, v| {
            out.u8(v as u8);
        });
        out.u16(0);
        match &self.device_name {
            Some(name) => out.u16(1).u8(name.len() as u8).text(name),
            None => out.u16(0),
        };
        out.u16(0);
        match self.clock_ms {
            Some(ms) => clock_block(&mut out, ms),
            None => _ = out.u16(0),
        }
        out.u16(0);
        out.framed()
    }

    fn channels(&self, out: &mut Writer, channels: &[Channel], value: impl Fn(&mut Writer, u16)) {
        out.u16(channels.len() as u16);
        for channel in channels {
            out.text(channel.name).f32(1.0).f32(0.0);
            out.i32(self.start_e4deg).u16(self.step_e4deg).u16(channel.values.len() as u16);
            for v in &channel.values {
                value(out, *v);
            }
        }
    }
}

fn clock_block(out: &mut Writer, ms: u64) {
    let (days, ms_of_day) = (ms / 86_400_000, ms % 86_400_000);
    let (year, month, day) = crate::gpos::date_of_day(days as i64);
    let s = ms_of_day / 1000;
    out.u16(1).u16(year as u16).u8(month).u8(day);
    out.u8((s / 3600) as u8).u8((s / 60 % 60) as u8).u8((s % 60) as u8).u32((ms_of_day % 1000 * 1000) as u32);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan() -> ScanTelegram {
        ScanTelegram {
            status: [0, 0],
            telegram_counter: 0xC1C3,
            scan_counter: 0xC1C6,
            scan_time_us: 0x8B62_1C37,
            transmission_time_us: 0x8B62_7603,
            frequency_centihz: 5000,
            measurement_frequency_100hz: 360,
            start_e4deg: -450_000,
            step_e4deg: 5000,
            channels_16: vec![Channel { name: "DIST1", values: vec![0x293, 0x272, 0] }],
            channels_8: vec![],
            device_name: None,
            clock_ms: None,
        }
    }

    #[test]
    fn the_text_telegram_reads_like_the_one_in_the_notes() {
        let text = String::from_utf8(scan().framed(Dialect::A, "sSN")).unwrap();
        let expected = "\u{2}sSN LMDscandata 1 1 E68F71 0 0 C1C3 C1C6 8B621C37 8B627603 0 0 7 0 0 1388 168 0 \
                        1 DIST1 3F800000 00000000 FFF92230 1388 3 293 272 0 0 0 0 0 0 0\u{3}";
        assert_eq!(text, expected);
    }

    #[test]
    fn the_binary_telegram_of_541_beams_is_as_long_as_a_real_one() {
        let channels_16 = vec![Channel { name: "DIST1", values: vec![1234; 541] }];
        let real = ScanTelegram { channels_16, clock_ms: Some(86_400_123), ..scan() };
        // A real LMS111 with the time block sends 1191 bytes.
        assert_eq!(real.framed(Dialect::B, "sSN").len(), 1191);
    }

    #[test]
    fn eight_bit_strength_travels_in_its_own_section() {
        let with = ScanTelegram { channels_8: vec![Channel { name: "RSSI1", values: vec![254, 0, 7] }], ..scan() };
        let text = String::from_utf8(with.framed(Dialect::A, "sSN")).unwrap();
        assert!(text.ends_with("293 272 0 1 RSSI1 3F800000 00000000 FFF92230 1388 3 FE 0 7 0 0 0 0 0\u{3}"), "{text}");
    }
}
