//! What of the pan-tilt driver runs without a graph.

pub mod probe;
