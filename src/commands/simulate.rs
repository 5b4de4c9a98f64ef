//! `tsense simulate`: the outside world alone, on its real wires, for foreign clients; or a ray cloud of it in a file.
//!
//! Prints one JSON line with the addresses the devices really have, then runs until a signal or `--for`.

use super::{Failure, Outcome, print, words};
use crate::files::{can_be_written, write_bytes};
use clap::ValueEnum;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tsense_ports::signals;
use tsense_simulator::{
    Faults, GposOptions, Lms151Options, Motion, ORIGIN_M, PanTiltOptions, Person, PoseErrors, Quality, RayCase,
    RayOptions, Scene, SceneName, VehicleOptions, Way, World, WorldClock, WorldOptions, ZONE, ray_cloud,
};

/// Run the simulated outside world: an LMS-151, a pan-tilt unit and a position system in a scene.
#[derive(Debug, clap::Args)]
#[command(
    before_help = "Example:\n  tsense simulate --scene forest --vehicle drive    (then, elsewhere: tsense run \
        config/simulator.toml)\n  tsense simulate --write-rays plot.ply --case drive --for 15s",
    after_help = "Faults: --fault drop_every=10, --fault gpos:stall_at_s=5, --fault pan-tilt:drop_every=3; \
        the device is lms151 where none is named."
)]
pub struct Args {
    /// Which scene: forest, flat, slope, grass, ditch, wall, person, young, rocks, bumps or drift.
    #[arg(long, default_value = "forest", value_name = "NAME")]
    pub scene: SceneName,
    /// Seed of everything that chance decides.
    #[arg(long, default_value_t = 7, value_name = "N")]
    pub seed: u64,
    /// Where the LMS-151 listens; port 0 takes any free one; "none" for no ladar.
    #[arg(long, default_value = "127.0.0.1:2111", value_name = "ADDRESS")]
    pub lms151: String,
    /// Link to the pan-tilt unit's terminal; "none" for no unit.
    #[arg(long, default_value = "/tmp/tsense-pan-tilt", value_name = "LINK")]
    pub pan_tilt: String,
    /// Where the position system listens; "none" for none.
    #[arg(long, default_value = "127.0.0.1:2947", value_name = "ADDRESS")]
    pub gpos: String,
    /// How fast the world runs against real time, 0.1x to 20x.
    #[arg(long, default_value = "1x", value_parser = words::speed, value_name = "X")]
    pub speed: f64,
    /// Whether the vehicle stands or drives.
    #[arg(long, value_enum, default_value_t = VehicleChoice::Stand)]
    pub vehicle: VehicleChoice,
    /// The way it drives.
    #[arg(long, value_enum, default_value_t = WayChoice::Oval)]
    pub way: WayChoice,
    /// Speed of a driving vehicle, metres per second.
    #[arg(long, default_value_t = 0.7, value_parser = words::within(0.01, 30.0), value_name = "M/S")]
    pub vehicle_speed: f64,
    /// How good the reported position is.
    #[arg(long, value_enum, default_value_t = QualityChoice::RtkFixed)]
    pub pose_quality: QualityChoice,
    /// How fast the reported position runs away, metres a minute.
    #[arg(long, default_value_t = 0.0, value_parser = words::within(-1000.0, 1000.0), value_name = "M/MIN")]
    pub pose_drift: f64,
    /// Time from starting to measure until the ladar is ready, seconds; a real one takes up to 30.
    #[arg(long, default_value_t = 2.0, value_parser = words::within(0.0, 3600.0), value_name = "SECONDS")]
    pub spin_up: f64,
    /// The ladar's own counter at the start, microseconds.
    #[arg(long, default_value_t = 1_000_000, value_name = "MICROSECONDS")]
    pub clock_start: u32,
    /// Puts a person in front of the vehicle who is gone after this time (s, m or h).
    #[arg(long, value_parser = words::seconds, value_name = "TIME")]
    pub person_leaves: Option<f64>,
    /// Something that goes wrong, `[DEVICE:]KEY=VALUE`; may be repeated.
    #[arg(long = "fault", value_name = "FAULT")]
    pub faults: Vec<String>,
    /// End after this time of the world (s, m or h); a ray cloud is that long, 10s without it.
    #[arg(long = "for", value_parser = words::seconds, value_name = "TIME")]
    pub run_for: Option<f64>,
    /// Write the truth (trees, drops, rocks, walls, origin) as JSON to this file.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Write a ray cloud (PLY) to this file instead of running devices.
    #[arg(long, value_name = "FILE")]
    pub write_rays: Option<PathBuf>,
    /// Which ray cloud: static, clipped (to 30 x 30 x 12 m), drive (40 m) or oval (51 m, once round).
    #[arg(long, default_value = "static", value_name = "CASE", requires = "write_rays")]
    pub case: RayCase,
}

/// Whether the vehicle moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum VehicleChoice {
    /// It stands.
    Stand,
    /// It drives.
    Drive,
}

/// Which way it takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WayChoice {
    /// Round and round.
    Oval,
    /// 40 m and stop.
    Line,
}

/// How good the position is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum QualityChoice {
    /// No error.
    Exact,
    /// Centimetres.
    RtkFixed,
    /// Decimetres.
    RtkFloat,
    /// Metres.
    Single,
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let options = options_of(args)?;
    if let Some(file) = &args.truth {
        write_bytes(file, format!("{:#}\n", truth(&options.build_scene())))?;
    }
    match &args.write_rays {
        Some(file) => write_rays(args, file),
        None => run_world(args, &options),
    }
}

