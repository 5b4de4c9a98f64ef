//! Vertical slices through a voxel map as a picture (SVG), one above the other.
//!
//! In: slices of occupancies, row by row from below. Out: the text of a file on white. Orange is occupied, blue is free,
//! stronger with the evidence; grey is unknown.

use std::fmt::Write;

/// A slice and what stands above it.
pub struct Slice {
    /// Title.
    pub title: String,
    /// Voxels a row.
    pub width: usize,
    /// Occupancies, nothing where unknown; rows from below.
    pub values: Vec<Option<f32>>,
}

/// Pixels a voxel.
const SCALE: usize = 6;
/// Height of a title, pixels.
const TITLE: usize = 28;
/// Evidence at which a colour is full.
const FULL: f32 = 12.0;

/// The file.
pub fn picture(slices: &[Slice]) -> String {
    let width = slices.iter().map(|slice| slice.width * SCALE).max().unwrap_or(0);
    let height_of = |slice: &Slice| slice.values.len() / slice.width.max(1) * SCALE + TITLE;
    let height: usize = slices.iter().map(height_of).sum();
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"15\" shape-rendering=\"crispEdges\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    let mut top = 0;
    for slice in slices {
        draw(&mut out, slice, top);
        top += height_of(slice);
    }
    out + "</svg>\n"
}

fn draw(out: &mut String, slice: &Slice, top: usize) {
    let rows = slice.values.len() / slice.width.max(1);
    // A string takes everything.
    let _ = writeln!(out, "<text x=\"4\" y=\"{}\">{}</text>", top + 19, slice.title);
    for row in 0..rows {
        let y = top + TITLE + (rows - 1 - row) * SCALE;
        let line = &slice.values[row * slice.width..(row + 1) * slice.width];
        let mut x = 0;
        // Runs of one colour are one box: a tenth of the file.
        for run in line.chunk_by(|a, b| color(*a) == color(*b)) {
            let (at, width) = (x * SCALE, run.len() * SCALE);
            x += run.len();
            let color = color(run[0]);
            let _ = writeln!(out, "<path d=\"M{at} {y}h{width}v{SCALE}h-{width}z\" fill=\"{color}\"/>");
        }
    }
}

fn color(value: Option<f32>) -> String {
    let Some(value) = value else { return "#ddd".into() };
    // Eight steps a side.
    let share = ((value.abs() / FULL).min(1.0) * 8.0).ceil() / 8.0;
    let full = if value > 0.0 { [213.0, 94.0, 0.0] } else { [86.0, 180.0, 233.0] };
    let [r, g, b] = full.map(|c: f32| (255.0 + (c - 255.0) * share).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_one_colour_are_one_box_and_rows_count_from_below() {
        let slice = Slice { title: "t".into(), width: 3, values: vec![None, None, Some(30.0), Some(0.0), None, None] };
        let file = picture(&[slice]);
        assert_eq!(file.matches("<path").count(), 4);
        assert!(file.contains("<path d=\"M12 34h6v6h-6z\" fill=\"#d55e00\"/>"), "{file}");
    }
}
