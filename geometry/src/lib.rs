//! Space and time for the Terrain Smart Sensor: frames and transforms as types, instants, interpolated
//! trajectories, voxel indices, the exact ray walk and georeferenced rasters.
//!
//! This crate knows no device, no process and no clock: everything is a value. World coordinates are `f64`.

mod attitude;
mod frame;
mod raster;
mod ray_walk;
mod time;
mod trajectory;
mod voxel;

pub use attitude::{
    Attitude, Mounting, PanTiltAngles, attitude_of, base_from_tilt, beam_direction, global_from_vehicle,
    vehicle_from_ladar,
};
pub use frame::{Frame, Global, Ladar, PanTiltBase, Point, Tilt, Transform, Vector, Vehicle};
pub use raster::{Raster, RasterShape};
pub use ray_walk::{RayWalk, ray_walk};
pub use time::{NS_PER_S, Timestamp};
pub use trajectory::{Bracket, Interpolate, Limits, NoValue, Trajectory};
pub use voxel::{COORDINATE_MAX_M, VoxelGrid, VoxelIndex};
