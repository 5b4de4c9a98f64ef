//! What the driver asks of the device, and what the device answers: requests encoded, answers parsed, in either dialect.
//!
//! In: a [`Request`], or the fields of its answer. Out: bytes, or a [`Reply`]. Which request follows which is decided in
//! [`super::session`]. Source: protocol notes 1.3, row numbers in the comments.

use super::fields::{Malformed, Reader};
use super::scan_data;
use super::telegram::{Dialect, Packet, Verb, payload};

/// Log-in level of the authorised client and the hash of its factory password (row 1).
const CLIENT_LEVEL: u8 = 3;
const CLIENT_PASSWORD_HASH: u32 = 0xF472_4744;
/// The fixed measuring range of the LMS1xx, 1/10000 degree (row 2).
pub const RANGE_E4_DEG: [i32; 2] = [-450_000, 2_250_000];

/// How fast the mirror turns and how densely it measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanConfig {
    /// Turns, 1/100 Hz.
    pub frequency_centihz: u32,
    /// Angle between beams, 1/10000 degree.
    pub step_e4_deg: u32,
    /// First and last angle, 1/10000 degree.
    pub range_e4_deg: [i32; 2],
}

/// What each scan telegram carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataConfig {
    /// Both echoes, or the first only.
    pub both_echoes: bool,
    /// Echo strength: none, 8 or 16 bit.
    pub remission_bits: Option<u8>,
    /// Every n-th scan, 1 to 50000.
    pub output_interval: u16,
}

/// A variable the driver reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variable {
    /// Device type and version.
    DeviceIdent,
    /// Firmware.
    FirmwareVersion,
    /// 0 busy, 1 ready, 2 error.
    DeviceState,
    /// Name its user gave it.
    LocationName,
    /// Operating time, 1/10 hour.
    OperatingHours,
    /// Times switched on.
    PowerOns,
    /// How it scans now.
    ScanConfig,
    /// What it does now.
    Status,
    /// How dirty its window is.
    Contamination,
}

/// What is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Read a variable.
    Read(Variable),
    /// Become the authorised client.
    LogIn,
    /// Set rate and density.
    SetScanConfig(ScanConfig),
    /// Set what a telegram carries.
    SetDataConfig(DataConfig),
    /// Set the angles that are sent.
    SetOutputRange {
        /// Angle between beams, 1/10000 degree.
        step_e4_deg: u32,
    },
    /// Laser and motor on.
    StartMeasuring,
    /// Laser off.
    StopMeasuring,
    /// Laser and motor off.
    Standby,
    /// Leave the configuration level.
    Run,
    /// Subscribe to scans, or cancel.
    Stream(bool),
}

/// An answer, parsed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// Done; nothing more was said.
    Done,
    /// A result or a value.
    Number(u32),
    /// One or several texts.
    Texts(Vec<String>),
    /// How it scans; `status` is 0 where a setting was taken.
    ScanConfig {
        /// Result of setting it; 0 for a reading.
        status: u8,
        /// The values in force.
        config: ScanConfig,
    },
}

impl Variable {
    /// Its name on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Self::DeviceIdent => "DeviceIdent",
            Self::FirmwareVersion => "FirmwareVersion",
            Self::DeviceState => "SCdevicestate",
            Self::LocationName => "LocationName",
            Self::OperatingHours => "ODoprh",
            Self::PowerOns => "ODpwrc",
            Self::ScanConfig => "LMPscancfg",
            Self::Status => "STlms",
            Self::Contamination => "LCMstate",
        }
    }
}

