//! Topics `detections`, `grid` and `objects`, and the service `store`: what was seen, and what is believed.

use crate::message::{message, wire_enum};
use crate::topic::{Qos, Service, Topic};

wire_enum! {
    /// What a detection or an object is.
    Class, unknown = Unknown {
        /// Not said; in a query: any class.
        Unknown = 0 "unknown",
        /// A tree with a trunk.
        Tree = 1 "tree",
        /// A rock.
        Rock = 2 "rock",
        /// An edge that falls away.
        Drop = 3 "drop",
        /// A wall.
        Wall = 4 "wall",
        /// A patch of brush.
        Brush = 5 "brush",
    }
}

message! {
    /// Which snapshot the detections come from.
    DetectionsHeader = "tsense.detections.v1" {
        /// Instant of the newest beam in the snapshot, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// Instant the classification was done, nanoseconds since the epoch, graph clock.
        classified_ns: i64,
        /// The mapper's epoch.
        epoch: u64,
        /// The snapshot's number.
        snapshot: u64,
        /// Easting, northing of the vehicle, metres.
        vehicle_m: [f64; 2],
        /// UTM zone.
        zone: u8,
        /// 0 north, 1 south.
        south: u8,
        /// Zero.
        reserved: [u8; 6],
    }
}

message! {
    /// One thing seen in one snapshot.
    Detection = "tsense.detection.v2" {
        /// Instant of the newest beam that it rests on, nanoseconds since the epoch, graph clock: earlier than that of the
        /// message where nothing was seen of it since; 0 is that of the message.
        stamp_ns: i64,
        /// UTM easting of the axis at 1.3 m above ground, or of the middle of what is no tree, metres.
        easting_m: f64,
        /// UTM northing of the axis at 1.3 m above ground, or of the middle of what is no tree, metres.
        northing_m: f64,
        /// Ground height there, metres above the ellipsoid.
        ground_m: f64,
        /// One sigma of the position on each horizontal axis, metres.
        position_std_m: f32,
        /// Diameter at 1.3 m above ground; of a rock, a drop, a piece of wall or a patch of brush how far it reaches
        /// across, metres; NaN where not measured.
        dbh_m: f32,
        /// One sigma of the diameter, metres; NaN where not known.
        dbh_std_m: f32,
        /// Height above ground, metres; NaN where not measured.
        height_m: f32,
        /// How sure, 0 to 1, from this snapshot alone.
        confidence: f32,
        /// Share of the circumference that was seen, 0 to 1.
        arc_coverage: f32,
        /// Lean of the axis from vertical, east and north components, radians; 0 where not measured.
        lean_rad: [f32; 2],
        /// A [`Class`].
        class: u8,
        /// Zero.
        reserved: [u8; 7],
    }
}

/// The topic `detections`.
pub struct Detections;

impl Topic for Detections {
    type Header = DetectionsHeader;
    type Item = Detection;
    const NAME: &'static str = "detections";
    const QOS: Qos = Qos { publishers: 1, subscribers: 8, history: 1, buffer: 8, borrow: 4, loans: 2, event: true };
    /// More than stand on a 30 x 30 m space at 1500 stems a hectare, many times over.
    const ITEMS_MAX: usize = 1024;
}

wire_enum! {
    /// How a grid cell's ground height is known.
    GroundEvidence, unknown = Unknown {
        /// It is not.
        Unknown = 0 "unknown",
        /// Ground was seen in this cell.
        Measured = 1 "measured",
        /// Between measured cells.
        Interpolated = 2 "interpolated",
        /// Beyond measured cells.
        Extrapolated = 3 "extrapolated",
        /// From the attitude of the vehicle that stands on it (2-11).
        VehiclePlane = 4 "vehicle plane",
    }
}

wire_enum! {
    /// What stands on a grid cell.
    CellClass, unknown = Unknown {
        /// Not known.
        Unknown = 0 "unknown",
        /// Bare ground.
        Ground = 1 "ground",
        /// Vegetation to push through.
        Brush = 2 "brush",
        /// A trunk.
        Tree = 3 "tree",
        /// Something solid that is no trunk.
        Obstacle = 4 "obstacle",
        /// The ground falls away, or was expected and never seen.
        Drop = 5 "drop",
    }
}

