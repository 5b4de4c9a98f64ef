//! CoLa-A framing: `02`, printable payload, `03`.
//!
//! In: bytes as they arrive, in any pieces. Out: payloads, and counts of what was skipped. It holds at most one
//! unfinished payload of [`PAYLOAD_MAX`] bytes. Source: protocol notes 1.1.

use super::dialect::{FrameCounts, PAYLOAD_MAX};

const START: u8 = 0x02;
const END: u8 = 0x03;

/// Finds frames in a byte stream.
#[derive(Clone, Debug, Default)]
pub struct Framer {
    payload: Vec<u8>,
    inside: bool,
    counts: FrameCounts,
}

impl Framer {
    /// Takes bytes in, hands each whole payload out.
    pub fn feed(&mut self, bytes: &[u8], mut on_payload: impl FnMut(&[u8])) {
        for byte in bytes {
            match *byte {
                START => self.start(),
                END if self.inside => {
                    self.counts.frames += 1;
                    on_payload(&self.payload);
                    self.forget();
                }
                byte if self.inside => self.append(byte),
                _ => self.counts.bytes_skipped += 1,
            }
        }
    }

    /// Frames found and bytes skipped so far.
    pub fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// Bytes held of an unfinished frame.
    pub fn held(&self) -> usize {
        self.payload.len()
    }

    fn start(&mut self) {
        if self.inside {
            self.abandon();
        }
        self.inside = true;
    }

    fn append(&mut self, byte: u8) {
        // Other control characters cannot occur in this dialect: the frame is damaged, or the stream is CoLa-B.
        if byte < b' ' || self.payload.len() >= PAYLOAD_MAX {
            self.abandon();
            self.counts.bytes_skipped += 1;
            return;
        }
        self.payload.push(byte);
    }

    fn abandon(&mut self) {
        self.counts.bad_frames += 1;
        self.counts.bytes_skipped += 1 + self.payload.len() as u64;
        self.forget();
    }

    fn forget(&mut self) {
        self.payload.clear();
        self.inside = false;
    }
}

/// A payload between its frame bytes.
pub fn encode(payload: &[u8]) -> Vec<u8> {
    let mut frame = Vec::with_capacity(payload.len() + 2);
    frame.push(START);
    frame.extend_from_slice(payload);
    frame.push(END);
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(bytes: &[u8]) -> (Vec<String>, FrameCounts) {
        let (mut framer, mut out) = (Framer::default(), Vec::new());
        framer.feed(bytes, |p| out.push(super::super::fields::latin1(p)));
        (out, framer.counts())
    }

    #[test]
    fn a_frame_cut_off_by_the_next_one_is_counted_and_the_next_one_kept() {
        let (out, counts) = frames(b"noise\x02sRA cut\x02sAN Run 1\x03\x03");
        assert_eq!(out, ["sAN Run 1"]);
        assert_eq!((counts.frames, counts.bad_frames, counts.bytes_skipped), (1, 1, 5 + 8 + 1));
    }

    #[test]
    fn an_endless_frame_is_dropped_at_the_bound() {
        let mut framer = Framer::default();
        framer.feed(&[START], |_| panic!("no frame"));
        for _ in 0..40 {
            framer.feed(&[b'x'; 4096], |_| panic!("no frame"));
            assert!(framer.held() <= PAYLOAD_MAX);
        }
        assert_eq!(framer.counts().bad_frames, 1);
    }

    #[test]
    fn a_binary_stream_yields_no_frame() {
        let binary = super::super::cola_b::encode(b"sAN Run \x01");
        assert_eq!(frames(&binary).0, Vec::<String>::new());
    }
}
