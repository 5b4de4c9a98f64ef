//! Scores: what a survey or a demo found against what is there, tables of them, and `docs/results.md`.
//!
//! In: folders of truth (the layout of docs/survey.md), folders of results (`tsense survey`), scorecards (`tsense demo`).
//! Out: figures in metres with their names, text, Markdown. The definitions are those of the plots' own
//! score.py, which is no part of the repository; a test compares the two where it is at hand.
#![allow(clippy::disallowed_methods, reason = "shell: reads truth and results, runs the program itself")]

pub mod found;
mod glance;
pub mod goals;
pub mod live;
pub mod markdown;
pub mod numbers;
pub mod pairs;
pub mod plot;
pub mod raster;
pub mod report;
pub mod runs;
pub mod scene;
pub mod shapes;
pub mod statistics;
pub mod table;
pub mod things;
pub mod truth;

use crate::commands::{Failure, unreadable};
use std::path::Path;

/// A file's bytes.
pub fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(path).map_err(|e| unreadable(path, &e))
}
