//! A child's way to its stage: from the name on the command line to the stage's `run`.

use crate::config::Config;
use crate::mapfile;
use tsense_ports::Process;

/// How far processes that speak to the outside stand back, as `nice` counts: about a tenth of the weight of those that sense.
const OUTSIDE_NICENESS: i32 = 10;

/// Why a stage ended, in its own words.
pub type StageError = Box<dyn std::error::Error>;

/// Runs the process with this name until it is asked to stop.
pub fn run(process: Process, config: &Config) -> Result<(), StageError> {
    let name = process.name().to_owned();
    if config.outsides().contains(&name) {
        give_way();
    }
    if let Some(ladar) = config.ladars.iter().find(|ladar| ladar.name == name) {
        return Ok(tsense_drivers::lms151::process::run(process, ladar)?);
    }
    match (name.as_str(), config) {
        ("pan-tilt", Config { pan_tilt: Some(section), .. }) => {
            Ok(tsense_drivers::pan_tilt::process::run(process, section)?)
        }
        ("gpos", Config { gpos: Some(section), .. }) => Ok(tsense_drivers::gpos::process::run(process, section)?),
        ("mapper", Config { mapper: Some(section), .. }) => {
            Ok(tsense_mapper::process::run(process, section, config.ladar_mounts())?)
        }
        ("classifier", Config { classifier: Some(section), .. }) => {
            Ok(tsense_classifier::process::run(process, section)?)
        }
        ("kstore", Config { kstore: Some(section), .. }) => Ok(tsense_kstore::run(process, section)?),
        ("bridge", Config { bridge: Some(section), .. }) if section.enabled => {
            Ok(tsense_bridge::process::run(process, section)?)
        }
        ("jaus", Config { bridge: Some(section), .. }) if section.jaus.enabled => {
            Ok(tsense_bridge::jaus::process::run(process, &section.jaus, &config.jaus_rig())?)
        }
        ("ros2", Config { bridge: Some(section), .. }) if section.ros2.enabled => {
            Ok(tsense_bridge::ros2::process::run(process, &section.ros2, config.ros2_mounts())?)
        }
        ("foxglove", Config { bridge: Some(section), .. }) if section.foxglove.enabled => {
            Ok(tsense_bridge::foxglove::process::run(process, &section.foxglove, &section.ros2, config.ros2_mounts())?)
        }
        ("fleet", Config { bridge: Some(section), .. }) if section.fleet.enabled => {
            Ok(tsense_bridge::fleet::process::run(process, &section.fleet, mapfile::block::encode)?)
        }
        _ => {
            Err(format!("`{name}` is not in the configuration; there are {}", config.process_names().join(", ")).into())
        }
    }
}

/// What planners and pages ask for must not delay what is sensed, where both want the same core.
fn give_way() {
    if let Err(e) = rustix::process::nice(OUTSIDE_NICENESS) {
        tracing::warn!("this process keeps its priority ({e}); under load it may slow the others down");
    }
}
