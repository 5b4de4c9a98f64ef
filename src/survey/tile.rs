//! One tile: its rays through the voxels and into the store of returns, then the classifier's chain.
//!
//! In: the rays of the tile, in the order of the input. Out: a [`Piece`] and the voxel map. Rays come from the input
//! itself where the plot is one tile, else from a [`Spill`].

use super::extent::Corners;
use super::piece::Piece;
use super::plan::{Plan, Tile};
use super::spill::{Entry, Spill};
use super::stages::Stages;
use super::timeline::{Follower, Timeline};
use super::{Extent, Held, Options, Ray, SurveyError, each_ray};
use std::path::{Path, PathBuf};
use tsense_classifier::{Input, Memory, PlacedBeam, ReturnDrops, Returns, View, Window, detect};
use tsense_geometry::{Point, Timestamp};
use tsense_mapper::{Beam, BeamKind, VoxelMap, Weight};

/// Where a tile's rays come from.
pub enum Rays {
    /// The plot is one tile: its rays are held, or the input is read again.
    Input(Held),
    /// Sorted by tile.
    Sorted(Spill, PathBuf),
}

/// A tile that was surveyed.
pub struct Surveyed {
    /// The results of the chain.
    pub piece: Piece,
    /// The voxel map.
    pub map: VoxelMap,
    /// Blocks that rays reached.
    pub blocks: usize,
    /// Beams that the store of returns did not keep.
    pub drops: ReturnDrops,
}

/// The rays of a tile on their way into its map.
struct Tracer<'a> {
    map: tsense_mapper::Survey,
    returns: Returns,
    follower: Follower<'a>,
}

impl Rays {
    /// Sorts the rays of a plot in several tiles.
    pub fn sort(
        options: &Options,
        held: Held,
        plan: &Plan,
        folder: &Path,
        progress: impl FnMut(f64),
    ) -> Result<Self, SurveyError> {
        if plan.tile_count() == 1 {
            return Ok(Self::Input(held));
        }
        let failed = |cause| SurveyError::Spill { folder: folder.into(), cause };
        let mut spill = Spill::new(folder).map_err(failed)?;
        let mut window: Option<Timestamp> = None;
        each_ray(options, &held, progress, |ray| {
            // Windows of all tiles end together, as they do in a plot of one tile.
            let opened = window.filter(|opened| ray.stamp.seconds_since(*opened) < options.window_s);
            let opened = *window.insert(opened.unwrap_or(ray.stamp));
            plan.tiles_along(ray.origin, ray.end).try_for_each(|tile| spill.add(tile, &ray, opened)).map_err(failed)
        })?;
        Ok(Self::Sorted(spill, folder.into()))
    }

    /// Number of a tile's rays.
    pub fn count(&self, tile: &Tile, all: &Extent) -> u64 {
        match self {
            Self::Input(_) => all.rays,
            Self::Sorted(spill, _) => spill.rays(tile.index),
        }
    }

    /// Number of rays of all tiles; those that touch several count in each.
    pub fn total(&self, all: &Extent) -> u64 {
        match self {
            Self::Input(_) => all.rays,
            Self::Sorted(spill, _) => spill.total(),
        }
    }

    /// Hands a tile's rays to `take`.
    pub fn each(&mut self, options: &Options, tile: &Tile, mut take: impl FnMut(Entry)) -> Result<(), SurveyError> {
        match self {
            Self::Input(held) => each_ray(
                options,
                held,
                |_| {},
                |ray| {
                    take(Entry::Ray(ray));
                    Ok(())
                },
            )
            .map(drop),
            Self::Sorted(spill, folder) => {
                let failed = |cause| SurveyError::Spill { folder: folder.clone(), cause };
                spill.each(tile.index, take).map_err(failed)
            }
        }
    }

    /// Hands a tile's returns to `take`.
    pub fn each_return(
        &mut self,
        options: &Options,
        tile: &Tile,
        mut take: impl FnMut(&Ray) -> Result<(), SurveyError>,
    ) -> Result<(), SurveyError> {
        // After a fault the rest is read for nothing, once.
        let mut outcome = Ok(());
        self.each(options, tile, |entry| match entry {
            Entry::Ray(ray) if ray.is_return && outcome.is_ok() => outcome = take(&ray),
            _ => {}
        })?;
        outcome
    }

