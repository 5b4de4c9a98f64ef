//! The page on a forest made by formula: for work on the viewer without the rest of the system.
//!
//! `cargo run -p tsense-bridge --example synthetic [ADDRESS:PORT] [SECONDS]`; prints where the page is.

#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "an example is its own shell")]

mod forest;

use std::sync::Arc;
use std::time::{Duration, Instant};
use tsense_bridge::Config;
use tsense_bridge::web::{hub::Hub, scene::Scene, server::Server};
use tsense_geometry::Timestamp;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let listen = arguments.next().unwrap_or_else(|| "127.0.0.1:8151".into());
    let seconds: f64 = arguments.next().map_or(Ok(f64::INFINITY), |s| s.parse())?;
    let hub = Arc::new(Hub::default());
    let config = Config { listen, ..Config::default() };
    let server = Server::start(&config, Arc::clone(&hub))?;
    println!("the page is at {}", server.url());
    let (start, mut scene) = (Instant::now(), Scene::new(Arc::clone(&hub), &config));
    let forest = forest::Forest::new(7);
    let mut tick = 0u32;
    while start.elapsed().as_secs_f64() < seconds {
        let now = Timestamp::from_seconds(1.7e9 + start.elapsed().as_secs_f64());
        feed(&mut scene, &forest, tick, now);
        if tick.is_multiple_of(5) {
            let counters = scene.publish_counters(now);
            hub.set_report(serde_json::json!({"state": "running", "reason": server.url(), "counters": counters}));
        }
        tick += 1;
        std::thread::sleep(Duration::from_millis(100));
    }
    Ok(())
}

/// Ten times a second: head, pose and scan; now and then the rest.
fn feed(scene: &mut Scene, forest: &forest::Forest, tick: u32, now: Timestamp) {
    let tilt_rad = (f64::from(tick) * 0.1).sin() * 0.35 - 0.12;
    scene.joint(&forest::joint(tilt_rad, now));
    scene.pose(&forest::pose(now), now);
    let (header, beams) = forest.scan(tilt_rad, now);
    scene.points(&header, &beams, now);
    if tick.is_multiple_of(5) {
        forest.send_map(scene, tick / 5, now);
        let (header, cells) = forest.grid(now);
        scene.grid(&header, &cells);
        let (header, objects) = forest.objects(now);
        scene.objects(&header, &objects);
        let (header, detections) = forest.detections(now);
        scene.detections(&header, &detections);
        let (header, processes) = forest::processes(now);
        scene.processes(&header, &processes);
    }
}
