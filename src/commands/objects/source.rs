//! Where `tsense objects` gets its answer: the running store's service, or the store's file.

use super::{Failure, ObjectsArgs, tell};
use crate::graph::{Request, ask};
use std::path::{Path, PathBuf};
use tsense_contract::{Object, ObjectsHeader, Service, Store};
use tsense_geometry::Timestamp;
use tsense_kstore::persist::{Entry, FileFault, history_of, read_only};
use tsense_kstore::{Config, Query, Zone};
use tsense_ports::{Client, Clock, Domain, PortError, Process};

/// How long the store may take to answer, seconds: it answers within milliseconds, also while it writes.
const ANSWER_S: f64 = 2.0;

/// What is shown.
pub struct Listing {
    /// The objects that match.
    pub objects: Vec<Object>,
    /// True where the limit left some out.
    pub truncated: bool,
    /// Objects in the store.
    pub stored: u64,
    /// Zone of the places.
    pub zone: Option<Zone>,
    /// The instant confidence is decayed to.
    pub now: Timestamp,
    /// Where this came from, for people.
    pub origin: String,
}

/// What became of one object.
pub struct History {
    /// Its changes, oldest first.
    pub entries: Vec<Entry>,
    /// The instant ages are counted to.
    pub now: Timestamp,
}

/// Where the store is, by which configuration it is judged, and what time it is for it.
pub struct Source {
    /// The graph to ask, where one runs that has a store.
    graph: Option<Domain>,
    file: PathBuf,
    config: Config,
    now: Timestamp,
}

impl Source {
    /// The source that the arguments name.
    pub fn of(args: &ObjectsArgs) -> Result<Self, Failure> {
        let wall_clock = Clock::start(1.0).now();
        if let Some(file) = &args.store {
            return Ok(Self { graph: None, file: file.clone(), config: Config::default(), now: wall_clock });
        }
        let domain = match &args.graph {
            Some(name) => Domain::new(name).map_err(|e| Failure::new(2, e))?,
            None => crate::commands::status::find(None).or_else(default_graph)?,
        };
        // The resolved configuration is there while the graph runs; a stopped one is taken to have the defaults.
        let config = crate::commands::config::load(&domain.config_file()).unwrap_or_default();
        let has_store = config.kstore.is_some();
        let section = config.kstore.unwrap_or_default();
        let facts = domain.facts().ok();
        let state_dir = facts.as_ref().map_or_else(|| default_state_dir(domain.name()), |f| f.state_dir.clone());
        let now = facts.map_or(wall_clock, |f| f.clock.now());
        let runs = has_store && ask(&domain, Request::Status).is_ok();
        Ok(Self { graph: runs.then_some(domain), file: state_dir.join(&section.file), config: section, now })
    }

    /// Asks the running store; where none runs, or it does not answer, reads its file.
    pub fn listing(self, query: &Query) -> Result<Listing, Failure> {
        let why = match &self.graph {
            None => "no running graph has it open".into(),
            Some(domain) => match self.ask(domain, query) {
                Ok(listing) => return Ok(listing),
                Err(error) => format!("the store does not answer: {error}"),
            },
        };
        self.read(query, &why)
    }

    /// What became of an object, oldest first: always from the file, which is where histories are.
    pub fn history(&self, id: u64) -> Result<History, Failure> {
        let entries = history_of(&self.file, id).map_err(|fault| refused(&self.file, &fault))?;
        tell(format_args!("tsense: read from the file {}", self.file.display()));
        if entries.is_empty() {
            let why = "it was never given, or its entries were the oldest and made room for others";
            return Err(Failure::new(1, format!("no history of object {id} in {}: {why}", self.file.display())));
        }
        Ok(History { entries, now: self.now })
    }

    fn ask(&self, domain: &Domain, query: &Query) -> Result<Listing, PortError> {
        let mut process = Process::observe(domain, "objects")?;
        let mut client = process.client::<Store>()?;
        let (header, mut objects) = client.ask(&query.to_wire(), ANSWER_S)?;
        let mut truncated = header.truncated == 1;
        if truncated && query.limit > <Store as Service>::ITEMS_MAX {
            (objects, truncated) = pages(&mut client, query)?;
        }
        let origin = format!("asked the store of the running graph {}", domain.name());
        let zone = Zone::from_wire(header.zone, header.south);
        let ObjectsHeader { stored, .. } = header;
        Ok(Listing { objects, truncated, stored, zone, now: process.clock().now(), origin })
    }

    fn read(self, query: &Query, why: &str) -> Result<Listing, Failure> {
        let loaded = read_only(&self.file).map_err(|fault| refused(&self.file, &fault))?;
        for note in &loaded.notes {
            tell(format_args!("tsense: {note}"));
        }
        let store = loaded.into_store(self.config);
        let answer = store.query(query, self.now);
        Ok(Listing {
            objects: answer.objects,
            truncated: answer.truncated,
            stored: store.len() as u64,
            zone: store.zone(),
            now: self.now,
            origin: format!("read from the file {} ({why})", self.file.display()),
        })
    }
}

/// A long answer in pieces, by id; then nearest first where the query has a middle.
fn pages(client: &mut Client<Store>, query: &Query) -> Result<(Vec<Object>, bool), PortError> {
    let (mut objects, mut after_id): (Vec<Object>, u64) = (Vec::new(), 0);
    let truncated = loop {
        let page = Query { after_id: Some(after_id), limit: 0, ..*query };
        let (header, items) = client.ask(&page.to_wire(), ANSWER_S)?;
        objects.extend(&items);
        match items.last() {
            Some(last) if header.truncated == 1 && objects.len() < query.limit => after_id = last.id,
            _ => break header.truncated == 1 || objects.len() > query.limit,
        }
    };
    if let Some([east, north]) = query.middle() {
        let distance_m = |o: &Object| (o.easting_m - east).hypot(o.northing_m - north);
        objects.sort_by(|a, b| distance_m(a).total_cmp(&distance_m(b)).then(a.id.cmp(&b.id)));
    }
    objects.truncate(query.limit);
    Ok((objects, truncated))
}

fn refused(file: &Path, fault: &FileFault) -> Failure {
    if !file.exists() {
        let advice = "a graph makes it with its first detections; say --graph NAME or --store FILE for another";
        return Failure::new(1, format!("{}: there is no store yet; {advice}", file.display()));
    }
    if file.is_dir() {
        return Failure::new(2, format!("{}: a folder; give the store's file in it", file.display()));
    }
    Failure::new(if fault.is_damage() { 6 } else { 1 }, fault)
}

/// Where no graph runs, the store of the graph with the default name is meant; several running ones are a question.
fn default_graph(failure: Failure) -> Result<Domain, Failure> {
    if failure.code == 2 {
        return Err(failure);
    }
    Ok(Domain::new(&crate::config::GraphConfig::default().name)?)
}

fn default_state_dir(name: &str) -> PathBuf {
    crate::config::GraphConfig { name: name.into(), ..Default::default() }.state_dir()
}
