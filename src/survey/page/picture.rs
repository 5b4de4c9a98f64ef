//! The ground as a picture: light from the north-west over the heights, with drops, solid things and brush in colour.
//!
//! In: one tile after the other. Out: a PNG of at most [`PIXELS_MAX`] pixels an edge, north up. Shades are black and white
//! of some opacity, so that the page's own colour shows through, whatever its theme.

use crate::survey::piece::Piece;
use crate::survey::plan::Plan;
use tsense_contract::CellClass;
use tsense_geometry::RasterShape;

/// Most pixels along an edge; larger plots show every n-th cell.
const PIXELS_MAX: usize = 1100;
/// Towards the light: from the north-west, 45 degrees up.
const LIGHT: [f64; 3] = [-0.5, 0.5, std::f64::consts::FRAC_1_SQRT_2];
/// How much steeper the ground is drawn than it is.
const EXAGGERATION: f64 = 1.5;

/// The picture while it is made.
pub struct Picture {
    plot: RasterShape,
    step: usize,
    size: [usize; 2],
    pixels: Vec<u8>,
}

impl Picture {
    /// An empty picture of the whole plot.
    pub fn new(plan: &Plan) -> Self {
        let plot = plan.shape;
        let step = plot.width.max(plot.height).div_ceil(PIXELS_MAX);
        let size = [plot.width, plot.height].map(|cells| cells.div_ceil(step));
        Self { plot, step, size, pixels: vec![0; 4 * size[0] * size[1]] }
    }

    /// Draws the pixels whose first cells lie in a tile's core.
    pub fn add(&mut self, piece: &Piece) {
        for i in 0..piece.core.len() {
            let at =
                |axis: usize, inner: usize| (piece.core.first_cell[axis] - self.plot.first_cell[axis]) as usize + inner;
            let (column, row) = (at(0, i % piece.core.width), at(1, i / piece.core.width));
            if column % self.step == 0 && row % self.step == 0 {
                let (x, y) = (column / self.step, self.size[1] - 1 - row / self.step);
                if let Some(colour) = piece.cell(i).and_then(|i| colour(piece, i, self.step)) {
                    self.pixels[4 * (y * self.size[0] + x)..][..4].copy_from_slice(&colour);
                }
            }
        }
    }

    /// The file.
    pub fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        // At most PIXELS_MAX.
        let mut encoder = png::Encoder::new(&mut bytes, self.size[0] as u32, self.size[1] as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(&self.pixels)?;
        Ok(bytes)
    }

    /// Width and height of what the picture shows, metres: whole pixels.
    pub fn size_m(&self) -> [f64; 2] {
        self.size.map(|pixels| (pixels * self.step) as f64 * self.plot.cell_m)
    }
}

/// Red, green, blue, opacity; nothing where the ground is unknown.
fn colour(piece: &Piece, i: usize, step: usize) -> Option<[u8; 4]> {
    let shade = shade(piece, i, step)?;
    let brush_m = piece.found.brush_m.cells()[i];
    Some(match piece.found.costs.cells()[i].class {
        CellClass::Drop => [200, 52, 40, 200],
        CellClass::Obstacle => [88, 104, 124, 220],
        CellClass::Brush if brush_m >= 0.2 => [70, 130, 50, (90.0 + 60.0 * brush_m.min(2.0)) as u8],
        _ if shade < 0.0 => [0, 0, 0, (-shade * 255.0) as u8],
        _ => [255, 255, 255, (shade * 255.0) as u8],
    })
}

/// Darker (below 0) or lighter than level ground.
fn shade(piece: &Piece, i: usize, step: usize) -> Option<f64> {
    let heights = &piece.found.ground.height_m;
    let shape = heights.shape();
    let (column, row) = (i % shape.width, i / shape.width);
    let reach = step.max(2);
    let slope = |low: Option<&f32>, high: Option<&f32>| {
        let rise = f64::from(*high?) - f64::from(*low?);
        rise.is_finite().then(|| EXAGGERATION * rise / (2.0 * reach as f64 * shape.cell_m))
    };
    let east = slope(heights.get(column.checked_sub(reach)?, row), heights.get(column + reach, row)).unwrap_or(0.0);
    let north = slope(heights.get(column, row.checked_sub(reach)?), heights.get(column, row + reach)).unwrap_or(0.0);
    let known = !heights.cells()[i].is_nan();
    let length = (1.0 + east * east + north * north).sqrt();
    let light = (LIGHT[2] - LIGHT[0] * east - LIGHT[1] * north) / length;
    known.then(|| ((light - LIGHT[2]) * 1.4).clamp(-0.75, 0.6))
}

/// Bytes as text for a page that holds its pictures itself. Source: RFC 4648.
pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let byte = |i: usize| u32::from(three.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            let is_filled = digit > three.len();
            text.push(if is_filled { '=' } else { char::from(DIGITS[(bits >> (18 - 6 * digit) & 63) as usize]) });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of RFC 4648, section 10.
    #[test]
    fn base64_is_that_of_the_standard() {
        let texts = ["", "f", "fo", "foo", "foob", "fooba", "foobar"].map(|text| base64(text.as_bytes()));
        assert_eq!(texts, ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"]);
    }
}
