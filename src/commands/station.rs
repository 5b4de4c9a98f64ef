//! `tsense station`: a control station. The objects of several vehicles in one store, their blocks in a folder.
//!
//! In: what vehicles with `[bridge.fleet]` tell over Zenoh. Out: a GeoPackage, block files, and a table of the vehicles on
//! standard output now and then. A disk that fails is said, and tried again; what was not written is asked for again.

use super::words::seconds;
use super::{Failure, Outcome, print, tell};
use crate::mapfile;
use clap::Args;
use serde_json::json;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;
use tsense_bridge::fleet::link::{Event, StationLink};
use tsense_contract::VehicleName;
use tsense_kstore::persist::FileFault;
use tsense_kstore::station::{Forgotten, Options, Station, VehicleReport};
use tsense_ports::logging::{self, LogFormat};
use tsense_ports::{Clock, machine_seconds, signals};

const EXAMPLE: &str = "Example:\n  tsense station --listen 127.0.0.1:7447 --store fleet.gpkg --blocks fleet-blocks\n  \
tsense objects --store fleet.gpkg --class tree";

/// Merge what several vehicles know: a control station.
#[derive(Debug, Args)]
#[command(
    before_help = EXAMPLE,
    after_help = "Needs a tsense built with --features fleet. A vehicle reports with `[bridge.fleet] enabled = true`. QGIS \
        opens the store while it is written; its table `sources` says which vehicle saw what. Nobody is asked for a \
        password: listen on another address than loopback only within a network that you trust (docs/fleet.md)."
)]
pub struct StationArgs {
    /// Address and port to listen on; may be repeated.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:7447")]
    pub listen: Vec<SocketAddr>,
    /// The store, a GeoPackage; made where there is none.
    #[arg(long, value_name = "FILE", default_value = "fleet.gpkg")]
    pub store: PathBuf,
    /// Also gather blocks of the vehicles' maps in this folder.
    #[arg(long, value_name = "DIR")]
    pub blocks: Option<PathBuf>,
    /// Blocks take no more of the disk than this, megabytes.
    #[arg(long, value_name = "MB", default_value_t = 10_000)]
    pub blocks_max_mb: u64,
    /// The store takes no more of the disk than this, megabytes.
    #[arg(long, value_name = "MB", default_value_t = 4_000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub store_max_mb: u32,
    /// Listen to this vehicle only; may be repeated.
    #[arg(long, value_name = "NAME", value_parser = vehicle)]
    pub vehicle: Vec<VehicleName>,
    /// Take away what this vehicle reported, and its files below `--blocks`, then end; may be repeated.
    #[arg(long, value_name = "NAME", value_parser = vehicle)]
    pub forget: Vec<VehicleName>,
    /// Most vehicles.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub vehicles_max: u16,
    /// Time between two tables (s, m or h).
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = seconds)]
    pub report: f64,
    /// End by itself after this time (s, m or h).
    #[arg(long = "for", value_name = "TIME", value_parser = seconds)]
    pub duration_s: Option<f64>,
    /// Print each table as a line of JSON.
    #[arg(long)]
    pub json: bool,
    /// Say nothing but what is wrong.
    #[arg(long, short)]
    pub quiet: bool,
}

fn vehicle(text: &str) -> Result<VehicleName, String> {
    VehicleName::new(text).ok_or_else(|| format!("a name is {}", VehicleName::ALLOWED))
}

/// Answers and news that wait, at most: while the disk is slow questions stop, so few come.
const EVENTS_MAX: usize = 256;
/// Longest wait between two looks at what is to be asked.
const LOOK: Duration = Duration::from_millis(50);
/// Time between two attempts to open a store that failed, seconds.
const RETRY_S: f64 = 5.0;

/// Runs the command.
pub fn run(args: &StationArgs) -> Outcome {
    logging::start("station", "warn", LogFormat::Human);
    if !cfg!(feature = "fleet") && args.forget.is_empty() {
        return Err(Failure::new(1, "this tsense has no link to vehicles; build it with --features fleet"));
    }
    signals::install()?;
    let station = Station::open(options(args));
    let (station, notes) = station.map_err(|fault| Failure::new(if fault.is_damage() { 6 } else { 1 }, fault))?;
    notes.iter().for_each(|note| tell(format_args!("tsense: {note}")));
    if !args.forget.is_empty() {
        return forget(station, args);
    }
    let (to, events) = sync_channel(EVENTS_MAX);
    let listen: Vec<String> = args.listen.iter().map(SocketAddr::to_string).collect();
    let link = StationLink::open(&listen, usize::from(args.vehicles_max), to)
        .map_err(|e| Failure::new(1, format!("cannot listen on {}: {e}", listen.join(", "))))?;
    if !args.quiet {
        let (listen, store, objects) = (listen.join(", "), station.path().display(), station.fleet().len());
        tell(format_args!("tsense: station on {listen}, store {store} with {objects} objects"));
    }
    if args.listen.iter().any(|address| !address.ip().is_loopback()) {
        tell("tsense: whoever reaches that address may report objects: there is no password");
    }
    let mut desk = Desk { args, link, clock: Clock::start(1.0), station: Some(station), retry_s: 0.0 };
    let outcome = desk.work(&events);
    if let Some(station) = desk.station {
        station.close().map_err(|fault| Failure::new(1, fault))?;
    }
    outcome
}

