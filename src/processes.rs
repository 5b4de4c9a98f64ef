//! A child's way to its stage: from the name on the command line to the stage's `run`.

use crate::config::Config;
use tsense_drivers::{gpos, lms151, pan_tilt};
use tsense_mapper::LadarMount;
use tsense_ports::Process;

/// Why a stage ended, in its own words.
pub type StageError = Box<dyn std::error::Error>;

/// Runs the process with this name until it is asked to stop.
pub fn run(process: Process, config: &Config) -> Result<(), StageError> {
    let name = process.name().to_owned();
    if let Some(ladar) = config.ladars.iter().find(|ladar| ladar.name == name) {
        return Ok(lms151::process::run(process, ladar)?);
    }
    match (name.as_str(), config) {
        ("pan-tilt", Config { pan_tilt: Some(section), .. }) => Ok(pan_tilt::process::run(process, section)?),
        ("gpos", Config { gpos: Some(section), .. }) => Ok(gpos::process::run(process, section)?),
        ("mapper", Config { mapper: Some(section), .. }) => {
            Ok(tsense_mapper::process::run(process, section, ladar_mounts(config))?)
        }
        ("classifier", Config { classifier: Some(section), .. }) => {
            Ok(tsense_classifier::process::run(process, section)?)
        }
        ("kstore", Config { kstore: Some(section), .. }) => Ok(tsense_kstore::run(process, section)?),
        ("bridge", Config { bridge: Some(section), .. }) => Ok(tsense_bridge::process::run(process, section)?),
        _ => {
            Err(format!("`{name}` is not in the configuration; there are {}", config.process_names().join(", ")).into())
        }
    }
}

/// What the mapper must know of each `[[ladar]]`. Without a pan-tilt unit the heads are fixed at pan 0, tilt 0.
fn ladar_mounts(config: &Config) -> Vec<LadarMount> {
    let base = config.pan_tilt.as_ref().map(|section| section.mount);
    let mount = |ladar: &lms151::config::Config| LadarMount {
        name: ladar.name.clone(),
        on_pan_tilt: base.is_some(),
        vehicle_from_base: base.unwrap_or_default(),
        tilt_from_ladar: ladar.tilt_from_ladar,
        range_min_m: ladar.range_min_m,
        range_max_m: ladar.range_max_m,
        no_return_range_m: ladar.no_return_range_m,
        weight: ladar.weight,
    };
    config.ladars.iter().map(mount).collect()
}
