//! `LMDscandata`: one mirror turn as the device sends it, in either dialect, parsed and emitted.
//!
//! In: the fields of a telegram. Out: [`ScanData`], every field of it in the device's own units (1/100 Hz, 1/10000 degree,
//! microseconds since the device's start-up, raw values). It does not judge values or times: [`super::assemble`] does.
//! Source: protocol notes 1.4, field by field in the order of the wire.

use super::fields::{Malformed, Reader, Writer};

/// Name of the variable and of the event.
pub const NAME: &str = "LMDscandata";
/// Raw values below this one are codes and not measurements (protocol notes 1.5).
pub const CODES_END: u16 = 16;

/// One scan telegram.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScanData {
    /// Version of this layout.
    pub version: u16,
    /// Number given to the device by its user.
    pub device_number: u16,
    /// Serial number.
    pub serial: u32,
    /// Two status bytes; either non-zero is not good: 1 error or not yet ready, 2 contamination warning, 5 contamination error.
    pub status: [u8; 2],
    /// One more for each telegram, wraps.
    pub telegram_counter: u16,
    /// One more for each mirror turn, wraps.
    pub scan_counter: u16,
    /// The scan's own time on the device's clock, microseconds, wraps after 71.6 minutes.
    pub scan_time_us: u32,
    /// When the device sent it, same clock.
    pub transmission_time_us: u32,
    /// Digital inputs.
    pub inputs: [u8; 2],
    /// Digital outputs.
    pub outputs: [u8; 2],
    /// Angle of the scan layer on devices with several; reserved on this one.
    pub layer_angle: i16,
    /// Nominal turns, 1/100 Hz.
    pub scan_frequency_centihz: u32,
    /// Beams a second, in units of 100 Hz.
    pub measurement_frequency_100hz: u32,
    /// Encoders.
    pub encoders: Vec<Encoder>,
    /// Channels with 16-bit data.
    pub channels_16: Vec<Channel>,
    /// Channels with 8-bit data.
    pub channels_8: Vec<Channel>,
    /// Where the device says it is.
    pub position: Option<Position>,
    /// Name of the device.
    pub name: Option<String>,
    /// Comment its user stored.
    pub comment: Option<String>,
    /// Wall-clock time of transmission.
    pub time: Option<DeviceTime>,
    /// What triggered the scan.
    pub event: Option<DeviceEvent>,
}

/// One encoder's reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoder {
    /// Ticks.
    pub position: u32,
    /// Ticks a millimetre, or what the device is configured to.
    pub speed: u16,
}

/// One quantity of all beams.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// `DIST1`, `DIST2`, `RSSI1`, `RSSI2`, `ANGL1`, `VANG1`.
    pub name: [u8; 5],
    /// Value = raw * scale + offset.
    pub scale: f32,
    /// Value = raw * scale + offset.
    pub offset: f32,
    /// Angle of the first beam, 1/10000 degree.
    pub start_e4_deg: i32,
    /// Angle from a beam to the next, 1/10000 degree.
    pub step_e4_deg: u16,
    /// Raw values, first beam first.
    pub raw: Vec<u16>,
}

/// Position block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// x, y, z and the rotations about them.
    pub xyz_rotations: [f32; 6],
    /// How the rotations are meant.
    pub rotation_kind: u8,
}

/// Wall clock of the device; 1970 without a time server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceTime {
    /// Year.
    pub year: u16,
    /// 1 to 12.
    pub month: u8,
    /// 1 to 31.
    pub day: u8,
    /// 0 to 23.
    pub hour: u8,
    /// 0 to 59.
    pub minute: u8,
    /// 0 to 59.
    pub second: u8,
    /// Steps of 1000 on this device.
    pub microsecond: u32,
}

/// Event block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceEvent {
    /// Kind, four characters.
    pub kind: [u8; 4],
    /// Encoder position.
    pub position: u32,
    /// Device time, microseconds.
    pub time_us: u32,
    /// Angle, 1/10000 degree.
    pub angle_e4_deg: i32,
}

impl Channel {
    /// One raw value in the channel's unit; a code below 16 stays as it came.
    pub fn scaled(&self, raw: u16) -> f64 {
        if raw < CODES_END { f64::from(raw) } else { f64::from(raw) * f64::from(self.scale) + f64::from(self.offset) }
    }
}

impl ScanData {
    /// The channel of this name, 16-bit ones first.
    pub fn channel(&self, name: &[u8; 5]) -> Option<&Channel> {
        self.channels_16.iter().chain(&self.channels_8).find(|c| &c.name == name)
    }

