//! Runs of voxels that walks have found and that are to be marked.
//!
//! The marks of one path are set while the next one is found: the processor then does both at once, for finding keeps
//! its vectors busy, and marking its stores. A fixed number is set at a time, for it would mistake where a loop ends.

use super::AXIS_VOXELS_MAX;

/// Runs of the longest path: two a slab, and room for what two vectors write beyond it.
const PATH_MAX: usize = 2 * (AXIS_VOXELS_MAX + 16) + 16;

/// Runs that are found before all are marked: as many as the nearest cache holds beside the marks themselves.
const FOUND_MAX: usize = 2048;

/// Runs that are marked at a time: about those of sixteen slabs.
const AT_ONCE: usize = 24;

/// Runs whose bits are to be set in the same rows.
pub struct Found {
    /// Where the row of each lies, and its bits there.
    positions: Box<[u32]>,
    bits: Box<[u32]>,
    /// The first so many are set.
    raised: usize,
    /// So many are sure.
    used: usize,
    /// Whose rows they are.
    level: usize,
}

impl Found {
    /// None.
    pub fn new() -> Self {
        let room = || vec![0; FOUND_MAX + PATH_MAX].into();
        Self { positions: room(), bits: room(), raised: 0, used: 0, level: 0 }
    }

    /// The level of all that wait.
    #[inline(always)]
    pub fn level(&self) -> usize {
        self.level
    }

    /// Whether those that wait have to be marked before a path of this level is found.
    #[inline(always)]
    pub fn is_full_for(&self, level: usize) -> bool {
        level != self.level || self.used > FOUND_MAX
    }

    /// Those found from now on are of this level; none wait.
    #[inline(always)]
    pub fn begin(&mut self, level: usize) {
        debug_assert_eq!(self.raised, self.used);
        self.level = level;
    }

    /// Room for one path.
    #[inline(always)]
    pub fn room<'a>(&'a mut self, rows: &'a mut [u32]) -> Room<'a> {
        let (sure_positions, positions) = self.positions.split_at_mut(self.used);
        let (sure_bits, bits) = self.bits.split_at_mut(self.used);
        Room {
            positions,
            bits,
            waiting: Runs { positions: &sure_positions[self.raised..], bits: &sure_bits[self.raised..] },
            rows,
        }
    }

    /// A path of so many runs is sure, and so many before it still wait.
    #[inline(always)]
    pub fn add(&mut self, count: usize, waiting: usize) {
        self.raised = self.used - waiting;
        self.used += count;
    }

    /// Sets the bits of all that wait.
    #[inline(always)]
    pub fn raise(&mut self, rows: &mut [u32]) {
        let waiting = self.raised..self.used;
        Runs { positions: &self.positions[waiting.clone()], bits: &self.bits[waiting] }.raise(rows);
        (self.raised, self.used) = (0, 0);
    }

    /// Takes back what is not marked: positions and bits.
    #[cfg(test)]
    pub fn forget(&mut self) -> Vec<(u32, u32)> {
        let waiting = std::mem::take(&mut self.raised)..std::mem::take(&mut self.used);
        self.positions[waiting.clone()].iter().copied().zip(self.bits[waiting].iter().copied()).collect()
    }
}

/// Room for the runs of one path, and those before it that wait to be marked.
pub struct Room<'a> {
    /// Where the path's go.
    pub positions: &'a mut [u32],
    pub bits: &'a mut [u32],
    waiting: Runs<'a>,
    rows: &'a mut [u32],
}

impl Room<'_> {
    /// Marks some of those that wait: to be called for every sixteen slabs.
    #[inline(always)]
    pub fn raise_some(&mut self) {
        if let Some((some, waiting)) = self.waiting.split(AT_ONCE) {
            some.raise(self.rows);
            self.waiting = waiting;
        }
    }

    /// How many still wait.
    #[inline(always)]
    pub fn waiting(&self) -> usize {
        self.waiting.positions.len()
    }
}

/// Runs: positions of rows, and bits.
struct Runs<'a> {
    positions: &'a [u32],
    bits: &'a [u32],
}

impl<'a> Runs<'a> {
    #[inline(always)]
    fn split(&self, at: usize) -> Option<(Self, Self)> {
        let (positions, more_positions) = self.positions.split_at_checked(at)?;
        let (bits, more_bits) = self.bits.split_at_checked(at)?;
        Some((Self { positions, bits }, Self { positions: more_positions, bits: more_bits }))
    }

    #[inline(always)]
    #[allow(unsafe_code, reason = "a check for each run costs a tenth of the walk")]
    fn raise(&self, rows: &mut [u32]) {
        for (position, bits) in self.positions.iter().zip(self.bits) {
            // SAFETY: a reference is readable. Volatile, for the compiler gathers these loads into vectors otherwise,
            // and then takes the vectors apart again.
            let position = unsafe { std::ptr::from_ref(position).read_volatile() } as usize;
            debug_assert!(position < rows.len());
            // SAFETY: `MarkField::found` was promised that there is such a row.
            *unsafe { rows.get_unchecked_mut(position) } |= bits;
        }
    }
}