    /// Surveys a tile; nothing where no beam ends in it.
    pub fn survey(
        &mut self,
        options: &Options,
        tile: &Tile,
        extent: &Extent,
        timeline: &mut Timeline,
        stages: &mut Stages,
    ) -> Result<Option<Surveyed>, SurveyError> {
        let Some((low, high)) = self.space(options, tile, extent)? else { return Ok(None) };
        let config = tsense_mapper::Survey::config_for(low, high, options.voxel_size_m, options.window_s);
        let mut tracer = Tracer {
            map: tsense_mapper::Survey::new(&config, low + (high - low).scaled(0.5))?,
            returns: Returns::new(&options.classifier.returns),
            follower: timeline.follow(tile.core),
        };
        self.each(options, tile, |entry| tracer.take(entry))?;
        stages.end("reading, voxels, returns");
        let Tracer { map, mut returns, follower } = tracer;
        returns.settle();
        let map = follower.finish(map);
        // Returns that lie around the tile's space, and none in it.
        if map.blocks().next().is_none() {
            return Ok(None);
        }
        let view = view_of(&map, &options.classifier)?;
        stages.end("returns by direction, view");
        let (input, mut memory) = (Input::of_survey(&view, &returns), Memory::new(usize::MAX));
        let detected = detect(&input, &mut memory, &options.classifier);
        stages.end("ground and trees");
        let found = detected.finish(&input, &mut memory, &options.classifier);
        stages.end("brush, drops, traversability");
        let (blocks, drops) = (map.blocks().count(), returns.drops());
        Ok(Some(Surveyed { piece: Piece::new(tile, found), map, blocks, drops }))
    }

    /// The box that a tile's map covers.
    fn space(&mut self, options: &Options, tile: &Tile, all: &Extent) -> Result<Option<Corners>, SurveyError> {
        if matches!(self, Self::Input(_)) {
            return Ok(all.space(options.reach_m));
        }
        let mut extent = Extent::default();
        let [west, south, east, north] = tile.around_m;
        self.each(options, tile, |entry| {
            if let Entry::Ray(ray) = entry {
                let inside = (west..=east).contains(&ray.end.x()) && (south..=north).contains(&ray.end.y());
                extent.add(&Ray { is_return: ray.is_return && inside, ..ray });
            }
        })?;
        Ok(extent.space(options.reach_m))
    }
}

impl Tracer<'_> {
    fn take(&mut self, entry: Entry) {
        match entry {
            Entry::Ray(ray) => {
                self.follower.before(ray.stamp, &mut self.map);
                match ray.is_point() {
                    true => self.returns.insert_point(ray.end),
                    false => self.returns.insert(&placed(&ray)),
                }
                // A ray that lies outside of the space says nothing about it.
                let _ = self.map.insert(ray.stamp, &beam_of(&ray));
            }
            Entry::WindowEnds(stamp) => {
                // A beam that is nowhere marks nothing, but ends the window.
                let nowhere = Point::new(f64::NAN, f64::NAN, f64::NAN);
                let beam = Beam { origin: nowhere, end: nowhere, kind: BeamKind::NoReturn, weight: Weight::FULL };
                let _ = self.map.insert(stamp, &beam);
            }
        }
    }
}

fn placed(ray: &Ray) -> PlacedBeam {
    PlacedBeam { ladar: 0, stamp: ray.stamp, origin: ray.origin, end: ray.end, is_return: ray.is_return }
}

fn beam_of(ray: &Ray) -> Beam {
    let kind = if ray.is_return { BeamKind::Hit } else { BeamKind::NoReturn };
    Beam { origin: ray.origin, end: ray.end, kind, weight: Weight::FULL }
}

fn view_of(map: &VoxelMap, config: &tsense_classifier::Config) -> Result<View, SurveyError> {
    let window = Window::covering(map.blocks().map(|(key, _)| key))
        .ok_or_else(|| SurveyError::View { blocks: map.blocks().count() })?;
    Ok(View::of_blocks(window, map.grid(), map.blocks(), config.voxel_confidence_min))
}