    /// Reads all fields; the reader stands behind the last one afterwards.
    pub fn parse(r: &mut Reader<'_>) -> Result<Self, Malformed> {
        let mut data = Self::parse_head(r)?;
        data.encoders = many(r, "encoder count", 6, parse_encoder)?;
        data.channels_16 = many(r, "16-bit channel count", CHANNEL_BYTES, |r| parse_channel(r, 2))?;
        data.channels_8 = many(r, "8-bit channel count", CHANNEL_BYTES, |r| parse_channel(r, 1))?;
        data.position = optional(r, "position flag", parse_position)?;
        data.name = optional(r, "name flag", |r| r.text("name", 1))?;
        data.comment = optional(r, "comment flag", |r| r.text("comment", 1))?;
        data.time = optional(r, "time flag", parse_time)?;
        data.event = optional(r, "event flag", parse_event)?;
        Ok(data)
    }

    fn parse_head(r: &mut Reader<'_>) -> Result<Self, Malformed> {
        Ok(Self {
            version: r.u16("version")?,
            device_number: r.u16("device number")?,
            serial: r.u32("serial number")?,
            status: [r.u8("status 1")?, r.u8("status 2")?],
            telegram_counter: r.u16("telegram counter")?,
            scan_counter: r.u16("scan counter")?,
            scan_time_us: r.u32("scan time")?,
            transmission_time_us: r.u32("transmission time")?,
            inputs: [r.u8("inputs 1")?, r.u8("inputs 2")?],
            outputs: [r.u8("outputs 1")?, r.u8("outputs 2")?],
            layer_angle: r.i16("layer angle")?,
            scan_frequency_centihz: r.u32("scan frequency")?,
            measurement_frequency_100hz: r.u32("measurement frequency")?,
            ..Self::default()
        })
    }

    /// Writes all fields.
    pub fn emit(&self, w: &mut Writer) {
        w.u16(self.version).u16(self.device_number).u32(self.serial).u8(self.status[0]).u8(self.status[1]);
        w.u16(self.telegram_counter).u16(self.scan_counter).u32(self.scan_time_us).u32(self.transmission_time_us);
        w.u8(self.inputs[0]).u8(self.inputs[1]).u8(self.outputs[0]).u8(self.outputs[1]).i16(self.layer_angle);
        w.u32(self.scan_frequency_centihz).u32(self.measurement_frequency_100hz);
        emit_many(w, &self.encoders, |w, e| {
            w.u32(e.position).u16(e.speed);
        });
        emit_many(w, &self.channels_16, |w, c| emit_channel(w, c, 2));
        emit_many(w, &self.channels_8, |w, c| emit_channel(w, c, 1));
        emit_optional(w, &self.position, |w, p| {
            p.xyz_rotations.iter().for_each(|v| {
                w.f32(*v);
            });
            w.u8(p.rotation_kind);
        });
        emit_optional(w, &self.name, |w, text| {
            w.text(text, 1);
        });
        emit_optional(w, &self.comment, |w, text| {
            w.text(text, 1);
        });
        emit_optional(w, &self.time, emit_time);
        emit_optional(w, &self.event, |w, e| {
            w.chars(&e.kind).u32(e.position).u32(e.time_us).i32(e.angle_e4_deg);
        });
    }
}

/// Least bytes of a channel block in CoLa-B: name, scale, offset, start, step, count.
const CHANNEL_BYTES: usize = 5 + 4 + 4 + 4 + 2 + 2;

