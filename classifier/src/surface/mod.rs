//! The ground as one smooth surface below all that was seen, found from coarse to fine.
//!
//! In: feet, the lowest thing seen in each column, metres from the raster's south-west corner and above the view's
//! base. Out: the surface's height anywhere, and how surely ground was seen under each node of the finest level. At
//! each level the feet of a tile are judged against the coarser surface: many at one lowest height are ground, scattered
//! ones are cover. Then the surface, a thin plate, bends to them. It knows no slope limit: a plate bends as `bend` says.
//! Source: hierarchic robust interpolation (Kraus and Pfeifer 1998; Pfeifer, Stadler and Briese 2001); the onset is ours.

mod config;
mod deviation;
mod feet;
mod fit;
mod level;
mod shifted;
mod thin_plate;
mod tiles;
mod trend;

pub use config::SurfaceConfig;
pub use feet::{Foot, UP, feet_of_heights, feet_of_returns};
pub use level::{Heights, Level};
pub use shifted::mean_surface as ground_surface;
pub use tiles::Sight;

#[cfg(test)]
mod tests;

use deviation::deviations;
use tiles::{Proof, Tiles};
use tsense_geometry::RasterShape;

/// The ground's surface.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Heights of the finest nodes.
    pub heights: Heights,
    /// How surely the feet of each of their tiles stand on ground.
    pub sight: Vec<Sight>,
    /// One sigma of each, metres.
    pub std_m: Vec<f32>,
}

/// The surface below the feet as one raster of tiles sees it, or nothing where there is no foot.
fn surface_of(feet: &[Foot], shape: RasterShape, config: &SurfaceConfig) -> Option<Surface> {
    let levels = Level::coarse_to_fine(shape, config);
    let mut heights = fit::plane(feet, *levels.first().filter(|_| !feet.is_empty())?);
    let mut proof: Option<Proof> = None;
    let (mut sight, mut own_std_m) = (Vec::new(), Vec::new());
    for level in levels {
        heights = heights.on(level);
        let tiles = Tiles::of(feet, &heights, proof.as_ref().filter(|_| level.is_fine()), config);
        fit::fit(&mut heights, &tiles, config);
        proof = Proof::of(level, &tiles).or(proof);
        (sight, own_std_m) = (tiles.sight, tiles.std_m);
    }
    let std_m = deviations(&heights, &sight, &own_std_m, config);
    Some(Surface { heights, sight, std_m })
}
