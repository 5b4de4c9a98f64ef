//! Scans, poses and pan-tilt readings become beams, voxels and snapshots.
//!
//! The core is pure: messages and instants in, values out; only `process` knows topics and the clock. Reading order:
//! [`Mapper`] (the whole stage), `placer` (waiting), `beams` (thesis (2-9), (2-10)), `voxel_map` with `clip`, `walk`
//! (a beam plainly), `runs` with `trace` (the same fast), `marks`, `window`, `block`, `evidence`. Another sensor's
//! voxels come by `voxel_queue`. [`Survey`] feeds recorded rays to the same map.

mod ahead;
mod beams;
mod block;
pub mod block_store;
mod blocks_config;
mod clip;
mod condition;
mod config;
mod continuation;
mod drops;
#[cfg(test)]
mod erosion;
mod evidence;
mod evidence_window;
#[cfg(test)]
mod flat_cost;
mod ladar_mount;
mod mapper;
mod marks;
mod motion;
#[cfg(test)]
mod order_tests;
mod placer;
#[cfg(test)]
mod placer_tests;
pub mod process;
mod ratio;
mod runs;
#[cfg(test)]
mod scene;
mod snapshot;
mod snapshot_cost;
#[cfg(test)]
mod snapshot_tests;
#[cfg(test)]
mod speed;
mod survey;
#[cfg(test)]
mod testing;
mod trace;
pub mod tsmap;
mod untouched;
mod voxel_map;
#[cfg(test)]
mod voxel_map_tests;
mod voxel_queue;
#[cfg(test)]
mod voxel_queue_tests;
mod voxel_sensor;
mod walk;
mod window;

pub use beams::{Beam, BeamKind, PlacedScan, Weight, beam_stamp};
pub use block::BrickSet;
pub use blocks_config::{BlockMode, BlocksConfig};
pub use config::{Config, EvidenceConfig, FadingConfig, PlacingConfig, Scheme, SchemeConfig, WindowRule};
pub use continuation::{Continuation, Moment};
pub use drops::{DropCause, Drops};
pub use ladar_mount::{Extrinsics, LadarMount};
pub use mapper::Mapper;
pub use motion::{HeadSample, Motion};
pub use placer::Placer;
pub use ratio::Counters;
pub use snapshot::{DELTA_BRICKS_MAX, Snapshot, SnapshotContext};
pub use snapshot_cost::{Percentiles, SnapshotCost, SnapshotCosts, snapshot_costs};
pub use survey::Survey;
pub use trace::InstructionSet;
pub use voxel_map::{EDGE_VOXELS_MAX, Fused, MapError, Voxel, VoxelMap};
pub use voxel_sensor::VoxelSensor;
pub use window::blocks_for;
