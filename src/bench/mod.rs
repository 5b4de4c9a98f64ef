//! Benchmarks that anyone can run: the mapper's inner job on recorded rays.

mod measure;
mod recording;

pub use measure::{Figures, Options, measure};
pub use recording::Recording;
