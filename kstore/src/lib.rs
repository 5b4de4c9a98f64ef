//! The local knowledge store of the Terrain Smart Sensor: detections become objects one can trust.
//!
//! Each snapshot's detections are absorbed by stored objects of their class within a gate; confidence grows with
//! independent sightings and decays with time, faster where a snapshot speaks against an object; an object is reported
//! only after several sightings spread over time. Source: thesis, local knowledge store.
//!
//! [`KnowledgeStore`] is pure: stamps and detections in, objects out.

pub mod config;
mod consensus;
mod correction;
mod decay;
mod forget;
mod history;
mod index;
mod merge;
mod object;
pub mod persist;
mod process;
mod query;
mod records;
mod registration;
mod reproject;
mod seen;
pub mod station;
mod store;
#[cfg(test)]
mod store_properties;
#[cfg(test)]
mod store_tests;
#[cfg(test)]
mod testing;
mod writer;
mod zone;

pub use config::Config;
pub use correction::Correction;
pub use decay::View;
pub use history::{Event, Reason};
pub use object::{Estimate, Known, Refusal, Sighting};
pub use process::{Error, run};
pub use query::{Answer, Query, view_without_grid};
pub use records::{Changes, Dropped, Outcome, Snapshot};
pub use registration::Registration;
pub use reproject::Reprojection;
pub use seen::Seen;
pub use store::KnowledgeStore;
pub use zone::Zone;