impl Request {
    /// Name of the variable, method or event.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Read(variable) => variable.name(),
            Self::LogIn => "SetAccessMode",
            Self::SetScanConfig(_) => "mLMPsetscancfg",
            Self::SetDataConfig(_) => "LMDscandatacfg",
            Self::SetOutputRange { .. } => "LMPoutputRange",
            Self::StartMeasuring => "LMCstartmeas",
            Self::StopMeasuring => "LMCstopmeas",
            Self::Standby => "LMCstandby",
            Self::Run => "Run",
            Self::Stream(_) => scan_data::NAME,
        }
    }

    fn verbs(&self) -> (Verb, Verb) {
        match self {
            Self::Read(_) => (Verb::Read, Verb::ReadAnswer),
            Self::SetDataConfig(_) | Self::SetOutputRange { .. } => (Verb::Write, Verb::WriteAnswer),
            Self::Stream(_) => (Verb::Subscribe, Verb::SubscribeAnswer),
            _ => (Verb::Method, Verb::MethodAnswer),
        }
    }

    /// The request's payload.
    pub fn encode(&self, dialect: Dialect) -> Vec<u8> {
        payload(dialect, self.verbs().0, self.name(), |w| match self {
            Self::LogIn => {
                w.u8_two_digits(CLIENT_LEVEL).u32(CLIENT_PASSWORD_HASH);
            }
            Self::SetScanConfig(c) => {
                w.u32(c.frequency_centihz).u16(1).u32(c.step_e4_deg).i32(c.range_e4_deg[0]).i32(c.range_e4_deg[1]);
            }
            Self::SetDataConfig(c) => {
                w.u8_two_digits(if c.both_echoes { 3 } else { 1 }).u8_two_digits(0);
                w.u8(u8::from(c.remission_bits.is_some())).u8(u8::from(c.remission_bits == Some(16)));
                // Unit, encoder (two bytes), position, device name, comment: none. Time: sent.
                w.u8(0).u8_two_digits(0).u8_two_digits(0).u8(0).u8(0).u8(0).u8(1).u16(c.output_interval);
            }
            Self::SetOutputRange { step_e4_deg } => {
                w.u16(1).u32(*step_e4_deg).i32(RANGE_E4_DEG[0]).i32(RANGE_E4_DEG[1]);
            }
            Self::Stream(on) => {
                w.u8(u8::from(*on));
            }
            _ => {}
        })
    }

    /// Whether `packet` answers this request. A fault does too, but names nothing: the caller decides.
    pub fn is_answered_by(&self, packet: &Packet<'_>) -> bool {
        packet.verb == self.verbs().1 && packet.name == self.name()
    }

    /// Reads the answer's fields.
    pub fn parse_reply(&self, packet: &Packet<'_>) -> Result<Reply, Malformed> {
        let mut r = packet.fields();
        match self {
            Self::Read(Variable::DeviceIdent | Variable::FirmwareVersion | Variable::LocationName) => texts(&mut r),
            Self::Read(Variable::OperatingHours | Variable::PowerOns) => Ok(Reply::Number(r.u32("value")?)),
            Self::Read(Variable::DeviceState | Variable::Contamination) => Ok(Reply::Number(r.u8("value")?.into())),
            Self::Read(Variable::ScanConfig) => Ok(Reply::ScanConfig { status: 0, config: scan_config(&mut r)? }),
            Self::Read(Variable::Status) => Ok(Reply::Number(status(&mut r)?.into())),
            Self::SetScanConfig(_) => Ok(Reply::ScanConfig { status: r.u8("status")?, config: scan_config(&mut r)? }),
            Self::LogIn | Self::StartMeasuring | Self::StopMeasuring | Self::Standby | Self::Run => {
                Ok(Reply::Number(r.u8("result")?.into()))
            }
            Self::SetDataConfig(_) | Self::SetOutputRange { .. } | Self::Stream(_) => Ok(Reply::Done),
        }
    }
}

fn scan_config(r: &mut Reader<'_>) -> Result<ScanConfig, Malformed> {
    let frequency_centihz = r.u32("frequency")?;
    r.u16("sectors")?;
    let step_e4_deg = r.u32("resolution")?;
    Ok(ScanConfig { frequency_centihz, step_e4_deg, range_e4_deg: [r.i32("start angle")?, r.i32("stop angle")?] })
}

fn texts(r: &mut Reader<'_>) -> Result<Reply, Malformed> {
    let mut texts = Vec::new();
    // Two texts at most; CoLa-A devices may leave a space at the end.
    while texts.len() < 2 && !r.remaining().trim_ascii().is_empty() {
        texts.push(r.text("text", 2)?);
    }
    Ok(Reply::Texts(texts))
}

/// The state number of `STlms` (row 9); what follows it varies between firmwares and is not used.
fn status(r: &mut Reader<'_>) -> Result<u8, Malformed> {
    match (r.dialect(), r.remaining()) {
        // The state's width in CoLa-B is not documented: some devices send two bytes, high byte 0.
        (Dialect::B, [0, state, _, ..]) => Ok(*state),
        (Dialect::B, [0, state]) => Ok(*state),
        _ => r.u8("state"),
    }
}

/// A state number of `STlms` in words.
pub fn status_name(state: u8) -> &'static str {
    match state {
        1 => "initialising",
        2 => "configuring",
        3 => "idle",
        4 => "rotating",
        5 => "preparing",
        6 => "ready",
        STATUS_MEASURING => "measuring",
        _ => "undefined",
    }
}

/// `STlms` while the device measures.
pub const STATUS_MEASURING: u8 = 7;

