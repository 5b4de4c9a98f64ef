//! `tsense imaging study`: the figures of `docs/imaging.md`: planes on curved ground, what a blur does, a moving person.

use super::blur::{Neighbours, blur_map};
use super::slices::{Slice, picture};
use super::{Blocks, MovingRow, moving};
use crate::bench::Recording;
use crate::bench::svg::{Axis, Chart, Series, svg};
use crate::commands::{Failure, Outcome, print};
use crate::files::{OutputError, can_be_written, write_bytes};
use clap::Args;
use serde::Serialize;
use serde_json::json;
use std::path::{Path, PathBuf};
use tsense_classifier::imaging::{hough_planes, plane_of_heights};
use tsense_contract::{BRICKS_PER_BLOCK, VoxelState, locate};
use tsense_geometry::{Point, VoxelIndex};
use tsense_mapper::Survey;
use tsense_simulator::{ORIGIN_M, RayCase, SceneName};

/// The figures of the documentation: planes on curved ground, blur, a moving person.
#[derive(Debug, Args)]
#[command(before_help = "Example:\n  tsense imaging study --plot-planes planes.svg --plot-blur blur.svg")]
pub struct StudyArgs {
    /// Seed of the scenes; the moving person is tried on this one and the two after it
    #[arg(long, value_name = "N", default_value_t = 7)]
    seed: u64,
    /// Draw the planes on curved ground
    #[arg(long, value_name = "FILE.svg")]
    plot_planes: Option<PathBuf>,
    /// Draw a slice of a map before and after the blur
    #[arg(long, value_name = "FILE.svg")]
    plot_blur: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Radii of curvature, metres; the last is all but flat.
const RADII_M: [f64; 9] = [10.0, 15.0, 20.0, 30.0, 50.0, 100.0, 200.0, 500.0, 1000.0];
/// The radius of the section that is drawn, metres.
const DRAWN_M: f64 = 40.0;
/// Edge of the patch of ground, voxels, and of a voxel, metres: a block's.
const PATCH: i32 = 100;
const VOXEL_M: f64 = 0.15;
/// Slope of the ground at its middle, east and north: between two bins of the angles.
const SLOPE: [f64; 2] = [0.06, 0.03];

/// Planes on ground of one curvature. Errors of the plane's height against the ground's, metres.
#[derive(Clone, Copy, Debug, Serialize)]
struct CurveRow {
    radius_m: f64,
    hough_rms_m: f64,
    hough_max_m: f64,
    /// Least squares over the voxels that the Hough plane holds.
    refined_rms_m: f64,
    least_squares_rms_m: f64,
    least_squares_max_m: f64,
    /// Share of the voxels in the Hough plane's bin.
    on_plane: f64,
}

/// What a blur does to a map.
#[derive(Clone, Debug, Serialize)]
struct BlurRow {
    weights: String,
    neighbours: &'static str,
    occupied: usize,
    /// Occupied voxels that touch no other.
    lone: usize,
    /// Mean and deviation of the occupancy of occupied voxels.
    occupancy_mean: f64,
    occupancy_std: f64,
}

/// Runs the command.
pub fn run(args: &StudyArgs) -> Outcome {
    args.plot_planes.iter().chain(&args.plot_blur).try_for_each(|file| can_be_written(file))?;
    let curves: Vec<CurveRow> = RADII_M.iter().filter_map(|radius_m| Some(curve(*radius_m)?.row)).collect();
    write_plot(args.plot_planes.as_deref(), || svg(&curve_charts(&curves)))?;
    let map = forest_map(args.seed)?;
    let blurs = blurs(&map);
    write_plot(args.plot_blur.as_deref(), || {
        picture(&blurs.iter().map(|(row, map)| slice(row, map)).collect::<Vec<_>>())
    })?;
    let rows: Vec<&BlurRow> = blurs.iter().map(|(row, _)| row).collect();
    let mut movings = Vec::new();
    for seed in (0..3).map(|i| args.seed.wrapping_add(i)) {
        for scene in [SceneName::Person, SceneName::Forest, SceneName::Grass] {
            movings.push(moving(scene, seed)?);
        }
    }
    if args.json {
        return print(&format!("{}\n", json!({ "planes": curves, "blur": rows, "moving": movings })));
    }
    print(&text(&curves, &rows, &movings))
}

fn write_plot(file: Option<&Path>, text: impl FnOnce() -> String) -> Result<(), OutputError> {
    file.map_or(Ok(()), |file| write_bytes(file, text()))
}

/// Ground curved along x, about its middle, metres.
fn ground_m(radius_m: f64, x: f64, y: f64) -> f64 {
    SLOPE[0] * x + SLOPE[1] * y - x * x / (2.0 * radius_m)
}

/// Heights of planes over a place.
type Height = Box<dyn Fn(f64, f64) -> f64>;

struct Curve {
    row: CurveRow,
    hough: Height,
    least_squares: Height,
}

/// Ground as voxels hold it, and the planes through it.
fn curve(radius_m: f64) -> Option<Curve> {
    let places: Vec<[f64; 2]> = (0..PATCH * PATCH)
        .map(|i| [i % PATCH, i / PATCH].map(|c| (f64::from(c - PATCH / 2) + 0.5) * VOXEL_M))
        .collect();
    let voxel = |[x, y]: [f64; 2]| [x, y, ((ground_m(radius_m, x, y) / VOXEL_M).floor() + 0.5) * VOXEL_M];
    let points: Vec<[f64; 3]> = places.iter().map(|place| voxel(*place)).collect();
    let plane = hough_planes(&points, VOXEL_M, 1).pop()?;
    let [nx, ny, nz] = plane.normal();
    let hough = move |x: f64, y: f64| (plane.rho_m - nx * x - ny * y) / nz;
    let on: Vec<[f64; 3]> = points.iter().copied().filter(|point| plane.distance_m(*point).abs() <= VOXEL_M).collect();
    let height = |[a, b, c]: [f64; 3]| move |x: f64, y: f64| a * x + b * y + c;
    let (refined, least_squares) = (height(plane_of_heights(&on)?), height(plane_of_heights(&points)?));
    let errors = |plane: &dyn Fn(f64, f64) -> f64| {
        let (mut sum, mut most) = (0.0, 0.0f64);
        for [x, y] in &places {
            let error = plane(*x, *y) - ground_m(radius_m, *x, *y);
            (sum, most) = (sum + error * error, most.max(error.abs()));
        }
        ((sum / places.len() as f64).sqrt(), most)
    };
    let ((hough_rms_m, hough_max_m), (least_squares_rms_m, least_squares_max_m)) =
        (errors(&hough), errors(&least_squares));
    let row = CurveRow {
        radius_m,
        hough_rms_m,
        hough_max_m,
        refined_rms_m: errors(&refined).0,
        least_squares_rms_m,
        least_squares_max_m,
        on_plane: plane.votes as f64 / points.len() as f64,
    };
    Some(Curve { row, hough: Box::new(hough), least_squares: Box::new(least_squares) })
}

fn curve_charts(rows: &[CurveRow]) -> Vec<Chart> {
    let series = |name, value: fn(&CurveRow) -> f64| Series {
        name,
        points: rows.iter().map(|row| [row.radius_m, value(row)]).collect(),
    };
    let errors = Chart {
        title: "Error of a plane on curved ground",
        x: Axis { label: "radius of curvature, m", is_log: true },
        y: Axis { label: "rms over 15 x 15 m, m", is_log: true },
        series: vec![
            series("Hough, 40 x 20 bins", |row| row.hough_rms_m),
            series("least squares", |row| row.least_squares_rms_m),
            series("fit to its voxels", |row| row.refined_rms_m),
        ],
    };
    let Some(drawn) = curve(DRAWN_M) else { return vec![errors] };
    let line = |name, height: &dyn Fn(f64, f64) -> f64| Series {
        name,
        points: (0..=PATCH)
            .map(|i| f64::from(i - PATCH / 2) * VOXEL_M)
            .map(|x| [x + 7.5, height(x, 0.0) + 2.0])
            .collect(),
    };
    let section = Chart {
        title: "Section, radius 40 m",
        x: Axis { label: "east, m", is_log: false },
        y: Axis { label: "height, m", is_log: false },
        series: vec![
            line("ground", &|x, y| ground_m(DRAWN_M, x, y)),
            line("Hough plane", &drawn.hough),
            line("least squares", &drawn.least_squares),
        ],
    };
    vec![section, errors]
}

/// A tripod's map of the forest, and the slice that is drawn.
fn forest_map(seed: u64) -> Result<Blocks, Failure> {
    let scene = std::sync::Arc::new(tsense_simulator::Scene::new(SceneName::Forest, seed));
    let options = tsense_simulator::RayOptions { case: RayCase::Clipped, ..Default::default() };
    let recording = Recording::cast("forest", scene, &options, 20.0).map_err(|e| Failure::new(6, e))?;
    let config = Survey::config_for(recording.low, recording.high, VOXEL_M, 2.7);
    let middle: Point<_> = recording.low + (recording.high - recording.low).scaled(0.5);
    let mut survey = Survey::new(&config, middle).map_err(|e| Failure::new(2, e))?;
    for scan in &recording.scans {
        for beam in &scan.beams {
            survey.insert(scan.stamp, beam);
        }
    }
    Ok(survey.finish().blocks().map(|(key, bricks)| (key, bricks.to_vec())).collect())
}

fn blurs(map: &Blocks) -> Vec<(BlurRow, Blocks)> {
    let case = |weights: &[f32], neighbours| {
        let blurred = if weights.len() < 2 { map.clone() } else { blur_map(map, weights, neighbours) };
        let words: Vec<String> = weights.iter().map(f32::to_string).collect();
        let (name, words) = (if neighbours == Neighbours::All { "all" } else { "known" }, words.join(","));
        (measure(&blurred, words, name), blurred)
    };
    vec![
        case(&[1.0], Neighbours::Known),
        case(&[2.0, 1.0], Neighbours::Known),
        case(&[2.0, 1.0], Neighbours::All),
        case(&[4.0, 2.0, 1.0], Neighbours::Known),
    ]
}

fn state(map: &Blocks, voxel: VoxelIndex) -> (VoxelState, i8) {
    let (key, place, inner) = locate(voxel);
    let brick = map.get(&key).and_then(|bricks| bricks.get(place));
    brick.map_or((VoxelState::Unknown, 0), |brick| (brick.state(inner), brick.occupancy[inner]))
}

fn measure(map: &Blocks, weights: String, neighbours: &'static str) -> BlurRow {
    let (mut occupied, mut lone, mut sum, mut squares) = (0, 0, 0.0, 0.0);
    for (key, bricks) in map {
        for (place, brick) in bricks.iter().enumerate().take(BRICKS_PER_BLOCK) {
            for i in (0..64).filter(|i| brick.state(*i) == VoxelState::Occupied) {
                let value = f64::from(brick.occupancy[i]);
                (occupied, sum, squares) = (occupied + 1, sum + value, squares + value * value);
                let voxel = crate::mapfile::points::voxel_of(*key, place, i);
                let touches = (0..27).filter(|n| *n != 13).any(|n| {
                    let step = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
                    state(map, [0, 1, 2].map(|axis| voxel[axis] + step[axis])).0 == VoxelState::Occupied
                });
                lone += usize::from(!touches);
            }
        }
    }
    let mean = sum / f64::from(occupied.max(1));
    let std = (squares / f64::from(occupied.max(1)) - mean * mean).max(0.0).sqrt();
    BlurRow { weights, neighbours, occupied: occupied as usize, lone, occupancy_mean: mean, occupancy_std: std }
}

/// Twenty metres from west to east, six high, through the trees four metres north of the scene's middle.
fn slice(row: &BlurRow, map: &Blocks) -> Slice {
    let first = [ORIGIN_M[0], ORIGIN_M[1] + 4.0, ORIGIN_M[2] - 1.0].map(|m| (m / VOXEL_M).floor() as i32);
    let (width, rows) = (133, 40);
    let value = |i: i32| match state(map, [first[0] + i % width, first[1], first[2] + i / width]) {
        (VoxelState::Unknown, _) => None,
        (_, occupancy) => Some(f32::from(occupancy)),
    };
    let title = match row.weights.as_str() {
        "1" => "as mapped".to_owned(),
        weights => format!("blurred, weights {weights}, {} neighbours", row.neighbours),
    };
    Slice { title, width: width as usize, values: (0..width * rows).map(value).collect() }
}

fn text(curves: &[CurveRow], blurs: &[&BlurRow], movings: &[MovingRow]) -> String {
    let mut text = String::from(
        "planes on curved ground, 15 x 15 m, errors in metres\n\
         radius m  Hough rms   max   refined rms  least squares rms   max   on plane %\n",
    );
    for c in curves {
        let (hough, squares) = ((c.hough_rms_m, c.hough_max_m), (c.least_squares_rms_m, c.least_squares_max_m));
        text.push_str(&format!("{:8.0} {:10.3} {:5.2} {:13.3}", c.radius_m, hough.0, hough.1, c.refined_rms_m));
        text.push_str(&format!(" {:18.3} {:5.2} {:12.0}\n", squares.0, squares.1, 100.0 * c.on_plane));
    }
    text.push_str("blur\nweights  neighbours  occupied    lone  occupancy mean, deviation\n");
    for b in blurs {
        text.push_str(&format!("{:8} {:10} {:9} {:7}", b.weights, b.neighbours, b.occupied, b.lone));
        text.push_str(&format!(" {:10.1} {:10.1}\n", b.occupancy_mean, b.occupancy_std));
    }
    text.push_str("a person who walked over\nscene   seed  came, off m  left, off m  false things\n");
    let metres = |off_m: Option<f64>| off_m.map_or("not found".into(), |m| format!("{m:.2}"));
    for m in movings {
        let (came, left) = (metres(m.came_off_m), metres(m.left_off_m));
        text.push_str(&format!("{:7} {:5} {came:>12} {left:>12} {:13}\n", m.scene, m.seed, m.false_things));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The thesis's finding (figure 3-13), with figures: the more the ground curves, the farther it departs.
    #[test]
    fn a_plane_departs_from_curved_ground_and_least_squares_less_than_hough() {
        let [tight, flat] = [15.0, 1000.0].map(|radius_m| curve(radius_m).unwrap().row);
        assert!(tight.hough_rms_m > 2.0 * flat.hough_rms_m && tight.hough_max_m > 1.0, "{tight:?}");
        for row in [tight, flat] {
            assert!(row.least_squares_rms_m <= row.hough_rms_m, "{row:?}");
        }
        // A parabola of sagitta s departs from its best line by s / 3 sqrt(5) * 2: 7.5^2 / 30 * 0.298.
        assert!((tight.least_squares_rms_m - 0.559).abs() < 0.02, "{tight:?}");
        assert!(flat.least_squares_rms_m < 0.03 && flat.on_plane < 1.0, "{flat:?}");
    }
}
