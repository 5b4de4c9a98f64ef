//! Three vehicles and a station as real processes on loopback, one link cut and returned; a station that is killed again
//! and again while vehicles write.

use super::Scratch;
use super::harness::{self, PATIENCE, TestGraph, tsense};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tsense_contract::{Class, Detection, Detections, DetectionsHeader};
use tsense_kstore::persist::read_only;
use tsense_ports::{Outbox, Process};

/// `tsense station` as a process.
struct StationProcess {
    child: Child,
    lines: Arc<Mutex<Vec<Value>>>,
}

impl StationProcess {
    fn start(address: SocketAddr, store: &Path) -> Self {
        let mut command = tsense(&["station", "--json", "--report", "0.2s", "--listen", &address.to_string()]);
        command.arg("--store").arg(store).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let (lines, out) = (Arc::new(Mutex::new(Vec::new())), child.stdout.take().unwrap());
        let into = Arc::clone(&lines);
        std::thread::spawn(move || {
            for line in BufReader::new(out).lines().map_while(Result::ok) {
                into.lock().unwrap().extend(serde_json::from_str::<Value>(&line));
            }
        });
        Self { child, lines }
    }

    fn newest(&self) -> Option<Value> {
        self.lines.lock().unwrap().last().cloned()
    }

    /// Waits for a table of the vehicles.
    fn wait_until(&mut self, what: &str, reached: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        while start.elapsed() < 2 * PATIENCE {
            assert!(self.child.try_wait().unwrap().is_none(), "the station ended before: {what}");
            if let Some(line) = self.newest().filter(&reached) {
                return line;
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("never: {what}\n{:#?}", self.newest());
    }

    fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for StationProcess {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A link that can be cut: both ends see their connection end, and new ones are refused until it is mended.
struct Relay {
    address: SocketAddr,
    is_cut: Arc<AtomicBool>,
    open: Arc<Mutex<Vec<TcpStream>>>,
}

impl Relay {
    fn new(to: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let (is_cut, open) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Vec::new())));
        let (cut, streams) = (Arc::clone(&is_cut), Arc::clone(&open));
        std::thread::spawn(move || {
            for near in listener.incoming().map_while(Result::ok) {
                let Ok(far) = TcpStream::connect(to) else { continue };
                if cut.load(Ordering::SeqCst) {
                    continue;
                }
                streams.lock().unwrap().extend([near.try_clone().unwrap(), far.try_clone().unwrap()]);
                pump(near.try_clone().unwrap(), far.try_clone().unwrap());
                pump(far, near);
            }
        });
        Self { address, is_cut, open }
    }

    fn cut(&self) {
        self.is_cut.store(true, Ordering::SeqCst);
        for stream in self.open.lock().unwrap().drain(..) {
            let _ = stream.shutdown(std::net::Shutdown::Both);
        }
    }

    fn mend(&self) {
        self.is_cut.store(false, Ordering::SeqCst);
    }
}

fn pump(mut from: TcpStream, mut to: TcpStream) {
    std::thread::spawn(move || {
        let mut buffer = [0; 1 << 16];
        while let Ok(n @ 1..) = from.read(&mut buffer) {
            if to.write_all(&buffer[..n]).is_err() {
                break;
            }
        }
        let _ = to.shutdown(std::net::Shutdown::Both);
        let _ = from.shutdown(std::net::Shutdown::Both);
    });
}

fn free_address() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

/// A vehicle: a graph with a store and the process `fleet`; this test is its classifier.
struct Car {
    graph: TestGraph,
    /// Before the process that it belongs to.
    detections: Outbox<Detections>,
    process: Process,
    trees: Vec<i64>,
    snapshot: u64,
}

impl Car {
    fn start(name: &str, station: SocketAddr, trees: impl IntoIterator<Item = i64>) -> Self {
        let sections = format!(
            "[kstore]\nindependence_s = 0.1\nreport_span_s = 0.2\n[bridge]\nenabled = false\n\
             [bridge.fleet]\nenabled = true\nvehicle = {name:?}\nconnect = [\"{station}\"]\nobjects_period_s = 0.2\n"
        );
        let graph = TestGraph::start("", &sections);
        let mut process = graph.observer();
        let detections = process.outbox(None).unwrap();
        Self { graph, detections, process, trees: trees.into_iter().collect(), snapshot: 0 }
    }

