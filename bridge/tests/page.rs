//! The page in a real browser, fed with a forest made by formula. Skips loudly where there is no Chromium.

#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "common/chromium.rs"]
mod chromium;
#[path = "../examples/synthetic/forest.rs"]
mod forest;

use chromium::Browser;
use forest::Forest;
use std::collections::BTreeSet;
use std::sync::Arc;
use tsense_bridge::Config;
use tsense_bridge::web::hub::Hub;
use tsense_bridge::web::scene::Scene;
use tsense_bridge::web::server::Server;
use tsense_bridge::web::surface::surface_of;
use tsense_contract::CommitEntry;
use tsense_geometry::Timestamp;

const NOW: Timestamp = Timestamp::from_ns(1_700_000_000_000_000_000);

fn feed_all(scene: &mut Scene, forest: &Forest) {
    scene.joint(&forest::joint(0.1, NOW));
    scene.pose(&forest::pose(NOW), NOW);
    forest.send_map(scene, 1, NOW);
    let (header, cells) = forest.grid(NOW);
    scene.grid(&header, &cells);
    let (header, beams) = forest.scan(-0.2, NOW);
    scene.points(&header, &beams, NOW);
    let (header, objects) = forest.objects(NOW);
    scene.objects(&header, &objects);
    let (header, detections) = forest.detections(NOW);
    scene.detections(&header, &detections);
    let (header, processes) = forest::processes(NOW);
    scene.processes(&header, &processes);
    scene.publish_counters(NOW);
}

/// One test, because a browser takes seconds to start; each part is named by its function.
#[test]
fn the_page_shows_the_system_in_a_browser() {
    let hub = Arc::new(Hub::default());
    let config = Config { listen: "127.0.0.1:0".into(), ..Config::default() };
    let server = Server::start(&config, Arc::clone(&hub)).unwrap();
    let (forest, mut scene) = (Forest::new(7), Scene::new(Arc::clone(&hub), &config));
    feed_all(&mut scene, &forest);
    let Some(mut page) = Browser::open(&server.url(), 1024, 600) else { return };
    page.wait_for("window.tsense && tsense.drawnSnapshot === 1 && tsense.counts.objects === 16");
    everything_that_was_sent_is_there(&mut page, &forest);
    colours_are_those_of_the_thesis(&mut page);
    lamps_and_lists_say_what_was_said(&mut page);
    layers_can_be_switched(&mut page);
    a_block_that_left_the_map_leaves_the_screen(&mut page, &mut scene, &forest);
    the_same_blocks_again_and_again_need_no_more_memory(&mut page, &mut scene, &forest);
    assert_eq!(page.complaints, Vec::<String>::new());
    a_lost_bridge_is_shown_and_found_again(&mut page, server, hub);
}

fn everything_that_was_sent_is_there(page: &mut Browser, forest: &Forest) {
    let surfaces = forest.blocks().into_values().map(|bricks| surface_of(&bricks).unwrap());
    let (voxels, faces) = surfaces.fold((0, 0), |(voxels, faces), surface| {
        let open: u32 = surface.words.iter().map(|word| (word >> 20 & 63).count_ones()).sum();
        (voxels + surface.words.len(), faces + open)
    });
    assert!(voxels > 20_000, "the forest has {voxels} voxels only");
    let counts = page.value("tsense.counts");
    assert_eq!(counts["blocks"], forest.blocks().len());
    assert_eq!((&counts["voxels"], &counts["faces"]), (&voxels.into(), &faces.into()));
    assert_eq!((&counts["objects"], &counts["detections"]), (&16.into(), &17.into()));
    assert_eq!((&counts["points"], &counts["cells"]), (&541.into(), &40_000.into()));
    assert_eq!(counts["decodeErrors"], 0);
    assert!(page.value("tsense.frameDone").as_u64().unwrap() > 0);
}

/// Pixels of a hue, among 614,400.
fn pixels(page: &mut Browser, hex: &str) -> u64 {
    page.value(&format!("tsense.pixelsLike('{hex}')")).as_u64().unwrap()
}

