//! Imaging tools on voxels, as library calls: blur, difference of two snapshots and what moved, Hough planes.
//!
//! In: dense blocks of values or points. Out: new blocks, changed voxels, planes. None is part of [`crate::detect`];
//! the thesis tried them and left them out of its final chain. Source: thesis, "3D Imaging techniques".

mod blur;
mod difference;
mod groups;
mod hough;
mod least_squares;
mod movers;
mod volume;

pub use blur::{blur, blur_known};
pub use difference::{Changes, difference};
pub use hough::{HoughPlane, PHI_BINS, THETA_BINS, hough_planes, planes_in_turn};
pub use least_squares::plane_of_heights;
pub use movers::{Mover, MoverSize, movers};
pub use volume::Volume;
