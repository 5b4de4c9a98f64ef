//! Which snapshot is classified next: the newest complete one that was not classified yet.
//!
//! In: samples of topic `map` as they come, in memory of any type `S`. Out: a snapshot, and by name what was not used. It
//! knows no topic and no time; putting samples together is the work of `contract`.

use tsense_contract::{BLOCKS_MAX, Brick, MapHeader, Snapshot, SnapshotAssembler, Taken};

/// The map as it comes in.
#[derive(Debug)]
pub struct Intake<S> {
    assembler: SnapshotAssembler<S>,
    /// Epoch and number of the snapshot classified last.
    done: Option<(u64, u64)>,
}

impl<S: AsRef<[Brick]>> Default for Intake<S> {
    fn default() -> Self {
        Self { assembler: SnapshotAssembler::new(BLOCKS_MAX), done: None }
    }
}

impl<S: AsRef<[Brick]>> Intake<S> {
    /// Takes a sample. A complete snapshot that waits is skipped for the next one. `dropped` hears of all that is not
    /// used.
    pub fn take(&mut self, header: &MapHeader, sample: S, mut dropped: impl FnMut(&'static str)) {
        let waited = self.next().is_some();
        match self.assembler.take(header, sample) {
            Taken::Part | Taken::Complete => {}
            Taken::Incomplete { .. } => dropped("incomplete snapshot"),
            Taken::Refused(why) => dropped(why.as_str()),
        }
        if waited && self.assembler.complete().is_none_or(|s| number(&s.header) == number(header)) {
            dropped("older snapshot");
        }
    }

    /// The snapshot to classify now, if any.
    pub fn next(&self) -> Option<Snapshot<'_, S>> {
        self.assembler.complete().filter(|snapshot| self.done != Some(number(&snapshot.header)))
    }

    /// The snapshot with this commit was classified, or cannot be.
    pub fn done(&mut self, commit: &MapHeader) {
        self.done = Some(number(commit));
    }

    /// True where the mapper should be asked for every block anew.
    pub fn keyframe_needed(&self) -> bool {
        self.assembler.keyframe_needed()
    }
}

fn number(header: &MapHeader) -> (u64, u64) {
    (header.epoch, header.snapshot)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use tsense_contract::{
        BRICKS_PER_BLOCK, CommitEntry, DeltaEntry, MapSampleKind, delta_items, pack_commit, write_delta,
    };

    /// One block in a map; each snapshot changes its brick 5.
    #[derive(Default)]
    struct Bench {
        intake: Intake<Vec<Brick>>,
        dropped: Vec<&'static str>,
    }

    impl Bench {
        fn send(&mut self, kind: MapSampleKind, snapshot: u64, version: u32, items: Vec<Brick>) -> &mut Self {
            let header = MapHeader { epoch: 1, snapshot, version, kind: kind.to_wire(), ..MapHeader::zeroed() };
            self.intake.take(&header, items, |cause| self.dropped.push(cause));
            self
        }

        fn whole(&mut self, snapshot: u32) -> &mut Self {
            let items = vec![Brick { confidence: [snapshot as u8; 64], ..Brick::UNKNOWN }; BRICKS_PER_BLOCK];
            self.send(MapSampleKind::Block, snapshot.into(), snapshot, items).commit(snapshot)
        }

        fn delta(&mut self, snapshot: u32) -> &mut Self {
            let entry = DeltaEntry { key: [0; 3], base: snapshot - 1, version: snapshot, bricks: 1 };
            let new = vec![Brick { confidence: [snapshot as u8; 64], ..Brick::UNKNOWN }; BRICKS_PER_BLOCK];
            let mut items = vec![Brick::UNKNOWN; delta_items(1, 1)];
            write_delta(&mut items, &[entry], &[5], |_| &new);
            self.send(MapSampleKind::Delta, snapshot.into(), 1, items)
        }

        fn commit(&mut self, snapshot: u32) -> &mut Self {
            let items = pack_commit(&[CommitEntry { key: [0; 3], version: snapshot }]);
            self.send(MapSampleKind::Commit, snapshot.into(), 1, items)
        }

        /// What a classification would see of bricks 4 and 5, once.
        fn classified(&mut self) -> Option<[u8; 2]> {
            let snapshot = self.intake.next()?;
            let (header, bricks) = (snapshot.header, snapshot.blocks().next().unwrap().1);
            let seen = [bricks[4].confidence[0], bricks[5].confidence[0]];
            self.intake.done(&header);
            Some(seen)
        }
    }

    #[test]
    fn every_snapshot_is_classified_once_with_its_changes() {
        let mut bench = Bench::default();
        assert!(bench.intake.keyframe_needed());
        assert_eq!(bench.whole(1).classified(), Some([1, 1]));
        assert_eq!(bench.classified(), None);
        assert_eq!(bench.delta(2).classified(), None, "not before its commit");
        assert_eq!(bench.commit(2).classified(), Some([1, 2]));
        assert_eq!(bench.delta(3).commit(3).classified(), Some([1, 3]));
        assert_eq!(bench.dropped, Vec::<&str>::new());
    }

    #[test]
    fn only_the_newest_of_several_is_classified_and_the_others_are_counted() {
        let mut bench = Bench::default();
        bench.whole(1).delta(2).commit(2).delta(3).commit(3);
        assert_eq!(bench.classified(), Some([1, 3]));
        assert_eq!(bench.dropped, ["older snapshot", "older snapshot"]);
    }

    #[test]
    fn after_a_lost_delta_nothing_is_classified_until_the_keyframe() {
        let mut bench = Bench::default();
        assert_eq!(bench.whole(1).classified(), Some([1, 1]));
        // Delta 2 is lost: its commit and all after it are incomplete.
        assert_eq!(bench.commit(2).classified(), None);
        assert_eq!(bench.delta(3).commit(3).classified(), None);
        assert!(bench.intake.keyframe_needed());
        assert_eq!(bench.dropped, ["incomplete snapshot", "incomplete snapshot"]);
        assert_eq!(bench.whole(4).classified(), Some([4, 4]));
        assert!(!bench.intake.keyframe_needed());
    }

    #[test]
    fn a_lost_commit_costs_its_snapshot_only() {
        let mut bench = Bench::default();
        bench.whole(1).classified();
        assert_eq!(bench.delta(2).delta(3).commit(3).classified(), Some([1, 3]));
        assert!(!bench.intake.keyframe_needed());
    }
}
