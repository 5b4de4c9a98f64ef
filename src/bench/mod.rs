//! Benchmarks that anyone can run: the mapper's inner job on recorded rays.

pub mod clouds;
pub mod ground;
mod measure;
mod recording;
pub mod shares;
pub mod svg;

pub use measure::{Figures, Options, measure};
pub use recording::Recording;
