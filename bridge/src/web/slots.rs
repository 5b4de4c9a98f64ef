//! What can be shown now, a frame a slot, and what a client of it still needs.
//!
//! A newer frame replaces the older one in its slot, whether or not anyone took it: state, not history. A client is
//! nothing but a cursor of one number a frame kind, so a slow client costs no memory here, skips what was
//! overtaken, and catches up with the newest. Frames are given out oldest first: no slot starves another, and the
//! blocks of a snapshot come before its table.

use super::frames::{Frame, Kind};
use std::collections::BTreeMap;
use tsense_contract::BlockKey;

/// A place for one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    /// The only frame of its kind.
    Only(Kind),
    /// One block of the map.
    Block(BlockKey),
    /// The newest scan of one ladar.
    Points(u8),
}

impl Slot {
    /// The kind of the frames in this slot.
    pub fn kind(self) -> Kind {
        match self {
            Self::Only(kind) => kind,
            Self::Block(_) => Kind::Block,
            Self::Points(_) => Kind::Points,
        }
    }
}

/// The newest frame of every slot, numbered in the order they came.
#[derive(Debug, Default)]
pub struct Slots {
    newest: u64,
    frames: BTreeMap<Slot, (u64, Frame)>,
    order: BTreeMap<u64, Slot>,
}

impl Slots {
    /// Puts a frame into its slot and returns its number.
    pub fn put(&mut self, slot: Slot, frame: Frame) -> u64 {
        self.newest += 1;
        if let Some((old, _)) = self.frames.insert(slot, (self.newest, frame)) {
            self.order.remove(&old);
        }
        self.order.insert(self.newest, slot);
        self.newest
    }

    /// Empties the slots that `gone` names.
    pub fn remove(&mut self, gone: impl Fn(Slot) -> bool) {
        self.order.retain(|_, slot| !gone(*slot));
        self.frames.retain(|slot, _| !gone(*slot));
    }

    /// The oldest frame the cursor has not seen, and marks it seen.
    pub fn next(&self, cursor: &mut Cursor) -> Option<Frame> {
        let start = cursor.oldest()?;
        let (number, slot) = self.order.range(start..).find(|(number, slot)| cursor.needs(slot.kind(), **number))?;
        cursor.seen[slot.kind() as usize] = *number;
        Some(self.frames[slot].1.clone())
    }

    /// Number of the newest frame.
    pub fn newest(&self) -> u64 {
        self.newest
    }

    /// Bytes of all frames.
    pub fn bytes(&self) -> usize {
        self.frames.values().map(|(_, frame)| frame.len()).sum()
    }
}

/// What one client has seen and wants to see.
#[derive(Clone, Debug)]
pub struct Cursor {
    seen: [u64; Kind::ALL.len()],
    wants: [bool; Kind::ALL.len()],
}

impl Default for Cursor {
    /// Has seen nothing and wants all.
    fn default() -> Self {
        Self { seen: [0; Kind::ALL.len()], wants: [true; Kind::ALL.len()] }
    }
}

impl Cursor {
    /// Wants the layers that `wanted` names from now on. A layer that was off is sent anew in full.
    pub fn subscribe(&mut self, wanted: impl Fn(&str) -> bool) {
        for kind in Kind::ALL {
            let wants = kind == Kind::Hello || wanted(kind.layer());
            if wants && !self.wants[kind as usize] {
                self.seen[kind as usize] = 0;
            }
            self.wants[kind as usize] = wants;
        }
    }

    fn needs(&self, kind: Kind, number: u64) -> bool {
        self.wants[kind as usize] && number > self.seen[kind as usize]
    }

