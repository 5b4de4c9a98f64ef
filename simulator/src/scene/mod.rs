//! The outside world: a scene from a name and a seed, and the truth about it.
//!
//! Out: casts of rays and beams, and the true ground, trees, brush and drops, in UTM. Inside, places are metres
//! from the scene's origin (x east, y north, z up); [`Scene::to_global`] and [`Scene::to_local`] go between.
//! The same name and seed give the same scene on every run. A scene does not change; only a person moves.

mod column;
mod layout;
mod name;
mod shapes;
mod terrain;
mod things;
mod truth;

pub use name::{DRIVE_M_S, SceneName};
pub use shapes::{Cone, Ellipsoid, Meeting, Ray, Slab};
pub use terrain::{Ditch, HALF_EXTENT_M, NODE_M, Terrain, TerrainSpec};
pub use things::{
    BREAST_HEIGHT_M, Figure, PERSON_HEIGHT_M, PERSON_RADIUS_M, Person, Porous, Rock, Tree, TreeSpec, Wall,
};
pub use truth::{TrueDrop, TrueRock, TrueTree, TrueWall};

pub(crate) use column::{Columns, Item};

use nalgebra::Vector3;
use tsense_geometry::{Global, Point};

/// UTM easting, northing and ellipsoidal height of every scene's origin, metres.
pub const ORIGIN_M: [f64; 3] = [369_000.0, 3_279_000.0, 40.0];
/// UTM zone of every scene; northern hemisphere.
pub const ZONE: u8 = 17;

/// A piece of the outside world.
#[derive(Clone, Debug)]
pub struct Scene {
    name: SceneName,
    seed: u64,
    ditch: Option<Ditch>,
    person: Option<Person>,
    pub(crate) terrain: Terrain,
    pub(crate) trees: Vec<Tree>,
    pub(crate) bushes: Vec<Porous>,
    pub(crate) rocks: Vec<Rock>,
    pub(crate) walls: Vec<Wall>,
    pub(crate) columns: Columns,
}

impl Scene {
    /// The scene of this name that grows from this seed.
    pub fn new(name: SceneName, seed: u64) -> Self {
        let layout::Furniture { terrain, ditch, trees, bushes, rocks, walls, person } = layout::furnish(name, seed);
        let mut scene =
            Self { name, seed, ditch, person, terrain, trees, bushes, rocks, walls, columns: Columns::default() };
        scene.columns = Columns::new(&scene);
        scene
    }

    /// A scene of hand-placed things, for tests.
    pub fn from_parts(
        terrain: Terrain,
        trees: Vec<Tree>,
        bushes: Vec<Porous>,
        rocks: Vec<Rock>,
        walls: Vec<Wall>,
    ) -> Self {
        let mut scene = Self {
            name: SceneName::Flat,
            seed: 0,
            ditch: None,
            person: None,
            terrain,
            trees,
            bushes,
            rocks,
            walls,
            columns: Columns::default(),
        };
        scene.columns = Columns::new(&scene);
        scene
    }

    /// The scene with this person in it, or with nobody.
    pub fn with_person(mut self, person: Option<Person>) -> Self {
        self.person = person;
        self
    }

    /// Its name.
    pub fn name(&self) -> SceneName {
        self.name
    }

    /// The seed it grew from.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Whoever walks in it.
    pub fn person(&self) -> Option<Person> {
        self.person
    }

    /// The ditch, where there is one.
    pub fn ditch(&self) -> Option<Ditch> {
        self.ditch
    }

    /// The person as a figure at an instant, seconds of world time after the start.
    pub fn figure(&self, world_s: f64) -> Option<Figure> {
        let [x, y] = self.person?.at_m(world_s)?;
        Some(Figure::new(Vector3::new(x, y, self.terrain.ground_m(x, y))))
    }

    /// A place of the scene in UTM.
    pub fn to_global(&self, local: Vector3<f64>) -> Point<Global> {
        Point::new(local.x + ORIGIN_M[0], local.y + ORIGIN_M[1], local.z + ORIGIN_M[2])
    }

    /// A place in UTM in the scene's own metres.
    pub fn to_local(&self, global: Point<Global>) -> Vector3<f64> {
        Vector3::new(global.x() - ORIGIN_M[0], global.y() - ORIGIN_M[1], global.z() - ORIGIN_M[2])
    }
}
