//! Vehicles, a station and the link between them in one thread, with a clock and a chance of their own.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tsense_bridge::fleet::{Answer, Vehicle};
use tsense_contract::{
    BlockPlace, FleetBlock, FleetBlockFile, FleetList, FleetPage, Object, ObjectsHeader, VehicleName, fleet_encode,
};
use tsense_geometry::Timestamp;
use tsense_kstore::Known;
use tsense_kstore::station::{Options, Station};

/// A numbered place of the wood: trees stand 3 m apart, and every vehicle is some centimetres off.
pub type Place = i64;

const TREES: u64 = 60;
const SPACING_M: f64 = 3.0;
const STEP_S: f64 = 0.5;

/// Seeded chance (xorshift).
pub struct Chance(u64);

impl Chance {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }
    pub fn below(&mut self, n: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % n
    }
    fn one_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }
}

/// Which tree a merged object is.
pub fn place_of(known: &Known) -> Place {
    let east_m = known.place_m[0] - 500_000.0;
    let place = (east_m / SPACING_M).round();
    assert!((east_m - place * SPACING_M).abs() < 0.2, "{east_m}");
    place as Place
}

/// A vehicle with its store and its files.
pub struct Car {
    pub vehicle: Vehicle,
    /// Place by id: the store; ids are never given twice.
    store: BTreeMap<u64, (Place, u32)>,
    next_id: u64,
    files: BTreeMap<BlockPlace, Vec<u8>>,
    is_cut: bool,
}

/// Something on its way.
struct Flying {
    at: u64,
    car: usize,
    what: Cargo,
}

enum Cargo {
    Question(Vec<u8>),
    Answer(Vec<u8>),
    News(Vec<u8>),
}

pub struct World {
    chance: Chance,
    folder: PathBuf,
    station: Option<Station>,
    cars: Vec<Car>,
    flying: Vec<Flying>,
    step: u64,
    is_healed: bool,
    pub answers: u64,
    pub restarts: u64,
}

/// What taking in whole lists cost the station.
pub struct Measured {
    pub seconds: f64,
    pub pages: usize,
    pub bytes: usize,
    pub merged: usize,
}

/// Vehicles that all see the same trees list them to a new station.
pub fn list_everything(folder: &Path, vehicles: usize, objects: usize) -> Measured {
    let now = Timestamp::from_ns(1_700_000_000_000_000_000);
    let mut cars: Vec<Car> = (0..vehicles).map(|i| Car::new(1 + i as u64)).collect();
    for (number, car) in cars.iter_mut().enumerate() {
        car.store = (0..objects as Place).map(|place| (1 + place as u64, (place, 0))).collect();
        let all: Vec<Object> = car.store.iter().map(|(id, seen)| object(*id, *seen, number)).collect();
        let header = ObjectsHeader { zone: 17, ..bytemuck::Zeroable::zeroed() };
        // The first answer only says which zone it is.
        for _ in 0..2 {
            car.vehicle.objects.take(&header, &all, now);
        }
    }
    let mut station = Station::open(options(folder)).unwrap().0;
    for (i, car) in cars.iter().enumerate() {
        station.hear(&format!("car{i}"), &car.vehicle.news(now), now);
    }
    let mut measured = Measured { seconds: 0.0, pages: 0, bytes: 0, merged: 0 };
    loop {
        let questions = station.questions(now);
        if questions.is_empty() {
            measured.merged = station.fleet().len();
            station.close().unwrap();
            return measured;
        }
        for (name, question) in questions {
            let car: usize = name.as_str()[3..].parse().unwrap();
            let Some(answer) = cars[car].answer(&question, now) else { continue };
            let start = std::time::Instant::now();
            station.take(name.as_str(), &answer, now).unwrap();
            measured.seconds += start.elapsed().as_secs_f64();
            (measured.pages, measured.bytes) = (measured.pages + 1, measured.bytes + answer.len());
        }
    }
}

fn options(folder: &Path) -> Options {
    Options {
        store: folder.join("fleet.gpkg"),
        blocks: Some(folder.join("blocks")),
        blocks_max_bytes: 1 << 30,
        store_max_mb: 1000,
        vehicles: Vec::new(),
        vehicles_max: 16,
        check_block,
    }
}

