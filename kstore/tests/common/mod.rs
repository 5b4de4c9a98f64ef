//! Folders and detections for tests that touch the disk.
#![allow(dead_code, clippy::disallowed_methods, reason = "shared by several test files; tests touch the disk")]

pub mod graph;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use tsense_contract::{Class, Detection};
use tsense_geometry::Timestamp;
use tsense_kstore::{Config, KnowledgeStore, Snapshot, View, Zone};

/// A folder of its own, removed at the end.
pub struct Folder(pub PathBuf);

impl Folder {
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = format!("tsense-kstore-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub fn file(&self) -> PathBuf {
        self.0.join("objects.gpkg")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Appends to a path's name.
pub fn with_end(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    name.into()
}

pub fn zone() -> Zone {
    Zone::from_epsg(32_617).unwrap()
}

pub fn at(seconds: f64) -> Timestamp {
    Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(seconds)
}

pub fn tree(east_m: f64, north_m: f64) -> Detection {
    Detection {
        easting_m: 500_000.0 + east_m,
        northing_m: 4_000_000.0 + north_m,
        ground_m: 100.0,
        position_std_m: 0.05,
        dbh_m: 0.3,
        dbh_std_m: 0.02,
        height_m: f32::NAN,
        confidence: 0.6,
        arc_coverage: 0.4,
        lean_rad: [0.0; 2],
        class: Class::Tree.to_wire(),
        stamp_ns: 0,
        reserved: [0; 7],
    }
}

/// One step of a store: a snapshot of these trees.
pub fn see(store: &mut KnowledgeStore, seconds: f64, trees: &[Detection]) {
    let snapshot = Snapshot { stamp: at(seconds), vehicle_m: [500_000.0, 4_000_000.0], zone: zone(), epoch: 1 };
    store.take(&snapshot, trees, |_| View::Unseen);
}

pub fn config() -> Config {
    Config::default()
}
