//! Voxels that walks have found and that are to be marked.
//!
//! The marks of one path are set while the next one is found: the processor then does both at once, for finding keeps its
//! vectors busy, and marking its stores. A fixed number is set at a time, for it would mistake where a loop ends. Until a
//! path's turn comes its marks can be fetched.

use super::AXIS_VOXELS_MAX;
use crate::evidence::{FULL_MISS, NOTHING};

/// Positions of the longest path: three voxels a slab, and room for what three vectors write beyond it.
const PATH_MAX: usize = 3 * (AXIS_VOXELS_MAX + 16);

/// Positions that are found before all are marked: as many as the nearest cache holds beside the marks themselves.
const FOUND_MAX: usize = 2048;

/// Positions that are marked at a time: about those of sixteen slabs.
const AT_ONCE: usize = 32;

/// Positions of marks that are to be raised to one and the same.
pub struct Found {
    positions: Box<[u32]>,
    /// The first so many are raised.
    raised: usize,
    /// So many are sure.
    used: usize,
    mark: u8,
}

impl Found {
    /// None.
    pub fn new() -> Self {
        Self { positions: vec![0; FOUND_MAX + PATH_MAX].into(), raised: 0, used: 0, mark: NOTHING }
    }

    /// Room for one path; `mark` is to be that of all others, or those are raised first.
    #[inline(always)]
    pub fn room<'a>(&'a mut self, mark: u8, marks: &'a mut [u8]) -> Room<'a> {
        if mark != self.mark || self.used > FOUND_MAX {
            self.raise(marks);
            self.mark = mark;
        }
        let (sure, path) = self.positions.split_at_mut(self.used);
        Room { path, waiting: &sure[self.raised..], mark, marks }
    }

    /// A path of so many positions is sure, and so many before it still wait.
    #[inline(always)]
    pub fn add(&mut self, count: usize, waiting: usize) {
        self.raised = self.used - waiting;
        self.used += count;
    }

    /// Raises all marks that wait.
    #[inline(always)]
    pub fn raise(&mut self, marks: &mut [u8]) {
        raise(&self.positions[self.raised..self.used], self.mark, marks);
        (self.raised, self.used) = (0, 0);
    }

    /// Takes back what is not marked.
    #[cfg(test)]
    pub fn forget(&mut self) -> Vec<u32> {
        let waiting = std::mem::take(&mut self.raised)..std::mem::take(&mut self.used);
        self.positions[waiting].to_vec()
    }
}

/// Room for the positions of one path, and those before it that wait to be marked.
pub struct Room<'a> {
    /// Where the path's go.
    pub path: &'a mut [u32],
    waiting: &'a [u32],
    mark: u8,
    marks: &'a mut [u8],
}

impl Room<'_> {
    /// Has the marks of sixteen positions of the path fetched, or of most of them: neighbours share a cache line.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn fetch(&self, from: usize) {
        let Some(sixteen) = self.path.get(from..).and_then(|path| path.first_chunk::<16>()) else { return };
        for position in sixteen.iter().step_by(2) {
            // Where fewer voxels count, what follows them may be anything.
            if let Some(mark) = self.marks.get(*position as usize) {
                crate::ahead::fetch(mark);
            }
        }
    }

    /// Raises some of those that wait: to be called for every sixteen slabs.
    #[inline(always)]
    pub fn raise_some(&mut self) {
        if let Some((some, waiting)) = self.waiting.split_first_chunk::<AT_ONCE>() {
            raise(some, self.mark, self.marks);
            self.waiting = waiting;
        }
    }

    /// How many still wait.
    #[inline(always)]
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }
}

/// Raises marks to `mark` at least.
#[inline(always)]
fn raise(positions: &[u32], mark: u8, marks: &mut [u8]) {
    // The largest mark there is needs no reading of what was there.
    if mark == FULL_MISS {
        raise_by(positions, marks, |_| FULL_MISS);
    } else {
        raise_by(positions, marks, |before| before | mark);
    }
}

#[inline(always)]
#[allow(unsafe_code, reason = "a check for each mark costs a fifth of the walk")]
fn raise_by(positions: &[u32], marks: &mut [u8], raised: impl Fn(u8) -> u8) {
    for position in positions {
        // SAFETY: a reference is readable. Volatile, for the compiler gathers these loads into vectors otherwise, and
        // then takes the vectors apart again.
        let position = unsafe { std::ptr::from_ref(position).read_volatile() } as usize;
        debug_assert!(position < marks.len());
        // SAFETY: `MarkField::found` was promised that there is such a mark.
        let mark = unsafe { marks.get_unchecked_mut(position) };
        *mark = raised(*mark);
    }
}
