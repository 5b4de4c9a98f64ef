//! A session's outgoing link with its faults: telegrams in, the writes that really happen out.

use super::cola::{Dialect, Writer};
use crate::faults::{Faults, every};

/// One client's link.
#[derive(Debug)]
pub(crate) struct Link {
    faults: Faults,
    telegrams: u64,
    held: Vec<u8>,
    held_count: u32,
}

impl Link {
    pub fn new(faults: Faults) -> Self {
        Self { faults, telegrams: 0, held: Vec::new(), held_count: 0 }
    }

    /// An answer: whole unless everything is fragmented.
    pub fn answer(&self, bytes: Vec<u8>) -> Vec<Vec<u8>> {
        self.pieces(bytes)
    }

    /// A measured-data telegram with whatever happens to it.
    pub fn telegram(&mut self, mut bytes: Vec<u8>, dialect: Dialect) -> Vec<Vec<u8>> {
        self.telegrams += 1;
        let nth = |n| every(n, self.telegrams);
        if nth(self.faults.drop_every) {
            return Vec::new();
        }
        if nth(self.faults.bad_checksum_every) {
            break_end(&mut bytes, dialect);
        }
        let mut out = Vec::new();
        if nth(self.faults.stray_every) {
            out.extend(stray(dialect));
        }
        if nth(self.faults.duplicate_every) {
            out.extend_from_slice(&bytes);
        }
        out.extend(bytes);
        if self.faults.coalesce <= 1 {
            return self.pieces(out);
        }
        self.held.extend(out);
        self.held_count += 1;
        if self.held_count < self.faults.coalesce {
            return Vec::new();
        }
        self.held_count = 0;
        let held = std::mem::take(&mut self.held);
        self.pieces(held)
    }

    fn pieces(&self, bytes: Vec<u8>) -> Vec<Vec<u8>> {
        match self.faults.fragment_bytes as usize {
            0 => vec![bytes],
            size => bytes.chunks(size).map(<[u8]>::to_vec).collect(),
        }
    }
}

/// The checksum of a binary telegram, or the end mark of a text one, becomes wrong.
fn break_end(bytes: &mut [u8], dialect: Dialect) {
    if let Some(last) = bytes.last_mut() {
        *last = if dialect == Dialect::B { !*last } else { b' ' };
    }
}

/// An event nobody asked for: the state of the outputs.
fn stray(dialect: Dialect) -> Vec<u8> {
    let mut out = Writer::new(dialect, "sSN", "LIDoutputstate");
    out.u16(1).u32(0);
    for _ in 0..3 {
        out.u8(1).u32(7);
    }
    out.u16(0).framed()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn send(faults: Faults, count: usize) -> Vec<Vec<u8>> {
        let mut link = Link::new(faults);
        (0..count).flat_map(|i| link.telegram(vec![i as u8; 200], Dialect::A)).collect()
    }

    #[test]
    fn telegrams_are_dropped_doubled_cut_and_joined_as_asked() {
        assert_eq!(send(Faults { drop_every: 3, ..Faults::default() }, 9).len(), 6);
        let doubled = send(Faults { duplicate_every: 2, ..Faults::default() }, 2);
        assert_eq!((doubled[0].len(), doubled[1].len()), (200, 400));
        let cut = send(Faults { fragment_bytes: 97, ..Faults::default() }, 1);
        assert_eq!(cut.iter().map(Vec::len).collect::<Vec<_>>(), [97, 97, 6]);
        let joined = send(Faults { coalesce: 3, ..Faults::default() }, 6);
        assert_eq!(joined.iter().map(Vec::len).collect::<Vec<_>>(), [600, 600]);
        assert_eq!(send(Faults { bad_checksum_every: 2, ..Faults::default() }, 2)[1][199], b' ');
        let stray = send(Faults { stray_every: 1, ..Faults::default() }, 1);
        assert!(stray[0].starts_with(b"\x02sSN LIDoutputstate 1 0 "));
    }
}
