//! What all tiles of a survey found together.
//!
//! In: one [`Surveyed`] tile after the other. Out: the trees, the candidates that are none, and counts of everything.
//! Memory grows with the objects found, about 120 bytes each, not with the rays.

use super::extent::Extent;
use super::thing::{Kind, Thing};
use super::tile::Surveyed;
use super::timeline::Timeline;
use std::collections::BTreeMap;
use tsense_classifier::{Rejected, ReturnDrops};
use tsense_contract::{Detection, GroundEvidence};

/// Trees of two tiles that are closer than this are one, metres: less than stems stand apart, more than tiles differ.
const SAME_TREE_M: f64 = 0.3;

/// The sums over the tiles.
pub struct Totals {
    /// Rays read, returns among them, and where they lie.
    pub extent: Extent,
    /// Occupied and free voxels over time.
    pub timeline: Timeline,
    /// Trees; one that stands on the border of tiles is there once.
    pub trees: Vec<Detection>,
    /// Candidates that are no trees.
    pub rejected: Vec<Rejected>,
    /// Cells by how their ground is known.
    pub ground_cells: BTreeMap<GroundEvidence, u64>,
    /// Tiles in which a beam ended.
    pub tiles: usize,
    /// Blocks that rays reached; those of margins count in each tile.
    pub blocks: usize,
    /// Voxels that rays crossed, each crossing counted.
    pub voxel_visits: u64,
    /// Drops, rocks, walls and brush patches, by what they are.
    pub things: BTreeMap<Kind, u64>,
    /// Groups of cells that were too small to be a thing.
    pub too_small: u64,
    /// Beams that the stores of returns did not keep.
    pub drops: ReturnDrops,
}

impl Totals {
    /// Nothing was found yet.
    pub fn new(extent: Extent, timeline: Timeline) -> Self {
        Self {
            extent,
            timeline,
            trees: Vec::new(),
            rejected: Vec::new(),
            ground_cells: BTreeMap::new(),
            tiles: 0,
            blocks: 0,
            voxel_visits: 0,
            things: BTreeMap::new(),
            too_small: 0,
            drops: ReturnDrops::default(),
        }
    }

    /// Adds a tile.
    pub fn add(&mut self, tile: &Surveyed) {
        let piece = &tile.piece;
        self.tiles += 1;
        self.blocks += tile.blocks;
        self.voxel_visits += tile.map.voxel_visits();
        let (sum, drops) = (&mut self.drops, tile.drops);
        (sum.bad, sum.thinned) = (sum.bad + drops.bad, sum.thinned + drops.thinned);
        (sum.full, sum.left) = (sum.full + drops.full, sum.left + drops.left);
        let evidence = piece.found.ground.evidence.cells();
        let known = (0..piece.core.len()).map(|i| piece.cell(i).map_or(GroundEvidence::Unknown, |i| evidence[i]));
        known.for_each(|evidence| *self.ground_cells.entry(evidence).or_insert(0) += 1);
        self.rejected.extend(piece.found.rejected.iter().filter(|r| piece.holds(r.at_m[0], r.at_m[1])));
        // Those of this tile do not stand for one another: the chain tells them apart.
        let before = self.trees.len();
        for tree in piece.trees(SAME_TREE_M) {
            add_tree(&mut self.trees, before, *tree);
        }
    }

    /// Counts groups of cells that are whole: what they are, nothing for those that are too small.
    pub fn add_things(&mut self, groups: &[Option<Thing>]) {
        for thing in groups {
            match thing {
                Some(thing) => *self.things.entry(thing.kind).or_insert(0) += 1,
                None => self.too_small += 1,
            }
        }
    }
}

/// Adds a tree to those of earlier tiles, the first `before`; of two that are one, the surer is kept.
fn add_tree(trees: &mut Vec<Detection>, before: usize, tree: Detection) {
    let is_same =
        |other: &Detection| (other.easting_m - tree.easting_m).hypot(other.northing_m - tree.northing_m) < SAME_TREE_M;
    match trees[..before].iter_mut().find(|other| is_same(other)) {
        Some(other) if other.confidence < tree.confidence => *other = tree,
        Some(_) => {}
        None => trees.push(tree),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_tree_that_two_tiles_see_is_one_tree_and_the_surer_sighting_stays() {
        let tree = |easting_m, confidence| Detection { easting_m, confidence, ..Detection::zeroed() };
        let mut trees = vec![tree(10.0, 0.5), tree(20.0, 0.5)];
        for next in [tree(10.1, 0.9), tree(20.1, 0.4), tree(30.0, 0.4), tree(30.1, 0.4)] {
            add_tree(&mut trees, 2, next);
        }
        let places: Vec<f64> = trees.iter().map(|t| t.easting_m).collect();
        assert_eq!(places, [10.1, 20.0, 30.0, 30.1]);
    }
}