wire_enum! {
    /// What decided a cell's cost.
    CostReason, unknown = Unknown {
        /// Nothing is known here.
        Unknown = 0 "unknown",
        /// Nothing speaks against driving here.
        Clear = 1 "clear",
        /// The ground is steep.
        Slope = 2 "slope",
        /// The ground is rough.
        Roughness = 3 "roughness",
        /// The ground has a step.
        Step = 4 "step",
        /// Brush stands here.
        Brush = 5 "brush",
        /// A trunk stands here.
        Tree = 6 "tree",
        /// Something solid stands here.
        Obstacle = 7 "obstacle",
        /// Too little room under what hangs above.
        Clearance = 8 "clearance",
        /// The ground falls away, or was expected and never seen.
        Drop = 9 "drop",
        /// Something that moves was met here a moment ago.
        Moving = 10 "moving",
    }
}

/// Cost of a cell that must not be driven.
pub const COST_LETHAL: u8 = 254;
/// Cost of a cell of which nothing is known.
pub const COST_UNKNOWN: u8 = 255;

message! {
    /// Where the Smart Sensor Grid lies.
    GridHeader = "tsense.grid.v1" {
        /// Instant of the newest beam in the snapshot, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// Instant the classification was done, nanoseconds since the epoch, graph clock.
        classified_ns: i64,
        /// The snapshot's number.
        snapshot: u64,
        /// Edge of a cell, metres.
        cell_m: f64,
        /// Height the cells' ground is relative to, metres above the ellipsoid.
        base_m: f64,
        /// Column and row of cell (0, 0) counted from the UTM origin in cells.
        first_cell: [i32; 2],
        /// Cells along easting.
        width: u32,
        /// Cells along northing.
        height: u32,
        /// UTM zone.
        zone: u8,
        /// 0 north, 1 south.
        south: u8,
        /// Zero.
        reserved: [u8; 6],
    }
}

message! {
    /// One cell of the Smart Sensor Grid; row by row from the south-west.
    GridCell = "tsense.cell.v2" {
        /// Ground height above the header's base, metres; NaN where unknown.
        ground_m: f32,
        /// Height of vegetation that is no trunk, above ground, metres; 0 where none, NaN where it was not seen.
        vegetation_m: f32,
        /// One sigma of the ground's height, millimetres; 65,535 where unknown.
        ground_std_mm: u16,
        /// How dense the vegetation stands: of what is known between its foot and its top, how much is occupied, percent;
        /// 0 where none, 255 where unknown.
        density_pct: u8,
        /// 0 free to 253, [`COST_LETHAL`], [`COST_UNKNOWN`].
        cost: u8,
        /// A [`CostReason`].
        reason: u8,
        /// A [`GroundEvidence`].
        evidence: u8,
        /// A [`CellClass`].
        class: u8,
        /// Zero.
        reserved: u8,
    }
}

impl GridCell {
    /// One sigma of the ground's height, metres; NaN where unknown.
    pub fn ground_std_m(&self) -> f32 {
        if self.ground_std_mm == u16::MAX { f32::NAN } else { f32::from(self.ground_std_mm) / 1e3 }
    }

    /// How dense the vegetation stands, 0 to 1; NaN where unknown.
    pub fn density(&self) -> f32 {
        if self.density_pct == u8::MAX { f32::NAN } else { f32::from(self.density_pct) / 100.0 }
    }
}

/// The topic `grid`.
pub struct Grid;

impl Topic for Grid {
    type Header = GridHeader;
    type Item = GridCell;
    const NAME: &'static str = "grid";
    const QOS: Qos = Qos { publishers: 1, subscribers: 8, history: 1, buffer: 8, borrow: 4, loans: 2, event: true };
    /// 672 x 672 cells: 100 x 100 m at 0.15 m in whole bricks, wherever they lie.
    const ITEMS_MAX: usize = 672 * 672;
}

