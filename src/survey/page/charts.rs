//! The page's drawings: the map of trees, the histogram of diameters, the section, occupancy over time.
//!
//! In: what the survey found. Out: SVG as text, coloured by classes of the page's style sheet, so that it follows the
//! page's theme. Drawings scale with the page; their text is sized for the width they are shown at.

use super::picture::base64;
use super::section::Section;
use crate::bench::svg::Scale;
use crate::survey::plan::Plan;
use crate::survey::timeline::Counts;
use std::fmt::Write;
use tsense_contract::Detection;

/// Most trees that are drawn on the map: more would make the page slow.
const CIRCLES_MAX: usize = 20_000;
/// Width of a class of diameters, metres.
const DBH_CLASS_M: f64 = 0.05;

/// Adds text; a string takes everything.
fn put(out: &mut String, text: std::fmt::Arguments<'_>) {
    let _ = out.write_fmt(text);
}

/// The map: the picture of the ground, a circle a tree, a scale bar, north up.
pub fn map(png: &[u8], size_m: [f64; 2], plan: &Plan, trees: &[Detection]) -> String {
    let [width, height] = size_m;
    let west = f64::from(plan.shape.first_cell[0]) * plan.shape.cell_m;
    // The picture's last row may reach a little below the plot; its first begins at the plot's northern edge or above.
    let north = f64::from(plan.shape.first_cell[1]) * plan.shape.cell_m + height;
    let span = width.max(height);
    let unit = span / 100.0;
    let mut out = format!(
        "<svg class=\"map\" viewBox=\"0 0 {width:.2} {height:.2}\" role=\"img\" aria-label=\"Map of trees over the shaded ground\">\
         <image href=\"data:image/png;base64,{}\" width=\"{width:.2}\" height=\"{height:.2}\" preserveAspectRatio=\"none\"/>\n<g class=\"trees\">",
        base64(png)
    );
    for (id, tree) in (1..).zip(trees).take(CIRCLES_MAX) {
        let radius = (f64::from(tree.dbh_m) / 2.0).max(0.7 * unit * (0.6 + f64::from(tree.dbh_m).min(1.0)));
        let radius = if radius.is_finite() { radius } else { 0.4 * unit };
        let (x, y) = (tree.easting_m - west, north - tree.northing_m);
        put(&mut out, format_args!("<circle data-id=\"{id}\" cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius:.2}\"/>"));
    }
    out.push_str("</g>");
    let bar = round_length(width / 4.0);
    let (left, base) = (3.0 * unit, height - 3.0 * unit);
    put(
        &mut out,
        format_args!(
            "<g class=\"scale\"><path d=\"M{left:.2} {:.2}v{unit:.2}h{bar}v{:.2}\" stroke-width=\"{:.3}\"/>\
             <text x=\"{:.2}\" y=\"{:.2}\" font-size=\"{:.2}\">{bar} m</text></g>",
            base - unit,
            -unit,
            0.3 * unit,
            left + bar / 2.0,
            base - 1.4 * unit,
            2.4 * unit,
        ),
    );
    let (x, y) = (width - 4.0 * unit, 6.6 * unit);
    put(
        &mut out,
        format_args!(
            "<g class=\"north\"><path d=\"M{x:.2} {:.2}l{:.2} {:.2}l{:.2} {:.2}l{:.2} {:.2}z\"/>\
             <text x=\"{x:.2}\" y=\"{:.2}\" font-size=\"{:.2}\">N</text></g></svg>",
            y - 4.4 * unit,
            1.3 * unit,
            4.0 * unit,
            -1.3 * unit,
            -0.9 * unit,
            -1.3 * unit,
            0.9 * unit,
            y + 2.2 * unit,
            2.4 * unit,
        ),
    );
    out
}

/// The greatest of 1, 2, 5, 10, ... that is not more.
fn round_length(m: f64) -> f64 {
    let decade = 10f64.powf(m.max(0.1).log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|times| times * decade).find(|length| *length <= m).unwrap_or(decade)
}

/// A frame for a chart: its size, where its lines lie (left, top, right, bottom), its two scales.
struct Frame {
    size: [f64; 2],
    area: [f64; 4],
    x: Scale,
    y: Scale,
}

impl Frame {
    fn new(size: [f64; 2], x: impl Iterator<Item = f64>, y: impl Iterator<Item = f64>) -> Self {
        let area = [52.0, 14.0, size[0] - 14.0, size[1] - 42.0];
        Self { size, area, x: Scale::of(false, x, [area[0], area[2]]), y: Scale::of(false, y, [area[3], area[1]]) }
    }

