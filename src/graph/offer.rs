//! Every topic, event and service of a graph, created by the launcher before anybody is started.
//!
//! All of them are offered whatever the configuration leaves out, so that a reader of a process that is not there
//! waits for data and not for a topic. Only scans and other sensors' voxels depend on the configuration: one instance each.

use crate::config::Config;
use tsense_contract::{
    Detections, Grid, Heartbeats, Joints, MAP_KEYFRAME, Map, Objects, Points, Poses, Processes, Scan, Store, Voxels,
};
use tsense_ports::{Host, Most, PortError};

pub(super) fn everything(host: &mut Host, config: &Config) -> Result<(), PortError> {
    host.offer::<Heartbeats>(None)?;
    host.offer::<Processes>(None)?;
    for ladar in &config.ladars {
        host.offer::<Scan>(Some(&ladar.name))?;
    }
    for sensor in config.mapper.iter().flat_map(|mapper| &mapper.voxel_sensor) {
        host.offer::<Voxels>(Some(&sensor.name))?;
    }
    host.offer::<Joints>(None)?;
    host.offer::<Poses>(None)?;
    host.offer_most::<Map>(None, map_most(config))?;
    host.offer_event(MAP_KEYFRAME)?;
    host.offer::<Points>(None)?;
    host.offer::<Detections>(None)?;
    host.offer_most::<Grid>(None, grid_most(config))?;
    host.offer::<Objects>(None)?;
    host.offer_requests::<Store>()
}

/// As the topic's own bounds, of the blocks that the working space can have: every block and two samples more in the
/// buffer, every block and one sample held, and two on loan.
fn map_most(config: &Config) -> Most {
    let blocks = config.mapper.as_ref().and_then(|mapper| mapper.blocks_max());
    blocks.map_or(Most::ALL, |blocks| Most { samples: 2 * blocks + 5, ..Most::ALL })
}

fn grid_most(config: &Config) -> Most {
    Most { items: config.grid_cells_max().unwrap_or(usize::MAX), ..Most::ALL }
}
