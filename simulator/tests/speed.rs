//! How fast beams are cast, and what a live scanner costs. Timings mean something in release builds only:
//! `cargo test --release -p tsense-simulator --test speed -- --ignored --nocapture`
#![allow(clippy::disallowed_methods, reason = "a measurement has clocks, sockets and /proc")]

use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tsense_simulator::{
    Lms151Options, Motion, RayCase, RayOptions, Scene, SceneName, VehicleOptions, World, WorldClock, WorldOptions,
    ray_cloud,
};

/// CPU time of this process so far, seconds.
fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    // User and system time in ticks of 10 ms.
    (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
}

#[test]
#[ignore = "a measurement"]
fn ray_clouds_are_written_faster_than_real_time() {
    for name in [SceneName::Forest, SceneName::Grass, SceneName::Young] {
        let begin = Instant::now();
        let scene = Arc::new(Scene::new(name, 7));
        let built_s = begin.elapsed().as_secs_f64();
        for case in [RayCase::Static, RayCase::Drive] {
            let before = cpu_s();
            let (_, counts) = ray_cloud(scene.clone(), &RayOptions { case, ..RayOptions::default() });
            let took_s = cpu_s() - before;
            let beams = counts.rays + counts.left_out;
            eprintln!(
                "{name:?} {case:?}: scene {built_s:.2} s; {beams} beams of 10 s in {took_s:.2} CPU s, {:.2} us a beam, \
                 {} returns, {} left out",
                took_s * 1e6 / beams as f64,
                counts.returns,
                counts.left_out
            );
            assert!(took_s < 10.0);
        }
    }
}

#[test]
#[ignore = "a measurement"]
fn a_live_scanner_takes_well_under_half_a_core() {
    let options = WorldOptions {
        vehicle: VehicleOptions { motion: Motion::Drive, waits_s: 0.0, ..VehicleOptions::default() },
        lms151: Some(Lms151Options { address: "127.0.0.1:0".into(), spin_up_s: 0.1, ..Lms151Options::default() }),
        pan_tilt: None,
        gpos: None,
        ..WorldOptions::default()
    };
    let world = World::start(&options, WorldClock::starting_now(1.0)).unwrap();
    let mut socket = TcpStream::connect(world.addresses().lms151.unwrap()).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    socket.write_all(b"\x02sEN LMDscandata 1\x03").unwrap();
    let (begin, cpu, mut buffer) = (Instant::now(), cpu_s(), [0u8; 65_536]);
    while begin.elapsed().as_secs_f64() < 10.0 {
        assert!(socket.read(&mut buffer).unwrap() > 0);
    }
    let (seconds, cpu) = (begin.elapsed().as_secs_f64(), cpu_s() - cpu);
    let counts = world.counts();
    eprintln!("{:.0} beams/s at {:.1} % of a core; {counts:?}", counts.beams as f64 / seconds, 100.0 * cpu / seconds);
    assert!(cpu / seconds < 0.5);
    world.stop();
}
