//! The newest state of many things, and the order in which they last changed: what a reader with a cursor asks of.
//!
//! In: a value for a key, or that it is gone. Out: what changed after a number, in order. Each key is there once, with
//! its newest value and a number that grows with every change of anything; so the log is bounded by the things that
//! there are, however long a reader is away. What is gone is remembered up to a bound; beyond it the log starts a new
//! epoch, and every reader reads it anew.

use std::collections::BTreeMap;

/// Keys of things gone that are remembered: more than a store of 100,000 objects loses while nobody reads.
const GONE_MAX: usize = 100_000;

/// A change: its number, its key, and the value unless the thing is gone.
pub type Change<'a, K, V> = (u64, &'a K, Option<&'a V>);

/// See the head of this file.
#[derive(Clone, Debug)]
pub struct ChangeLog<K, V> {
    epoch: u64,
    head: u64,
    things: BTreeMap<K, (u64, Option<V>)>,
    order: BTreeMap<u64, K>,
    gone: usize,
}

impl<K: Clone + Ord, V> ChangeLog<K, V> {
    /// An empty log. The epoch is one that no log of this vehicle had before.
    pub fn new(epoch: u64) -> Self {
        Self { epoch, head: 0, things: BTreeMap::new(), order: BTreeMap::new(), gone: 0 }
    }

    /// Numbers of two epochs do not compare.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// The newest number; 0 in an empty log.
    pub fn head(&self) -> u64 {
        self.head
    }

    /// A thing that is there.
    pub fn get(&self, key: &K) -> Option<&V> {
        self.things.get(key)?.1.as_ref()
    }

    /// Things that are there, by key.
    pub fn iter(&self) -> impl Iterator<Item = (&K, &V)> {
        self.things.iter().filter_map(|(key, (_, value))| Some((key, value.as_ref()?)))
    }

    /// Things from a key on that are there, by key.
    pub fn from(&self, key: K) -> impl Iterator<Item = (&K, &V)> {
        self.things.range(key..).filter_map(|(key, (_, value))| Some((key, value.as_ref()?)))
    }

    /// A thing is new, or has changed.
    pub fn put(&mut self, key: K, value: V) {
        self.change(key, Some(value));
    }

    /// A thing is gone, and readers must know.
    pub fn remove(&mut self, key: &K) {
        if self.get(key).is_some() {
            self.change(key.clone(), None);
            if self.gone > GONE_MAX {
                self.start_epoch();
            }
        }
    }

    /// A thing is not offered any more; readers keep what they have of it.
    pub fn forget(&mut self, key: &K) {
        if let Some((number, value)) = self.things.remove(key) {
            self.order.remove(&number);
            self.gone -= usize::from(value.is_none());
        }
    }

    /// Whoever reads starts at the beginning again; what is gone is forgotten.
    pub fn start_epoch(&mut self) {
        self.epoch += 1;
        self.things.retain(|_, (_, value)| value.is_some());
        let things = &self.things;
        self.order.retain(|_, key| things.contains_key(key));
        self.gone = 0;
    }

    /// Up to `limit` changes after a number, in their order.
    pub fn after(&self, number: u64, limit: usize) -> impl Iterator<Item = Change<'_, K, V>> {
        let later = self.order.range(number.saturating_add(1)..).take(limit);
        later.map(|(number, key)| (*number, key, self.things.get(key).and_then(|(_, value)| value.as_ref())))
    }

    fn change(&mut self, key: K, value: Option<V>) {
        self.head += 1;
        self.gone += usize::from(value.is_none());
        if let Some((number, old)) = self.things.insert(key.clone(), (self.head, value)) {
            self.order.remove(&number);
            self.gone -= usize::from(old.is_none());
        }
        self.order.insert(self.head, key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listed(log: &ChangeLog<u8, char>, after: u64, limit: usize) -> Vec<(u64, u8, Option<char>)> {
        log.after(after, limit).map(|(number, key, value)| (number, *key, value.copied())).collect()
    }

    #[test]
    fn each_thing_is_listed_once_with_its_newest_value_where_it_changed_last() {
        let mut log = ChangeLog::new(5);
        [(1, 'a'), (2, 'b'), (3, 'c'), (1, 'd')].into_iter().for_each(|(key, value)| log.put(key, value));
        log.remove(&2);
        log.remove(&9);
        assert_eq!(listed(&log, 0, 9), [(3, 3, Some('c')), (4, 1, Some('d')), (5, 2, None)]);
        assert_eq!(listed(&log, 3, 1), [(4, 1, Some('d'))]);
        assert_eq!((listed(&log, u64::MAX, 9), log.head(), log.get(&2)), (vec![], 5, None));
    }

    #[test]
    fn what_is_gone_is_bounded_and_then_everybody_reads_anew() {
        let mut log = ChangeLog::new(1);
        log.put(0, 'a');
        for key in 1..=GONE_MAX as u32 + 1 {
            log.put(key, 'b');
            log.remove(&key);
        }
        assert_eq!((log.epoch(), log.things.len(), log.order.len(), log.gone), (2, 1, 1, 0));
        assert_eq!(log.after(0, 9).count(), 1);
    }

    #[test]
    fn a_thing_that_comes_back_is_there_again_and_one_forgotten_is_not_told() {
        let mut log = ChangeLog::new(1);
        log.put(1, 'a');
        log.remove(&1);
        log.put(1, 'b');
        log.put(2, 'c');
        log.forget(&2);
        assert_eq!((listed(&log, 0, 9), log.gone), (vec![(3, 1, Some('b'))], 0));
    }
}
