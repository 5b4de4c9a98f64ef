//! Zeroed memory that comes from the system untouched: what is never written costs no memory and no time.
//!
//! In: a number of elements. Out: a slice of them, aligned as they want it. Where more than 16 bytes of alignment are
//! asked for, the standard library clears memory by hand, all of it; of words it does not. So room is made for one
//! element more, and the slice begins at the first place that is aligned.

use bytemuck::{Pod, pod_align_to, pod_align_to_mut};
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

/// A slice of zeroed elements.
pub struct Untouched<T> {
    words: Box<[u64]>,
    len: usize,
    of: PhantomData<T>,
}

impl<T: Pod> Untouched<T> {
    /// So many elements, every bit zero.
    pub fn zeroed(len: usize) -> Self {
        let words = ((len + 1) * size_of::<T>()).div_ceil(size_of::<u64>());
        Self { words: bytemuck::zeroed_slice_box(words), len, of: PhantomData }
    }
}

impl<T: Pod> Deref for Untouched<T> {
    type Target = [T];
    #[inline(always)]
    fn deref(&self) -> &[T] {
        &pod_align_to(&self.words).1[..self.len]
    }
}

impl<T: Pod> DerefMut for Untouched<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        &mut pod_align_to_mut(&mut self.words).1[..self.len]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Marks;

    #[test]
    fn elements_are_zero_aligned_and_stay_where_they_are() {
        for len in [0, 1, 7, 10_000] {
            let mut marks = Untouched::<Marks>::zeroed(len);
            assert!(marks.len() == len && marks.iter().all(|marks| marks.0 == [0; 64]));
            assert!(marks.as_ptr().addr().is_multiple_of(64));
            marks.iter_mut().enumerate().for_each(|(i, marks)| marks.0[i % 64] = 1 + (i % 200) as u8);
            let moved = Box::new(marks);
            assert!(moved.iter().enumerate().all(|(i, marks)| marks.0[i % 64] == 1 + (i % 200) as u8));
        }
    }
}
