//! The server over a real loopback socket: who is refused, what a slow client costs, what a layer switch does.

#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "common/http.rs"]
mod http;

use http::{ask, get, read_message, send_text, upgrade};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tsense_bridge::Config;
use tsense_bridge::web::frames::{Frame, Kind, json_frame, parse};
use tsense_bridge::web::hub::Hub;
use tsense_bridge::web::server::Server;
use tsense_bridge::web::slots::Slot;

fn serve(max_clients: usize) -> (Server, Arc<Hub>) {
    let hub = Arc::new(Hub::default());
    let config = Config { listen: "127.0.0.1:0".into(), max_clients, ..Config::default() };
    (Server::start(&config, Arc::clone(&hub)).unwrap(), hub)
}

#[test]
fn foreign_hosts_and_origins_get_403_with_a_reason_and_this_page_does_not() {
    let (server, _hub) = serve(8);
    let address = server.address();
    let own = format!("Host: {address}");
    for (host, origin, expected) in [
        (own.as_str(), format!("Origin: http://{address}"), "101"),
        (&own, "Origin: http://evil.example".into(), "403"),
        (&own, "Origin: null".into(), "403"),
        (&own, "Origin: http://localhost:3000".into(), "403"),
        ("Host: evil.example", "Origin: http://evil.example".into(), "403"),
        ("X-Nothing: 1", "X-Nothing: 2".into(), "403"),
    ] {
        let (_, head) = ask(address, "/ws", &upgrade(host, &origin));
        assert!(head.starts_with(&format!("HTTP/1.1 {expected}")), "{host}, {origin}: {head}");
    }
    for path in ["/", "/health", "/main.js", "/metrics", "/nothing"] {
        let (_, head) = ask(address, path, &["Host: rebound.example"]);
        assert!(head.starts_with("HTTP/1.1 403"), "{path}: {head}");
    }
    let (mut refused, _) = ask(address, "/", &["Host: rebound.example", "Connection: close"]);
    let mut reason = String::new();
    std::io::Read::read_to_string(&mut refused, &mut reason).unwrap();
    assert!(reason.contains("rebound.example") && reason.contains("allowed_hosts"), "{reason}");
}

#[test]
fn the_page_its_health_and_its_headers_are_there() {
    let (server, hub) = serve(8);
    hub.set_report(serde_json::json!({"state": "running", "counters": {"beams_per_s": 5.0}}));
    let (head, page) = get(server.address(), "/");
    assert!(page.starts_with("<!doctype html>"));
    for header in
        ["content-security-policy: default-src 'none'", "x-content-type-options: nosniff", "x-frame-options: DENY"]
    {
        assert!(head.contains(header), "{header} is missing: {head}");
    }
    let (_, health) = get(server.address(), "/health");
    let health: serde_json::Value = serde_json::from_str(&health).unwrap();
    assert_eq!((&health["state"], &health["clients"]), (&"running".into(), &0.into()));
    assert_eq!(get(server.address(), "/metrics").1, "tsense_bridge_clients 0\ntsense_bridge_beams_per_s 5.0\n");
    assert!(get(server.address(), "/../Cargo.toml").0.starts_with("HTTP/1.1 404"));
}

#[test]
fn a_taken_port_is_an_error_that_says_what_to_do() {
    let (server, hub) = serve(8);
    let config = Config { listen: server.address().to_string(), ..Config::default() };
    let error = Server::start(&config, hub).unwrap_err().to_string();
    assert!(error.contains(&server.address().to_string()) && error.contains("[bridge] listen"), "{error}");
}

#[test]
fn viewers_beyond_the_limit_are_turned_away_and_places_come_free() {
    let (server, hub) = serve(1);
    let (host, origin) = (format!("Host: {}", server.address()), format!("Origin: http://{}", server.address()));
    let (first, head) = ask(server.address(), "/ws", &upgrade(&host, &origin));
    assert!(head.starts_with("HTTP/1.1 101"));
    let (_, head) = ask(server.address(), "/ws", &upgrade(&host, &origin));
    assert!(head.starts_with("HTTP/1.1 503"), "{head}");
    drop(first);
    let start = Instant::now();
    while hub.clients() > 0 {
        assert!(start.elapsed() < Duration::from_secs(10), "the place was not given back");
        std::thread::sleep(Duration::from_millis(10));
    }
    let (_, head) = ask(server.address(), "/ws", &upgrade(&host, &origin));
    assert!(head.starts_with("HTTP/1.1 101"), "{head}");
}

#[test]
fn a_viewer_gets_the_newest_of_the_layers_it_wants() {
    let (server, hub) = serve(8);
    let hello = |text: &str| json_frame(Kind::Hello, 0, &text.into());
    let grid = |text: &str| json_frame(Kind::Grid, 0, &text.into());
    hub.put(Slot::Only(Kind::Hello), hello("hello"));
    let (host, origin) = (format!("Host: {}", server.address()), format!("Origin: http://{}", server.address()));
    let (mut socket, _) = ask(server.address(), "/ws", &upgrade(&host, &origin));
    let mut next = || String::from_utf8(parse(&read_message(&mut socket)).unwrap().1.to_vec()).unwrap();
    assert_eq!(next(), "\"hello\"");
    hub.put(Slot::Only(Kind::Grid), grid("a grid"));
    assert_eq!(next(), "\"a grid\"");
    send_text(&mut socket, "nonsense that is ignored");
    send_text(&mut socket, r#"{"want": ["counters"]}"#);
    std::thread::sleep(Duration::from_millis(300));
    hub.put(Slot::Only(Kind::Grid), grid("not wanted"));
    hub.put(Slot::Only(Kind::Counters), json_frame(Kind::Counters, 0, &1.into()));
    let (header, payload) = (read_message(&mut socket), b"1");
    assert_eq!(parse(&header).unwrap().1, payload);
}

/// Resident memory of this process, bytes.
fn resident_bytes() -> usize {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap();
    text.split(' ').nth(1).unwrap().parse::<usize>().unwrap() * 4096
}

#[test]
fn a_client_that_never_reads_costs_little_and_holds_nobody_up() {
    const FRAME_BYTES: usize = 256 << 10;
    let (server, hub) = serve(8);
    let (host, origin) = (format!("Host: {}", server.address()), format!("Origin: http://{}", server.address()));
    let sleepers: Vec<_> = (0..4).map(|_| ask(server.address(), "/ws", &upgrade(&host, &origin)).0).collect();
    let frame = |i: u32| {
        let mut bytes = vec![0u8; FRAME_BYTES];
        bytes[..4].copy_from_slice(&i.to_le_bytes());
        Frame::from(bytes)
    };
    for i in 0..64 {
        hub.put(Slot::Block([0, 0, i]), frame(0));
    }
    std::thread::sleep(Duration::from_millis(300));
    let (before, mut slowest) = (resident_bytes(), Duration::ZERO);
    for i in 0..4096u32 {
        let frame = frame(i);
        let start = Instant::now();
        hub.put(Slot::Block([0, 0, i as i32 % 64]), frame);
        slowest = slowest.max(start.elapsed());
    }
    let grown = resident_bytes().saturating_sub(before);
    println!("1 GB fed past 4 sleeping clients: memory grew {} kB, slowest put {slowest:?}", grown >> 10);
    assert_eq!(hub.bytes(), 64 * FRAME_BYTES);
    assert!(grown < 4 * (8 << 20), "{grown} bytes for 4 clients");
    assert!(slowest < Duration::from_millis(500), "the feeding thread was held up for {slowest:?}");
    drop(sleepers);
}
