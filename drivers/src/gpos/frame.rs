//! Frames in a stream of bytes: NMEA sentences, NovAtel ASCII and binary logs, mixed, torn apart or glued together.
//!
//! In: bytes as they come. Out: frames whose checksum is right, without it. A frame that fails is given up one byte at
//! a time, so a good frame that begins inside a broken one is still found. What lies between frames is counted.
//!
//! Source: wire format notes sections 4.1 (NMEA) and 4.2 (NovAtel OEM7).

/// A frame whose checksum is right.
#[derive(Clone, Debug, PartialEq)]
pub enum Frame {
    /// The text between `$` and `*`.
    Nmea(String),
    /// The text between `#` or `%` and `*`.
    NovatelText(String),
    /// A NovAtel binary log: message number and body.
    NovatelBinary {
        /// The message number; 1465 is INSPVAX.
        id: u16,
        /// GPS week of the header.
        week: u16,
        /// Milliseconds of the week in the header.
        week_ms: u32,
        /// The body without header and checksum.
        body: Vec<u8>,
    },
}

/// A frame and where it lay in the stream.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The frame.
    pub frame: Frame,
    /// Bytes from the frame's first byte to the end of what was read with it.
    pub bytes_since_start: usize,
}

/// What was thrown away so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Losses {
    /// Frames with a wrong checksum.
    pub checksum: u64,
    /// Frames that are too long or hold bytes they must not.
    pub malformed: u64,
    /// Bytes outside of any frame.
    pub noise_bytes: u64,
}

/// Longest NMEA sentence, bytes: the standard's 82 are exceeded by precise receivers.
const NMEA_MAX: usize = 256;
/// Longest NovAtel text log that is waited for, bytes: INSPVAX has 300.
const NOVATEL_TEXT_MAX: usize = 1024;
/// Longest binary body that is believed, bytes; other logs in the stream are skipped whole up to this.
const NOVATEL_BODY_MAX: usize = 8192;
const LONG_HEADER: usize = 28;
const SHORT_HEADER: usize = 12;
const CRC_BYTES: usize = 4;

/// Cuts a stream into frames. Never holds more than the longest frame and one read.
#[derive(Debug, Default)]
pub struct Framer {
    buffer: Vec<u8>,
    losses: Losses,
}

enum Step {
    /// A frame of this many bytes.
    Frame(Frame, usize),
    /// The first byte begins nothing, or something broken.
    Skip(Fault),
    /// More bytes are needed to tell.
    More,
}

enum Fault {
    Noise,
    Checksum,
    Malformed,
}

impl Framer {
    /// Takes bytes; returns the frames they complete.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<Found> {
        self.buffer.extend_from_slice(bytes);
        let mut frames = Vec::new();
        let mut at = 0;
        while at < self.buffer.len() {
            match step(&self.buffer[at..]) {
                Step::Frame(frame, length) => {
                    frames.push(Found { frame, bytes_since_start: self.buffer.len() - at });
                    at += length;
                }
                Step::Skip(fault) => {
                    self.count(fault);
                    at += 1;
                }
                Step::More => break,
            }
        }
        self.buffer.drain(..at);
        frames
    }

    fn count(&mut self, fault: Fault) {
        match fault {
            Fault::Noise => self.losses.noise_bytes += 1,
            Fault::Checksum => self.losses.checksum += 1,
            Fault::Malformed => self.losses.malformed += 1,
        }
    }

    /// What was thrown away so far.
    pub fn losses(&self) -> Losses {
        self.losses
    }

    /// Forgets a half frame: the line was opened anew.
    pub fn clear(&mut self) {
        self.buffer.clear();
    }
}

fn step(bytes: &[u8]) -> Step {
    match bytes[0] {
        b'$' => text(bytes, NMEA_MAX, nmea),
        b'#' | b'%' => text(bytes, NOVATEL_TEXT_MAX, novatel_text),
        0xAA => binary(bytes),
        _ => Step::Skip(Fault::Noise),
    }
}

/// A line of printable characters, given to `check` without its first byte and its end.
fn text(bytes: &[u8], longest: usize, check: fn(&str) -> Option<Frame>) -> Step {
    let end = bytes.iter().skip(1).position(|b| !matches!(b, b' '..=b'~') || *b == b'$').map(|at| at + 1);
    match end {
        None if bytes.len() < longest => Step::More,
        None => Step::Skip(Fault::Malformed),
        Some(end) if end > longest || !matches!(bytes[end], b'\r' | b'\n') => Step::Skip(Fault::Malformed),
        Some(end) => {
            let line = std::str::from_utf8(&bytes[1..end]).unwrap_or("");
            // The line feed behind a carriage return belongs to the line.
            let line_feed = usize::from(bytes[end] == b'\r' && bytes.get(end + 1) == Some(&b'\n'));
            check(line).map_or(Step::Skip(Fault::Checksum), |frame| Step::Frame(frame, end + 1 + line_feed))
        }
    }
}

/// XOR of the bytes between `$` and `*`, two hexadecimal digits.
fn nmea(line: &str) -> Option<Frame> {
    let (body, sum) = line.rsplit_once('*')?;
    let sum = u8::from_str_radix(sum.trim_end(), 16).ok()?;
    let right = body.bytes().fold(0, |x, b| x ^ b) == sum;
    right.then(|| Frame::Nmea(body.into()))
}