impl World {
    pub fn new(folder: &Path, chance: Chance, cars: usize) -> Self {
        let mut world = Self {
            chance,
            folder: folder.into(),
            station: None,
            cars: (0..cars).map(|i| Car::new(1 + i as u64)).collect(),
            flying: Vec::new(),
            step: 0,
            is_healed: false,
            answers: 0,
            restarts: 0,
        };
        world.open();
        world
    }

    pub fn station(&self) -> &Station {
        self.station.as_ref().unwrap()
    }

    pub fn store(&self) -> PathBuf {
        self.folder.join("fleet.gpkg")
    }

    /// Opens the station's store as it lies there: the one before was killed.
    fn open(&mut self) {
        self.station = None;
        let (station, notes) = Station::open(options(&self.folder)).unwrap();
        assert_eq!(notes, Vec::<String>::new());
        self.station = Some(station);
    }

    /// The station forgets a vehicle and is opened anew; the vehicle is away until it is `heal`ed.
    pub fn forget(&mut self, car: usize) {
        self.flying.clear();
        let name = VehicleName::new(&format!("car{car}")).unwrap();
        assert!(self.station.as_mut().unwrap().forget(&name).unwrap().is_some());
        assert_eq!(self.station.as_mut().unwrap().forget(&name).unwrap(), None);
        self.open();
    }

    fn now(&self) -> Timestamp {
        Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(self.step as f64 * STEP_S)
    }

    /// Half a second: the vehicles drive, the link does its worst, now and then somebody is restarted.
    pub fn step(&mut self, number: u64) {
        for car in 0..self.cars.len() {
            self.drive(car);
            if self.chance.one_in(15) {
                self.cars[car].is_cut = !self.cars[car].is_cut;
            }
            if self.chance.one_in(40) {
                self.restart_car(car);
            }
        }
        if self.chance.one_in(20) {
            self.open();
            self.restarts += 1;
        }
        self.communicate();
        assert!(number < 1 << 20);
    }

    /// The link is good, and everybody is still, until the station has everything.
    pub fn heal(&mut self) {
        self.is_healed = true;
        self.cars.iter_mut().for_each(|car| car.is_cut = false);
        let mut quiet = 0;
        for _ in 0..400 {
            self.communicate();
            let report = self.station().report(self.now());
            let is_done = report.iter().all(|v| v.lag == Some(0) && v.blocks_wanted == 0 && v.connected);
            quiet = if is_done && report.len() == self.cars.len() { quiet + 1 } else { 0 };
            // Longer than anything is on its way.
            if quiet == 15 {
                return;
            }
        }
        panic!("never: {:#?}", self.station().report(self.now()));
    }

    /// Trees are found, seen again, lost; blocks change.
    fn drive(&mut self, number: usize) {
        self.cars[number].change_store(&mut self.chance);
        if self.chance.one_in(3) {
            let key = [self.chance.below(5) as i32, number as i32, 0];
            let file = file_of(key, self.chance.below(1 << 30));
            let block = FleetBlock {
                voxel_size_m: 0.15,
                key,
                bytes: file.len() as u32,
                crc: crc32(&file),
                zone: 17,
                ..bytemuck::Zeroable::zeroed()
            };
            let car = &mut self.cars[number];
            car.files.insert(block.place(), file);
            car.vehicle.blocks.put(block);
        }
    }

    /// A vehicle's process starts again: its files are there, its lists are made anew.
    fn restart_car(&mut self, number: usize) {
        let car = &mut self.cars[number];
        car.vehicle = Vehicle::new(1_000 + self.step * 10 + number as u64);
        for (place, file) in &car.files {
            let (zone, south, voxel_size, key) = *place;
            let voxel_size_m = f64::from_bits(voxel_size);
            let (bytes, crc) = (file.len() as u32, crc32(file));
            let block =
                FleetBlock { number: 0, stamp_ns: 0, voxel_size_m, key, bytes, crc, zone, south, reserved: [0; 2] };
            car.vehicle.blocks.put(block);
        }
        self.restarts += 1;
    }

    fn communicate(&mut self) {
        self.step += 1;
        let now = self.now();
        for car in 0..self.cars.len() {
            self.cars[car].look_at_store(car, now);
            let news = self.cars[car].vehicle.news(now);
            self.send(car, Cargo::News(news));
        }
        let due: Vec<Flying> = self.flying.extract_if(.., |f| f.at <= self.step).collect();
        for Flying { car, what, .. } in due {
            self.deliver(car, what, now);
        }
        for (name, question) in self.station.as_mut().unwrap().questions(now) {
            let car = name.as_str()[3..].parse().unwrap();
            self.send(car, Cargo::Question(question));
        }
    }

