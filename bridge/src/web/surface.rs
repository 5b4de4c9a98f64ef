//! The visible surface of a block: occupied voxels with at least one face that no occupied voxel covers.
//!
//! In: the bricks of one block (contract `map`). Out: one 32-bit word a visible voxel, in the order of its indices
//! (x fastest). Rows of 100 voxels are bits of a `u128`, so that a face test is a shift and an AND for a whole row.
//! Voxels at the block's border count as uncovered on that side: a block is drawn without its neighbours. It knows
//! no colour: the viewer takes the class of a column from the grid.

use tsense_contract::{BLOCK_BRICKS, BLOCK_VOXELS, BRICK_EDGE, BRICKS_PER_BLOCK, Brick, brick_offset};

/// Most visible voxels of a block that are sent: 256 kB. A block of forest has about 20,000 (`examples/synthetic`);
/// what is beyond the bound is counted as dropped.
pub const SURFACE_VOXELS_MAX: usize = 1 << 16;

/// Bits of a word: x 0-6, y 7-13, z 14-19, faces 20-25 (-x, +x, -y, +y, -z, +z), crowding 26-30.
const Y_BIT: u32 = 7;
const Z_BIT: u32 = 14;
const FACE_BIT: u32 = 20;
const CROWD_BIT: u32 = 26;

/// Neighbours of a voxel that share a face, an edge or a corner.
const NEIGHBOURS: usize = 26;

/// What can be seen of a block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Surface {
    /// One word a visible voxel.
    pub words: Vec<u32>,
    /// Visible voxels beyond [`SURFACE_VOXELS_MAX`].
    pub cut: usize,
}

/// Occupied voxels as bits: `rows[z][y]` has bit x.
type Rows = [[u128; BLOCK_VOXELS[1]]; BLOCK_VOXELS[2]];

/// Finds the visible voxels of a block, or nothing where the number of bricks is not a block's.
pub fn surface_of(bricks: &[Brick]) -> Option<Surface> {
    if bricks.len() != BRICKS_PER_BLOCK {
        return None;
    }
    let rows = occupied_rows(bricks);
    let mut surface = Surface::default();
    for z in 0..BLOCK_VOXELS[2] {
        for y in 0..BLOCK_VOXELS[1] {
            push_row(&rows, y, z, &mut surface);
        }
    }
    Some(surface)
}

fn occupied_rows(bricks: &[Brick]) -> Box<Rows> {
    let mut rows = Box::new([[0u128; BLOCK_VOXELS[1]]; BLOCK_VOXELS[2]]);
    for bz in 0..BLOCK_BRICKS[2] {
        for by in 0..BLOCK_BRICKS[1] {
            for bx in 0..BLOCK_BRICKS[0] {
                add_brick(&bricks[brick_offset([bx, by, bz])], [bx, by, bz], &mut rows);
            }
        }
    }
    rows
}

fn add_brick(brick: &Brick, at: [usize; 3], rows: &mut Rows) {
    // Most bricks hold air or nothing: one pass over 64 bytes settles those.
    if brick.occupancy.iter().all(|o| *o <= 0) {
        return;
    }
    for (i, (occupancy, confidence)) in brick.occupancy.iter().zip(&brick.confidence).enumerate() {
        if *occupancy > 0 && *confidence > 0 {
            let [x, y, z] = [i % BRICK_EDGE, i / BRICK_EDGE % BRICK_EDGE, i / (BRICK_EDGE * BRICK_EDGE)];
            rows[at[2] * BRICK_EDGE + z][at[1] * BRICK_EDGE + y] |= 1 << (at[0] * BRICK_EDGE + x);
        }
    }
}

/// The row at `(y + dy, z + dz)`; outside of the block nothing is occupied.
fn row_at(rows: &Rows, y: usize, z: usize, dy: isize, dz: isize) -> u128 {
    let inside = |i: usize, d: isize, count: usize| i.checked_add_signed(d).filter(|i| *i < count);
    match (inside(y, dy, BLOCK_VOXELS[1]), inside(z, dz, BLOCK_VOXELS[2])) {
        (Some(y), Some(z)) => rows[z][y],
        _ => 0,
    }
}

fn push_row(rows: &Rows, y: usize, z: usize, surface: &mut Surface) {
    let row = rows[z][y];
    if row == 0 {
        return;
    }
    let open = [
        row & !(row << 1),
        row & !(row >> 1),
        row & !row_at(rows, y, z, -1, 0),
        row & !row_at(rows, y, z, 1, 0),
        row & !row_at(rows, y, z, 0, -1),
        row & !row_at(rows, y, z, 0, 1),
    ];
    let mut left = open.iter().fold(0, |all, face| all | face);
    while left != 0 {
        let x = left.trailing_zeros();
        left &= left - 1;
        if surface.words.len() >= SURFACE_VOXELS_MAX {
            surface.cut += 1;
            continue;
        }
        let faces = (0..6).fold(0, |word, face| word | ((open[face] >> x & 1) as u32) << face);
        let crowd = crowding(rows, x as usize, y, z);
        surface.words.push(x | (y as u32) << Y_BIT | (z as u32) << Z_BIT | faces << FACE_BIT | crowd << CROWD_BIT);
    }
}

