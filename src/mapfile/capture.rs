//! The map of a running graph: one complete snapshot of topic `map`.
//!
//! In: a graph. Out: the header and blocks of a map file. It asks for a keyframe, as every reader that joins does, and
//! copies the blocks out of shared memory; the graph does not wait for it.

use crate::commands::Failure;
use tsense_contract::{BLOCKS_MAX, KeyframeRequests, MAP_KEYFRAME, Map, Snapshot, SnapshotAssembler, Taken};
use tsense_geometry::Timestamp;
use tsense_mapper::tsmap::{MapFileHeader, StoredBlock};
use tsense_ports::{Domain, Process, Sample, machine_seconds};

/// Longest wait for samples between two looks at the clock, graph seconds.
const LOOK_S: f64 = 0.1;

/// Takes the newest complete snapshot, within `patience_s` seconds of the machine.
pub fn capture(domain: &Domain, patience_s: f64) -> Result<(MapFileHeader, Vec<StoredBlock>), Failure> {
    let mut process = Process::observe(domain, "map")?;
    let mut map = process.inbox::<Map>(None)?;
    let keyframe = process.event_sender(MAP_KEYFRAME)?;
    let mut requests = KeyframeRequests::default();
    let mut assembler: SnapshotAssembler<Sample<Map>> = SnapshotAssembler::new(BLOCKS_MAX);
    let until_s = machine_seconds() + patience_s;
    while machine_seconds() < until_s {
        process.wait(LOOK_S);
        while let Some(sample) = map.take()? {
            let header = *sample.header();
            // At once: the next sample would end this snapshot.
            if assembler.take(&header, sample) == Taken::Complete
                && let Some(snapshot) = assembler.complete()
            {
                return Ok(copy(&snapshot));
            }
        }
        if requests.due(assembler.keyframe_needed(), process.clock().now()) {
            // A mapper that restarts just now is asked again.
            let _ = keyframe.notify();
        }
    }
    let why = "no complete snapshot of the map came; `tsense status` says whether the mapper has data";
    Err(Failure::new(1, format!("graph {}: within {patience_s} s {why}", domain.name())))
}

fn copy(snapshot: &Snapshot<'_, Sample<Map>>) -> (MapFileHeader, Vec<StoredBlock>) {
    let header = &snapshot.header;
    let stamp = Timestamp::from_ns(header.stamp_ns);
    let file = MapFileHeader::in_zone(header.voxel_size_m, stamp, header.pose.zone, header.pose.south == 1);
    let blocks = snapshot.blocks().map(|(key, bricks)| StoredBlock { stamp, ..StoredBlock::of(key, bricks, &[]) });
    (file, blocks.filter(|block| !block.is_empty()).collect())
}
