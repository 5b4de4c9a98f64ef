//! Once its buffers have grown, the mapper allocates nothing: not for a beam, a scan, a pose or a snapshot.
//!
//! The allocator of this test counts. It is alone in its binary, and its one test runs on one thread.
#![allow(unsafe_code, reason = "a global allocator is an unsafe trait; this one only counts and passes on")]

mod common;

use common::{BEAMS, Ride, Room};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Allocations of this thread.
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is passed on to the system's allocator as it is.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: as the caller promised.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: as the caller promised.
        unsafe { System.realloc(memory, layout, size) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Feeds scans, a snapshot after every tenth and a keyframe after every hundredth; allocations, beams, snapshots.
fn feed(ride: &mut Ride, room: &mut Room, scans: u32) -> (usize, usize, usize) {
    let before = COUNT.get();
    let (mut beams, mut snapshots) = (0, 0);
    for i in 1..=scans {
        let now = ride.next_scan();
        beams += ride.trace(now);
        if i % 10 == 0 {
            room.publish(&mut ride.mapper, i % 100 == 0, now);
            snapshots += 1;
        }
    }
    (COUNT.get() - before, beams, snapshots)
}

#[test]
fn beams_and_snapshots_allocate_nothing_once_the_buffers_have_grown() {
    // A crawl: the map changes, fades, and the working space moves within its blocks.
    let (mut ride, mut room) = (Ride::new(0.1), Room::new());
    // Two nods there and back, 12 s.
    let (warming, ..) = feed(&mut ride, &mut room, 600);
    assert!(warming > 0, "the counter counts");
    let (allocations, beams, snapshots) = feed(&mut ride, &mut room, 600);
    assert_eq!((beams, snapshots), (600 * BEAMS, 60));
    assert_eq!(allocations, 0, "allocations for {beams} beams and {snapshots} snapshots");
    let drops = ride.mapper.placer().drops();
    assert_eq!(drops.total(), 0, "{drops:?}");
}
