//! Points as PLY, binary little-endian, coordinates in double precision: UTM does not fit into floats.
//!
//! Properties that start with `scalar_` are what CloudCompare shows as scalar fields. PLY knows no coordinate system:
//! a comment names it.

use super::system_of;
use std::io::Write;
use tsense_mapper::tsmap::MapFileHeader;

/// The header of a file of points with a position, a colour and further properties, each with its PLY type.
pub fn write_head(
    out: &mut impl Write,
    header: &MapFileHeader,
    points: u64,
    properties: &[(&str, &str)],
) -> std::io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "comment made by tsense {}", env!("CARGO_PKG_VERSION"))?;
    writeln!(out, "comment coordinates: {}, metres; voxels of {} m", system_of(header), header.voxel_size_m)?;
    writeln!(out, "element vertex {points}")?;
    for axis in ["x", "y", "z"] {
        writeln!(out, "property double {axis}")?;
    }
    for color in ["red", "green", "blue"] {
        writeln!(out, "property uchar {color}")?;
    }
    for (kind, name) in properties {
        writeln!(out, "property {kind} {name}")?;
    }
    writeln!(out, "end_header")
}

/// One point: position, colour, and the bytes of the further properties.
pub fn write_point(out: &mut impl Write, at_m: [f64; 3], color: [u8; 3], further: &[u8]) -> std::io::Result<()> {
    for c in at_m {
        out.write_all(&c.to_le_bytes())?;
    }
    out.write_all(&color)?;
    out.write_all(further)
}