    fn deliver(&mut self, car: usize, what: Cargo, now: Timestamp) {
        let (station, name) = (self.station.as_mut().unwrap(), format!("car{car}"));
        match what {
            Cargo::News(bytes) => station.hear(&name, &bytes, now),
            Cargo::Answer(bytes) => {
                self.answers += 1;
                station.take(&name, &bytes, now).unwrap();
            }
            Cargo::Question(bytes) => {
                if let Some(answer) = self.cars[car].answer(&bytes, now) {
                    self.send(car, Cargo::Answer(answer));
                }
            }
        }
    }

    /// Lost one time in five, repeated one time in five, damaged one time in ten, late by up to 5 s.
    fn send(&mut self, car: usize, what: Cargo) {
        if self.is_healed {
            return self.flying.push(Flying { at: self.step + 1, car, what });
        }
        if self.cars[car].is_cut || self.chance.one_in(5) {
            return;
        }
        let times = if self.chance.one_in(5) { 2 } else { 1 };
        for _ in 0..times {
            let mut bytes = what.bytes().to_vec();
            if self.chance.one_in(10) {
                let at = self.chance.below(bytes.len() as u64) as usize;
                bytes[at] ^= 1 << self.chance.below(8);
            }
            let at = self.step + 1 + if self.chance.one_in(4) { self.chance.below(10) } else { 0 };
            self.flying.push(Flying { at, car, what: what.of(bytes) });
        }
    }

    /// Bytes of any kind as news and as answers; how many.
    pub fn send_nonsense(&mut self, count: u64) -> u64 {
        let now = self.now();
        let page = FleetPage {
            list: FleetList::Objects.to_wire(),
            ask: u64::MAX,
            epoch: 7,
            count: u32::MAX,
            ..bytemuck::Zeroable::zeroed()
        };
        for i in 0..count {
            let mut bytes = match i % 4 {
                0 => fleet_encode(&page, &[1, 2, 3]),
                1 => self.cars[0].vehicle.news(now)[..i as usize % 40].to_vec(),
                2 => fleet_encode(&FleetBlockFile { ask: i, block: bytemuck::Zeroable::zeroed() }, b"no block"),
                _ => (0..self.chance.below(300)).map(|_| i as u8).collect(),
            };
            if i % 8 > 4 && !bytes.is_empty() {
                bytes[0] ^= 1;
            }
            let station = self.station.as_mut().unwrap();
            if i % 3 == 0 { station.hear("car0", &bytes, now) } else { station.take("car1", &bytes, now).unwrap() }
        }
        count
    }

    pub fn refused(&self) -> u64 {
        self.station().report(self.now()).iter().flat_map(|v| v.dropped.values()).sum()
    }

    /// Places that any vehicle reports.
    pub fn union(&self) -> Vec<Place> {
        union(self.cars.iter().map(Car::places))
    }

    /// Places that any but one reports.
    pub fn union_without(&self, car: usize) -> Vec<Place> {
        let others = self.cars.iter().enumerate().filter(|(i, _)| *i != car);
        union(others.map(|(_, other)| other.places()))
    }

    pub fn files_there(&self) -> BTreeMap<String, Vec<u8>> {
        let all = self.cars.iter().enumerate().flat_map(|(i, car)| car.files.iter().map(move |(p, f)| (i, p.3, f)));
        all.map(|(i, [x, y, z], file)| (format!("car{i}/17N-0.15m/{x}_{y}_{z}.tsmap"), file.clone())).collect()
    }

    pub fn files_here(&self) -> BTreeMap<String, Vec<u8>> {
        let root = self.folder.join("blocks");
        let entries = |folder: &Path| -> Vec<PathBuf> {
            std::fs::read_dir(folder).map_or(vec![], |all| all.map(|e| e.unwrap().path()).collect())
        };
        let maps = entries(&root).into_iter().flat_map(|car| entries(&car));
        let files = maps.flat_map(|map| entries(&map));
        let name = |path: &Path| path.strip_prefix(&root).unwrap().display().to_string();
        files.map(|path| (name(&path), std::fs::read(&path).unwrap())).collect()
    }
}