    /// A frame that ends where its greatest values are, so that a metre is as long upwards as it is sideways.
    fn tight(size: [f64; 2], most: [f64; 2]) -> Self {
        let loose = Self::new(size, most.into_iter().take(1), most.into_iter().skip(1));
        let [left, top, right, bottom] = loose.area;
        let stretch = |from: f64, to: f64, at: Option<f64>| from + (to - from).powi(2) / (at.unwrap_or(to) - from);
        let x = Scale::of(false, most.into_iter().take(1), [left, stretch(left, right, loose.x.at(most[0]))]);
        let y = Scale::of(false, most.into_iter().skip(1), [bottom, stretch(bottom, top, loose.y.at(most[1]))]);
        Self { x, y, ..loose }
    }

    /// Axes with round numbers and their names.
    fn open(&self, name: &str, x_label: &str, y_label: &str) -> String {
        let ([width, height], [left, top, right, bottom]) = (self.size, self.area);
        let mut out =
            format!("<svg class=\"chart\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{name}\">");
        for (value, label) in self.y.ticks() {
            let at = self.y.at(value).unwrap_or(bottom);
            if at < top - 1.0 {
                continue;
            }
            put(&mut out, format_args!("<path class=\"grid\" d=\"M{left} {at:.1}H{right}\"/>"));
            put(&mut out, format_args!("<text class=\"y\" x=\"{}\" y=\"{:.1}\">{label}</text>", left - 7.0, at + 4.0));
        }
        for (value, label) in self.x.ticks() {
            let at = self.x.at(value).unwrap_or(left);
            if at > right + 1.0 {
                continue;
            }
            put(&mut out, format_args!("<path class=\"tick\" d=\"M{at:.1} {bottom}v4\"/>"));
            put(&mut out, format_args!("<text class=\"x\" x=\"{at:.1}\" y=\"{}\">{label}</text>", bottom + 18.0));
        }
        put(&mut out, format_args!("<path class=\"axis\" d=\"M{left} {bottom}H{right}\"/>"));
        put(
            &mut out,
            format_args!(
                "<text class=\"x name\" x=\"{}\" y=\"{}\">{x_label}</text>",
                (left + right) / 2.0,
                height - 6.0
            ),
        );
        let middle = (top + bottom) / 2.0;
        put(
            &mut out,
            format_args!("<text class=\"x name\" transform=\"translate(13 {middle}) rotate(-90)\">{y_label}</text>"),
        );
        out
    }

    fn place(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        Some([self.x.at(x)?, self.y.at(y)?])
    }

