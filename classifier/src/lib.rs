//! Snapshot in, meaning out: ground, brush, trunks, drops and the Smart Sensor Grid from a map of voxels.
//!
//! A pure library (time and bytes are arguments) with one chain, which reads like that of the thesis: [`detect`], then
//! [`Detected::finish`]. And one shell, `process`. In: bricks of voxels in UTM. Out: detections and a grid, metres, UTM.
//! It keeps nothing from one snapshot to the next but what its caller holds: the bounded store of [`Returns`], and the
//! [`Memory`] of the snapshots before. Merging detections is the knowledge store's work.

pub mod config;
pub mod imaging;
pub mod process;

mod aimed;
mod brush;
mod classify;
mod cluster;
mod column_bits;
mod columns;
mod convolution;
mod crown;
mod density;
mod distance;
mod drops;
mod grid;
mod ground;
mod intake;
mod interpolation;
mod memory;
mod moving;
mod pits;
mod plane_fit;
mod profile;
mod pyramid;
mod returns;
mod rock;
mod solid;
mod stems;
mod surface;
mod surface_ground;
mod things;
mod tiles;
mod traversability;
mod trunk;
mod under_surface;
mod vehicle_plane;

pub use classify::{Classification, Detected, Input, detect};
pub use column_bits::ColumnBits;
pub use columns::{COLUMNS_MAX, LEVELS_MAX, View, Window};
pub use config::{Config, Detector};
pub use density::Columns;
pub use ground::Ground;
pub use memory::Memory;
pub use moving::{Moving, MovingConfig};
pub use returns::{
    Beam, Cells, ColumnReturn, PlacedBeam, Points, ReturnColumns, ReturnDrops, Returns, ReturnsConfig, Station,
};
pub use rock::{ROCK_IN_BRUSH_MAX, is_rock_size};
pub use stems::StemsConfig;
pub use traversability::Cost;
pub use trunk::{BREAST_HEIGHT_M, Reason, Rejected};
