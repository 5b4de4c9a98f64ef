//! What is served: the newest of each topic, and the report that answers a query about it.

use super::config::Config;
use super::cost_map::{self, Layer};
use super::place::Place;
use super::ranges::{self, Ladar};
use super::rig::{PanTilt, Rig};
use super::{objects, smart_grid};
use tsense_contract::{GridCell, GridHeader, Joint, Object, ObjectsHeader, Return, ScanHeader};
use tsense_jaus::message::Field;
use tsense_jaus::message::cost_map::QueryCostMap2D;
use tsense_jaus::message::objects::QueryVectorObjects;
use tsense_jaus::message::pose::{QueryPanTiltJointPositions, QueryPanTiltSpecifications};
use tsense_jaus::message::range::{
    QueryRangeSensorCapabilities, QueryRangeSensorCompressedData, QueryRangeSensorConfiguration, QueryRangeSensorData,
    QuerySensorGeometricProperties,
};
use tsense_jaus::message::smart_grid::{LAYERS, QuerySmartGrid};
use tsense_jaus::{Malformed, Message, Reader, code_of};

/// Why there is no report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// No such query here.
    Unsupported,
    /// The query is malformed.
    Malformed(Malformed),
    /// There is nothing to report yet.
    Nothing,
}

impl Refusal {
    /// In a few words, as a cause to count by.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Unsupported => "unsupported message",
            Self::Malformed(fault) => fault.as_str(),
            Self::Nothing => "asked before there is data",
        }
    }
}

impl From<Malformed> for Refusal {
    fn from(fault: Malformed) -> Self {
        Self::Malformed(fault)
    }
}

/// A kind of product; each counts its changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The grid, as a cost map or as the experimental message.
    Grid,
    /// Scans.
    Scans,
    /// Angles of the pan-tilt unit.
    Head,
    /// Objects.
    Objects,
}

/// The newest of everything.
pub struct Products {
    config: Config,
    place: Option<Place>,
    grid: Option<(GridHeader, Vec<GridCell>)>,
    objects: Option<(ObjectsHeader, Vec<Object>)>,
    ladars: Vec<Ladar>,
    head: Option<PanTilt>,
    changes: [u64; 4],
}

impl Products {
    /// Nothing yet.
    pub fn new(config: &Config, rig: &Rig) -> Self {
        let ladars = rig.ladars.iter().cloned().map(Ladar::new).collect();
        let head = rig.head.clone().map(PanTilt::new);
        Self { config: config.clone(), place: None, grid: None, objects: None, ladars, head, changes: [0; 4] }
    }

