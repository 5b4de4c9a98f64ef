//! The device's mind: its settings, its state over time, and the answer to every command.
//!
//! In: a request's payload, the session it came through and the instant. Out: an answer in the same dialect and what
//! must happen besides. No sockets, no clock. Commands and codes: shared protocol notes, 1.2 and 1.3.

use super::Lms151Options;
use super::cola::{Dialect, Reader, Writer};
use super::scan::SERIAL;
use super::shape::{RANGE_E4DEG, ScanShape};
use tsense_geometry::Timestamp;

/// Error codes of `sFA`.
mod code {
    pub const ACCESS_DENIED: u16 = 0x1;
    pub const UNKNOWN_METHOD: u16 = 0x2;
    pub const UNKNOWN_VARIABLE: u16 = 0x3;
    pub const CONDITION_FAILED: u16 = 0x4;
    pub const INVALID_DATA: u16 = 0x5;
    pub const PARAMETER_MISSING: u16 = 0x8;
    pub const UNKNOWN_COMMAND: u16 = 0xC;
    pub const UNKNOWN_EVENT: u16 = 0xF;
}

/// Passwords by access level.
const PASSWORDS: [(u8, u32); 3] = [(2, 0xB21A_CE26), (3, 0xF472_4744), (4, 0x81BE_23AA)];
/// Level that may change settings.
const AUTHORISED: u8 = 3;
/// How long an ordinary answer takes, seconds.
const ANSWER_S: f64 = 0.0015;
/// How long starting the measurement takes to answer, seconds.
const START_ANSWER_S: f64 = 0.014;

/// What the data telegram carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct DataConfig {
    pub second_echo: bool,
    pub remission: bool,
    pub remission_16_bit: bool,
    pub device_name: bool,
    pub clock: bool,
    pub interval: u16,
}

/// What one client has asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Session {
    level: u8,
    /// Scans are streamed to it.
    pub streaming: bool,
    /// The next scan answers a poll.
    pub polled: bool,
}

/// What a request leads to.
#[derive(Debug, PartialEq)]
pub(crate) enum Outcome {
    /// These bytes, after a while.
    Answer { bytes: Vec<u8>, after_s: f64 },
    /// The next scan is the answer.
    NextScan,
    /// These bytes, then the device restarts.
    Reboot(Vec<u8>),
}

/// What the mirror does, while it turns and measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Measuring {
    /// When the measurement began.
    pub since: Timestamp,
    pub shape: ScanShape,
    pub data: DataConfig,
    /// Transmitted window, 1/10000 degrees.
    pub window_e4deg: [i32; 2],
    /// When the device started up.
    pub booted: Timestamp,
}

/// The simulated device.
#[derive(Debug)]
pub(crate) struct Device {
    spin_up_s: f64,
    contamination: u8,
    shape: ScanShape,
    data: DataConfig,
    window_e4deg: [i32; 2],
    /// When the motor was told to turn; nothing while it stands.
    started: Option<Timestamp>,
    booted: Timestamp,
}

impl Device {
    /// A device that is switched on at an instant; it begins to measure by itself.
    pub fn new(options: &Lms151Options, now: Timestamp) -> Self {
        Self {
            spin_up_s: options.spin_up_s,
            contamination: options.faults.contamination.min(3) as u8,
            shape: ScanShape { frequency_centihz: 5000, step_e4deg: 5000 },
            data: DataConfig {
                second_echo: false,
                remission: false,
                remission_16_bit: false,
                device_name: false,
                clock: false,
                interval: 1,
            },
            window_e4deg: RANGE_E4DEG,
            started: Some(now),
            booted: now,
        }
    }

    /// Switched off and on again: settings that were not saved are kept here, which a real device does not promise.
    pub fn reboot(&mut self, now: Timestamp) {
        self.started = Some(now);
        self.booted = now;
    }

    /// The state number of `STlms`: 3 idle, 5 preparing, 7 measuring.
    pub fn state(&self, now: Timestamp) -> u8 {
        match self.started {
            None => 3,
            Some(started) if now.seconds_since(started) < self.spin_up_s => 5,
            Some(_) => 7,
        }
    }

