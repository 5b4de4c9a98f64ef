//! A station: the beams that left from about one place, sorted by direction.
//!
//! In: origins and ends in UTM, metres. Out: beams whose ends are relative to the station's base, so that an `f32` keeps
//! hundredths of a millimetre, in the order of their cells of direction. Adding is a push; sorting and thinning wait
//! until somebody looks ([`Station::settle`]).

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, SQRT_2, TAU};
use std::ops::Range;
use tsense_geometry::{Global, Point, Timestamp};

/// Origins within this of the one before count as the same, metres.
const SAME_ORIGIN_M: f32 = 0.002;

/// Two echoes of one beam lie farther apart than this, metres; repetitions of a beam do not.
const PAIR_APART_M: f32 = 0.3;
/// Sine of the angle below which two beams have one direction.
const PAIR_ANGLE: f32 = 4e-4;
/// Share of beams with a second echo above which a ladar sends several.
const PAIRS_SHARE: f64 = 0.000_5;

/// Cells of elevation in a band of the index, 4 degrees: some seven beams of a survey's station.
const BAND_CELLS: u32 = 16;
/// Beams in a column, on average, from which its bands are indexed.
const BANDS_FROM: usize = 16;

/// One beam of a station: 20 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Where it ends, relative to the station's base: east, north, up, metres.
    pub end_m: [f32; 3],
    /// Its cell of direction: azimuth in the high half, elevation in the low one.
    cell: u32,
    /// Index of its origin in the station.
    origin: u16,
    /// Whether something is at its end; else it ends at the usable range.
    pub is_return: bool,
    /// Whether nobody has looked at it yet.
    pub is_fresh: bool,
}

/// Whether two neighbours in the order of directions are echoes of one beam.
fn is_pair(a: &Beam, b: &Beam) -> bool {
    if a.cell != b.cell || a.origin != b.origin || !a.is_return || !b.is_return {
        return false;
    }
    let length = |v: [f32; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let ([ax, ay, az], [bx, by, bz]) = (a.end_m, b.end_m);
    let cross = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
    let (long, short) = (length(a.end_m), length(b.end_m));
    (long - short).abs() > PAIR_APART_M && length(cross) < PAIR_ANGLE * long * short
}

/// The index of a cell's band where every column has so many.
fn band_of(cell: u32, bands: u32) -> usize {
    ((cell >> 16) * bands + ((cell & 0xffff) / BAND_CELLS).min(bands - 1)) as usize
}

/// Tells multiples of a number by one product instead of a division (Lemire, Kaser and Kurz 2019).
fn multiples_of(step: u32) -> impl Fn(u32) -> bool + Copy {
    let inverse = (u64::MAX / u64::from(step.max(1))).wrapping_add(1);
    move |n| u64::from(n).wrapping_mul(inverse) <= inverse.wrapping_sub(1)
}

/// Odd powers of the arc tangent below tan(pi / 8), fitted at Chebyshev points: off by 1e-11 at most.
const ATAN: [f64; 7] = [
    0.999999999979,
    -0.333333321279,
    0.199998858985,
    -0.142816392561,
    0.110410541232,
    -0.0845910896992,
    0.047129968843,
];

/// `y.atan2(x)` to 1e-11, in a quarter of the time: every beam asks twice.
fn angle(y: f64, x: f64) -> f64 {
    let (short, long) = (y.abs().min(x.abs()), y.abs().max(x.abs()));
    // Around the diagonal: atan t = pi / 4 + atan((t - 1) / (t + 1)).
    let is_near = short <= (SQRT_2 - 1.0) * long;
    let (from, up, down) = if is_near { (0.0, short, long) } else { (FRAC_PI_4, short - long, short + long) };
    let t = if down > 0.0 { up / down } else { 0.0 };
    let eighth = from + t * ATAN.iter().rev().fold(0.0, |sum, factor| sum * (t * t) + factor);
    let quarter = if y.abs() > x.abs() { FRAC_PI_2 - eighth } else { eighth };
    let half = if x < 0.0 { PI - quarter } else { quarter };
    if y < 0.0 { -half } else { half }
}

/// Cells of direction: azimuth counter-clockwise from east, elevation from straight down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cells {
    /// Edge of a cell, radians.
    pub edge_rad: f64,
}

impl Cells {
    /// Columns of cells around the circle.
    fn turns(&self) -> u32 {
        (TAU / self.edge_rad) as u32 + 1
    }
    fn azimuth(&self, azimuth_rad: f64) -> u32 {
        (azimuth_rad.rem_euclid(TAU) / self.edge_rad) as u32
    }
    fn elevation(&self, elevation_rad: f64) -> u32 {
        ((elevation_rad + FRAC_PI_2).clamp(0.0, TAU) / self.edge_rad) as u32
    }
    fn of(&self, direction: [f64; 3]) -> u32 {
        let [x, y, z] = direction;
        self.azimuth(angle(y, x)) << 16 | self.elevation(angle(z, (x * x + y * y).sqrt()))
    }
}

