//! `tsense map save|load|publish|info|diff|fuse|export`: the voxel map as a file.

use super::{Failure, Outcome, config, print, status, tell, words};
use crate::files::can_be_written;
use crate::graph::{Request, ask};
use crate::mapfile::export::{Export, Kind};
use crate::mapfile::points::{Shade, What};
use crate::mapfile::publish::Publication;
use crate::mapfile::{self, capture, diff, fuse, info, load};
use clap::{Args, Subcommand};
use serde_json::json;
use std::path::{Path, PathBuf};
use tsense_mapper::tsmap::{MapFileHeader, StoredBlock};
use tsense_ports::Domain;

/// The voxel map as a file: save it, look at it, compare two, make one of two, export points, put one into a graph.
#[derive(Debug, Args)]
#[command(
    arg_required_else_help = true,
    before_help = "Example:\n  tsense map save now.tsmap && tsense map export now.tsmap --out now.laz"
)]
pub struct MapArgs {
    #[command(subcommand)]
    command: MapCommand,
}

#[derive(Debug, Subcommand)]
enum MapCommand {
    /// Write the map of a running graph into a file.
    #[command(before_help = "Example:\n  tsense map save now.tsmap")]
    Save {
        /// The file to write, by custom NAME.tsmap
        file: PathBuf,
        /// Name of the graph; needed only where several are running
        #[arg(long, value_name = "NAME", value_parser = words::graph)]
        graph: Option<String>,
        /// Longest wait for a complete snapshot, seconds
        #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = words::within(0.0, 3600.0))]
        patience: f64,
        /// Print what was written as JSON
        #[arg(long)]
        json: bool,
    },
    /// Put a file's blocks into the folder of stored blocks of a graph that is not running.
    ///
    /// The mapper reads them when the vehicle comes near. The configuration must say `[mapper.blocks] mode = "store"`.
    /// Stored confidence fades by the age of the blocks unless it says `fade_stored = false`.
    #[command(before_help = "Example:\n  tsense map load yesterday.tsmap --config tsense.toml")]
    Load {
        /// The map file
        file: PathBuf,
        /// The graph's configuration, TOML
        #[arg(long, value_name = "FILE")]
        config: PathBuf,
        /// Name of the graph instead of the configured one
        #[arg(long, value_name = "NAME", value_parser = words::graph)]
        graph: Option<String>,
        /// The graph's state folder instead of the configured one
        #[arg(long, value_name = "DIR")]
        state_dir: Option<PathBuf>,
        /// Write over blocks that are stored already; otherwise these are kept
        #[arg(long)]
        replace: bool,
        /// Print what was written as JSON
        #[arg(long)]
        json: bool,
    },
    /// Tell a running graph what a file holds, as what was known before: yesterday's map.
    ///
    /// The mapper fills with it what it does not know, and believes its own ladars elsewhere. The configuration names
    /// the file as a sensor: `[[mapper.voxel_sensor]]` with `name` and `weight`. Runs until Ctrl-C, and tells what lies around
    /// the vehicle again and again, as far as it drives.
    #[command(before_help = "Example:\n  tsense map publish yesterday.tsmap --as yesterday")]
    Publish {
        /// The map file; its voxels are at most four times as large as the mapper's
        file: PathBuf,
        /// The configured name of the sensor that it stands for
        #[arg(long = "as", value_name = "NAME")]
        name: String,
        /// Name of the graph; needed only where several are running
        #[arg(long, value_name = "NAME", value_parser = words::graph)]
        graph: Option<String>,
        /// Time after which a place is told again (s, m or h)
        #[arg(long, value_name = "TIME", value_parser = words::seconds, default_value = "2s")]
        every: f64,
        /// How far around the vehicle, metres: half the mapper's working space, and the way of some seconds
        #[arg(long, value_name = "M", value_parser = words::within(1.0, 1000.0), default_value_t = 30.0)]
        reach: f64,
        /// Which voxels
        #[arg(long, value_enum, default_value_t = What::All)]
        what: What,
        /// End after this time (s, m or h)
        #[arg(long = "for", value_name = "TIME", value_parser = words::seconds)]
        run_for: Option<f64>,
        /// Print at the end what was told, as JSON
        #[arg(long)]
        json: bool,
        /// Say nothing but what is wrong
        #[arg(long, short)]
        quiet: bool,
    },
    /// Say what a file holds, and whether every block checks; exit code 6 where one does not.
    #[command(before_help = "Example:\n  tsense map info now.tsmap")]
    Info {
        /// The map file
        file: PathBuf,
        /// Print JSON, with a line for every block
        #[arg(long)]
        json: bool,
    },
    /// Count the voxels that changed from one file to another.
    #[command(before_help = "Example:\n  tsense map diff monday.tsmap tuesday.tsmap --touching 4 --out changes.ply")]
    Diff {
        /// The earlier map file
        before: PathBuf,
        /// The later map file
        after: PathBuf,
        /// Print JSON instead of text
        #[arg(long)]
        json: bool,
        /// Write the changed voxels as points; scalar_change is 1 appeared, 2 vanished, 3 newly occupied
        #[arg(long, value_name = "FILE.ply")]
        out: Option<PathBuf>,
        /// Smallest group of touching voxels that counts as appeared or vanished, voxels
        #[arg(long, value_name = "N", default_value_t = 1)]
        touching: usize,
    },
    /// Count one file into another of the same place, as the live map counts a sensor's voxels.
    ///
    /// Where only one of them knows a voxel it is as that one says; elsewhere the second adds to the first or takes from it, by
    /// its weight.
    #[command(before_help = "Example:\n  tsense map fuse today.tsmap drone.tsmap --weight 0.5 --out both.tsmap")]
    Fuse {
        /// The map file
        file: PathBuf,
        /// The file that is counted in
        other: PathBuf,
        /// What it counts against one window of a ladar of weight 1, in quarters
        #[arg(long, value_name = "W", value_parser = words::within(0.01, 1.0), default_value_t = 0.5)]
        weight: f64,
        /// The file to write, by custom NAME.tsmap
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Print what was written as JSON
        #[arg(long)]
        json: bool,
    },
    /// Write voxels as points at their centres, with occupancy and confidence as attributes.
    #[command(before_help = "Example:\n  tsense map export now.tsmap --out now.laz --what occupied --color height")]
    Export {
        /// The map file
        file: PathBuf,
        /// The file to write; .las, .laz or .ply says which kind
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Which voxels
        #[arg(long, value_enum, default_value_t = What::Occupied)]
        what: What,
        /// What the colour shows
        #[arg(long, value_enum, default_value_t = Shade::Height)]
        color: Shade,
        /// Print what was written as JSON
        #[arg(long)]
        json: bool,
    },
}