    /// A line through places.
    fn line(&self, class: &str, points: impl Iterator<Item = [f64; 2]>) -> String {
        let places: Vec<String> = points.filter_map(|p| self.place(p)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        format!("<polyline class=\"{class}\" points=\"{}\"/>", places.join(" "))
    }
}

/// How many stems there are of each class of diameters.
pub fn histogram(trees: &[Detection]) -> String {
    let class_of = |tree: &Detection| (f64::from(tree.dbh_m) / DBH_CLASS_M) as usize;
    let measured = || trees.iter().filter(|tree| tree.dbh_m.is_finite());
    // Stems of several metres are not trees; they end in the last class.
    let classes = measured().map(class_of).max().unwrap_or(0).min(60) + 1;
    let mut counts = vec![0u32; classes];
    measured().for_each(|tree| counts[class_of(tree).min(classes - 1)] += 1);
    let ends = [0.0, classes as f64 * DBH_CLASS_M * 100.0];
    let frame = Frame::new([520.0, 344.0], ends.into_iter(), counts.iter().map(|n| f64::from(*n)));
    let mut out = frame.open("Histogram of stem diameters", "diameter at 1.3 m, cm", "stems");
    for (i, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let at = |i: usize| frame.x.at(i as f64 * DBH_CLASS_M * 100.0).unwrap_or(0.0);
        let (x, width) = (at(i) + 1.0, at(i + 1) - at(i) - 2.0);
        let (top, bottom) = (frame.y.at(f64::from(*count)).unwrap_or(0.0), frame.area[3]);
        let (from, to) = (i * 5, i * 5 + 5);
        put(
            &mut out,
            format_args!(
                "<rect class=\"bar\" x=\"{x:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{:.1}\" rx=\"1.5\">\
                 <title>{from} to {to} cm: {count}</title></rect>",
                bottom - top
            ),
        );
    }
    out + "</svg>"
}

/// The section: returns, brush, ground with its deviation, stems.
pub fn section(section: &Section) -> String {
    let heights = section.returns.keys().map(|grain| Section::place_of(*grain)[1]);
    let heights = heights.chain(section.ground.iter().map(|[_, z, ..]| *z)).filter(|z| z.is_finite());
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
    if low > high {
        return "<p>No ground was seen along any line.</p>".into();
    }
    let base = low.floor();
    let span_m = section.ends_m[1] - section.ends_m[0];
    // Metres are as long upwards as they are sideways, within what a page can show.
    let size = [1080.0, (1014.0 * (high - base) / span_m.max(1.0)).clamp(160.0, 620.0) + 56.0];
    let frame = Frame::tight(size, [span_m.max(1.0), (high - base).max(1.0)]);
    let from = section.ends_m[0];
    let way = ["east", "north"][section.axis];
    let mut out =
        frame.open("Section through the plot", &format!("metres towards {way}"), &format!("height above {base} m"));
    for (class, is_stem) in [("returns", false), ("returns stem", true)] {
        let places = section.returns.iter().filter(|(_, stem)| **stem == is_stem);
        let places = places.filter_map(|(grain, _)| {
            let [along, z] = Section::place_of(*grain);
            frame.place([along - from, z - base])
        });
        let path: String = places.map(|[x, y]| format!("M{x:.1} {y:.1}h0")).collect();
        put(&mut out, format_args!("<path class=\"{class}\" d=\"{path}\"/>"));
    }
    for [along, ground_m, _, brush_m] in section.ground.iter().filter(|[.., brush_m]| *brush_m > 0.0) {
        if let (Some([x, y]), Some([_, top])) =
            (frame.place([along - from, ground_m - base]), frame.place([along - from, ground_m + brush_m - base]))
        {
            put(&mut out, format_args!("<path class=\"brush\" d=\"M{x:.1} {y:.1}V{top:.1}\"/>"));
        }
    }
    let known = || section.ground.iter().filter(|[_, z, ..]| z.is_finite());
    let upper = known().map(|[along, z, std, _]| [along - from, z + std - base]);
    let lower = known().rev().map(|[along, z, std, _]| [along - from, z - std - base]);
    out.push_str(&frame.line("sigma", upper.chain(lower)));
    out.push_str(&frame.line("ground", known().map(|[along, z, ..]| [along - from, z - base])));
    for tree in &section.stems {
        let along = [tree.easting_m, tree.northing_m][section.axis] - from;
        let lean = f64::from(tree.lean_rad[section.axis]).tan();
        let top_m = if tree.height_m.is_finite() { f64::from(tree.height_m).min(8.0) } else { 3.0 };
        let at = |up_m: f64| [along + lean * (up_m - 1.3), tree.ground_m + up_m - base];
        let scale = (frame.area[2] - frame.area[0]) / span_m.max(1.0);
        let stem = frame.line("stem", [at(0.0), at(top_m)].into_iter());
        let width = (f64::from(tree.dbh_m) * scale).max(1.5);
        let stem = stem.replace(
            "/>",
            &format!(" stroke-width=\"{width:.1}\"><title>DBH {:.1} cm</title></polyline>", tree.dbh_m * 100.0),
        );
        out.push_str(&stem);
    }
    out + "</svg>"
}

/// Occupied or free space over time, cubic metres.
pub fn occupancy(counts: &[Counts], voxel_m3: f64, is_free: bool) -> String {
    let value = |c: &Counts| (if is_free { c.free } else { c.occupied }) as f64 * voxel_m3;
    let frame = Frame::new([520.0, 172.0], counts.iter().map(|c| c.at_s), counts.iter().map(value));
    let (name, class) =
        if is_free { ("Free space over time", "free") } else { ("Occupied space over time", "occupied") };
    let mut out = frame.open(name, "seconds", if is_free { "free, m³" } else { "occupied, m³" });
    out.push_str(&frame.line(class, [[0.0, 0.0]].into_iter().chain(counts.iter().map(|c| [c.at_s, value(c)]))));
    if let Some([x, y]) = counts.last().and_then(|c| frame.place([c.at_s, value(c)])) {
        put(&mut out, format_args!("<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\"/>"));
    }
    out + "</svg>"
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_tight_frame_ends_at_its_greatest_values() {
        let frame = Frame::tight([1080.0, 500.0], [36.0, 30.5]);
        let [x, y] = frame.place([36.0, 30.5]).unwrap();
        assert!((x - frame.area[2]).abs() < 1e-9 && (y - frame.area[1]).abs() < 1e-9);
        assert_eq!(frame.place([0.0, 0.0]), Some([frame.area[0], frame.area[3]]));
    }

    #[test]
    fn scale_bars_are_round() {
        assert_eq!([9.6, 30.0, 0.4, 55.0].map(round_length), [5.0, 20.0, 0.2, 50.0]);
    }

    #[test]
    fn a_histogram_has_a_bar_for_each_class_that_has_stems() {
        let tree = |dbh_m| Detection { dbh_m, ..Detection::zeroed() };
        let chart = histogram(&[tree(0.31), tree(0.34), tree(0.12), tree(f32::NAN)]);
        assert_eq!(chart.matches("<rect").count(), 2);
        assert!(chart.contains("30 to 35 cm: 2") && chart.contains("10 to 15 cm: 1"));
        assert!(histogram(&[]).ends_with("</svg>"));
    }
}