/// Beams from about one place.
#[derive(Clone, Debug)]
pub struct Station {
    /// What ends and origins are relative to: the first beam's origin.
    pub base: Point<Global>,
    /// The ladar that they came from.
    pub ladar: u8,
    /// Stamp of the first beam.
    pub opened: Timestamp,
    /// Stamp of the newest beam.
    pub newest: Timestamp,
    origins_m: Vec<[f32; 3]>,
    beams: Vec<Beam>,
    /// Beams before this index are sorted and thinned.
    settled: usize,
    /// Some beams may be fresh.
    has_fresh: bool,
    /// Beams with a second echo.
    pairs: usize,
    /// Where the beams of each band of cells start, column by column, as of the last settling; one more than there are
    /// bands. Empty where there are so few beams that a search is as quick.
    starts: Vec<u32>,
    /// Bands of a column.
    bands: u32,
}

impl Station {
    /// A station without a beam.
    pub fn new(ladar: u8, base: Point<Global>, opened: Timestamp) -> Self {
        Self {
            base,
            ladar,
            opened,
            newest: opened,
            origins_m: Vec::new(),
            beams: Vec::new(),
            settled: 0,
            has_fresh: false,
            pairs: 0,
            starts: Vec::new(),
            bands: 1,
        }
    }

    /// All beams.
    pub fn beams(&self) -> &[Beam] {
        &self.beams
    }

    /// Where a beam left, relative to the base, metres.
    pub fn origin_m(&self, beam: &Beam) -> [f32; 3] {
        self.origins_m[beam.origin as usize]
    }

    /// Takes a beam in; false where the station holds as many origins as it can tell apart.
    pub fn push(
        &mut self,
        stamp: Timestamp,
        origin: Point<Global>,
        end: Point<Global>,
        is_return: bool,
        cells: Cells,
    ) -> bool {
        let from_m = (origin - self.base).xyz;
        let Some(at) = self.origin_index([from_m.x as f32, from_m.y as f32, from_m.z as f32]) else { return false };
        let (way, to_m) = ((end - origin).xyz, (end - self.base).xyz);
        let cell = cells.of([way.x, way.y, way.z]);
        let end_m = [to_m.x as f32, to_m.y as f32, to_m.z as f32];
        self.beams.push(Beam { end_m, cell, origin: at, is_return, is_fresh: true });
        (self.newest, self.has_fresh) = (self.newest.max(stamp), true);
        true
    }

    fn origin_index(&mut self, origin_m: [f32; 3]) -> Option<u16> {
        let same = |other: &[f32; 3]| (0..3).all(|axis| (other[axis] - origin_m[axis]).abs() <= SAME_ORIGIN_M);
        if !self.origins_m.last().is_some_and(same) {
            self.origins_m.push(origin_m);
        }
        u16::try_from(self.origins_m.len() - 1).ok()
    }

    /// Whether there may be beams that nobody has looked at yet.
    pub fn has_fresh(&self) -> bool {
        self.has_fresh
    }

    /// All beams were looked at.
    pub fn seen(&mut self) {
        if std::mem::take(&mut self.has_fresh) {
            self.beams.iter_mut().for_each(|beam| beam.is_fresh = false);
        }
    }

    /// Sorts by direction and thins every cell to its newest `per_cell_max` beams; how many went.
    pub fn settle(&mut self, per_cell_max: usize, cells: Cells) -> usize {
        if self.settled == self.beams.len() {
            return 0;
        }
        // Stable: within a cell the order stays that of arrival.
        self.beams.sort_by_key(|beam| beam.cell);
        let before = self.beams.len();
        let beams = &mut self.beams;
        let (mut write, mut from) = (0, 0);
        while from < before {
            let cell = beams[from].cell;
            let to = from + beams[from..].iter().take_while(|beam| beam.cell == cell).count();
            let kept = from.max(to.saturating_sub(per_cell_max));
            beams.copy_within(kept..to, write);
            (write, from) = (write + to - kept, to);
        }
        beams.truncate(write);
        self.settled = write;
        self.index_bands(cells);
        self.pairs = self.beams.windows(2).filter(|pair| is_pair(&pair[0], &pair[1])).count();
        before - write
    }

    fn index_bands(&mut self, cells: Cells) {
        self.starts.clear();
        let (columns, beams) = (cells.turns() as usize, self.beams.len());
        if beams < columns {
            return;
        }
        self.bands = if beams < BANDS_FROM * columns { 1 } else { cells.elevation(FRAC_PI_2) / BAND_CELLS + 1 };
        self.starts.resize(columns * self.bands as usize + 1, 0);
        for beam in &self.beams {
            self.starts[band_of(beam.cell, self.bands) + 1] += 1;
        }
        for i in 1..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
    }

