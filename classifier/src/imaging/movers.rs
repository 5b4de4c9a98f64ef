//! Moving things: what came and what went between two snapshots, each as one thing with a place.
//!
//! In: the [`Changes`] of two views and how large a thing must be. Out: groups of changed voxels, UTM, metres. A ladar sees
//! the near side of a thing only, and its middle lies behind what is seen: the place is the middle of the circle
//! through the changed voxels where that is a body's (up to 0.5 m in radius), else the mean of the voxels.
//! What moves while the head nods is smeared along its way, and its place is the middle of the smear. Crowns and grass
//! flicker, for beams pass them or not by chance; but they flicker beside leaves that are there in both views, while
//! what moves has free space around it: a group that mostly touches what stays is left out. Source: thesis,
//! "Differencing"; the circle is the least-squares one of Kasa (1976).

use super::difference::Changes;
use super::groups::{Place, groups};
use super::least_squares::linear;
use crate::column_bits::ColumnBits;
use crate::columns::View;
use std::collections::BTreeSet;

/// Largest radius of a body, metres: a person with a load.
const RADIUS_MAX_M: f64 = 0.5;

/// How large a change must be to be a thing: grass and leaves flicker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoverSize {
    /// Least number of touching voxels.
    pub voxels_min: usize,
    /// Least height of the group, metres.
    pub height_min_m: f64,
    /// Largest share of its voxels that may touch what is there in both views, 0 to 1; those near its foot, which
    /// stands on something, do not count.
    pub beside_max: f64,
}

impl Default for MoverSize {
    /// A person from the waist up at 10 m: at 0.15 m some twenty voxels over 0.6 m.
    fn default() -> Self {
        Self { voxels_min: 12, height_min_m: 0.6, beside_max: 0.25 }
    }
}

/// A thing that came or went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mover {
    /// True where it came, false where it went.
    pub came: bool,
    /// Easting and northing of its middle, metres.
    pub at_m: [f64; 2],
    /// Height of its lowest and highest face, metres above the ellipsoid.
    pub span_m: [f64; 2],
    /// Changed voxels.
    pub voxels: usize,
}

/// What came and what went between two views, largest first.
pub fn movers(changes: &Changes, [before, after]: [&View; 2], size: &MoverSize) -> Vec<Mover> {
    let stays = [before, after].map(|view| &view.touched);
    let of = |bits: &ColumnBits, came| {
        let things = groups(bits.clone(), after).into_iter().filter(|group| group.len() >= size.voxels_min);
        let alone = things.filter(|group| share_beside(group, stays, after.shape.width) <= size.beside_max);
        alone.map(move |group| mover(&group, after, came)).filter(|m| m.span_m[1] - m.span_m[0] >= size.height_min_m)
    };
    let mut movers: Vec<Mover> = of(&changes.appeared, true).chain(of(&changes.vanished, false)).collect();
    movers.sort_by(|a, b| b.voxels.cmp(&a.voxels).then(b.came.cmp(&a.came)));
    movers
}

/// Levels above the lowest one at which a thing may touch the ground it stands on.
const FOOT_LEVELS: usize = 2;

/// The share of a group's voxels, those of its foot left out, beside which something is that both views hold.
fn share_beside(group: &[Place], [before, after]: [&ColumnBits; 2], width: usize) -> f64 {
    let lowest = group.iter().map(|(_, level)| *level).min().unwrap_or(0);
    let members: BTreeSet<&Place> = group.iter().collect();
    let stays = |place: Place| before.contains(place.0, place.1) && after.contains(place.0, place.1);
    let touches = |(column, level): Place| {
        let steps = [-1, 0, 1].map(|row| [-1, 0, 1].map(|step| row * width as isize + step)).into_iter().flatten();
        let columns = steps.filter_map(|step| column.checked_add_signed(step)).filter(|c| *c < before.columns());
        let mut around = columns.flat_map(|c| (level.saturating_sub(1)..level + 2).map(move |l| (c, l)));
        around.any(|place| stays(place) && !members.contains(&place))
    };
    let upper: Vec<Place> = group.iter().filter(|(_, level)| *level > lowest + FOOT_LEVELS).copied().collect();
    upper.iter().filter(|place| touches(**place)).count() as f64 / upper.len().max(1) as f64
}

fn mover(group: &[Place], view: &View, came: bool) -> Mover {
    let width = view.shape.width;
    let places: Vec<[f64; 2]> = group.iter().map(|(c, _)| view.shape.center_of(c % width, c / width)).collect();
    let (low, high) = group.iter().fold((usize::MAX, 0), |(low, high), (_, l)| (low.min(*l), high.max(*l + 1)));
    let span_m = [view.level_bottom_m(low), view.level_bottom_m(high)];
    Mover { came, at_m: middle(&places), span_m, voxels: group.len() }
}

