//! What is served: the newest of each topic, and the report that answers a query about it.

use super::config::Config;
use super::cost_map::{self, Layer};
use super::place::Place;
use super::ranges::{self, Ladar};
use super::{objects, smart_grid};
use tsense_contract::{GridCell, GridHeader, Object, ObjectsHeader, Return, ScanHeader};
use tsense_jaus::message::Field;
use tsense_jaus::message::cost_map::QueryCostMap2D;
use tsense_jaus::message::objects::QueryVectorObjects;
use tsense_jaus::message::range::{QueryRangeSensorCapabilities, QueryRangeSensorConfiguration, QueryRangeSensorData};
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
    changes: [u64; 3],
}

impl Products {
    /// Nothing yet. Ladars are numbered from 1 in this order.
    pub fn new(config: &Config, ladars: &[String]) -> Self {
        let ladars = ladars.iter().map(|name| Ladar { name: name.clone(), scan: None }).collect();
        Self { config: config.clone(), place: None, grid: None, objects: None, ladars, changes: [0; 3] }
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
        // Without a zone there is no object to be placed: an empty store before the first pose.
        self.go_to(header.zone, header.south)?;
        self.objects = Some((*header, objects.to_vec()));
        self.changes[Kind::Objects as usize] += 1;
        Ok(())
    }

    /// A new scan of a ladar.
    pub fn take_scan(&mut self, ladar: usize, header: &ScanHeader, returns: &[Return]) {
        if let Some(ladar) = self.ladars.get_mut(ladar) {
            ladar.scan = Some((*header, returns.to_vec()));
            self.changes[Kind::Scans as usize] += 1;
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
            QueryRangeSensorData::CODE | QueryRangeSensorCapabilities::CODE | QueryRangeSensorConfiguration::CODE => {
                Kind::Scans
            }
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
            QueryRangeSensorData::CODE if main => self.scans(&QueryRangeSensorData::from_bytes(query)?),
            QueryRangeSensorCapabilities::CODE if main => {
                Ok(ranges::capabilities(&self.ladars, &Message::from_bytes(query)?).to_bytes())
            }
            QueryRangeSensorConfiguration::CODE if main => {
                Ok(ranges::configuration(&self.ladars, &Message::from_bytes(query)?).to_bytes())
            }
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

    fn scans(&self, query: &QueryRangeSensorData) -> Result<Vec<u8>, Refusal> {
        Ok(ranges::data(&self.ladars, query).to_bytes())
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