    fn see(&mut self, off_m: f64) {
        self.process.wait(0.0);
        self.snapshot += 1;
        let now = self.process.clock().now();
        let header = DetectionsHeader {
            stamp_ns: now.ns,
            classified_ns: now.ns,
            epoch: 1,
            snapshot: self.snapshot,
            vehicle_m: [500_000.0, 4_000_000.0],
            zone: 17,
            south: 0,
            reserved: [0; 6],
        };
        let trees: Vec<Detection> = self.trees.iter().map(|tree| detection(*tree, off_m)).collect();
        self.detections.send(&header, &trees).unwrap();
    }
}

fn detection(tree: i64, off_m: f64) -> Detection {
    Detection {
        stamp_ns: 0,
        easting_m: 500_000.0 + 3.0 * tree as f64 + off_m,
        northing_m: 4_000_000.0,
        ground_m: 100.0,
        position_std_m: 0.05,
        dbh_m: 0.3,
        dbh_std_m: 0.02,
        height_m: 12.0,
        confidence: 0.9,
        arc_coverage: 0.4,
        lean_rad: [0.0; 2],
        class: Class::Tree.to_wire(),
        reserved: [0; 7],
    }
}

fn see(cars: &mut [Car], times: usize) {
    for _ in 0..times {
        for (i, car) in cars.iter_mut().enumerate() {
            car.see(0.04 * i as f64 - 0.04);
        }
        std::thread::sleep(Duration::from_millis(150));
    }
}

/// Vehicles by the object that they see, as QGIS would join them.
fn seen_by(store: &Path) -> BTreeMap<i64, Vec<String>> {
    let gpkg = geopackage::OpenOptions::new().open_read_only(store).unwrap();
    let sql =
        "SELECT o.id, s.vehicle FROM objects o JOIN sources s ON s.object_id = o.id WHERE s.present ORDER BY 1, 2";
    let mut found: BTreeMap<i64, Vec<String>> = BTreeMap::new();
    let mut statement = gpkg.connection().prepare(sql).unwrap();
    let mut rows = statement.query([]).unwrap();
    while let Some(row) = rows.next().unwrap() {
        found.entry(row.get(0).unwrap()).or_default().push(row.get(1).unwrap());
    }
    found
}

fn objects(line: &Value) -> u64 {
    line["objects"].as_u64().unwrap_or(0)
}

fn row<'l>(line: &'l Value, vehicle: &str) -> Option<&'l Value> {
    line["vehicles"].as_array()?.iter().find(|v| v["vehicle"] == vehicle)
}

fn is_settled(line: &Value) -> bool {
    let vehicles = line["vehicles"].as_array();
    vehicles.is_some_and(|all| all.iter().all(|v| v["connected"] == true && v["lag"] == 0))
}

#[test]
fn three_vehicles_and_a_station_with_a_link_that_is_cut_and_a_station_that_is_killed() {
    let scratch = Scratch::new("graphs");
    let (address, store) = (free_address(), scratch.0.join("fleet.gpkg"));
    let relay = Relay::new(address);
    let mut station = StationProcess::start(address, &store);
    // Trees 0 to 5, 3 to 8, 6 to 11: the union is 12, six of them seen by two.
    let mut cars = [
        Car::start("ash", address, 0..6),
        Car::start("birch", relay.address, 3..9),
        Car::start("cedar", address, 6..12),
    ];
    see(&mut cars, 12);
    station.wait_until("12 objects of three vehicles", |line| objects(line) == 12 && is_settled(line));
    only_loopback(&cars, &station);
    let before = seen_by(&store);
    let twice = before.values().filter(|vehicles| vehicles.len() == 2).count();
    assert_eq!((before.len(), twice), (12, 6), "{before:?}");

    relay.cut();
    cars[1].trees.extend(12..15);
    see(&mut cars, 12);
    let line = station.wait_until("birch is away", |line| row(line, "birch").is_some_and(|v| v["connected"] == false));
    assert_eq!(objects(&line), 12, "{line:#}");
    station.kill();
    station = StationProcess::start(address, &store);
    see(&mut cars, 4);
    relay.mend();
    station.wait_until("15 objects", |line| objects(line) == 15 && is_settled(line));
    let after = seen_by(&store);
    assert!(before.iter().all(|(id, vehicles)| after.get(id) == Some(vehicles)), "{before:?}\n{after:?}");
    assert_eq!(after.len(), 15);

    // A tree of one vehicle is gone: the station's goes with it. `tsense objects` reads the store.
    let listed = harness::output(&["objects", "--store", store.to_str().unwrap(), "--json"]);
    let listed: Value = serde_json::from_slice(&listed.stdout).unwrap();
    assert_eq!(listed["objects"].as_array().unwrap().len(), 15, "{listed:#}");
    for car in cars {
        drop((car.detections, car.process));
        car.graph.finish();
    }
}

