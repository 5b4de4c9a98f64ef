//! What is remembered of candidates from one snapshot to the next, so that only those of which something new was seen
//! are judged again.
//!
//! In: candidates, and the returns that came in since the last snapshot. Out: which candidates are judged now: those
//! never judged first, then those judged longest ago, as many as a snapshot may judge; stems have half of the turns, so that
//! twigs that come and go do not keep them waiting. The others keep their verdict and wait. The choice depends on the snapshots alone, never on time that passed. What no candidate asks for is forgotten
//! at once, so there are never more entries than candidates.

use super::{Proven, StemScene, Verdict};
use std::collections::BTreeMap;

/// Radius around a candidate within which returns are news of it, metres.
const NEWS_M: f64 = 0.3;
/// Fewest new returns that are worth judging a stem, and any other candidate, again.
const NEWS_STEM: usize = 5;
const NEWS_OTHER: usize = 8;
/// The same as a share of the beams that hit a stem, and of the returns around any other candidate.
const NEWS_STEM_SHARE: usize = 10;
const NEWS_OTHER_SHARE: usize = 4;
/// Snapshots after which any news is worth it: beams that pass are no returns, and a stem seen again is to be told so. 1.4
/// seconds at 5 Hz, less than a nod.
const STALE_SNAPSHOTS: u64 = 7;
/// Change of the ground's height below a stem that is worth judging it again, metres.
const GROUND_MOVED_M: f64 = 0.05;

/// A column of the world: its index counted from the UTM origin.
pub type WorldCell = [i32; 2];

/// A candidate that was judged.
pub struct Entry {
    /// A stem, or why it is none.
    pub verdict: Verdict<Proven>,
    /// Place of the candidate, relative to the corner of the view, metres.
    pub at_m: [f64; 2],
    /// Number of the snapshot that it was judged in.
    judged: u64,
    /// Returns around it when it was judged, and those that came since.
    returns: usize,
    news: usize,
    /// New returns since a stem was last fitted from nothing.
    news_since_start: usize,
    /// Some candidate of this snapshot lies on it.
    is_kept: bool,
}

/// What is remembered.
pub struct Memory {
    /// Most candidates that are judged in a snapshot.
    judged_max: usize,
    snapshot: u64,
    corner_m: [f64; 3],
    entries: BTreeMap<WorldCell, Entry>,
}

/// What is to be done with a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turn {
    /// It is judged now.
    Now,
    /// It keeps its verdict, if it has one.
    Later,
}

impl Memory {
    /// Nothing is remembered; a snapshot judges at most `judged_max` candidates.
    pub fn new(judged_max: usize) -> Self {
        Self { judged_max, snapshot: 0, corner_m: [0.0; 3], entries: BTreeMap::new() }
    }

    /// Begins a snapshot: places follow the view's corner, news are counted, and every candidate gets its turn.
    pub fn turns(&mut self, scene: &StemScene, places: &[[f64; 2]]) -> Vec<(WorldCell, Turn)> {
        self.snapshot += 1;
        self.follow(scene.corner_m());
        for entry in self.entries.values_mut() {
            let fresh = scene.columns.fresh_around(entry.at_m, NEWS_M);
            (entry.news, entry.is_kept) = (entry.news + fresh, false);
            entry.news_since_start += fresh;
        }
        let stems = self.entries.iter().filter_map(|(key, entry)| Some((entry.verdict.as_ref().ok()?, *key)));
        let sure: Vec<_> = stems.filter(|(stem, _)| stem.is_sure()).collect();
        let keys: Vec<WorldCell> = places.iter().map(|at_m| self.key_of(&sure, scene, *at_m)).collect();
        // When each was judged last, and its place in the order: stems, and others.
        let (mut stems, mut others) = (Vec::new(), Vec::new());
        for (order, key) in keys.iter().enumerate() {
            match self.entries.get_mut(key) {
                Some(entry) if entry.is_kept => {}
                Some(entry) => {
                    entry.is_kept = true;
                    if entry.is_due(scene, self.snapshot) {
                        let wanted = if entry.verdict.is_ok() { &mut stems } else { &mut others };
                        wanted.push((entry.judged, order));
                    }
                }
                None => others.push((0, order)),
            }
        }
        stems.sort_unstable();
        others.sort_unstable();
        stems.truncate((self.judged_max / 2).max(self.judged_max.saturating_sub(others.len())));
        others.truncate(self.judged_max - stems.len());
        let mut turns: Vec<_> = keys.into_iter().map(|key| (key, Turn::Later)).collect();
        stems.iter().chain(&others).for_each(|(_, order)| turns[*order].1 = Turn::Now);
        turns
    }