    /// What the mirror does at an instant; nothing unless it measures.
    pub fn measuring(&self, now: Timestamp) -> Option<Measuring> {
        let started = self.started.filter(|_| self.state(now) == 7)?;
        Some(Measuring {
            since: started.plus_seconds(self.spin_up_s),
            shape: self.shape,
            data: self.data,
            window_e4deg: self.window_e4deg,
            booted: self.booted,
        })
    }

    /// Contamination as `LCMstate` says it.
    pub fn contamination(&self) -> u8 {
        self.contamination
    }

    /// Answers one request.
    pub fn handle(&mut self, session: &mut Session, dialect: Dialect, payload: &[u8], now: Timestamp) -> Outcome {
        let error = |code| Outcome::Answer { bytes: Writer::error(dialect, code), after_s: ANSWER_S };
        let Some((word, name, fields)) = Reader::new(dialect, payload) else { return error(code::UNKNOWN_COMMAND) };
        if (word, name) == ("sRN", "LMDscandata") {
            session.polled = true;
            return Outcome::NextScan;
        }
        if (word, name) == ("sMN", "mSCreboot") {
            let bytes = Writer::new(dialect, "sAN", name).framed();
            return if session.level >= AUTHORISED { Outcome::Reboot(bytes) } else { error(code::ACCESS_DENIED) };
        }
        let answered = match word {
            "sRN" => self.read(dialect, name, now),
            "sWN" => self.write(session, dialect, name, fields),
            "sMN" => self.call(session, dialect, name, fields, now),
            "sEN" => subscribe(session, dialect, name, fields),
            _ => Err(code::UNKNOWN_COMMAND),
        };
        let after_s = if name == "LMCstartmeas" { START_ANSWER_S } else { ANSWER_S };
        match answered {
            Ok(bytes) => Outcome::Answer { bytes, after_s },
            Err(code) => error(code),
        }
    }

    fn read(&self, dialect: Dialect, name: &str, now: Timestamp) -> Result<Vec<u8>, u16> {
        let mut out = Writer::new(dialect, "sRA", name);
        let [start, stop] = RANGE_E4DEG;
        match name {
            "STlms" => self.status(&mut out, now),
            "LMPscancfg" => {
                let shape = self.shape;
                out.u32(shape.frequency_centihz).u16(1).u32(shape.step_e4deg).i32(start).i32(stop)
            }
            "LMPoutputRange" => {
                out.u16(1).u32(self.shape.step_e4deg).i32(self.window_e4deg[0]).i32(self.window_e4deg[1])
            }
            "LMDscandatacfg" => {
                let d = self.data;
                out.u8(if d.second_echo { 3 } else { 1 }).u8(0).u8(d.remission.into()).u8(d.remission_16_bit.into());
                out.u8(0).u8(0).u8(0).u8(0).u8(d.device_name.into()).u8(0).u8(d.clock.into()).u16(d.interval)
            }
            "DeviceIdent" => out.string("LMS151-SIM").string("V1.80"),
            "FirmwareVersion" => out.string("V1.80.2"),
            "SerialNumber" => out.string(&SERIAL.to_string()),
            "LocationName" => out.string("simulated"),
            "SCdevicestate" => out.u8(1),
            "ODoprh" => out.u32(11_100),
            "ODpwrc" => out.u32(63),
            "LCMstate" => out.u8(self.contamination),
            "EIHstCola" => out.u8((dialect == Dialect::B).into()),
            _ => return Err(code::UNKNOWN_VARIABLE),
        };
        Ok(out.framed())
    }