    /// A new grid; one that does not hold what it says is refused.
    pub fn take_grid(&mut self, header: &GridHeader, cells: &[GridCell]) -> Result<(), &'static str> {
        let (width, height) = (header.width as usize, header.height as usize);
        if width.checked_mul(height) != Some(cells.len()) || cells.is_empty() || !(0.01..=10.0).contains(&header.cell_m)
        {
            return Err("grid of a strange shape");
        }
        self.go_to(header.zone, header.south)?;
        self.grid = Some((*header, cells.to_vec()));
        self.changes[Kind::Grid as usize] += 1;
        Ok(())
    }

    /// New objects.
    pub fn take_objects(&mut self, header: &ObjectsHeader, objects: &[Object]) -> Result<(), &'static str> {
        // An empty store has no zone before the first pose, and says nothing: nothing is lost of it.
        if header.zone == 0 && objects.is_empty() {
            return Ok(());
        }
        self.go_to(header.zone, header.south)?;
        self.objects = Some((*header, objects.to_vec()));
        self.changes[Kind::Objects as usize] += 1;
        Ok(())
    }

    /// A new scan of a ladar.
    pub fn take_scan(&mut self, ladar: usize, header: &ScanHeader, returns: &[Return]) {
        if let Some(ladar) = self.ladars.get_mut(ladar) {
            ladar.take(header, returns);
            self.changes[Kind::Scans as usize] += 1;
        }
    }

    /// New angles of the pan-tilt unit.
    pub fn take_joint(&mut self, joint: &Joint) {
        if self.head.as_mut().is_some_and(|head| head.take(joint)) {
            self.changes[Kind::Head as usize] += 1;
        }
    }

    /// The zone is pinned for the life of a graph; should it change all the same, the old products lie elsewhere.
    fn go_to(&mut self, zone: u8, south: u8) -> Result<(), &'static str> {
        if self.place.as_ref().is_none_or(|place| place.zone() != (zone, south)) {
            self.place = Some(Place::new(zone, south).ok_or("product without a zone")?);
            (self.grid, self.objects) = (None, None);
        }
        Ok(())
    }

    /// How often the products that a query asks for have changed; none where it asks for no product.
    pub fn generation(&self, code: u16) -> Option<u64> {
        let kind = match code {
            QueryCostMap2D::CODE => Kind::Grid,
            QueryRangeSensorData::CODE
            | QueryRangeSensorCompressedData::CODE
            | QueryRangeSensorCapabilities::CODE
            | QueryRangeSensorConfiguration::CODE => Kind::Scans,
            QueryPanTiltJointPositions::CODE => Kind::Head,
            code if code == self.config.objects_query_code => Kind::Objects,
            code if code == self.config.grid_query_code => Kind::Grid,
            _ => return None,
        };
        Some(self.changes[kind as usize])
    }

    /// The report that answers a query to the component that shows this layer as its cost map. Whether a query is one of
    /// ours does not depend on whether there is data.
    pub fn report(&self, layer: Layer, query: &[u8]) -> Result<Vec<u8>, Refusal> {
        let main = layer == Layer::Traversability;
        match code_of(query).ok_or(Malformed::Truncated)? {
            QueryCostMap2D::CODE => self.cost_map(layer, &QueryCostMap2D::from_bytes(query)?),
            0x2801..=0x2805 if main => self.ranges(query),
            QueryPanTiltSpecifications::CODE | QueryPanTiltJointPositions::CODE if main => self.pan_tilt(query),
            code if main && self.config.experimental && code == self.config.objects_query_code => {
                self.vector_objects(query)
            }
            code if main && self.config.experimental && code == self.config.grid_query_code => self.smart_grid(query),
            _ => Err(Refusal::Unsupported),
        }
    }

    fn cost_map(&self, layer: Layer, query: &QueryCostMap2D) -> Result<Vec<u8>, Refusal> {
        let ((header, cells), place) = self.grid.as_ref().zip(self.place.as_ref()).ok_or(Refusal::Nothing)?;
        let report = cost_map::report((header, cells), layer, query, place, &self.config);
        report.map(|report| report.to_bytes()).ok_or(Refusal::Nothing)
    }

    fn ranges(&self, query: &[u8]) -> Result<Vec<u8>, Refusal> {
        let (ladars, head) = (&self.ladars[..], self.head.as_ref());
        Ok(match code_of(query) {
            Some(QueryRangeSensorCapabilities::CODE) => {
                ranges::capabilities(ladars, &Message::from_bytes(query)?).to_bytes()
            }
            Some(QueryRangeSensorConfiguration::CODE) => {
                ranges::configuration(ladars, &Message::from_bytes(query)?).to_bytes()
            }
            Some(QueryRangeSensorData::CODE) => ranges::data(ladars, head, &Message::from_bytes(query)?).to_bytes(),
            Some(QueryRangeSensorCompressedData::CODE) => {
                ranges::compressed_data(ladars, head, &Message::from_bytes(query)?).to_bytes()
            }
            Some(QuerySensorGeometricProperties::CODE) => {
                ranges::geometry(ladars, head, self.config.main_id(), &Message::from_bytes(query)?).to_bytes()
            }
            _ => return Err(Refusal::Unsupported),
        })
    }

    /// The answer to who would set ladars.
    pub fn set_ranges(&self, command: &[u8]) -> Result<Vec<u8>, Malformed> {
        Ok(ranges::set(&self.ladars, &Message::from_bytes(command)?).to_bytes())
    }

    fn pan_tilt(&self, query: &[u8]) -> Result<Vec<u8>, Refusal> {
        let head = self.head.as_ref().ok_or(Refusal::Unsupported)?;
        if code_of(query) == Some(QueryPanTiltSpecifications::CODE) {
            return Ok(head.specifications(QueryPanTiltSpecifications::from_bytes(query)?.wanted).to_bytes());
        }
        QueryPanTiltJointPositions::from_bytes(query)?;
        Ok(head.positions().ok_or(Refusal::Nothing)?.to_bytes())
    }

    fn vector_objects(&self, query: &[u8]) -> Result<Vec<u8>, Refusal> {
        let query = QueryVectorObjects::from_bytes(&with_code(QueryVectorObjects::CODE, query))?;
        let ((header, list), place) = self.objects.as_ref().zip(self.place.as_ref()).ok_or(Refusal::Nothing)?;
        let report = objects::report((header, list), &query, place).to_bytes();
        Ok(with_code(self.config.objects_report_code, &report))
    }

    fn smart_grid(&self, query: &[u8]) -> Result<Vec<u8>, Refusal> {
        let mut reader = Reader::new(&query[2..]);
        let QuerySmartGrid { layers } = Field::read(&mut reader)?;
        reader.end()?;
        if layers == 0 || layers & !LAYERS != 0 {
            return Err(Refusal::Malformed(Malformed::Value));
        }
        let ((header, cells), place) = self.grid.as_ref().zip(self.place.as_ref()).ok_or(Refusal::Nothing)?;
        let report = smart_grid::report((header, cells), layers, place, &self.config);
        report.map(|report| report.to_bytes(self.config.grid_report_code)).ok_or(Refusal::Nothing)
    }
}

/// A message under another code.
fn with_code(code: u16, message: &[u8]) -> Vec<u8> {
    [&code.to_le_bytes(), &message[2..]].concat()
}
