//! A map file's blocks, put where a stopped graph's mapper will find them: into its folder of stored blocks.
//!
//! In: a configuration whose mapper stores blocks, and the blocks of a file. Out: one file a block. It does not talk to
//! a running mapper: that one has read what it needs, and would write over what is put beside it.

use crate::commands::Failure;
use crate::config::Config;
use std::path::Path;
use tsense_mapper::block_store::Folder;
use tsense_mapper::tsmap::Reader;
use tsense_mapper::{BlockMode, BlocksConfig};

use super::damaged;

/// How a load went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Loaded {
    /// Blocks written.
    pub written: usize,
    /// Blocks left as they were stored.
    pub kept: usize,
    /// Older files that had to go because of the limit.
    pub removed: usize,
}

/// Puts every block into the folder of a configuration's mapper.
pub fn load(path: &Path, reader: Reader<'_>, config: &Config, replaces: bool) -> Result<Loaded, Failure> {
    let (blocks, voxel_size_m) = section(config)?;
    let header = reader.header();
    if header.voxel_size_m != voxel_size_m {
        let message = format!("{}: voxels of {} m", path.display(), header.voxel_size_m);
        return Err(Failure::new(2, format!("{message}, but [mapper] voxel_size_m is {voxel_size_m}")));
    }
    if header.zone == 0 {
        let message = format!("{}: the map is in no UTM zone on WGS 84, and a mapper's is", path.display());
        return Err(Failure::new(2, message));
    }
    // All blocks are looked at before the first is written: a damaged file changes nothing.
    reader.clone().try_for_each(|block| block.map(drop)).map_err(|fault| damaged(path, &fault))?;
    let root = config.graph.state_dir().join(&blocks.folder);
    let mut folder = Folder::open(&root, (blocks.disk_max_mb * 1e6) as u64).map_err(|e| Failure::new(1, e))?;
    let mut loaded = Loaded::default();
    for block in reader {
        let block = block.map_err(|fault| damaged(path, &fault))?;
        if !replaces && folder.path_of(&header, block.key).exists() {
            loaded.kept += 1;
            continue;
        }
        loaded.removed += folder.save(&header, &block).map_err(|e| Failure::new(1, e))?;
        loaded.written += 1;
    }
    Ok(loaded)
}

fn section(config: &Config) -> Result<(&BlocksConfig, f64), Failure> {
    match &config.mapper {
        Some(mapper) if mapper.blocks.mode == BlockMode::Store => Ok((&mapper.blocks, mapper.voxel_size_m)),
        Some(_) => {
            Err(Failure::new(3, "[mapper.blocks] mode is discard: set it to \"store\", or nothing would read the map"))
        }
        None => Err(Failure::new(3, "there is no section [mapper]: nothing would read the map")),
    }
}