    /// The entry that a place belongs to: that of a stem beyond doubt that holds it, its own column's, a neighbour's; a
    /// new one's where there is none.
    fn key_of(&self, sure: &[(&Proven, WorldCell)], scene: &StemScene, at_m: [f64; 2]) -> WorldCell {
        let own = scene.cell_of(at_m);
        if let Some((_, key)) = sure.iter().find(|(stem, _)| stem.surely_holds(at_m)) {
            return *key;
        }
        let around = (-1..=1).flat_map(|y| (-1..=1).map(move |x| [own[0] + x, own[1] + y]));
        std::iter::once(own).chain(around).find(|key| self.entries.contains_key(key)).unwrap_or(own)
    }

    fn follow(&mut self, corner_m: [f64; 3]) {
        let shift: [f64; 3] = std::array::from_fn(|axis| self.corner_m[axis] - corner_m[axis]);
        if shift != [0.0; 3] {
            for entry in self.entries.values_mut() {
                (entry.at_m[0], entry.at_m[1]) = (entry.at_m[0] + shift[0], entry.at_m[1] + shift[1]);
                if let Ok(stem) = &mut entry.verdict {
                    stem.place.shift(shift);
                }
            }
        }
        self.corner_m = corner_m;
    }

    /// What is remembered of an entry.
    pub fn entry(&self, key: WorldCell) -> Option<&Entry> {
        self.entries.get(&key)
    }

    #[cfg(test)]
    /// How many candidates were judged in the last snapshot.
    pub fn judged(&self) -> usize {
        self.entries.values().filter(|entry| entry.judged == self.snapshot).count()
    }

    /// Remembers a verdict on a candidate. `from_start` where it was not begun from an earlier stem.
    pub fn remember(
        &mut self,
        key: WorldCell,
        at_m: [f64; 2],
        verdict: Verdict<Proven>,
        from_start: bool,
        scene: &StemScene,
    ) {
        let returns = scene.columns.around(at_m, NEWS_M).count();
        let before = self.entries.get(&key).map_or(0, |entry| entry.news_since_start);
        let news_since_start = if from_start { 0 } else { before };
        let entry = Entry { verdict, at_m, judged: self.snapshot, returns, news: 0, news_since_start, is_kept: true };
        self.entries.insert(key, entry);
    }

    /// Ends a snapshot: forgets what no candidate lies on, and gives all that is known.
    pub fn entries(&mut self) -> impl Iterator<Item = &Entry> {
        self.entries.retain(|_, entry| entry.is_kept);
        self.entries.values()
    }
}

impl Entry {
    fn is_due(&self, scene: &StemScene, snapshot: u64) -> bool {
        let is_stale = self.news > 0 && snapshot >= self.judged + STALE_SNAPSHOTS;
        is_stale
            || match &self.verdict {
                Ok(stem) => {
                    self.news >= NEWS_STEM.max(stem.account.hits / NEWS_STEM_SHARE)
                        || scene
                            .place(stem.place.at_m)
                            .is_ok_and(|now| (now.ground_m - stem.place.ground_m).abs() > GROUND_MOVED_M)
                }
                Err(_) => self.news >= NEWS_OTHER.max(self.returns / NEWS_OTHER_SHARE),
            }
    }

    /// The stem to start from, where there is one beyond doubt and less was seen of it since than before.
    pub fn known(&self) -> Option<&Proven> {
        let stem = self.verdict.as_ref().ok()?;
        (stem.is_sure() && self.news_since_start < stem.account.hits).then_some(stem)
    }
}