/// Occupied neighbours of a voxel, 0 to 26; at the block's border scaled up from those that lie inside, so that
/// blocks do not show their seams. The viewer darkens crowded voxels.
fn crowding(rows: &Rows, x: usize, y: usize, z: usize) -> u32 {
    let mut occupied = 0;
    for (dy, dz) in (-1..=1).flat_map(|dz| (-1..=1).map(move |dy| (dy, dz))) {
        let row = row_at(rows, y, z, dy, dz);
        let three = if x == 0 { (row & 0b11) << 1 } else { row >> (x - 1) & 0b111 };
        occupied += three.count_ones();
    }
    let span = |i: usize, count: usize| 1 + usize::from(i > 0) + usize::from(i + 1 < count);
    let inside = span(x, BLOCK_VOXELS[0]) * span(y, BLOCK_VOXELS[1]) * span(z, BLOCK_VOXELS[2]) - 1;
    ((occupied - 1) as usize * NEIGHBOURS / inside) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use tsense_contract::locate;

    fn block_with(voxels: &[[i32; 3]]) -> Vec<Brick> {
        let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
        for voxel in voxels {
            let (_, brick, inner) = locate(*voxel);
            (bricks[brick].occupancy[inner], bricks[brick].confidence[inner]) = (5, 3);
        }
        bricks
    }

    fn unpack(word: u32) -> ([u32; 3], u32, u32) {
        ([word & 127, word >> 7 & 127, word >> 14 & 63], word >> 20 & 63, word >> 26 & 31)
    }

    fn found(voxels: &[[i32; 3]]) -> Vec<([u32; 3], u32, u32)> {
        surface_of(&block_with(voxels)).unwrap().words.into_iter().map(unpack).collect()
    }

    #[test]
    fn a_lone_voxel_shows_six_faces_and_a_pair_hides_the_shared_one() {
        assert_eq!(found(&[[50, 60, 39]]), [([50, 60, 39], 0b111111, 0)]);
        assert_eq!(found(&[[9, 9, 9], [10, 9, 9]]), [([9, 9, 9], 0b111101, 1), ([10, 9, 9], 0b111110, 1)]);
    }

    #[test]
    fn the_middle_of_a_solid_cube_is_not_sent() {
        let cube: Vec<_> = (0..27).map(|i| [10 + i % 3, 20 + i / 3 % 3, 5 + i / 9]).collect();
        let seen = found(&cube);
        assert_eq!(seen.len(), 26);
        assert!(seen.iter().all(|(at, _, _)| *at != [11, 21, 6]));
        assert!(
            seen.contains(&([11, 21, 7], 0b100000, 17)),
            "top centre: the top face, 17 neighbours below and beside"
        );
    }

    #[test]
    fn the_last_voxel_of_a_row_is_open_and_its_crowding_is_scaled() {
        assert_eq!(found(&[[99, 0, 0]]), [([99, 0, 0], 0b111111, 0)]);
        // A corner has 7 neighbours inside; one of them occupied is 26 / 7 = 3 of 26.
        assert_eq!(found(&[[0, 0, 0], [0, 0, 1]])[0], ([0, 0, 0], 0b011111, 3));
    }

    #[test]
    fn free_voxels_faded_voxels_and_other_lengths_show_nothing() {
        let mut bricks = block_with(&[[1, 1, 1], [2, 2, 2]]);
        let (_, brick, inner) = locate([1, 1, 1]);
        bricks[brick].confidence[inner] = 0;
        let (_, brick, inner) = locate([2, 2, 2]);
        bricks[brick].occupancy[inner] = -4;
        assert_eq!(surface_of(&bricks), Some(Surface::default()));
        assert_eq!(surface_of(&bricks[1..]), None);
    }

    #[test]
    fn beyond_the_bound_voxels_are_counted_and_not_sent() {
        let checkered: Vec<_> = (0..400_000)
            .map(|i| [i % 100, i / 100 % 100, i / 10_000])
            .filter(|[x, y, z]| (x + y + z) % 2 == 0)
            .collect();
        let surface = surface_of(&block_with(&checkered)).unwrap();
        assert_eq!((surface.words.len(), surface.cut), (SURFACE_VOXELS_MAX, 200_000 - SURFACE_VOXELS_MAX));
    }

    #[test]
    fn the_fast_way_finds_what_asking_each_neighbour_finds() {
        let cases = AtomicUsize::new(0);
        let place = (0..12i32, 88..100i32, 30..40i32).prop_map(|(x, y, z)| [x, y, z]);
        proptest!(ProptestConfig::with_cases(64), |(voxels in prop::collection::btree_set(place, 1..300))| {
            cases.fetch_add(1, Ordering::Relaxed);
            let list: Vec<_> = voxels.iter().copied().collect();
            let mut expected = Vec::new();
            for voxel in &voxels {
                let mut faces = 0;
                for face in 0..6 {
                    let mut next = *voxel;
                    next[face / 2] += if face % 2 == 0 { -1 } else { 1 };
                    faces |= u32::from(!voxels.contains(&next)) << face;
                }
                if faces != 0 {
                    expected.push((voxel.map(|c| c as u32), faces));
                }
            }
            expected.sort_by_key(|(at, _)| [at[2], at[1], at[0]]);
            let seen: Vec<_> = found(&list).into_iter().map(|(at, faces, _)| (at, faces)).collect();
            prop_assert_eq!(seen, expected);
        });
        assert_eq!(cases.load(Ordering::Relaxed), 64);
    }
}
