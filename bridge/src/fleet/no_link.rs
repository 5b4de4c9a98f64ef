//! The two ends of the link in a program that was built without Zenoh: there is none, and it says so.

use std::sync::mpsc::SyncSender;
use tsense_contract::VehicleName;

/// Why there is no link.
pub type LinkError = Box<dyn std::error::Error + Send + Sync>;

const NOT_BUILT: &str = "this tsense was built without the link; build with --features fleet";

/// What came in at a station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A vehicle of this name says how far its lists go.
    News(String, Vec<u8>),
    /// A vehicle of this name answers.
    Answer(String, Vec<u8>),
}

/// A vehicle's end; there is none.
pub struct VehicleLink {}

impl VehicleLink {
    /// Says why not.
    pub fn open(
        _address: &str,
        _name: &VehicleName,
        _answer: impl Fn(&[u8]) -> Option<Vec<u8>> + Send + 'static,
    ) -> Result<Self, LinkError> {
        Err(NOT_BUILT.into())
    }

    /// Nobody hears it.
    pub fn tell(&self, _news: Vec<u8>) {}

    /// None.
    pub fn stations(&self) -> usize {
        0
    }

    /// None.
    pub fn sent_bytes(&self) -> u64 {
        0
    }
}

/// A station's end; there is none.
pub struct StationLink {}

impl StationLink {
    /// Says why not.
    pub fn open(_listen: &[String], _vehicles_max: usize, _events: SyncSender<Event>) -> Result<Self, LinkError> {
        Err(NOT_BUILT.into())
    }

    /// Nobody is asked.
    pub fn ask(&self, _vehicle: &VehicleName, _question: Vec<u8>) {}

    /// None.
    pub fn lost(&self) -> u64 {
        0
    }
}