/// Forgets vehicles, without listening to any.
fn forget(mut station: Station, args: &StationArgs) -> Outcome {
    let mut lines = Vec::new();
    for name in &args.forget {
        let forgotten = station.forget(name).map_err(|fault| Failure::new(1, fault))?;
        let store = station.path().display();
        let Some(Forgotten { objects, blocks }) = forgotten else {
            return Err(Failure::new(1, format!("{store}: no vehicle {name}; its table `vehicles` lists all")));
        };
        lines.push(match args.json {
            true => json!({ "vehicle": name.as_str(), "objects": objects, "blocks": blocks }).to_string(),
            false => format!("{name}: forgotten, with {objects} objects and {blocks} blocks"),
        });
    }
    station.close().map_err(|fault| Failure::new(1, fault))?;
    print(&(lines.join("\n") + "\n"))
}

fn options(args: &StationArgs) -> Options {
    Options {
        store: args.store.clone(),
        blocks: args.blocks.clone(),
        blocks_max_bytes: args.blocks_max_mb.saturating_mul(1_000_000),
        store_max_mb: args.store_max_mb,
        vehicles: args.vehicle.clone(),
        vehicles_max: usize::from(args.vehicles_max),
        check_block: mapfile::block::check,
    }
}

/// The running station.
struct Desk<'a> {
    args: &'a StationArgs,
    link: StationLink,
    clock: Clock,
    /// None while its disk fails.
    station: Option<Station>,
    retry_s: f64,
}

impl Desk<'_> {
    fn work(&mut self, events: &Receiver<Event>) -> Outcome {
        let start_s = machine_seconds();
        let mut next_report_s = start_s + self.args.report;
        loop {
            match events.recv_timeout(LOOK) {
                Ok(event) => self.take(event),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(Failure::new(1, "the link is gone")),
            }
            while let Ok(event) = events.try_recv() {
                self.take(event);
            }
            self.ask();
            let now_s = machine_seconds();
            let is_over = self.args.duration_s.is_some_and(|duration_s| now_s - start_s >= duration_s);
            let asked = signals::requested();
            if now_s >= next_report_s || is_over || asked.is_some() {
                next_report_s = now_s + self.args.report;
                self.report()?;
            }
            match asked {
                Some(signal) => return Ok(crate::graph::Asked::from(signal).exit_code()),
                None if is_over => return Ok(0),
                None => {}
            }
        }
    }

    fn take(&mut self, event: Event) {
        let now = self.clock.now();
        let Some(station) = &mut self.station else { return };
        let taken = match event {
            Event::News(vehicle, bytes) => {
                station.hear(&vehicle, &bytes, now);
                Ok(())
            }
            Event::Answer(vehicle, bytes) => station.take(&vehicle, &bytes, now),
        };
        if let Err(fault) = taken {
            self.failed(&fault);
        }
    }

    /// What is in memory may be ahead of the disk: it is dropped, and the file is opened anew.
    fn failed(&mut self, fault: &FileFault) {
        tell(format_args!("tsense: {fault}; trying again every {RETRY_S} s"));
        self.station = None;
        self.retry_s = machine_seconds() + RETRY_S;
    }

    fn ask(&mut self) {
        if self.station.is_none() && machine_seconds() >= self.retry_s {
            match Station::open(options(self.args)) {
                Ok((station, _)) => self.station = Some(station),
                Err(fault) => self.failed(&fault),
            }
        }
        let now = self.clock.now();
        for (vehicle, question) in self.station.iter_mut().flat_map(|station| station.questions(now)) {
            self.link.ask(&vehicle, question);
        }
    }

    fn report(&self) -> Outcome {
        let Some(station) = &self.station else { return Ok(0) };
        let vehicles = station.report(self.clock.now());
        if self.args.json {
            let (blocks, block_bytes) = station.block_usage();
            let line = json!({
                "objects": station.fleet().len(),
                "blocks": blocks,
                "block_bytes": block_bytes,
                "strangers": station.strangers(),
                "lost": self.link.lost(),
                "full": station.is_full(),
                "vehicles": vehicles,
            });
            return print(&format!("{line}\n"));
        }
        print(&table(station, &vehicles, self.link.lost()))
    }
}

/// Columns for people; the drops come last because they are the longest.
fn table(station: &Station, vehicles: &[VehicleReport], lost: u64) -> String {
    let (blocks, block_bytes) = station.block_usage();
    let mut text = format!("{} objects, {blocks} blocks ({:.1} MB)", station.fleet().len(), block_bytes as f64 / 1e6);
    let said = [(station.strangers(), "messages of strangers"), (lost, "messages lost: the disk is too slow")];
    for (count, words) in said.into_iter().filter(|(count, _)| *count > 0) {
        text += &format!(", {count} {words}");
    }
    text += if station.is_full() { ", THE STORE IS FULL\n" } else { "\n" };
    text += &format!(
        "{:32}  {:4}  {:>8}  {:>10}  {:>6}  {:>7}  {:>8}  dropped\n",
        "vehicle", "link", "objects", "cursor", "lag", "wanted", "MB"
    );
    for v in vehicles {
        let link = if v.connected { "up" } else { "away" };
        let lag = v.lag.map_or_else(|| "-".into(), |lag| lag.to_string());
        let dropped: Vec<String> = v.dropped.iter().map(|(cause, count)| format!("{count} {cause}")).collect();
        let (name, megabytes) = (&v.vehicle, v.bytes as f64 / 1e6);
        let row = format!(
            "{name:32}  {link:4}  {:>8}  {:>10}  {lag:>6}  {:>7}  {megabytes:>8.3}  {}",
            v.objects,
            v.cursor,
            v.blocks_wanted,
            dropped.join(", ")
        );
        text += row.trim_end();
        text.push('\n');
    }
    text
}
