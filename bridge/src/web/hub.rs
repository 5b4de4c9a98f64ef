//! Where the feeding thread and the clients meet: the slots behind a lock that nobody holds for long.
//!
//! `put` never waits for a client: a client copies a reference to a frame out and sends it without the lock.

use super::frames::Frame;
use super::slots::{Cursor, Slot, Slots};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// The newest frames, shared by all clients, and what the feeding thread says of itself.
#[derive(Debug)]
pub struct Hub {
    slots: Mutex<Slots>,
    changed: watch::Sender<u64>,
    clients: Arc<AtomicUsize>,
    report: Mutex<serde_json::Value>,
}

impl Default for Hub {
    fn default() -> Self {
        Self {
            slots: Mutex::default(),
            changed: watch::Sender::new(0),
            clients: Arc::default(),
            report: Mutex::new(serde_json::json!({"state": "starting", "reason": "no data yet"})),
        }
    }
}

/// A panic elsewhere leaves the slots as they were: each change is one statement, so the lock stays usable.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    /// Puts the newest frame of a slot.
    pub fn put(&self, slot: Slot, frame: Frame) {
        let number = locked(&self.slots).put(slot, frame);
        self.changed.send_replace(number);
    }

    /// Empties the slots that `gone` names.
    pub fn remove(&self, gone: impl Fn(Slot) -> bool) {
        locked(&self.slots).remove(gone);
    }

    /// The oldest frame the cursor has not seen.
    pub fn next(&self, cursor: &mut Cursor) -> Option<Frame> {
        locked(&self.slots).next(cursor)
    }

    /// Bytes of all frames held.
    pub fn bytes(&self) -> usize {
        locked(&self.slots).bytes()
    }

    /// Tells of every change: subscribe before asking for the next frame, then wait.
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.changed.subscribe()
    }

    /// Clients connected now.
    pub fn clients(&self) -> usize {
        self.clients.load(Ordering::Relaxed)
    }

    /// A place among at most `clients_max` clients, given back on drop; nothing where all are taken.
    pub fn admit(&self, clients_max: usize) -> Option<Admission> {
        let admitted = self.clients.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |clients| {
            (clients < clients_max).then_some(clients + 1)
        });
        admitted.ok().map(|_| Admission { clients: Arc::clone(&self.clients) })
    }

    /// Sets what `/health` and `/metrics` tell.
    pub fn set_report(&self, report: serde_json::Value) {
        *locked(&self.report) = report;
    }

    /// What `/health` tells.
    pub fn report(&self) -> serde_json::Value {
        locked(&self.report).clone()
    }
}

/// A client's place.
#[derive(Debug)]
pub struct Admission {
    clients: Arc<AtomicUsize>,
}

impl Drop for Admission {
    fn drop(&mut self) {
        self.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_limited_and_given_back() {
        let hub = Hub::default();
        let (first, second) = (hub.admit(2).unwrap(), hub.admit(2));
        assert!(second.is_some() && hub.admit(2).is_none());
        drop(first);
        assert_eq!(hub.clients(), 1);
        assert!(hub.admit(2).is_some());
    }
}