/// What the device says to a rate and density it does not take (row 2).
pub fn scan_config_refusal(status: u8) -> &'static str {
    match status {
        1 => "bad frequency",
        2 => "bad resolution",
        3 => "frequency and resolution do not go together",
        4 => "bad scan area",
        _ => "unknown reason",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lms151::fields::latin1;

    fn reply(request: Request, dialect: Dialect, payload: &[u8]) -> Reply {
        let packet = Packet::parse(dialect, payload).unwrap();
        assert!(request.is_answered_by(&packet), "{request:?}");
        request.parse_reply(&packet).unwrap()
    }

    const FIFTY: ScanConfig = ScanConfig { frequency_centihz: 5000, step_e4_deg: 5000, range_e4_deg: RANGE_E4_DEG };

    #[test]
    fn requests_read_as_the_table_of_the_protocol_notes() {
        let text = |r: Request| latin1(&r.encode(Dialect::A));
        assert_eq!(text(Request::LogIn), "sMN SetAccessMode 03 F4724744");
        assert_eq!(text(Request::SetScanConfig(FIFTY)), "sMN mLMPsetscancfg 1388 1 1388 FFF92230 225510");
        let data = DataConfig { both_echoes: false, remission_bits: Some(16), output_interval: 1 };
        // The table's example has the width flag set while remission is off; here both follow from one choice.
        assert_eq!(text(Request::SetDataConfig(data)), "sWN LMDscandatacfg 01 00 1 1 0 00 00 0 0 0 1 1");
        assert_eq!(text(Request::SetOutputRange { step_e4_deg: 5000 }), "sWN LMPoutputRange 1 1388 FFF92230 225510");
        assert_eq!(text(Request::Stream(true)), "sEN LMDscandata 1");
        assert_eq!(text(Request::Read(Variable::Status)), "sRN STlms");
        assert_eq!(text(Request::Run), "sMN Run");
    }

    #[test]
    fn binary_requests_are_those_a_real_device_took() {
        // The thirteen bytes are those of a capture of a real LMS111; the range is the table's.
        let none = DataConfig { both_echoes: false, remission_bits: None, output_interval: 1 };
        let fields = [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1];
        assert_eq!(Request::SetDataConfig(none).encode(Dialect::B), [&b"sWN LMDscandatacfg "[..], &fields].concat());
        assert_eq!(
            Request::SetOutputRange { step_e4_deg: 5000 }.encode(Dialect::B),
            b"sWN LMPoutputRange \x00\x01\x00\x00\x13\x88\xff\xf9\x22\x30\x00\x22\x55\x10"
        );
    }

    #[test]
    fn answers_read_in_both_dialects() {
        use Variable::*;
        let texts = |t: &[&str]| Reply::Texts(t.iter().map(|t| t.to_string()).collect());
        let b = |r, p: &[u8]| reply(r, Dialect::B, p);
        let a = |r, p: &[u8]| reply(r, Dialect::A, p);
        assert_eq!(b(Request::Read(FirmwareVersion), b"sRA FirmwareVersion \x00\x09V1.80.2  "), texts(&["V1.80.2  "]));
        assert_eq!(b(Request::Read(OperatingHours), b"sRA ODoprh \x00\x00\x04V"), Reply::Number(1110));
        assert_eq!(a(Request::Read(LocationName), b"sRA LocationName B not defined"), texts(&["not defined"]));
        assert_eq!(a(Request::Read(DeviceIdent), b"sRA DeviceIdent 6 LMS151 5 V1.80"), texts(&["LMS151", "V1.80"]));
        let range = Reply::ScanConfig { status: 0, config: FIFTY };
        assert_eq!(a(Request::Read(ScanConfig), b"sRA LMPscancfg 1388 1 1388 FFF92230 225510"), range);
        assert_eq!(a(Request::SetScanConfig(FIFTY), b"sAN mLMPsetscancfg 0 1388 1 1388 FFF92230 225510"), range);
        assert_eq!(a(Request::Stream(true), b"sEA LMDscandata 1"), Reply::Done);
    }

    #[test]
    fn the_state_is_found_whatever_follows_it() {
        let request = Request::Read(Variable::Status);
        assert_eq!(reply(request, Dialect::A, b"sRA STlms 7 0 8 00:34:19 A 01.01.1970 0 0 0"), Reply::Number(7));
        assert_eq!(reply(request, Dialect::A, b"sRA STlms 5 0"), Reply::Number(5));
        assert_eq!(reply(request, Dialect::B, b"sRA STlms \x00\x07\x00\x00\x0800:34:19"), Reply::Number(7));
        assert_eq!(reply(request, Dialect::B, b"sRA STlms \x07\x00\x00\x0800:34:19"), Reply::Number(7));
        assert_eq!(reply(request, Dialect::B, b"sRA STlms \x07"), Reply::Number(7));
    }

    #[test]
    fn an_event_of_the_same_name_is_no_answer() {
        let event = Packet::parse(Dialect::A, b"sSN LMDscandata 1").unwrap();
        assert!(!Request::Stream(true).is_answered_by(&event));
    }
}
