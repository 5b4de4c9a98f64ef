//! Where objects are: an R-tree of ids by place, so that neighbours are found without looking at every object.

use rstar::primitives::GeomWithData;
use rstar::{AABB, RTree};

type Entry = GeomWithData<[f64; 2], u64>;

/// Ids by easting and northing, metres.
#[derive(Clone, Debug)]
pub struct Index {
    tree: RTree<Entry>,
}

impl Index {
    /// An index of all given objects at once.
    pub fn of(places: impl Iterator<Item = (u64, [f64; 2])>) -> Self {
        Self { tree: RTree::bulk_load(places.map(|(id, place)| Entry::new(place, id)).collect()) }
    }

    /// Adds an object.
    pub fn insert(&mut self, id: u64, place_m: [f64; 2]) {
        self.tree.insert(Entry::new(place_m, id));
    }

    /// Takes an object out; `place_m` is exactly where it was put.
    pub fn remove(&mut self, id: u64, place_m: [f64; 2]) {
        self.tree.remove(&Entry::new(place_m, id));
    }

    /// Moves an object.
    pub fn shift(&mut self, id: u64, from_m: [f64; 2], to_m: [f64; 2]) {
        if from_m != to_m {
            self.remove(id, from_m);
            self.insert(id, to_m);
        }
    }

    /// Ids within a circle, in no particular order.
    pub fn near(&self, place_m: [f64; 2], radius_m: f64) -> impl Iterator<Item = u64> {
        self.tree.locate_within_distance(place_m, radius_m * radius_m).map(|entry| entry.data)
    }

    /// Ids and places within a box, borders included, in no particular order.
    pub fn within(&self, min_m: [f64; 2], max_m: [f64; 2]) -> impl Iterator<Item = (u64, [f64; 2])> {
        self.tree.locate_in_envelope(AABB::from_corners(min_m, max_m)).map(|entry| (entry.data, *entry.geom()))
    }

    /// Number of entries.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.tree.size()
    }
}
