//! Where objects are: R-trees of ids by place, one for each class, so that neighbours are found without looking at
//! every object, and the few rocks without looking at the many trees.

use rstar::primitives::GeomWithData;
use rstar::{AABB, RTree};
use tsense_contract::Class;

type Entry = GeomWithData<[f64; 2], u64>;

/// An object as the index knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The object.
    pub id: u64,
    /// Easting, northing, metres.
    pub place_m: [f64; 2],
}

impl From<&Entry> for Found {
    fn from(entry: &Entry) -> Self {
        Self { id: entry.data, place_m: *entry.geom() }
    }
}

/// Ids by class, easting and northing, metres.
#[derive(Clone, Debug)]
pub struct Index {
    /// By the class's byte.
    trees: Vec<RTree<Entry>>,
}

impl Index {
    /// An index of all given objects at once.
    pub fn of(objects: impl Iterator<Item = (Class, Found)>) -> Self {
        let mut entries = vec![Vec::new(); Class::ALL.len()];
        objects.for_each(|(class, f)| entries[usize::from(class.to_wire())].push(Entry::new(f.place_m, f.id)));
        Self { trees: entries.into_iter().map(RTree::bulk_load).collect() }
    }

    /// Adds an object.
    pub fn insert(&mut self, class: Class, id: u64, place_m: [f64; 2]) {
        self.trees[usize::from(class.to_wire())].insert(Entry::new(place_m, id));
    }

    /// Takes an object out; `place_m` is exactly where it was put.
    pub fn remove(&mut self, class: Class, id: u64, place_m: [f64; 2]) {
        self.trees[usize::from(class.to_wire())].remove(&Entry::new(place_m, id));
    }

    /// Moves an object.
    pub fn shift(&mut self, class: Class, id: u64, from_m: [f64; 2], to_m: [f64; 2]) {
        if from_m != to_m {
            self.remove(class, id, from_m);
            self.insert(class, id, to_m);
        }
    }

    /// Within a circle, of one class or of all, in no particular order.
    pub fn near(&self, class: Option<Class>, place_m: [f64; 2], radius_m: f64) -> impl Iterator<Item = u64> {
        let trees = self.trees(class).iter();
        trees.flat_map(move |tree| tree.locate_within_distance(place_m, radius_m * radius_m)).map(|entry| entry.data)
    }

    /// Within a box, borders included, in no particular order.
    pub fn within(&self, class: Option<Class>, min_m: [f64; 2], max_m: [f64; 2]) -> impl Iterator<Item = Found> {
        let area = AABB::from_corners(min_m, max_m);
        self.trees(class).iter().flat_map(move |tree| tree.locate_in_envelope(area)).map(Found::from)
    }

    /// The nearest first, of equals the oldest, each found only when it is asked for.
    pub fn nearest(&self, class: Option<Class>, place_m: [f64; 2]) -> impl Iterator<Item = Found> {
        let walks = self.trees(class).iter().map(|tree| tree.nearest_neighbor_iter_with_distance_2(place_m).peekable());
        let mut walks: Vec<_> = walks.collect();
        let mut equals: Vec<Found> = Vec::new();
        std::iter::from_fn(move || {
            if equals.is_empty() {
                let next = walks.iter_mut().filter_map(|w| w.peek().map(|(_, d)| *d)).min_by(f64::total_cmp)?;
                for walk in &mut walks {
                    equals
                        .extend(std::iter::from_fn(|| walk.next_if(|(_, d)| *d <= next)).map(|(e, _)| Found::from(e)));
                }
                equals.sort_by_key(|f| std::cmp::Reverse(f.id));
            }
            equals.pop()
        })
    }

    /// Number of entries.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.trees.iter().map(RTree::size).sum()
    }

    fn trees(&self, class: Option<Class>) -> &[RTree<Entry>] {
        class.map_or(&self.trees, |class| std::slice::from_ref(&self.trees[usize::from(class.to_wire())]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_come_first_of_all_classes_and_of_equals_the_oldest() {
        let places = [(Class::Tree, 3.0), (Class::Rock, 1.0), (Class::Tree, 1.0), (Class::Wall, 2.0)];
        let objects = places.iter().zip(1..).map(|(&(class, east), id)| (class, Found { id, place_m: [east, 0.0] }));
        let index = Index::of(objects);
        let ids = |class| index.nearest(class, [0.0, 0.0]).map(|f| f.id).collect::<Vec<_>>();
        assert_eq!(ids(None), [2, 3, 4, 1]);
        assert_eq!(ids(Some(Class::Tree)), [3, 1]);
        assert_eq!(ids(Some(Class::Drop)), [] as [u64; 0]);
    }
}
