//! Charts as SVG: lines over axes with units, linear or logarithmic.
//!
//! In: series of points. Out: the text of a file, charts side by side, on white, so that it reads on any page. Values
//! that an axis cannot show (not finite; not above zero on a logarithmic one) are left out.

use std::fmt::Write;

/// One axis.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// What it shows, with its unit.
    pub label: &'static str,
    /// Logarithmic.
    pub is_log: bool,
}

/// One line.
#[derive(Clone, Debug)]
pub struct Series {
    /// For the legend.
    pub name: &'static str,
    /// In order of x.
    pub points: Vec<[f64; 2]>,
}

/// One chart.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Above it.
    pub title: &'static str,
    /// To the right.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    /// At most four, so that each has a colour and a dash of its own.
    pub series: Vec<Series>,
}

/// Size of one chart with its titles and legend, pixels.
const SIZE: [f64; 2] = [400.0, 380.0];
/// The area of the lines: left, top, right, bottom.
const AREA: [f64; 4] = [66.0, 40.0, 384.0, 270.0];
/// Colours that differ for the colour-blind too (Okabe and Ito), and dashes for print.
const STYLES: [(&str, &str); 4] = [("#0072b2", ""), ("#d55e00", "7 4"), ("#009e73", "2 3"), ("#a0468c", "9 3 2 3")];

/// The file.
pub fn svg(charts: &[Chart]) -> String {
    let (width, height) = (SIZE[0] * charts.len() as f64, SIZE[1]);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    for (i, chart) in charts.iter().enumerate() {
        put(&mut out, format_args!("<g transform=\"translate({} 0)\">\n", SIZE[0] * i as f64));
        draw(&mut out, chart);
        out.push_str("</g>\n");
    }
    out.push_str("</svg>\n");
    out
}

fn put(out: &mut String, text: std::fmt::Arguments<'_>) {
    // A string takes everything.
    let _ = out.write_fmt(text);
}

fn draw(out: &mut String, chart: &Chart) {
    let [left, top, right, bottom] = AREA;
    let scale = |axis: Axis, i: usize, ends: [f64; 2]| {
        Scale::of(axis.is_log, chart.series.iter().flat_map(|s| s.points.iter().map(move |p| p[i])), ends)
    };
    let (x, y) = (scale(chart.x, 0, [left, right]), scale(chart.y, 1, [bottom, top]));
    let middle = (left + right) / 2.0;
    put(
        out,
        format_args!("<text x=\"{middle}\" y=\"22\" text-anchor=\"middle\" font-size=\"15\">{}</text>\n", chart.title),
    );
    for (value, label) in x.ticks() {
        let at = x.at(value).unwrap_or(left);
        put(out, format_args!("<path d=\"M{at:.1} {top}V{bottom}\" stroke=\"#ddd\"/>\n"));
        let below = bottom + 18.0;
        put(out, format_args!("<text x=\"{at:.1}\" y=\"{below}\" text-anchor=\"middle\">{label}</text>\n"));
    }
    for (value, label) in y.ticks() {
        let at = y.at(value).unwrap_or(bottom);
        put(out, format_args!("<path d=\"M{left} {at:.1}H{right}\" stroke=\"#ddd\"/>\n"));
        let (before, at) = (left - 6.0, at + 4.5);
        put(out, format_args!("<text x=\"{before}\" y=\"{at:.1}\" text-anchor=\"end\">{label}</text>\n"));
    }
    put(out, format_args!("<path d=\"M{left} {top}V{bottom}H{right}\" fill=\"none\" stroke=\"#333\"/>\n"));
    let below = bottom + 38.0;
    put(out, format_args!("<text x=\"{middle}\" y=\"{below}\" text-anchor=\"middle\">{}</text>\n", chart.x.label));
    let up = (top + bottom) / 2.0;
    put(
        out,
        format_args!(
            "<text transform=\"translate(16 {up}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
            chart.y.label
        ),
    );
    for (i, series) in chart.series.iter().enumerate() {
        draw_series(out, series, STYLES[i % STYLES.len()], &x, &y);
        draw_legend(out, series.name, STYLES[i % STYLES.len()], i);
    }
}

fn draw_series(out: &mut String, series: &Series, (colour, dash): (&str, &str), x: &Scale, y: &Scale) {
    let places: Vec<[f64; 2]> = series.points.iter().filter_map(|p| Some([x.at(p[0])?, y.at(p[1])?])).collect();
    let line: Vec<String> = places.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    put(
        out,
        format_args!(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" stroke-dasharray=\"{dash}\"/>\n",
            line.join(" ")
        ),
    );
    // Few points are measurements that one wants to see.
    for [x, y] in places.iter().filter(|_| places.len() <= 15) {
        put(out, format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{colour}\"/>\n"));
    }
}