impl Cargo {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::Question(bytes) | Self::Answer(bytes) | Self::News(bytes) => bytes,
        }
    }
    fn of(&self, bytes: Vec<u8>) -> Self {
        match self {
            Self::Question(_) => Self::Question(bytes),
            Self::Answer(_) => Self::Answer(bytes),
            Self::News(_) => Self::News(bytes),
        }
    }
}

/// Places that are in any of the lists.
pub fn union(lists: impl Iterator<Item = Vec<Place>>) -> Vec<Place> {
    lists.flatten().collect::<std::collections::BTreeSet<_>>().into_iter().collect()
}

impl Car {
    pub fn new(epoch: u64) -> Self {
        let (store, files) = (BTreeMap::new(), BTreeMap::new());
        Self { vehicle: Vehicle::new(epoch), store, next_id: 1, files, is_cut: false }
    }

    /// Places that it reports.
    pub fn places(&self) -> Vec<Place> {
        self.store.values().map(|(place, _)| *place).collect()
    }

    /// Trees are found, seen again elsewhere by some centimetres, lost.
    pub fn change_store(&mut self, chance: &mut Chance) {
        for _ in 0..4 {
            let place = chance.below(TREES) as Place;
            let (is_lost, shift) = (chance.one_in(4), chance.below(5) as u32);
            match self.store.iter().find(|(_, (p, _))| *p == place).map(|(id, _)| *id) {
                Some(id) if is_lost => drop(self.store.remove(&id)),
                Some(id) => drop(self.store.insert(id, (place, shift))),
                None => {
                    self.store.insert(self.next_id, (place, shift));
                    self.next_id += 1;
                }
            }
        }
    }

    /// The walk over the store, in answers of seven objects.
    pub fn look_at_store(&mut self, number: usize, now: Timestamp) {
        for _ in 0..12 {
            let query = self.vehicle.objects.query();
            let rest = self.store.range(query.after_id + 1..);
            let objects: Vec<Object> = rest.take(7).map(|(id, seen)| object(*id, *seen, number)).collect();
            let truncated = u8::from(objects.len() == 7);
            let header = ObjectsHeader { zone: 17, truncated, ..bytemuck::Zeroable::zeroed() };
            self.vehicle.objects.take(&header, &objects, now);
            if self.vehicle.objects.query().after_id == 0 {
                return;
            }
        }
    }

    pub fn answer(&self, question: &[u8], now: Timestamp) -> Option<Vec<u8>> {
        match self.vehicle.answer(question, now).ok()? {
            Answer::Page(bytes) => Some(bytes),
            Answer::Later => None,
            Answer::File(ask, block) => {
                let file = self.files.get(&block.place()).cloned().unwrap_or_default();
                let block = FleetBlock { bytes: file.len() as u32, crc: crc32(&file), ..block };
                Some(fleet_encode(&FleetBlockFile { ask, block }, &file))
            }
        }
    }
}

/// A tree as a vehicle knows it: some centimetres off, by the vehicle and by when it was seen.
fn object(id: u64, (place, shift): (Place, u32), number: usize) -> Object {
    let off_m = 0.03 * number as f64 + 0.03 * f64::from(shift) - 0.08;
    Object {
        id,
        first_seen_ns: 1_600_000_000_000_000_000,
        last_seen_ns: 1_600_000_100_000_000_000,
        easting_m: 500_000.0 + SPACING_M * place as f64 + off_m,
        northing_m: 4_000_000.0,
        ground_m: 100.0,
        position_std_m: 0.05,
        dbh_m: 0.3,
        dbh_std_m: 0.02,
        height_m: f32::NAN,
        confidence: 3.0,
        sightings: 5 + shift,
        class: 1,
        reported: 1,
        reserved: [0; 6],
    }
}

/// A stand-in for a map file: its key, then anything.
fn file_of(key: [i32; 3], content: u64) -> Vec<u8> {
    [bytemuck::cast_slice(&key), content.to_le_bytes().as_slice()].concat()
}

fn check_block(file: &[u8]) -> Result<BlockPlace, String> {
    let key = file.first_chunk::<12>().ok_or("short")?;
    Ok((17, 0, 0.15_f64.to_bits(), bytemuck::pod_read_unaligned(key)))
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & (!(crc & 1)).wrapping_add(1)))
    })
}