fn many<T>(
    r: &mut Reader<'_>,
    field: &'static str,
    bytes_each: usize,
    one: impl Fn(&mut Reader<'_>) -> Result<T, Malformed>,
) -> Result<Vec<T>, Malformed> {
    let count = usize::from(r.u16(field)?);
    r.expect_room(field, count, bytes_each)?;
    (0..count).map(|_| one(r)).collect()
}

fn optional<T>(
    r: &mut Reader<'_>,
    field: &'static str,
    one: impl Fn(&mut Reader<'_>) -> Result<T, Malformed>,
) -> Result<Option<T>, Malformed> {
    if r.u16(field)? == 0 { Ok(None) } else { one(r).map(Some) }
}

fn parse_encoder(r: &mut Reader<'_>) -> Result<Encoder, Malformed> {
    Ok(Encoder { position: r.u32("encoder position")?, speed: r.u16("encoder speed")? })
}

fn parse_channel(r: &mut Reader<'_>, bytes_each: usize) -> Result<Channel, Malformed> {
    let name = r.chars("channel name", 5)?;
    let mut channel = Channel {
        name: std::array::from_fn(|i| name[i]),
        scale: r.f32("channel scale")?,
        offset: r.f32("channel offset")?,
        start_e4_deg: r.i32("start angle")?,
        step_e4_deg: r.u16("angular step")?,
        raw: Vec::new(),
    };
    let count = usize::from(r.u16("data count")?);
    r.expect_room("data count", count, bytes_each)?;
    channel.raw.reserve_exact(count);
    for _ in 0..count {
        channel.raw.push(if bytes_each == 1 { u16::from(r.u8("data")?) } else { r.u16("data")? });
    }
    Ok(channel)
}

fn parse_position(r: &mut Reader<'_>) -> Result<Position, Malformed> {
    let mut xyz_rotations = [0.0; 6];
    for value in &mut xyz_rotations {
        *value = r.f32("position")?;
    }
    Ok(Position { xyz_rotations, rotation_kind: r.u8("rotation kind")? })
}

fn parse_time(r: &mut Reader<'_>) -> Result<DeviceTime, Malformed> {
    Ok(DeviceTime {
        year: r.u16("year")?,
        month: r.u8("month")?,
        day: r.u8("day")?,
        hour: r.u8("hour")?,
        minute: r.u8("minute")?,
        second: r.u8("second")?,
        microsecond: r.u32("microsecond")?,
    })
}

fn parse_event(r: &mut Reader<'_>) -> Result<DeviceEvent, Malformed> {
    let kind = r.chars("event kind", 4)?;
    Ok(DeviceEvent {
        kind: std::array::from_fn(|i| kind[i]),
        position: r.u32("event position")?,
        time_us: r.u32("event time")?,
        angle_e4_deg: r.i32("event angle")?,
    })
}

fn emit_many<T>(w: &mut Writer, items: &[T], one: impl Fn(&mut Writer, &T)) {
    let count = u16::try_from(items.len()).unwrap_or(u16::MAX);
    w.u16(count);
    items.iter().take(usize::from(count)).for_each(|item| one(w, item));
}

fn emit_optional<T>(w: &mut Writer, item: &Option<T>, one: impl Fn(&mut Writer, &T)) {
    w.u16(u16::from(item.is_some()));
    if let Some(item) = item {
        one(w, item);
    }
}

fn emit_channel(w: &mut Writer, c: &Channel, bytes_each: usize) {
    w.chars(&c.name).f32(c.scale).f32(c.offset).i32(c.start_e4_deg).u16(c.step_e4_deg);
    emit_many(w, &c.raw, |w, raw| match bytes_each {
        1 => {
            w.u8((*raw).min(0xFF) as u8);
        }
        _ => {
            w.u16(*raw);
        }
    });
}

fn emit_time(w: &mut Writer, t: &DeviceTime) {
    w.u16(t.year).u8(t.month).u8(t.day).u8(t.hour).u8(t.minute).u8(t.second).u32(t.microsecond);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lms151::telegram::{Dialect, Packet};

    fn parse(dialect: Dialect, payload: &[u8]) -> Result<ScanData, Malformed> {
        let mut fields = Packet::parse(dialect, payload)?.fields();
        let data = ScanData::parse(&mut fields)?;
        fields.finish()?;
        Ok(data)
    }

    #[test]
    fn a_telegram_written_out_by_hand_reads_field_by_field() {
        let text = b"sSN LMDscandata 1 1 A037B9 0 2 C1C3 C1C6 8B621C37 8B627603 0 1 7 0 0 1388 168 0 1 DIST1 40000000 \
            3F800000 FFF92230 1388 4 293 0 3 10 1 RSSI1 3F800000 00000000 FFF92230 1388 4 1 2 FE FF 0 0 1 B not defined \
            1 7B2 1 2 3 4 5 F4240 1 EVT1 1 2 FFFFFFFE";
        let scan = parse(Dialect::A, text).unwrap();
        assert_eq!((scan.serial, scan.status, scan.inputs, scan.outputs), (0xA0_37B9, [0, 2], [0, 1], [7, 0]));
        assert_eq!((scan.telegram_counter, scan.scan_counter), (0xC1C3, 0xC1C6));
        assert_eq!(scan.transmission_time_us - scan.scan_time_us, 0x59CC);
        assert_eq!((scan.scan_frequency_centihz, scan.measurement_frequency_100hz), (5000, 360));
        let dist = scan.channel(b"DIST1").unwrap();
        assert_eq!((dist.start_e4_deg, dist.step_e4_deg, &dist.raw[..]), (-450_000, 5000, &[0x293, 0, 3, 16][..]));
        // 0x293 = 659; 659 * 2 + 1. Codes stay, 16 is the first measurement.
        let scaled: Vec<f64> = dist.raw.iter().map(|r| dist.scaled(*r)).collect();
        assert_eq!(scaled, [1319.0, 0.0, 3.0, 33.0]);
        assert_eq!(scan.channel(b"RSSI1").unwrap().raw, [1, 2, 254, 255]);
        assert_eq!((scan.name, scan.comment.as_deref()), (None, Some("not defined")));
        let time = scan.time.unwrap();
        assert_eq!((time.year, time.month, time.second, time.microsecond), (1970, 1, 5, 1_000_000));
        assert_eq!(scan.event.unwrap().angle_e4_deg, -2);
    }

    #[test]
    fn a_count_larger_than_the_telegram_is_refused_before_memory_is_taken() {
        let text = b"sSN LMDscandata 1 1 1 0 0 1 1 1 1 0 0 0 0 0 1388 168 FFFF 1 2";
        let fault = parse(Dialect::A, text).unwrap_err();
        assert_eq!(fault.field, "encoder count");
        assert!(fault.why.starts_with("65535 values announced"), "{fault}");
    }
}
