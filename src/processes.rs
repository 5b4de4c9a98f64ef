//! A child's way to its stage: from the name on the command line to the stage's `run`.

use crate::config::Config;
use tsense_contract::ProcessState;
use tsense_ports::{Process, Wake};

/// Why a stage ended, in its own words.
pub type StageError = Box<dyn std::error::Error>;

/// Runs the process with this name until it is asked to stop.
pub fn run(process: Process, config: &Config) -> Result<(), StageError> {
    let name = process.name().to_owned();
    if let Some(ladar) = config.ladars.iter().find(|ladar| ladar.name == name) {
        return Ok(tsense_drivers::lms151::process::run(process, ladar)?);
    }
    match (name.as_str(), config) {
        ("kstore", Config { kstore: Some(section), .. }) => Ok(tsense_kstore::run(process, section)?),
        ("bridge", Config { bridge: Some(section), .. }) => Ok(tsense_bridge::process::run(process, section)?),
        ("pan-tilt" | "gpos" | "mapper" | "classifier", _) => idle(process),
        _ => {
            Err(format!("`{name}` is not in the configuration; there are {}", config.process_names().join(", ")).into())
        }
    }
}

/// Stands in for a stage that is not built in yet.
fn idle(mut process: Process) -> Result<(), StageError> {
    process.health().set(ProcessState::Degraded, "this stage is not built in yet");
    while process.wait(1.0) != Wake::Stop {}
    Ok(())
}
