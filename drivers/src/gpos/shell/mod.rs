//! What of the position driver runs without a graph.

pub mod jaus;
pub mod probe;