/// Runs the command.
pub fn run(args: &MapArgs) -> Outcome {
    match &args.command {
        MapCommand::Save { file, graph, patience, json } => save(file, graph.as_deref(), *patience, *json),
        MapCommand::Load { file, config, graph, state_dir, replace, json } => {
            let mut config = config::load(config)?;
            if let Some(name) = graph {
                config.graph.name.clone_from(name);
            }
            if let Some(folder) = state_dir {
                config.graph.state_dir.clone_from(folder);
            }
            load_into(file, &config, *replace, *json)
        }
        MapCommand::Publish { file, name, graph, every, reach, what, run_for, json, quiet } => {
            let (header, blocks) = read_all(file)?;
            let of = Publication { header, blocks, what: *what, every_s: *every, reach_m: *reach, for_s: *run_for };
            publish(&of, (name, graph.as_deref()), *json, *quiet)
        }
        MapCommand::Fuse { file, other, weight, out, json } => fuse_files([file, other], *weight, out, *json),
        MapCommand::Info { file, json } => say_info(file, *json),
        MapCommand::Diff { before, after, json, out, touching } => {
            say_difference([before, after], *json, out.as_deref(), *touching)
        }
        MapCommand::Export { file, out, what, color, json } => export(file, out, (*what, *color), *json),
    }
}

fn save(file: &Path, graph: Option<&str>, patience_s: f64, as_json: bool) -> Outcome {
    can_be_written(file)?;
    let (header, blocks) = capture::capture(&status::find(graph)?, patience_s)?;
    let bytes = mapfile::write(file, &header, &blocks)?;
    say_written(file, blocks.len(), bytes, as_json)
}

fn say_written(file: &Path, blocks: usize, bytes: usize, as_json: bool) -> Outcome {
    let text = format!("{blocks} blocks, {bytes} bytes in {}", file.display());
    say_done(&text, &json!({ "file": file, "blocks": blocks, "bytes": bytes }), as_json)
}

/// Tells what was done, or prints it.
fn say_done(text: &str, value: &serde_json::Value, as_json: bool) -> Outcome {
    if as_json {
        return print(&format!("{value}\n"));
    }
    tell(format_args!("tsense: {text}"));
    Ok(0)
}

