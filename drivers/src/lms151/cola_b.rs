//! CoLa-B framing: `02 02 02 02`, payload length (u32, big-endian), payload, XOR of the payload's bytes.
//!
//! In: bytes as they arrive, in any pieces. Out: payloads whose checksum is right, and counts of what was skipped. After a bad
//! length or checksum it searches the next start behind the bad one, so a frame swallowed by a damaged one is found
//! again. It holds at most one unfinished frame. Source: protocol notes 1.1.

use super::dialect::{FrameCounts, PAYLOAD_MAX};

const START: [u8; 4] = [2; 4];
/// Start and length.
const HEAD: usize = 8;
/// Bytes taken in between two looks at the buffer: it never holds more than one frame and one piece.
const PIECE: usize = 4096;

/// Finds frames in a byte stream.
#[derive(Clone, Debug, Default)]
pub struct Framer {
    buffer: Vec<u8>,
    counts: FrameCounts,
}

/// What the bytes at the front of the buffer are.
enum Front {
    Unfinished,
    /// No frame starts here: drop this many bytes.
    Noise(usize),
    /// A frame starts here and is damaged.
    Bad,
    /// A whole frame with a payload of this many bytes.
    Frame(usize),
}

impl Framer {
    /// Takes bytes in, hands each whole payload out.
    pub fn feed(&mut self, bytes: &[u8], mut on_payload: impl FnMut(&[u8])) {
        for piece in bytes.chunks(PIECE) {
            self.buffer.extend_from_slice(piece);
            let used = self.drain(&mut on_payload);
            self.buffer.drain(..used);
        }
    }

    /// Frames found and bytes skipped so far.
    pub fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// Bytes held of an unfinished frame.
    pub fn held(&self) -> usize {
        self.buffer.len()
    }

    fn drain(&mut self, on_payload: &mut impl FnMut(&[u8])) -> usize {
        let mut used = 0;
        loop {
            let rest = &self.buffer[used..];
            match front(rest) {
                Front::Unfinished => return used,
                Front::Noise(bytes) => {
                    self.counts.bytes_skipped += bytes as u64;
                    used += bytes;
                }
                Front::Bad => {
                    self.counts.bad_frames += 1;
                    self.counts.bytes_skipped += 1;
                    used += 1;
                }
                Front::Frame(length) => {
                    self.counts.frames += 1;
                    on_payload(&rest[HEAD..HEAD + length]);
                    used += HEAD + length + 1;
                }
            }
        }
    }
}

fn front(bytes: &[u8]) -> Front {
    let known = bytes.len().min(START.len());
    if bytes[..known] != START[..known] {
        return Front::Noise(bytes.iter().skip(1).position(|b| *b == START[0]).map_or(bytes.len(), |at| at + 1));
    }
    let Some(length) = bytes.get(4..HEAD) else { return Front::Unfinished };
    let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
    if length == 0 || length > PAYLOAD_MAX {
        return Front::Bad;
    }
    // Every command word starts with `s`: four accidental 02 and a plausible length are told apart here, before up to
    // 64 KiB of good telegrams would wait behind them.
    match bytes.get(HEAD) {
        None => return Front::Unfinished,
        Some(b's') => {}
        Some(_) => return Front::Bad,
    }
    let Some(frame) = bytes.get(HEAD..=HEAD + length) else { return Front::Unfinished };
    if checksum(&frame[..length]) == frame[length] { Front::Frame(length) } else { Front::Bad }
}

/// XOR of all bytes.
pub fn checksum(payload: &[u8]) -> u8 {
    payload.iter().fold(0, |sum, byte| sum ^ byte)
}

/// A payload in its frame.
pub fn encode(payload: &[u8]) -> Vec<u8> {
    let mut frame = Vec::with_capacity(payload.len() + HEAD + 1);
    frame.extend_from_slice(&START);
    frame.extend_from_slice(&(payload.len() as u32).to_be_bytes());
    frame.extend_from_slice(payload);
    frame.push(checksum(payload));
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(bytes: &[u8]) -> (Vec<Vec<u8>>, FrameCounts, usize) {
        let (mut framer, mut out) = (Framer::default(), Vec::new());
        framer.feed(bytes, |p| out.push(p.to_vec()));
        (out, framer.counts(), framer.held())
    }

    #[test]
    fn the_log_in_frame_of_the_makers_tool_is_reproduced() {
        // Written down from a capture of a real LMS111.
        let payload = b"sMN SetAccessMode \x03\xf4rGD";
        let frame = encode(payload);
        assert_eq!(frame[..8], [2, 2, 2, 2, 0, 0, 0, 0x17]);
        assert_eq!(frame.last(), Some(&0xb3));
        assert_eq!(frames(&frame).0, [payload.to_vec()]);
    }

    #[test]
    fn start_and_end_bytes_inside_a_payload_do_not_matter() {
        let payload = b"sSN LMDscandata \x02\x02\x02\x02\x03\x00\x00\x03\x02\x02\x02\x02";
        assert_eq!(
            frames(&encode(payload)),
            (vec![payload.to_vec()], FrameCounts { frames: 1, ..Default::default() }, 0)
        );
    }

    #[test]
    fn a_wrong_checksum_costs_one_frame_only() {
        let mut bytes = encode(b"sAN Run \x01");
        *bytes.last_mut().unwrap() ^= 1;
        bytes.extend(encode(b"sAN Run \x01"));
        let (out, counts, held) = frames(&bytes);
        assert_eq!((out.len(), counts.bad_frames, counts.bytes_skipped, held), (1, 1, 18, 0));
    }

    #[test]
    fn a_length_that_lies_gives_back_the_frames_it_swallowed() {
        let mut bytes = encode(b"sAN Run \x01");
        bytes[7] = 40;
        for _ in 0..3 {
            bytes.extend(encode(b"sAN Run \x01"));
        }
        assert_eq!(frames(&bytes).0.len(), 3);
    }

    #[test]
    fn an_impossible_length_is_not_waited_for() {
        let mut bytes = vec![2, 2, 2, 2, 0xff, 0xff, 0xff, 0xff];
        bytes.extend(encode(b"sAN Run \x01"));
        let (out, counts, held) = frames(&bytes);
        assert_eq!((out.len(), counts.bad_frames, held), (1, 1, 0));
    }

    #[test]
    fn a_stray_start_byte_before_a_frame_is_skipped() {
        let mut bytes = vec![2];
        bytes.extend(encode(b"sAN Run \x01"));
        assert_eq!(frames(&bytes).0.len(), 1);
    }
}