/// With this configuration nobody listens but on loopback.
fn only_loopback(cars: &[Car], station: &StationProcess) {
    let pids: Vec<u32> = cars.iter().map(|car| car.graph.pid("fleet")).chain([station.child.id()]).collect();
    let inodes: Vec<String> = pids.iter().flat_map(|pid| sockets_of(*pid)).collect();
    let mut listening = 0;
    for table in ["/proc/net/tcp", "/proc/net/tcp6", "/proc/net/udp", "/proc/net/udp6"] {
        for line in std::fs::read_to_string(table).unwrap_or_default().lines().skip(1) {
            let fields: Vec<&str> = line.split_whitespace().collect();
            let is_open = fields[3] == "0A" || table.contains("udp");
            if is_open && inodes.iter().any(|inode| inode == fields[9]) {
                assert!(fields[1].starts_with("0100007F:"), "{table}: {line}");
                listening += 1;
            }
        }
    }
    assert_eq!(listening, 1, "the station listens, and nobody else");
}

fn sockets_of(pid: u32) -> Vec<String> {
    let folder: PathBuf = format!("/proc/{pid}/fd").into();
    let links = std::fs::read_dir(folder).unwrap().filter_map(|e| std::fs::read_link(e.ok()?.path()).ok());
    let names = links.map(|link| link.display().to_string());
    names.filter_map(|name| Some(name.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned())).collect()
}

/// Vehicles without graphs, on real links: what they hold changes all the time while the station is killed.
#[test]
fn a_station_that_is_killed_again_and_again_loses_and_doubles_nothing() {
    use tsense_bridge::fleet::link::VehicleLink;
    let scratch = Scratch::new("killed");
    let (address, store) = (free_address(), scratch.0.join("fleet.gpkg"));
    let mut station = StationProcess::start(address, &store);
    let fleet: Vec<Arc<Mutex<super::world::Car>>> =
        (0..3).map(|i| Arc::new(Mutex::new(super::world::Car::new(1 + i)))).collect();
    let links: Vec<VehicleLink> = fleet
        .iter()
        .enumerate()
        .map(|(i, car)| {
            let name = tsense_contract::VehicleName::new(&format!("car{i}")).unwrap();
            let car = Arc::clone(car);
            let answer = move |question: &[u8]| car.lock().unwrap().answer(question, clock());
            VehicleLink::open(&address.to_string(), &name, answer).unwrap()
        })
        .collect();
    let mut chance = super::Chance::new(5);
    let (mut kills, start) = (0, Instant::now());
    while kills < 25 {
        for _ in 0..20 + chance.below(60) {
            for (i, car) in fleet.iter().enumerate() {
                let mut car = car.lock().unwrap();
                car.change_store(&mut chance);
                car.look_at_store(i, clock());
                links[i].tell(car.vehicle.news(clock()));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        station.kill();
        kills += 1;
        // Whatever was on disk then is whole, and nothing is in it twice.
        let places = places(&store);
        assert!(places.windows(2).all(|pair| pair[0] < pair[1]), "kill {kills}: {places:?}");
        station = StationProcess::start(address, &store);
        std::thread::sleep(Duration::from_millis(chance.below(1500)));
    }
    let union = super::world::union(fleet.iter().map(|car| car.lock().unwrap().places()));
    let began = Instant::now();
    while places(&store) != union {
        assert!(began.elapsed() < PATIENCE, "{:?}\n{union:?}\n{:#?}", places(&store), station.newest());
        for (car, link) in fleet.iter().zip(&links) {
            link.tell(car.lock().unwrap().vehicle.news(clock()));
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    println!("{kills} kills in {:.0} s, {} objects, all there once", start.elapsed().as_secs_f64(), union.len());
}

fn clock() -> tsense_geometry::Timestamp {
    tsense_ports::Clock::start(1.0).now()
}

/// The objects on disk by their place.
fn places(store: &Path) -> Vec<super::Place> {
    let objects = if store.exists() { read_only(store).unwrap().objects } else { Vec::new() };
    let mut places: Vec<super::Place> = objects.iter().map(super::world::place_of).collect();
    places.sort_unstable();
    places
}