    /// Frames before this number are seen, whatever their kind.
    fn oldest(&self) -> Option<u64> {
        self.seen.iter().zip(self.wants).filter(|(_, wants)| *wants).map(|(seen, _)| seen + 1).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn frame(text: &str) -> Frame {
        Frame::copy_from_slice(text.as_bytes())
    }

    fn drain(slots: &Slots, cursor: &mut Cursor) -> Vec<String> {
        std::iter::from_fn(|| slots.next(cursor)).map(|f| String::from_utf8_lossy(&f).into()).collect()
    }

    #[test]
    fn a_new_client_gets_all_and_then_only_what_changed() {
        let (mut slots, mut cursor) = (Slots::default(), Cursor::default());
        slots.put(Slot::Block([0, 0, 0]), frame("block 0"));
        slots.put(Slot::Block([1, 0, 0]), frame("block 1"));
        slots.put(Slot::Only(Kind::Commit), frame("table 1"));
        assert_eq!(drain(&slots, &mut cursor), ["block 0", "block 1", "table 1"]);
        assert!(drain(&slots, &mut cursor).is_empty());
        slots.put(Slot::Block([1, 0, 0]), frame("block 1 again"));
        slots.put(Slot::Only(Kind::Commit), frame("table 2"));
        assert_eq!(drain(&slots, &mut cursor), ["block 1 again", "table 2"]);
    }

    #[test]
    fn a_slow_client_skips_what_was_overtaken() {
        let (mut slots, mut cursor) = (Slots::default(), Cursor::default());
        for i in 0..1000 {
            slots.put(Slot::Points(0), frame(&format!("scan {i}")));
        }
        assert_eq!(drain(&slots, &mut cursor), ["scan 999"]);
        assert_eq!((slots.frames.len(), slots.order.len(), slots.bytes()), (1, 1, 8));
    }

    #[test]
    fn a_removed_slot_is_not_sent() {
        let (mut slots, mut cursor) = (Slots::default(), Cursor::default());
        slots.put(Slot::Block([0, 0, 0]), frame("block 0"));
        slots.put(Slot::Points(3), frame("scan"));
        slots.remove(|slot| slot.kind() == Kind::Block);
        assert_eq!(drain(&slots, &mut cursor), ["scan"]);
    }

    #[test]
    fn a_layer_switched_on_again_is_sent_in_full() {
        let (mut slots, mut cursor) = (Slots::default(), Cursor::default());
        cursor.subscribe(|layer| layer == "points");
        slots.put(Slot::Block([0, 0, 0]), frame("block 0"));
        slots.put(Slot::Points(0), frame("scan"));
        assert_eq!(drain(&slots, &mut cursor), ["scan"]);
        cursor.subscribe(|layer| layer == "map");
        assert_eq!(drain(&slots, &mut cursor), ["block 0"]);
        cursor.subscribe(|layer| layer == "map" || layer == "points");
        assert_eq!(drain(&slots, &mut cursor), ["scan"], "the map was not switched off in between");
    }

    #[test]
    fn whatever_happens_a_client_that_drains_holds_the_newest_of_every_slot() {
        let cases = AtomicUsize::new(0);
        let step = (0u8..5, any::<bool>());
        proptest!(|(steps in prop::collection::vec(step, 0..60))| {
            cases.fetch_add(1, Ordering::Relaxed);
            let (mut slots, mut cursor) = (Slots::default(), Cursor::default());
            let (mut truth, mut held) = (BTreeMap::new(), BTreeMap::new());
            for (i, (ladar, take)) in steps.iter().enumerate() {
                slots.put(Slot::Points(*ladar), frame(&format!("{ladar} {i}")));
                truth.insert(*ladar, i);
                if *take {
                    slots.next(&mut cursor).iter().for_each(|f| hold(&mut held, f));
                }
            }
            while let Some(f) = slots.next(&mut cursor) {
                hold(&mut held, &f);
            }
            prop_assert_eq!(held, truth);
        });
        assert!(cases.load(Ordering::Relaxed) >= 256);
    }

    fn hold(held: &mut BTreeMap<u8, usize>, frame: &Frame) {
        let text = String::from_utf8_lossy(frame).into_owned();
        let (ladar, i) = text.split_once(' ').unwrap();
        held.insert(ladar.parse().unwrap(), i.parse().unwrap());
    }
}