fn colours_are_those_of_the_thesis(page: &mut Browser) {
    page.value(
        "for (const layer of ['objects', 'detections', 'scan', 'fan', 'vehicle']) tsense.setLayer(layer, false)",
    );
    let (ground, brush, trunk) = (pixels(page, "#8cbf63"), pixels(page, "#2f6a36"), pixels(page, "#7a3fb0"));
    println!("pixels: ground {ground}, brush {brush}, trunk {trunk}");
    assert!(ground > 50_000 && brush > 5_000 && trunk > 5_000, "{ground}, {brush}, {trunk}");
    page.value("tsense.setLook({overlay: 'cost'})");
    // The layer is translucent: free ground is a mix of its blue and the green below.
    let (free, bare) = (pixels(page, "#497faa"), pixels(page, "#8cbf63"));
    println!("pixels with traversability: free {free}, bare ground {bare}");
    assert!(free > 20_000, "{free} pixels of free ground");
    assert!(bare < ground / 2, "the grid lies over the ground: {bare} of {ground}");
    page.value("tsense.setLook({overlay: 'density'}), tsense.setLayer('voxels', false)");
    // Nine tenths of the way along the colours of vegetation, mixed with the pale background.
    let dense = pixels(page, "#325c43");
    println!("pixels of dense brush: {dense}");
    assert!(dense > 5_000, "{dense} pixels of dense brush");
    page.value("tsense.setLook({overlay: 'none'}), tsense.setLayer('ground', false)");
    assert_eq!(pixels(page, "#325c43"), 0);
    assert_eq!(pixels(page, "#7a3fb0"), 0);
    page.value("for (const layer in tsense.layers) tsense.setLayer(layer, true)");
}

fn lamps_and_lists_say_what_was_said(page: &mut Browser) {
    let text = page.value("document.body.innerText");
    let text = text.as_str().unwrap();
    for expected in
        ["ladar/front", "degraded: differential corrections missing for 4 s", "connected", "graph synthetic"]
    {
        assert!(text.contains(expected), "{expected:?} is not on the page: {text}");
    }
    assert_eq!(page.value("document.querySelectorAll('#processes li').length"), 7);
    assert_eq!(page.value("document.querySelector('#processes li:nth-child(3) .lamp').className"), "lamp degraded");
    assert_eq!(page.value("document.querySelectorAll('#objects tr').length"), 16);
    // The whole page fits: nothing scrolls, at this size and on a small laptop.
    assert_eq!(page.value("document.documentElement.scrollHeight <= innerHeight"), true);
}

fn layers_can_be_switched(page: &mut Browser) {
    page.value("document.querySelector('#layers input[name=scan]').click()");
    assert_eq!(page.value("tsense.layers.scan"), false);
    page.value("dispatchEvent(new KeyboardEvent('keydown', {key: '5'}))");
    assert_eq!(page.value("tsense.layers.scan"), true);
    let distance = page.value("tsense.camera.distance").as_f64().unwrap();
    page.value("dispatchEvent(new KeyboardEvent('keydown', {key: '+'}))");
    assert!(page.value("tsense.camera.distance").as_f64().unwrap() < distance);
    page.value("document.getElementById('reset').click()");
    assert_eq!(page.value("tsense.camera.distance"), distance);
}

fn a_block_that_left_the_map_leaves_the_screen(page: &mut Browser, scene: &mut Scene, forest: &Forest) {
    let all = forest.blocks().len();
    let kept: BTreeSet<_> = forest.blocks().into_keys().take(all - 3).collect();
    let entries: Vec<_> = kept.into_iter().map(|key| CommitEntry { key, version: 1 }).collect();
    forest::send_commit(scene, &entries, 2, NOW);
    page.wait_for("tsense.drawnSnapshot === 2");
    assert_eq!(page.value("tsense.counts.blocks"), all - 3);
    assert_eq!(page.value("tsense.counts.textures"), all - 3 + 1, "a texture a block, and the grid's");
}

fn the_same_blocks_again_and_again_need_no_more_memory(page: &mut Browser, scene: &mut Scene, forest: &Forest) {
    let before = page.value("tsense.counts");
    for version in 3..23 {
        forest.send_map(scene, version, NOW);
        let (header, cells) = forest.grid(NOW);
        scene.grid(&header, &cells);
    }
    page.wait_for("tsense.drawnSnapshot === 22");
    let after = page.value("tsense.counts");
    assert_eq!(after["buffers"], before["buffers"]);
    assert_eq!(after["textures"], forest.blocks().len() + 1);
}

fn a_lost_bridge_is_shown_and_found_again(page: &mut Browser, server: Server, hub: Arc<Hub>) {
    let config = Config { listen: server.address().to_string(), ..Config::default() };
    drop(server);
    page.wait_for("tsense.connection === 'failed' && !document.getElementById('banner').hidden");
    let banner = page.value("document.getElementById('banner').textContent");
    assert!(banner.as_str().unwrap().contains("No connection to the bridge"), "{banner}");
    let server = Server::start(&config, hub).unwrap();
    page.wait_for("tsense.connection === 'running' && document.getElementById('banner').hidden");
    page.wait_for("tsense.drawnSnapshot === 22");
    drop(server);
}
