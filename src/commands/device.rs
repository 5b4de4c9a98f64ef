//! `tsense device`: one device alone, without a graph: its scans, or what it says of itself.
//!
//! In: a kind of device and an address. Out: scans or a description on standard output, as lines or as JSON. It never
//! changes how a device measures or moves. Exit code 4 where the device does not answer.

use super::{Failure, Outcome, print};
use clap::{Args as ClapArgs, Subcommand, ValueEnum};
use serde::Serialize;
use std::fmt::Display;
use std::io::Write;
use tsense_drivers::lms151::config::DialectChoice;
use tsense_drivers::lms151::shell::device::{self as lms151, ScanRecord};

/// Exit code where a device does not answer.
const NO_DEVICE: u8 = 4;

/// One device alone: its scans, or what it says of itself.
#[derive(Debug, ClapArgs)]
#[command(before_help = "Example: tsense device probe lms151 192.168.0.1:2111")]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    Scan(ScanArgs),
    Probe(ProbeArgs),
}

/// Print scans of a ladar, a line each.
#[derive(Debug, ClapArgs)]
#[command(before_help = "Example: tsense device scan lms151 192.168.0.1:2111 --scans 10 --json")]
struct ScanArgs {
    /// Kind of device
    device: Ladar,
    /// Host and port
    #[arg(value_name = "HOST:PORT")]
    address: String,
    /// How many scans
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    scans: u64,
    /// What the port speaks: found out, text or binary
    #[arg(long, value_enum, default_value_t = Dialect::Auto)]
    dialect: Dialect,
    /// A JSON object a line
    #[arg(long)]
    json: bool,
}

/// Say what answers at an address: identity, firmware, state.
#[derive(Debug, ClapArgs)]
#[command(before_help = "Example: tsense device probe lms151 192.168.0.1:2111")]
struct ProbeArgs {
    /// Kind of device
    device: Device,
    /// Host and port; for pan-tilt and gpos also a serial line
    #[arg(value_name = "ADDRESS")]
    address: String,
    /// For the lms151, what the port speaks: found out, text or binary
    #[arg(long, value_enum, default_value_t = Dialect::Auto)]
    dialect: Dialect,
    /// For a serial line, its rate; without it the usual ones are tried
    #[arg(long, value_name = "BITS/S")]
    baud: Option<u32>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Ladar {
    Lms151,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Device {
    Lms151,
    PanTilt,
    Gpos,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Dialect {
    Auto,
    A,
    B,
}

impl From<Dialect> for DialectChoice {
    fn from(dialect: Dialect) -> Self {
        match dialect {
            Dialect::Auto => Self::Auto,
            Dialect::A => Self::A,
            Dialect::B => Self::B,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    match &args.action {
        Action::Scan(args) => scans(args),
        Action::Probe(args) => probe_device(args),
    }
}

fn scans(args: &ScanArgs) -> Outcome {
    let Ladar::Lms151 = args.device;
    let mut out = std::io::stdout().lock();
    let print = |record: &ScanRecord| {
        let line = if args.json { json(record) } else { summary(record) };
        // A closed pipe ends the reading: nobody looks any more.
        writeln!(out, "{line}").and_then(|()| out.flush()).is_ok()
    };
    lms151::scan(&args.address, args.dialect.into(), args.scans, print).map_err(|e| Failure::new(NO_DEVICE, e))?;
    Ok(0)
}

fn json(record: &impl Serialize) -> String {
    serde_json::to_string(record).unwrap_or_else(|e| format!("{{\"error\":\"{e}\"}}"))
}

/// A scan on one line: values below 16 are codes and no distances.
fn summary(record: &ScanRecord) -> String {
    let distances = || record.distances_mm.iter().filter(|d| **d >= 16);
    let metres = |mm: Option<&u32>| mm.map_or("-".into(), |mm| format!("{:.3} m", f64::from(*mm) / 1e3));
    let beams = record.distances_mm.len();
    let end_deg = record.start_deg + record.step_deg * beams.saturating_sub(1) as f64;
    format!(
        "telegram {} scan {}: {beams} beams from {} to {end_deg} degrees, {} with a distance, nearest {}, farthest {}",
        record.telegram_counter,
        record.scan_counter,
        record.start_deg,
        distances().count(),
        metres(distances().min()),
        metres(distances().max()),
    )
}

fn probe_device(args: &ProbeArgs) -> Outcome {
    match args.device {
        Device::Lms151 => show(lms151::probe(&args.address, args.dialect.into()), args.json),
        Device::PanTilt => show(tsense_drivers::pan_tilt::probe(&line(&args.address), args.baud), args.json),
        Device::Gpos => show(tsense_drivers::gpos::probe(&line(&args.address), args.baud), args.json),
    }
}

/// The drivers of serial devices tell a socket by `tcp:`; people write HOST:PORT.
fn line(address: &str) -> String {
    let is_port = |(host, port): (&str, &str)| !host.contains('/') && port.parse::<u16>().is_ok();
    let is_socket = !address.starts_with("tcp:") && address.rsplit_once(':').is_some_and(is_port);
    if is_socket { format!("tcp:{address}") } else { address.into() }
}

/// What was found, as JSON or for people.
fn show<R: Serialize + Display, E: Display>(found: Result<R, E>, as_json: bool) -> Outcome {
    let report = found.map_err(|e| Failure::new(NO_DEVICE, e))?;
    let text = if as_json { json(&report) } else { report.to_string() };
    print(&(text + "\n"))
}