    /// The beams from a cell on, in the order of their cells.
    fn beams_from(&self, cell: u32) -> &[Beam] {
        let near = match self.starts.is_empty() {
            true => 0..self.beams.len(),
            false => {
                let band = band_of(cell, self.bands);
                self.starts[band] as usize..self.starts[band + 1] as usize
            }
        };
        &self.beams[near.start + self.beams[near].partition_point(|beam| beam.cell < cell)..]
    }

    /// Whether beams have second echoes; a ladar that sends one echo sends the strongest.
    pub fn has_echo_pairs(&self) -> bool {
        self.pairs as f64 > PAIRS_SHARE * self.beams.len() as f64
    }

    /// Beams whose cells touch a range of azimuths (from, to; radians, counter-clockwise from east) and a range of
    /// elevations. The range of azimuths may reach over north or any other end of the circle. Of the cells above one
    /// another only every `step`-th is read; all beams of a cell stay together, so the echoes of a beam do.
    pub fn towards(
        &self,
        cells: Cells,
        azimuth_rad: Range<f64>,
        elevation_rad: Range<f64>,
        step: u32,
    ) -> impl Iterator<Item = &Beam> {
        let turns = cells.turns();
        let first = cells.azimuth(azimuth_rad.start);
        let count = (((azimuth_rad.end - azimuth_rad.start) / cells.edge_rad).clamp(0.0, f64::from(turns)) as u32 + 2)
            .min(turns);
        let (low, high) = (cells.elevation(elevation_rad.start), cells.elevation(elevation_rad.end));
        let is_multiple = multiples_of(step);
        (0..count).map(move |i| (first + i) % turns).flat_map(move |column| {
            let beams = self.beams_from(column << 16 | low).iter();
            beams.take_while(move |beam| beam.cell <= (column << 16 | high)).filter(move |beam| is_multiple(beam.cell))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So many beams in all directions.
    fn station(count: u32, cells: Cells) -> Station {
        let base = Point::new(369_000.0, 3_279_000.0, 30.0);
        let mut station = Station::new(0, base, Timestamp::default());
        for i in 0..count {
            let (azimuth, elevation) = (2.399_963 * f64::from(i), 1.5 * (1.7 * f64::from(i)).sin());
            let [x, y, z] = [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin()];
            let end = base + tsense_geometry::Vector::new(5.0 * x, 5.0 * y, 5.0 * z);
            assert!(station.push(Timestamp::default(), base, end, true, cells));
        }
        station.settle(1000, cells);
        station
    }

    #[test]
    fn the_angle_is_that_of_the_library_all_around() {
        let mut worst: f64 = 0.0;
        for i in -40_000..=40_000 {
            let a = 1e-4 * f64::from(i);
            let (y, x) = (3.0 * a.sin(), 3.0 * a.cos());
            worst = worst.max((angle(y, x) - y.atan2(x)).abs());
        }
        assert!(worst < 2e-11, "{worst}");
        let ends = [[0.0, 0.0], [0.0, 2.0], [2.0, 0.0], [0.0, -2.0], [-2.0, 0.0], [1.0, 1.0], [-1.0, -1.0]];
        assert!(ends.iter().all(|[y, x]| (angle(*y, *x) - y.atan2(*x)).abs() < 2e-11));
    }

    /// The plain version: every beam is asked.
    #[test]
    fn beams_towards_a_place_are_those_of_its_cells_with_and_without_an_index() {
        let cells = Cells { edge_rad: 0.00436 };
        let mut compared = 0;
        for count in [500, 5_000, 50_000] {
            let station = station(count, cells);
            for (azimuth, low, step) in [(0.5, -0.6, 1), (-0.04, -0.2, 3), (3.1, 1.2, 5), (4.0, -1.57, 1)] {
                let found = station.towards(cells, azimuth..azimuth + 0.1, low..low + 0.3, step);
                let (first, turns) = (cells.azimuth(azimuth), cells.turns());
                let columns: Vec<u32> = (0..24).map(|i| (first + i) % turns).collect();
                let rows = cells.elevation(low)..=cells.elevation(low + 0.3);
                let of = |column: &u32| {
                    let column = *column;
                    let is_in = |beam: &Beam| beam.cell >> 16 == column && rows.contains(&(beam.cell & 0xffff));
                    let beams: Vec<Beam> = station.beams().iter().copied().filter(is_in).collect();
                    beams.into_iter().filter(move |beam| beam.cell % step == 0)
                };
                let plain: Vec<Beam> = columns.iter().flat_map(of).collect();
                assert_eq!(found.copied().collect::<Vec<_>>(), plain);
                compared += plain.len();
            }
        }
        assert!(compared > 100, "{compared}");
    }
}
