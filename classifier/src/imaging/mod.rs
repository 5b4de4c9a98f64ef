//! Imaging tools on voxels, as library calls: blur, difference of two snapshots, Hough planes.
//!
//! In: dense blocks of values or points. Out: new blocks, changed voxels, planes. None is part of [`crate::classify`];
//! the thesis tried them and left them out of its final chain. Source: thesis, "3D Imaging techniques".

mod blur;
mod difference;
mod hough;
mod volume;

pub use blur::blur;
pub use difference::{Changes, difference};
pub use hough::{HoughPlane, PHI_BINS, THETA_BINS, hough_planes};
pub use volume::Volume;