fn novatel_text(line: &str) -> Option<Frame> {
    let (body, sum) = line.rsplit_once('*')?;
    let sum = u32::from_str_radix(sum.trim_end(), 16).ok()?;
    (crc32(body.as_bytes()) == sum).then(|| Frame::NovatelText(body.into()))
}

fn binary(bytes: &[u8]) -> Step {
    let header = match bytes {
        [_, 0x44, 0x12, ..] => LONG_HEADER,
        [_, 0x44, 0x13, ..] => SHORT_HEADER,
        [_] | [_, 0x44] => return Step::More,
        _ => return Step::Skip(Fault::Noise),
    };
    let Some(head) = bytes.get(..header) else { return Step::More };
    let u16_at = |at: usize| u16::from_le_bytes([head[at], head[at + 1]]);
    let u32_at = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let (length, id, week, week_ms) = if header == LONG_HEADER {
        if usize::from(head[3]) != LONG_HEADER {
            return Step::Skip(Fault::Malformed);
        }
        (usize::from(u16_at(8)), u16_at(4), u16_at(14), u32_at(16))
    } else {
        (usize::from(head[3]), u16_at(4), u16_at(6), u32_at(8))
    };
    if length > NOVATEL_BODY_MAX {
        return Step::Skip(Fault::Malformed);
    }
    let end = header + length;
    let Some(sum) = bytes.get(end..end + CRC_BYTES) else { return Step::More };
    if crc32(&bytes[..end]) != u32::from_le_bytes([sum[0], sum[1], sum[2], sum[3]]) {
        return Step::Skip(Fault::Checksum);
    }
    let body = bytes[header..end].to_vec();
    Step::Frame(Frame::NovatelBinary { id, week, week_ms, body }, end + CRC_BYTES)
}

/// NovAtel's CRC-32: reflected polynomial EDB88320, initial value 0, no final inversion.
pub fn crc32(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |crc, byte| {
        let mut crc = crc ^ u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
        crc
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// `$body*hh` CR LF.
    pub fn sentence(body: &str) -> String {
        format!("${body}*{:02X}\r\n", body.bytes().fold(0, |x, b| x ^ b))
    }

    fn binary_log(id: u16, body: &[u8]) -> Vec<u8> {
        let mut log = vec![0xAA, 0x44, 0x13, body.len() as u8];
        log.extend(id.to_le_bytes());
        log.extend([0x9F, 0x06, 1, 0, 0, 0]);
        log.extend(body);
        log.extend(crc32(&log).to_le_bytes());
        log
    }

    fn frames(bytes: &[u8], piece: usize) -> (Vec<Frame>, Losses) {
        let mut framer = Framer::default();
        let frames = bytes.chunks(piece).flat_map(|piece| framer.push(piece)).map(|found| found.frame).collect();
        (frames, framer.losses())
    }

    #[test]
    fn a_checksum_known_from_elsewhere_is_right() {
        // 0x47 is the XOR of this body, added up by hand in a spreadsheet.
        assert!(nmea("GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47").is_some());
        assert!(nmea("GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*48").is_none());
    }

    #[test]
    fn mixed_frames_are_found_whatever_the_pieces() {
        let mut stream = b"\xAA\x44garbage$GPHDT,1".to_vec();
        stream.extend(sentence("GPHDT,90.0,T").bytes());
        stream.extend(binary_log(508, &[7; 9]));
        stream.extend(b"$GPHDT,91.0,T*00\r\n");
        stream.extend(sentence("GPHDT,92.0,T").bytes());
        let expected = [
            Frame::Nmea("GPHDT,90.0,T".into()),
            Frame::NovatelBinary { id: 508, week: 1695, week_ms: 1, body: vec![7; 9] },
            Frame::Nmea("GPHDT,92.0,T".into()),
        ];
        for piece in 1..stream.len() {
            let (found, losses) = frames(&stream, piece);
            assert_eq!(found, expected, "in pieces of {piece}");
            assert_eq!((losses.checksum, losses.malformed), (1, 1), "in pieces of {piece}");
        }
    }

    #[test]
    fn a_sentence_of_256_bytes_is_taken_and_an_endless_one_is_given_up() {
        let long = format!("GPTXT,{}", "x".repeat(245));
        assert_eq!(frames(sentence(&long).as_bytes(), 7).0.len(), 1);
        let mut framer = Framer::default();
        framer.push(&[b'$'; 1]);
        framer.push(&[b'x'; 5000]);
        assert!(framer.buffer.len() < NMEA_MAX);
    }

    proptest! {
        #[test]
        fn random_bytes_never_panic_and_hold_no_more_than_a_frame(
            bytes in proptest::collection::vec(prop_oneof![Just(0xAA_u8), Just(0x44), Just(0x12), Just(b'$'), any::<u8>()], 0..2000),
            piece in 1_usize..200,
        ) {
            let mut framer = Framer::default();
            for piece in bytes.chunks(piece) {
                framer.push(piece);
                prop_assert!(framer.buffer.len() <= LONG_HEADER + NOVATEL_BODY_MAX + CRC_BYTES);
            }
        }
    }
}