fn run_world(args: &Args, options: &WorldOptions) -> Outcome {
    signals::install()?;
    let clock = WorldClock::starting_now(args.speed);
    let world = World::start(options, clock).map_err(|e| Failure::new(4, e))?;
    let found = world.addresses();
    let line = json!({
        "lms151": found.lms151, "pan_tilt": found.pan_tilt, "gpos": found.gpos,
        "scene": args.scene.as_str(), "seed": args.seed, "speed": args.speed,
    });
    print(&format!("{line}\n"))?;
    let end = args.run_for.map(|s| clock.start().plus_seconds(s));
    let asked = loop {
        let asked = signals::requested();
        if asked.is_some() || end.is_some_and(|end| clock.now() >= end) {
            break asked;
        }
        WorldClock::sleep_real(0.05);
    };
    world.stop();
    Ok(if asked == Some(signals::StopSignal::Interrupt) { 130 } else { 0 })
}

fn write_rays(args: &Args, file: &Path) -> Outcome {
    can_be_written(file)?;
    let scene = Arc::new(Scene::new(args.scene, args.seed));
    let for_s = args.run_for.unwrap_or(10.0);
    if for_s > 600.0 {
        // 48 bytes a ray are kept in memory: ten minutes are 0.8 GB.
        return Err(Failure::new(2, format!("--for {for_s}s: a ray cloud is at most 600s long")));
    }
    let (bytes, counts) = ray_cloud(scene, &RayOptions { case: args.case, for_s, ..RayOptions::default() });
    write_bytes(file, bytes)?;
    let line = json!({ "file": file.to_string_lossy(), "rays": counts.rays, "returns": counts.returns, "left_out": counts.left_out });
    print(&format!("{line}\n"))
}

fn truth(scene: &Scene) -> serde_json::Value {
    json!({
        "scene": scene.name().as_str(), "seed": scene.seed(), "origin_m": ORIGIN_M, "zone": ZONE,
        "trees": scene.true_trees(), "drops": scene.true_drops(),
        "rocks": scene.true_rocks(), "walls": scene.true_walls(),
    })
}

fn options_of(args: &Args) -> Result<WorldOptions, Failure> {
    let [mut lms151_faults, mut pan_tilt_faults, mut gpos_faults] = [Faults::default(); 3];
    for fault in &args.faults {
        let (device, setting) = fault.split_once(':').unwrap_or(("lms151", fault));
        let faults = match device {
            "lms151" => &mut lms151_faults,
            "pan-tilt" => &mut pan_tilt_faults,
            "gpos" => &mut gpos_faults,
            _ => return Err(Failure::new(2, format!("--fault {fault}: no device '{device}'; lms151, pan-tilt, gpos"))),
        };
        faults.set(setting).map_err(|e| Failure::new(2, format!("--fault {fault}: {e}")))?;
    }
    let wanted = |text: &str| (text != "none").then(|| text.to_owned());
    let errors = PoseErrors {
        quality: match args.pose_quality {
            QualityChoice::Exact => Quality::Exact,
            QualityChoice::RtkFixed => Quality::RtkFixed,
            QualityChoice::RtkFloat => Quality::RtkFloat,
            QualityChoice::Single => Quality::Single,
        },
        drift_m_per_min: args.pose_drift,
        ..PoseErrors::default()
    };
    let lms151 = |address| Lms151Options {
        address,
        spin_up_s: args.spin_up,
        clock_start_us: args.clock_start,
        faults: lms151_faults,
        ..Lms151Options::default()
    };
    Ok(WorldOptions {
        scene: args.scene,
        seed: args.seed,
        vehicle: vehicle_of(args),
        person: args.person_leaves.map(|s| Person { leaves_at_s: Some(s), ..Person::STANDING }),
        lms151: wanted(&args.lms151).map(lms151),
        pan_tilt: wanted(&args.pan_tilt).map(|link| PanTiltOptions {
            link,
            faults: pan_tilt_faults,
            ..PanTiltOptions::default()
        }),
        gpos: wanted(&args.gpos).map(|address| GposOptions {
            address,
            errors,
            faults: gpos_faults,
            ..GposOptions::default()
        }),
        ..WorldOptions::default()
    })
}

fn vehicle_of(args: &Args) -> VehicleOptions {
    let motion = if args.vehicle == VehicleChoice::Drive { Motion::Drive } else { Motion::Stand };
    let way = if args.way == WayChoice::Line { Way::Line } else { Way::Oval };
    VehicleOptions { motion, way, speed_m_s: args.vehicle_speed, ..VehicleOptions::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: Args,
    }

    fn parse(words: &[&str]) -> Args {
        Cli::parse_from([&["simulate"], words].concat()).args
    }

    #[test]
    fn the_command_line_becomes_options() {
        let args = parse(&[
            "--scene",
            "ditch",
            "--seed",
            "3",
            "--gpos",
            "none",
            "--fault",
            "gpos:drop_every=2",
            "--fault",
            "wrap_after_s=10",
            "--vehicle",
            "drive",
            "--speed",
            "2x",
            "--for",
            "2m",
        ]);
        let options = options_of(&args).unwrap();
        assert_eq!((options.scene, options.seed, options.gpos), (SceneName::Ditch, 3, None));
        assert_eq!(options.lms151.unwrap().faults.wrap_after_s, 10.0);
        assert_eq!((options.vehicle.motion, args.speed, args.run_for), (Motion::Drive, 2.0, Some(120.0)));
    }

    #[test]
    fn a_wrong_fault_says_what_there_is() {
        let failure = options_of(&parse(&["--fault", "explode=1"])).unwrap_err();
        assert_eq!(failure.code, 2);
        assert!(failure.message.contains("drop_every"));
        assert!(options_of(&parse(&["--fault", "radar:drop_every=1"])).unwrap_err().message.contains("pan-tilt"));
    }
}