    fn status<'a>(&self, out: &'a mut Writer, now: Timestamp) -> &'a mut Writer {
        let up_s = now.seconds_since(self.booted).max(0.0) as u64;
        let (year, month, day) = crate::gpos::date_of_day((up_s / 86_400) as i64);
        let time = format!("{:02}:{:02}:{:02}", up_s / 3600 % 24, up_s / 60 % 60, up_s % 60);
        let date = format!("{day:02}.{month:02}.{:02}", year % 100);
        out.u16(self.state(now).into()).u8(0).string(&time).string(&date).u8(0).u8(0).u8(0)
    }

    fn write(
        &mut self,
        session: &Session,
        dialect: Dialect,
        name: &str,
        mut fields: Reader<'_>,
    ) -> Result<Vec<u8>, u16> {
        match name {
            "LMDscandatacfg" => {
                authorised(session)?;
                self.data = data_config(&mut fields)?;
            }
            "LMPoutputRange" => {
                authorised(session)?;
                let mut read = || Some((fields.u16()?, fields.u32()?, fields.i32()?, fields.i32()?));
                let (sectors, _, start, stop) = read().ok_or(code::PARAMETER_MISSING)?;
                if sectors != 1 || start >= stop || start < RANGE_E4DEG[0] || stop > RANGE_E4DEG[1] {
                    return Err(code::CONDITION_FAILED);
                }
                self.window_e4deg = [start, stop];
            }
            "EIHstCola" | "TSCRole" | "TSCTCInterface" | "TSCTCSrvAddr" | "TSCTCupdatetime" => {}
            _ => return Err(code::UNKNOWN_VARIABLE),
        }
        Ok(Writer::new(dialect, "sWA", name).framed())
    }

    fn call(
        &mut self,
        session: &mut Session,
        dialect: Dialect,
        name: &str,
        mut fields: Reader<'_>,
        now: Timestamp,
    ) -> Result<Vec<u8>, u16> {
        let mut out = Writer::new(dialect, "sAN", name);
        match name {
            "SetAccessMode" => {
                let level = fields.u8().ok_or(code::PARAMETER_MISSING)?;
                let password = fields.u32().ok_or(code::PARAMETER_MISSING)?;
                let granted = PASSWORDS.contains(&(level, password));
                if granted {
                    session.level = level;
                }
                out.u8(granted.into())
            }
            "Run" => {
                session.level = 0;
                out.u8(1)
            }
            "mLMPsetscancfg" => {
                authorised(session)?;
                let status = self.configure(&mut fields, now)?;
                let [start, stop] = RANGE_E4DEG;
                out.u8(status).u32(self.shape.frequency_centihz).u16(1);
                out.u32(self.shape.step_e4deg).i32(start).i32(stop)
            }
            "mEEwriteall" => {
                authorised(session)?;
                out.u8(1)
            }
            "LMCstartmeas" => {
                self.started = Some(self.started.unwrap_or(now));
                out.u8(0)
            }
            "LMCstopmeas" | "LMCstandby" => {
                self.started = None;
                out.u8(0)
            }
            "LSPsetdatetime" => out.u8(1),
            _ => return Err(code::UNKNOWN_METHOD),
        };
        Ok(out.framed())
    }

    /// Sets frequency and resolution: 0 ok, 1 bad frequency, 2 bad resolution, 3 bad pair, 4 bad area.
    fn configure(&mut self, fields: &mut Reader<'_>, now: Timestamp) -> Result<u8, u16> {
        let mut read = || Some((fields.u32()?, fields.u16()?, fields.u32()?, fields.i32()?, fields.i32()?));
        let (frequency_centihz, sectors, step_e4deg, start, stop) = read().ok_or(code::PARAMETER_MISSING)?;
        let status = match (frequency_centihz, step_e4deg) {
            (2500 | 5000, 5000) | (2500, 2500) if [start, stop] == RANGE_E4DEG && sectors == 1 => 0,
            (2500 | 5000, 5000) | (2500, 2500) => 4,
            (5000, 2500) => 3,
            (2500 | 5000, _) => 2,
            _ => 1,
        };
        let wanted = ScanShape { frequency_centihz, step_e4deg };
        if status == 0 && wanted != self.shape {
            self.shape = wanted;
            // The head spins up anew where it was turning.
            self.started = self.started.map(|_| now);
        }
        Ok(status)
    }
}

fn authorised(session: &Session) -> Result<(), u16> {
    if session.level >= AUTHORISED { Ok(()) } else { Err(code::ACCESS_DENIED) }
}

fn data_config(fields: &mut Reader<'_>) -> Result<DataConfig, u16> {
    let mut byte = || fields.u8().ok_or(code::PARAMETER_MISSING);
    let (channels, _) = (byte()?, byte()?);
    let (remission, width, unit) = (byte()?, byte()?, byte()?);
    let (_, _) = (byte()?, byte()?);
    let (position, device_name, comment, clock) = (byte()?, byte()?, byte()?, byte()?);
    let interval = fields.u16().ok_or(code::PARAMETER_MISSING)?;
    if !fields.is_done() {
        return Err(code::INVALID_DATA);
    }
    let flags = [remission, width, position, device_name, comment, clock];
    if !matches!(channels, 1 | 3) || flags.iter().any(|f| *f > 1) || unit != 0 || !(1..=50_000).contains(&interval) {
        return Err(code::CONDITION_FAILED);
    }
    Ok(DataConfig {
        second_echo: channels == 3,
        remission: remission == 1,
        remission_16_bit: width == 1,
        device_name: device_name == 1,
        clock: clock == 1,
        interval,
    })
}

