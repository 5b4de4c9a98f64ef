//! `tsense imaging planes`: the dominant planes of a map file by the Hough transform, 40 x 20 bins. Thesis (2-17).

use super::{Blocks, has_extension, read_map};
use crate::commands::{Failure, Outcome, print};
use crate::files::{OutputError, write_whole};
use crate::mapfile::ply;
use crate::mapfile::points::voxel_of;
use clap::Args;
use serde::Serialize;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};
use tsense_classifier::imaging::{HoughPlane, hough_planes, planes_in_turn};
use tsense_contract::{BRICKS_PER_BLOCK, VoxelState};
use tsense_geometry::VoxelGrid;
use tsense_mapper::tsmap::MapFileHeader;

/// Most planes that may be asked for.
const PLANES_MAX: usize = 255;
/// Colours of the first planes; later ones begin anew (Okabe and Ito).
const COLORS: [[u8; 3]; 6] =
    [[0, 158, 115], [213, 94, 0], [0, 114, 178], [204, 121, 167], [230, 159, 0], [86, 180, 233]];

/// Find the planes that most occupied voxels lie on.
#[derive(Debug, Args)]
#[command(before_help = "Example:\n  tsense imaging planes now.tsmap --count 3 --out planes.ply")]
pub struct PlanesArgs {
    /// The map file
    file: PathBuf,
    /// Planes wanted
    #[arg(long, value_name = "N", default_value_t = 3)]
    count: usize,
    /// Width of a bin of the distance rho, metres; a voxel by default
    #[arg(long, value_name = "M")]
    rho_bin: Option<f64>,
    /// Only voxels in this box: west, south, low, east, north, high, metres
    #[arg(long, value_name = "W,S,L,E,N,H", value_delimiter = ',', num_args = 1, allow_hyphen_values = true)]
    r#box: Option<Vec<f64>>,
    /// The strongest bins of one vote, as in the thesis; otherwise the points of a plane do not vote for the next
    #[arg(long)]
    one_vote: bool,
    /// Least number of voxels on a plane
    #[arg(long, value_name = "N", default_value_t = 50)]
    votes_min: usize,
    /// Write the planes (.csv) or the occupied voxels coloured by plane (.ply; scalar_plane is 0 for none)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// A plane normal . (x, y, z) = d in the map's coordinates.
#[derive(Clone, Debug, Serialize)]
pub struct Plane {
    /// Direction of the normal's projection from east, counter-clockwise, degrees.
    pub theta_deg: f64,
    /// Angle of the normal from the vertical, degrees.
    pub phi_deg: f64,
    /// Distance from the origin of the vote along the normal, metres.
    pub rho_m: f64,
    /// East, north, up.
    pub normal: [f64; 3],
    /// Distance from the origin of the coordinates along the normal, metres.
    pub d_m: f64,
    /// Voxels in its bin.
    pub votes: usize,
    /// Root mean square distance of the voxels within a bin's width, metres.
    pub rms_m: f64,
}

/// Runs the command.
pub fn run(args: &PlanesArgs) -> Outcome {
    check(args)?;
    let (header, blocks) = read_map(&args.file)?;
    let bin_m = args.rho_bin.unwrap_or(header.voxel_size_m);
    let points = occupied_points(&blocks, &header, args.r#box.as_deref())?;
    if points.is_empty() {
        return Err(Failure::new(1, format!("{}: no occupied voxel there to vote", args.file.display())));
    }
    // The origin of the vote lies amid the points: far from it a degree is metres.
    let origin_m = middle(&points);
    let local: Vec<[f64; 3]> = points.iter().map(|p| [0, 1, 2].map(|axis| p[axis] - origin_m[axis])).collect();
    let mut found = match args.one_vote {
        true => hough_planes(&local, bin_m, args.count),
        false => planes_in_turn(&local, bin_m, args.count, args.votes_min),
    };
    found.retain(|plane| plane.votes >= args.votes_min);
    let planes: Vec<Plane> = found.iter().map(|plane| describe(plane, &local, origin_m, bin_m)).collect();
    match args.out.as_deref() {
        Some(out) if has_extension(out, "csv") => write_csv(out, &planes)?,
        Some(out) => write_ply(out, &points, &owners(&found, &local, bin_m), &header)?,
        None => {}
    }
    if args.json {
        let value = json!({ "points": points.len(), "rho_bin_m": bin_m, "origin_m": origin_m, "planes": planes });
        return print(&format!("{value}\n"));
    }
    print(&text(&planes, points.len()))
}

fn check(args: &PlanesArgs) -> Result<(), Failure> {
    let known = args.out.as_deref().is_none_or(|out| has_extension(out, "csv") || has_extension(out, "ply"));
    let box_is_sound = args.r#box.as_ref().is_none_or(|b| b.len() == 6 && (0..3).all(|axis| b[axis] < b[axis + 3]));
    let fault = if !known {
        "--out: a name that ends in .csv or .ply is wanted".to_owned()
    } else if !box_is_sound {
        "--box: six numbers are wanted, west,south,low,east,north,high, each of the last three above its first".into()
    } else if !(1..=PLANES_MAX).contains(&args.count) {
        format!("--count {}: from 1 to {PLANES_MAX} are possible", args.count)
    } else if args.rho_bin.is_some_and(|bin_m| !(0.001..=100.0).contains(&bin_m)) {
        "--rho-bin: from 0.001 to 100 m are possible".into()
    } else {
        return Ok(());
    };
    Err(Failure::new(2, fault))
}

fn occupied_points(blocks: &Blocks, header: &MapFileHeader, within: Option<&[f64]>) -> Result<Vec<[f64; 3]>, Failure> {
    let grid =
        VoxelGrid::new(header.voxel_size_m).ok_or_else(|| Failure::new(6, "the map's voxel size is no length"))?;
    let inside = |p: &[f64; 3]| within.is_none_or(|b| (0..3).all(|axis| b[axis] <= p[axis] && p[axis] <= b[axis + 3]));
    let mut points = Vec::new();
    for (key, bricks) in blocks {
        for (place, brick) in bricks.iter().enumerate().take(BRICKS_PER_BLOCK) {
            let occupied = (0..64).filter(|i| brick.state(*i) == VoxelState::Occupied);
            points.extend(occupied.map(|i| grid.center_of(voxel_of(*key, place, i)).to_array()).filter(inside));
        }
    }
    Ok(points)
}

fn middle(points: &[[f64; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / points.len() as f64)
}

fn describe(plane: &HoughPlane, local: &[[f64; 3]], origin_m: [f64; 3], bin_m: f64) -> Plane {
    let normal = plane.normal();
    let near = local.iter().map(|p| plane.distance_m(*p)).filter(|d| d.abs() <= bin_m);
    let (sum, count) = near.fold((0.0, 0usize), |(sum, count), d| (sum + d * d, count + 1));
    Plane {
        theta_deg: plane.theta_rad.to_degrees(),
        phi_deg: plane.phi_rad.to_degrees(),
        rho_m: plane.rho_m,
        normal,
        d_m: plane.rho_m + (0..3).map(|axis| normal[axis] * origin_m[axis]).sum::<f64>(),
        votes: plane.votes,
        rms_m: (sum / count.max(1) as f64).sqrt(),
    }
}

/// For every point the first plane that it lies on, counted from 1; 0 for none.
fn owners(planes: &[HoughPlane], local: &[[f64; 3]], bin_m: f64) -> Vec<u8> {
    let owner = |p: &[f64; 3]| planes.iter().position(|plane| plane.distance_m(*p).abs() <= bin_m);
    local.iter().map(|p| owner(p).map_or(0, |i| i as u8 + 1)).collect()
}

fn text(planes: &[Plane], points: usize) -> String {
    let mut text = format!("{points} occupied voxels, {} planes\n", planes.len());
    if !planes.is_empty() {
        text.push_str("   votes  theta deg  phi deg    rho m    rms m   normal (east, north, up)\n");
    }
    for p in planes {
        let [e, n, u] = p.normal;
        let (votes, angles) = (p.votes, format!("{:9.1} {:8.1}", p.theta_deg, p.phi_deg));
        let (rho_m, rms_m) = (p.rho_m, p.rms_m);
        text.push_str(&format!("{votes:8}  {angles} {rho_m:8.3} {rms_m:8.3}   {e:.3}, {n:.3}, {u:.3}\n"));
    }
    text
}

fn write_csv(path: &Path, planes: &[Plane]) -> Result<(), OutputError> {
    write_whole(path, |writer| {
        writeln!(writer, "theta_deg,phi_deg,rho_m,normal_east,normal_north,normal_up,d_m,votes,rms_m")?;
        for p in planes {
            let [e, n, u] = p.normal;
            let (theta, phi) = (p.theta_deg, p.phi_deg);
            writeln!(
                writer,
                "{theta},{phi},{:.4},{e:.6},{n:.6},{u:.6},{:.4},{},{:.4}",
                p.rho_m, p.d_m, p.votes, p.rms_m
            )?;
        }
        Ok::<(), std::io::Error>(())
    })
}

fn write_ply(path: &Path, points: &[[f64; 3]], owners: &[u8], header: &MapFileHeader) -> Result<(), OutputError> {
    write_whole(path, |writer| {
        ply::write_head(writer, header, points.len() as u64, &[("uchar", "scalar_plane")])?;
        for (at_m, owner) in points.iter().zip(owners) {
            let color = owner.checked_sub(1).map_or([150; 3], |i| COLORS[usize::from(i) % COLORS.len()]);
            ply::write_point(writer, *at_m, color, &[*owner])?;
        }
        Ok::<(), std::io::Error>(())
    })
}
