//! The outside world of the Terrain Smart Sensor: a scene with its truth, a vehicle that drives through it, and
//! devices that speak their real wire protocols (LMS-151 over TCP, pan-tilt over a pty, NMEA over TCP).
//!
//! Nothing in the system knows that this crate exists; it knows nothing of the system but `geometry`'s frames.

mod cast;
mod clock;
mod faults;
mod gpos;
mod hazards;
mod lms151;
mod matching;
mod net;
mod pan_tilt;
mod path;
mod rays;
mod rng;
mod scene;
mod score;
mod thing_score;
mod trace;
mod vehicle;
mod view;
mod world;

pub use cast::{BeamReturn, Code, Echo, Optics};
pub use clock::WorldClock;
pub use faults::Faults;
pub use gpos::{Geodetic, GposOptions, PoseErrors, Quality, geodetic_of_utm};
pub use hazards::{HazardCell, HazardScore, Share, score_hazards};
pub use lms151::{Lms151Options, ScanShape};
pub use matching::matching;
pub use pan_tilt::{Axis, Dynamics, Head, PanTiltOptions};
pub use path::{Path, Place, Way};
pub use rays::{RayCase, RayCounts, RayOptions, nod_turns_s, ray_cloud};
pub use rng::Rng;
pub use scene::{
    BREAST_HEIGHT_M, Cone, Ditch, Ellipsoid, Figure, HALF_EXTENT_M, Meeting, NODE_M, ORIGIN_M, PERSON_HEIGHT_M,
    PERSON_RADIUS_M, Person, Porous, Ray, Rock, Scene, SceneName, Slab, Terrain, TerrainSpec, Tree, TreeSpec, TrueDrop,
    TrueRock, TrueTree, TrueWall, Wall, ZONE,
};
pub use score::{
    BRUSH_MAX_M, BRUSH_MIN_M, BrushScore, HeightScore, MATCH_M, ReportedTree, Sight, TreeScore, score_brush,
    score_ground, score_trees,
};
pub use thing_score::{KindScore, ReportedThing, ThingKind, ThingScore, score_things};
pub use trace::{Hit, Kind};
pub use vehicle::{Motion, Rig, Vehicle, VehicleOptions};
pub use world::{Addresses, Counts, World, WorldError, WorldOptions};
