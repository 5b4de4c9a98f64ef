//! What the processes of the Terrain Smart Sensor say to each other: plain data, and the topics that carry it.
//!
//! This crate never imports the shared-memory middleware or a serialiser; `ports` carries these types, `bridge`
//! translates them. The golden file `layout.txt` beside the manifest records every size, offset and field name.

mod delta;
mod fault;
mod fleet;
mod health;
mod map;
mod message;
mod motion;
mod none;
mod perception;
mod scan;
mod snapshot;
#[cfg(test)]
mod snapshot_tests;
mod topic;
mod voxels;

pub use delta::*;
pub use fault::{Checks, Fault};
pub use fleet::*;
pub use health::*;
pub use map::*;
pub use message::{Field, Message, Text};
pub use motion::*;
pub use none::Nothing;
pub use perception::*;
pub use scan::*;
pub use snapshot::*;
pub use topic::{Qos, Service, Topic};
pub use voxels::*;

/// The layout of all messages, a line a field: `type size`, then indented `offset name: kind`.
pub fn layout() -> String {
    fn describe<M: Message>(out: &mut String) {
        out.push_str(&format!("{} {}\n", M::TYPE_NAME, size_of::<M>()));
        for field in M::FIELDS {
            out.push_str(&format!("  {:4} {}: {}\n", field.offset, field.name, field.kind));
        }
    }
    let mut out = String::new();
    describe::<Return>(&mut out);
    describe::<ScanHeader>(&mut out);
    describe::<Pose>(&mut out);
    describe::<Joint>(&mut out);
    describe::<Nothing>(&mut out);
    describe::<Brick>(&mut out);
    describe::<MapHeader>(&mut out);
    describe::<CommitEntry>(&mut out);
    describe::<DeltaEntry>(&mut out);
    describe::<VoxelsHeader>(&mut out);
    describe::<SensedVoxel>(&mut out);
    describe::<PointsHeader>(&mut out);
    describe::<PlacedReturn>(&mut out);
    describe::<DetectionsHeader>(&mut out);
    describe::<Detection>(&mut out);
    describe::<GridHeader>(&mut out);
    describe::<GridCell>(&mut out);
    describe::<ObjectsHeader>(&mut out);
    describe::<Object>(&mut out);
    describe::<StoreQuery>(&mut out);
    describe::<DropCount>(&mut out);
    describe::<Heartbeat>(&mut out);
    describe::<ProcessStatus>(&mut out);
    describe::<ProcessesHeader>(&mut out);
    describe::<FleetNews>(&mut out);
    describe::<FleetAsk>(&mut out);
    describe::<FleetPage>(&mut out);
    describe::<FleetObject>(&mut out);
    describe::<FleetBlock>(&mut out);
    describe::<FleetBlockAsk>(&mut out);
    describe::<FleetBlockFile>(&mut out);
    out
}

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "the golden layout is a file")]
mod tests {
    /// Golden: run with `TSENSE_BLESS=1` after bumping the version of every message you changed.
    #[test]
    fn the_layout_is_the_golden_one() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/layout.txt");
        let now = super::layout();
        if std::env::var_os("TSENSE_BLESS").is_some() {
            std::fs::write(path, &now).unwrap();
        }
        assert_eq!(std::fs::read_to_string(path).unwrap(), now, "a message changed: bump its version and bless");
    }
}
