//! Every topic, event and service of a graph, created by the launcher before anybody is started.
//!
//! All of them are offered whatever the configuration leaves out, so that a reader of a process that is not there
//! waits for data and not for a topic. Only scans depend on the configuration: one instance a ladar.

use crate::config::Config;
use tsense_contract::{
    Detections, Grid, Heartbeats, Joints, MAP_KEYFRAME, Map, Objects, Points, Poses, Processes, Scan, Store,
};
use tsense_ports::{Host, PortError};

pub(super) fn everything(host: &mut Host, config: &Config) -> Result<(), PortError> {
    host.offer::<Heartbeats>(None)?;
    host.offer::<Processes>(None)?;
    for ladar in &config.ladars {
        host.offer::<Scan>(Some(&ladar.name))?;
    }
    host.offer::<Joints>(None)?;
    host.offer::<Poses>(None)?;
    host.offer::<Map>(None)?;
    host.offer_event(MAP_KEYFRAME)?;
    host.offer::<Points>(None)?;
    host.offer::<Detections>(None)?;
    host.offer::<Grid>(None)?;
    host.offer::<Objects>(None)?;
    host.offer_requests::<Store>()
}