message! {
    /// State of the knowledge store when the objects were published.
    ObjectsHeader = "tsense.objects.v2" {
        /// Instant of the newest detection merged, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// Objects in the store, reported or not.
        stored: u64,
        /// Easting, northing of the vehicle as its pose said at that instant, metres.
        vehicle_m: [f64; 2],
        /// What the store adds to that place to stand where the stored trees say, easting and northing, metres.
        offset_m: [f64; 2],
        /// Turn about the vehicle, counter-clockwise seen from above, that goes with the offset, radians.
        turn_rad: f64,
        /// 0 the answer is complete, 1 it was cut at the limit.
        truncated: u8,
        /// UTM zone.
        zone: u8,
        /// 0 north, 1 south.
        south: u8,
        /// 1 where stored trees confirm the offset, 0 where too few are in sight to say.
        registered: u8,
        /// Zero.
        reserved: [u8; 4],
    }
}

message! {
    /// One thing the knowledge store believes in.
    Object = "tsense.object.v1" {
        /// Stays the same for the life of the store.
        id: u64,
        /// First sighting, nanoseconds since the epoch.
        first_seen_ns: i64,
        /// Newest sighting, nanoseconds since the epoch.
        last_seen_ns: i64,
        /// UTM easting, metres.
        easting_m: f64,
        /// UTM northing, metres.
        northing_m: f64,
        /// Ground height there, metres above the ellipsoid.
        ground_m: f64,
        /// One sigma of the position on each horizontal axis, metres.
        position_std_m: f32,
        /// Diameter at 1.3 m, or how far what is no tree reaches across, metres; NaN where not measured.
        dbh_m: f32,
        /// One sigma of the diameter, metres; NaN where not known.
        dbh_std_m: f32,
        /// Height above ground, metres; NaN where not measured.
        height_m: f32,
        /// Summed confidence, decayed to now; reported above the store's threshold.
        confidence: f32,
        /// Detections merged into it.
        sightings: u32,
        /// A [`Class`].
        class: u8,
        /// 1 where confidence is above the report threshold.
        reported: u8,
        /// Zero.
        reserved: [u8; 6],
    }
}

/// The topic `objects`: every reported object near the vehicle, placed as the vehicle's pose says now (the header's
/// offset is taken off), so that it lies on the grid and the map of the same moment. Ids are those of the store.
pub struct Objects;

impl Topic for Objects {
    type Header = ObjectsHeader;
    type Item = Object;
    const NAME: &'static str = "objects";
    const QOS: Qos = Qos { publishers: 1, subscribers: 8, history: 1, buffer: 8, borrow: 4, loans: 2, event: true };
    const ITEMS_MAX: usize = 4096;
}

message! {
    /// Which objects a client wants.
    StoreQuery = "tsense.query.v2" {
        /// Smallest easting, northing, metres.
        min_m: [f64; 2],
        /// Largest easting, northing, metres.
        max_m: [f64; 2],
        /// Middle of a circle, easting and northing, metres; no meaning without a radius.
        near_m: [f64; 2],
        /// Only within this distance of the middle, metres; 0 asks for the whole area.
        radius_m: f64,
        /// By id: only ids above this one, so that a long answer comes in pieces.
        after_id: u64,
        /// Least confidence.
        confidence_min: f32,
        /// A [`Class`]; unknown asks for all.
        class: u8,
        /// 1 asks for unreported objects too.
        unreported: u8,
        /// Most objects in the answer; 0 asks for as many as fit.
        limit: u16,
        /// 0 nearest to the middle of the circle, or of the area, first; 1 by id.
        by_id: u8,
        /// Zero.
        reserved: [u8; 7],
    }
}

impl StoreQuery {
    /// Every reported object, wherever it stands, as many as fit.
    pub fn everything() -> Self {
        let (min_m, max_m) = ([f64::NEG_INFINITY; 2], [f64::INFINITY; 2]);
        Self { min_m, max_m, ..bytemuck::Zeroable::zeroed() }
    }
}

/// The request-response service `store`, served by the knowledge store: places as they are stored.
pub struct Store;

impl Service for Store {
    type Request = StoreQuery;
    type Header = ObjectsHeader;
    type Item = Object;
    const NAME: &'static str = "store";
    const ITEMS_MAX: usize = 4096;
    const CLIENTS: usize = 4;
}
