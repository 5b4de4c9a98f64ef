//! A segment in the order of its axes.

/// A segment, its longest axis first, on which it rises.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// The main axis, the second longest and the third.
    pub axes: [usize; 3],
    /// Ends on these axes, the lower one on the main axis first.
    pub start: [f64; 3],
    pub end: [f64; 3],
    /// How far it runs along each.
    pub lengths: [f64; 3],
}

/// Orders of the axes, longest first. By whether |x| >= |y| (1), |x| >= |z| (2), |y| >= |z| (4); two of the cases
/// cannot be.
pub const ORDERS: [[u8; 3]; 8] =
    [[2, 1, 0], [2, 0, 1], [0, 1, 2], [0, 2, 1], [1, 2, 0], [0, 1, 2], [1, 0, 2], [0, 1, 2]];

impl Segment {
    /// Nothing where it is too short to have a direction.
    #[inline(always)]
    pub fn of(start: [f64; 3], end: [f64; 3]) -> Option<Self> {
        let [x, y, z] = [0, 1, 2].map(|axis| (end[axis] - start[axis]).abs());
        let order = usize::from(x >= y) | usize::from(x >= z) << 1 | usize::from(y >= z) << 2;
        let axes = ORDERS[order].map(usize::from);
        let lengths = axes.map(|axis| [x, y, z][axis]);
        let (start, end) = (axes.map(|axis| start[axis]), axes.map(|axis| end[axis]));
        let (start, end) = if end[0] < start[0] { (end, start) } else { (start, end) };
        (lengths[0] >= super::LENGTH_MIN).then_some(Self { axes, start, end, lengths })
    }

    /// Voxels that it crosses.
    #[inline(always)]
    pub fn voxels(&self) -> u64 {
        let faces = |axis: usize| (self.end[axis] as i32).abs_diff(self.start[axis] as i32);
        u64::from(1 + faces(0) + faces(1) + faces(2))
    }

    /// Whether its runs are few and long.
    #[inline(always)]
    pub fn is_flat(&self) -> bool {
        self.lengths[0] > super::STEEP_MAX * self.lengths[1]
    }
}