fn subscribe(session: &mut Session, dialect: Dialect, name: &str, mut fields: Reader<'_>) -> Result<Vec<u8>, u16> {
    let on = fields.u8().ok_or(code::PARAMETER_MISSING)?;
    match name {
        "LMDscandata" => session.streaming = on == 1,
        "LIDoutputstate" | "LIDinputstate" | "LFErec" => {}
        _ => return Err(code::UNKNOWN_EVENT),
    }
    Ok(Writer::new(dialect, "sEA", name).u8(on).framed())
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Bench {
        device: Device,
        session: Session,
    }

    fn t(s: f64) -> Timestamp {
        Timestamp::from_seconds(1e9 + s)
    }

    impl Bench {
        fn new() -> Self {
            Self { device: Device::new(&Lms151Options::default(), t(0.0)), session: Session::default() }
        }

        fn ask(&mut self, request: &str, at_s: f64) -> String {
            match self.device.handle(&mut self.session, Dialect::A, request.as_bytes(), t(at_s)) {
                Outcome::Answer { bytes, .. } => {
                    String::from_utf8(bytes).unwrap().trim_matches(['\u{2}', '\u{3}']).to_owned()
                }
                other => format!("{other:?}"),
            }
        }

        fn log_in(&mut self) {
            assert_eq!(self.ask("sMN SetAccessMode 03 F4724744", 0.0), "sAN SetAccessMode 1");
        }
    }

    #[test]
    fn settings_need_a_log_in_and_run_logs_out() {
        let mut bench = Bench::new();
        let request = "sMN mLMPsetscancfg 1388 1 1388 FFF92230 225510";
        assert_eq!(bench.ask(request, 0.0), "sFA 1");
        assert_eq!(bench.ask("sMN SetAccessMode 03 F4724745", 0.0), "sAN SetAccessMode 0");
        bench.log_in();
        assert_eq!(bench.ask(request, 0.0), "sAN mLMPsetscancfg 0 1388 1 1388 FFF92230 225510");
        assert_eq!(bench.ask("sMN Run", 0.0), "sAN Run 1");
        assert_eq!(bench.ask("sWN LMDscandatacfg 01 00 0 1 0 00 00 0 0 0 1 1", 0.0), "sFA 1");
    }

    #[test]
    fn wrong_scan_settings_say_which_value_is_wrong() {
        let mut bench = Bench::new();
        bench.log_in();
        let mut status = |frequency: &str, step: &str, start: &str| {
            bench.ask(&format!("sMN mLMPsetscancfg {frequency} 1 {step} {start} 225510"), 0.0)
        };
        let kept = "1388 1 1388 FFF92230 225510";
        assert_eq!(status("+6000", "1388", "FFF92230"), format!("sAN mLMPsetscancfg 1 {kept}"));
        assert_eq!(status("1388", "+1000", "FFF92230"), format!("sAN mLMPsetscancfg 2 {kept}"));
        assert_eq!(status("1388", "9C4", "FFF92230"), format!("sAN mLMPsetscancfg 3 {kept}"));
        assert_eq!(status("1388", "1388", "-440000"), format!("sAN mLMPsetscancfg 4 {kept}"));
        assert_eq!(status("9C4", "9C4", "-450000"), "sAN mLMPsetscancfg 0 9C4 1 9C4 FFF92230 225510");
    }

    #[test]
    fn it_spins_up_from_5_to_7_and_a_new_setting_spins_it_up_again() {
        let mut bench = Bench::new();
        assert_eq!(bench.ask("sRN STlms", 1.9), "sRA STlms 5 0 8 00:00:01 8 01.01.70 0 0 0");
        assert!(bench.ask("sRN STlms", 2.0).starts_with("sRA STlms 7 "));
        bench.log_in();
        bench.ask("sMN mLMPsetscancfg 1388 1 1388 FFF92230 225510", 10.0);
        assert!(bench.ask("sRN STlms", 10.1).starts_with("sRA STlms 7 "), "nothing changed");
        bench.ask("sMN mLMPsetscancfg 9C4 1 9C4 FFF92230 225510", 20.0);
        assert!(bench.ask("sRN STlms", 21.9).starts_with("sRA STlms 5 "));
        assert!(bench.device.measuring(t(21.9)).is_none());
        assert_eq!(bench.device.measuring(t(23.0)).unwrap().since, t(22.0));
        assert_eq!(bench.ask("sMN LMCstopmeas", 30.0), "sAN LMCstopmeas 0");
        assert!(bench.ask("sRN STlms", 40.0).starts_with("sRA STlms 3 "));
        assert_eq!(bench.ask("sMN LMCstartmeas", 50.0), "sAN LMCstartmeas 0");
        assert!(bench.ask("sRN STlms", 51.0).starts_with("sRA STlms 5 "));
    }

    #[test]
    fn every_other_command_of_the_table_is_answered() {
        let mut bench = Bench::new();
        bench.log_in();
        for (request, answer) in [
            ("sRN LMPscancfg", "sRA LMPscancfg 1388 1 1388 FFF92230 225510"),
            ("sWN LMDscandatacfg 01 00 1 0 0 00 00 0 0 0 1 2", "sWA LMDscandatacfg"),
            ("sRN LMDscandatacfg", "sRA LMDscandatacfg 1 0 1 0 0 0 0 0 0 0 1 2"),
            ("sWN LMDscandatacfg 01 00 1 0", "sFA 8"),
            ("sWN LMDscandatacfg 02 00 0 0 0 00 00 0 0 0 1 1", "sFA 4"),
            ("sWN LMPoutputRange 1 1388 0 +1800000", "sWA LMPoutputRange"),
            ("sRN LMPoutputRange", "sRA LMPoutputRange 1 1388 0 1B7740"),
            ("sWN LMPoutputRange 1 1388 +10 +5", "sFA 4"),
            ("sMN mEEwriteall", "sAN mEEwriteall 1"),
            ("sEN LMDscandata 1", "sEA LMDscandata 1"),
            ("sEN LFErec 1", "sEA LFErec 1"),
            ("sRN FirmwareVersion", "sRA FirmwareVersion 7 V1.80.2"),
            ("sRN SCdevicestate", "sRA SCdevicestate 1"),
            ("sRN LCMstate", "sRA LCMstate 0"),
            ("sWN TSCRole 1", "sWA TSCRole"),
            ("sMN LMCstandby", "sAN LMCstandby 0"),
            ("sRN Nonsense", "sFA 3"),
            ("sMN Nonsense", "sFA 2"),
            ("sEN Nonsense 1", "sFA F"),
            ("hello", "sFA C"),
        ] {
            assert_eq!(bench.ask(request, 5.0), answer, "{request}");
        }
        assert!(bench.session.streaming);
        assert_eq!(bench.ask("sRN LMDscandata", 5.0), "NextScan");
        assert!(bench.ask("sMN mSCreboot", 5.0).starts_with("Reboot"));
    }

    #[test]
    fn the_binary_dialogue_of_a_real_capture_is_answered_byte_by_byte() {
        let mut bench = Bench::new();
        let mut ask = |request: &[u8]| match bench.device.handle(&mut bench.session, Dialect::B, request, t(9.0)) {
            Outcome::Answer { bytes, .. } => bytes,
            other => panic!("{other:?}"),
        };
        ask(b"sMN SetAccessMode \x03\xf4rGD");
        assert_eq!(
            ask(b"sWN LMDscandatacfg \x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x01\x00\x01"),
            b"\x02\x02\x02\x02\x00\x00\x00\x13sWA LMDscandatacfg M"
        );
        assert_eq!(
            ask(b"sRN LMDscandatacfg"),
            b"\x02\x02\x02\x02\x00\x00\x00 sRA LMDscandatacfg \x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x01\x00\x01I"
        );
        assert_eq!(ask(b"sMN LMCstartmeas"), b"\x02\x02\x02\x02\x00\x00\x00\x12sAN LMCstartmeas \x00D");
        assert_eq!(ask(b"sMN Run"), b"\x02\x02\x02\x02\x00\x00\x00\tsAN Run \x014");
        assert_eq!(ask(b"sEN LMDscandata \x01"), b"\x02\x02\x02\x02\x00\x00\x00\x11sEA LMDscandata \x01<");
    }
}