fn draw_legend(out: &mut String, name: &str, (colour, dash): (&str, &str), i: usize) {
    // Two columns, from a little left of the lines, so that the longest names fit.
    let (x, y) = (AREA[0] - 22.0 + 182.0 * (i % 2) as f64, AREA[3] + 64.0 + 22.0 * (i / 2) as f64);
    let (end, text, base) = (x + 28.0, x + 34.0, y + 4.5);
    put(
        out,
        format_args!(
            "<path d=\"M{x} {y}H{end}\" stroke=\"{colour}\" stroke-width=\"2\" stroke-dasharray=\"{dash}\"/>\n"
        ),
    );
    put(out, format_args!("<text x=\"{text}\" y=\"{base}\">{name}</text>\n"));
}

/// From values to pixels.
pub struct Scale {
    is_log: bool,
    /// Logarithms of the values, on a logarithmic axis.
    values: [f64; 2],
    pixels: [f64; 2],
}

impl Scale {
    /// The scale that shows all values between two pixels; a linear one begins at zero or below.
    pub fn of(is_log: bool, values: impl Iterator<Item = f64>, pixels: [f64; 2]) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|v| v.is_finite() && (!is_log || *v > 0.0)) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            (low, high) = (1.0, 10.0);
        }
        let values = if is_log {
            let ends = [low.log10().floor(), high.log10().ceil()];
            [ends[0], ends[1].max(ends[0] + 1.0)]
        } else {
            let low = low.min(0.0);
            let step = step_of(high - low);
            [(low / step).floor() * step, ((high / step).ceil() * step).max(low + step)]
        };
        Self { is_log, values, pixels }
    }

    /// Where a value lies; nothing where the axis cannot show it.
    pub fn at(&self, value: f64) -> Option<f64> {
        let value = if self.is_log { value.log10() } else { value };
        let ([low, high], [from, to]) = (self.values, self.pixels);
        value.is_finite().then(|| from + (to - from) * (value - low) / (high - low))
    }

    /// Values with their labels: decades, or about five round numbers.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        let [low, high] = self.values;
        if self.is_log {
            return (low as i32..=high as i32).map(|decade| (10f64.powi(decade), decade_label(decade))).collect();
        }
        let step = step_of(high - low);
        let count = ((high - low) / step).round() as i32;
        (0..=count).map(|i| low + f64::from(i) * step).map(|value| (value, label(value, step))).collect()
    }
}

/// A round step that divides a span into about five.
fn step_of(span: f64) -> f64 {
    let decade = 10f64.powf((span.max(1e-12) / 5.0).log10().floor());
    let times = span.max(1e-12) / 5.0 / decade;
    decade * [1.0, 2.0, 5.0].into_iter().find(|round| times <= *round).unwrap_or(10.0)
}

fn decade_label(decade: i32) -> String {
    match decade {
        ..-3 | 7.. => format!("1e{decade}"),
        -3..0 => format!("{:.*}", decade.unsigned_abs() as usize, 10f64.powi(decade)),
        0..3 => format!("{:.0}", 10f64.powi(decade)),
        3..6 => format!("{:.0} k", 10f64.powi(decade - 3)),
        6 => "1 M".into(),
    }
}

fn label(value: f64, step: f64) -> String {
    let digits = (-step.log10().floor()).max(0.0) as usize;
    if value >= 10_000.0 { format!("{} k", value / 1000.0) } else { format!("{value:.digits$}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_logarithmic_axis_has_decades_and_leaves_out_what_it_cannot_show() {
        let scale = Scale::of(true, [0.0, 3.0, 450.0, f64::NAN].into_iter(), [0.0, 300.0]);
        let labels: Vec<_> = scale.ticks().into_iter().map(|(_, label)| label).collect();
        assert_eq!(labels, ["1", "10", "100", "1 k"]);
        assert_eq!((scale.at(10.0), scale.at(0.0)), (Some(100.0), None));
    }

    #[test]
    fn a_linear_axis_begins_at_zero_and_has_round_steps() {
        let scale = Scale::of(false, [3.0, 0.7].into_iter(), [270.0, 40.0]);
        let labels: Vec<_> = scale.ticks().into_iter().map(|(_, label)| label).collect();
        assert_eq!(labels, ["0", "1", "2", "3"]);
        assert_eq!(scale.at(3.0), Some(40.0));
    }

    #[test]
    fn a_file_holds_every_series_and_its_name() {
        let axis = |label, is_log| Axis { label, is_log };
        let series = |name| Series { name, points: vec![[1.0, 2.0], [10.0, 20.0]] };
        let chart =
            Chart { title: "t", x: axis("n", true), y: axis("s", true), series: vec![series("one"), series("two")] };
        let file = svg(&[chart.clone(), chart]);
        assert_eq!((file.matches("<polyline").count(), file.matches(">two<").count()), (4, 2));
        assert!(file.starts_with("<svg") && file.ends_with("</svg>\n"));
    }
}