fn load_into(file: &Path, config: &crate::config::Config, replaces: bool, as_json: bool) -> Outcome {
    let domain = Domain::new(&config.graph.name).map_err(|e| Failure::new(2, e))?;
    if ask(&domain, Request::Status).is_ok() {
        let name = domain.name();
        let why = "its mapper would not see the blocks, and write over them";
        return Err(Failure::new(1, format!("graph {name} is running: {why}; `tsense stop --graph {name}` first")));
    }
    let bytes = mapfile::read(file)?;
    let done = load::load(file, mapfile::blocks_of(file, &bytes)?, config, replaces)?;
    let load::Loaded { written, kept, removed } = done;
    if config.mapper.as_ref().is_some_and(|mapper| mapper.blocks.fade_stored) {
        tell("tsense: stored confidence fades by age; [mapper.blocks] fade_stored = false brings it back as it is");
    }
    let text = format!("{written} blocks stored, {kept} kept as they were, {removed} older ones removed for the limit");
    say_done(&text, &json!({ "written": written, "kept": kept, "removed": removed }), as_json)
}

/// All of a file, every block checked.
fn read_all(file: &Path) -> Result<(MapFileHeader, Vec<StoredBlock>), Failure> {
    let bytes = mapfile::read(file)?;
    let reader = mapfile::blocks_of(file, &bytes)?;
    let header = reader.header();
    let blocks = reader.collect::<Result<_, _>>().map_err(|fault| mapfile::damaged(file, &fault))?;
    Ok((header, blocks))
}

fn publish(of: &Publication, (name, graph): (&str, Option<&str>), as_json: bool, is_quiet: bool) -> Outcome {
    let domain = status::find(graph)?;
    if !is_quiet {
        tell(format_args!("tsense: {} blocks told to graph {} as {name}; Ctrl-C ends", of.blocks.len(), domain.name()));
    }
    let told = of.run(&domain, name)?;
    if as_json {
        print(&pretty(&told)?)?;
    } else if !is_quiet {
        tell(format_args!("tsense: {} voxels told in {} samples", told.voxels, told.samples));
    }
    Ok(if told.interrupted { 130 } else { 0 })
}

fn fuse_files([file, other]: [&PathBuf; 2], weight: f64, out: &Path, as_json: bool) -> Outcome {
    can_be_written(out)?;
    let bytes = [mapfile::read(file)?, mapfile::read(other)?];
    let readers = [mapfile::blocks_of(file, &bytes[0])?, mapfile::blocks_of(other, &bytes[1])?];
    let [map, told] = readers;
    let (header, blocks) = fuse::fuse((file, map), (other, told), weight)?;
    let bytes = mapfile::write(out, &header, &blocks)?;
    say_written(out, blocks.len(), bytes, as_json)
}

fn say_info(file: &Path, as_json: bool) -> Outcome {
    let bytes = mapfile::read(file)?;
    let reader = mapfile::blocks_of(file, &bytes)?;
    let header = reader.header();
    let info = info::info(&file.display().to_string(), &bytes, reader);
    print(&if as_json { pretty(&info)? } else { info.to_text(&header) })?;
    Ok(if info.damaged_blocks == 0 { 0 } else { 6 })
}

fn say_difference([before, after]: [&PathBuf; 2], as_json: bool, out: Option<&Path>, touching: usize) -> Outcome {
    if out.is_some_and(|out| Kind::of(out) != Some(Kind::Ply)) {
        return Err(Failure::new(2, "--out: a name that ends in .ply is wanted"));
    }
    let bytes = [mapfile::read(before)?, mapfile::read(after)?];
    let readers = [mapfile::blocks_of(before, &bytes[0])?, mapfile::blocks_of(after, &bytes[1])?];
    let [first, second] = readers;
    let difference = diff::compare((before, first), (after, second), touching)?;
    if let Some(out) = out {
        difference.write_ply(out)?;
    }
    let c = difference.counts;
    let text = format!(
        "{} voxels appeared (free, then occupied)\n{} vanished (occupied, then free)\n{} newly occupied, {} newly free \
         (unknown before)\n{} forgotten (unknown now)\n{} unchanged\n{} in groups too small to count\n",
        c.appeared, c.vanished, c.newly_occupied, c.newly_free, c.forgotten, c.unchanged, c.flicker
    );
    print(&if as_json { pretty(&c)? } else { text })
}

fn export(file: &Path, out: &Path, (what, shade): (What, Shade), as_json: bool) -> Outcome {
    let wanted = || Failure::new(2, format!("{}: a name that ends in .las, .laz or .ply is wanted", out.display()));
    let kind = Kind::of(out).ok_or_else(wanted)?;
    let bytes = mapfile::read(file)?;
    let reader = mapfile::blocks_of(file, &bytes)?;
    if reader.header().epsg == 0 {
        tell("tsense: the coordinate system is unknown; the points carry none");
    }
    let points = Export { path: file, reader, what, shade }.write(out, kind)?;
    say_done(&format!("{points} points in {}", out.display()), &json!({ "file": out, "points": points }), as_json)
}

fn pretty(value: &impl serde::Serialize) -> Result<String, Failure> {
    serde_json::to_string_pretty(value).map(|text| text + "\n").map_err(|e| Failure::new(1, e))
}