/// The middle of a body whose near side these places are.
fn middle(places: &[[f64; 2]]) -> [f64; 2] {
    let count = places.len().max(1) as f64;
    let mean = [0, 1].map(|axis| places.iter().map(|p| p[axis]).sum::<f64>() / count);
    let about = |p: &[f64; 2]| [p[0] - mean[0], p[1] - mean[1]];
    match circle(places.iter().map(about)) {
        Some((center, radius_m)) if radius_m <= RADIUS_MAX_M => [mean[0] + center[0], mean[1] + center[1]],
        _ => mean,
    }
}

/// The circle x^2 + y^2 = a x + b y + c that is nearest to the points; nothing where they lie on a line.
fn circle(points: impl Iterator<Item = [f64; 2]>) -> Option<([f64; 2], f64)> {
    let [a, b, c] = linear(points.map(|[x, y]| ([x, y], x * x + y * y)))?;
    let square = c + (a * a + b * b) / 4.0;
    (square > 0.0).then(|| ([a / 2.0, b / 2.0], square.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use crate::imaging::difference;
    use tsense_geometry::VoxelGrid;

    /// Free space with the near (southern) half of a post of radius 0.45 m, 1.8 m high, at a column.
    fn post_at(column_x: usize) -> View {
        let window = Window { first: [400, 800, 0], size: [40, 40, 20] };
        let mut view = View::unknown(window, VoxelGrid::new(0.15).unwrap());
        for (column, level) in (0..1600).flat_map(|column| (0..20).map(move |level| (column, level))) {
            let (dx, dy) = ((column % 40) as f64 - column_x as f64, (column / 40) as f64 - 20.0);
            let on_rim = (dx.hypot(dy) - 3.0).abs() < 0.5 && dy <= 0.0;
            if on_rim && level < 12 { view.occupied.insert(column, level) } else { view.free.insert(column, level) }
        }
        view.touched = view.occupied.clone();
        view
    }

    #[test]
    fn the_middle_lies_behind_the_side_that_is_seen() {
        let (before, after) = (post_at(8), post_at(30));
        let found = movers(&difference(&before, &after, 4).unwrap(), [&before, &after], &MoverSize::default());
        assert_eq!(found.iter().map(|m| m.came).collect::<Vec<_>>(), [true, false]);
        for (mover, column) in found.iter().zip([30, 8]) {
            let truth = after.shape.center_of(column, 20);
            let off_m = (mover.at_m[0] - truth[0]).hypot(mover.at_m[1] - truth[1]);
            assert!(off_m < 0.05, "{off_m} m off: {mover:?}");
            assert!(mover.span_m[0].abs() < 1e-9 && (mover.span_m[1] - 1.8).abs() < 1e-9, "{mover:?}");
        }
    }

    #[test]
    fn a_wall_has_no_circle_and_small_things_do_not_count() {
        let line: Vec<[f64; 2]> = (0..20).map(|i| [0.15 * f64::from(i), 2.0]).collect();
        assert!((middle(&line)[0] - 1.425).abs() < 1e-9 && (middle(&line)[1] - 2.0).abs() < 1e-9);
        assert_eq!(middle(&[[3.0, 4.0]]), [3.0, 4.0]);
        let (before, after) = (post_at(8), post_at(30));
        let tall = MoverSize { height_min_m: 1.9, ..MoverSize::default() };
        assert!(movers(&difference(&before, &after, 4).unwrap(), [&before, &after], &tall).is_empty());
    }

    #[test]
    fn what_flickers_in_a_crown_does_not_move() {
        let (mut before, mut after) = (post_at(8), post_at(30));
        // Leaves all around the post, in both.
        for (column, level) in (0..1600).flat_map(|column| (0..12).map(move |level| (column, level))) {
            let changed = before.occupied.contains(column, level) || after.occupied.contains(column, level);
            if !changed && column % 2 == 0 {
                before.touched.insert(column, level);
                after.touched.insert(column, level);
            }
        }
        let changes = difference(&before, &after, 4).unwrap();
        assert!(movers(&changes, [&before, &after], &MoverSize::default()).is_empty());
        let all = MoverSize { beside_max: 1.0, ..MoverSize::default() };
        assert_eq!(movers(&changes, [&before, &after], &all).len(), 2);
    }
}
