//! `report.html`: the survey on one page that needs nothing else: no network, no other file.
//!
//! In: the totals, the report, a picture of the ground and a section. Out: HTML with its style, script and pictures
//! inside. It follows the reader's light or dark theme and prints. Without scripts everything shows but the figures of
//! a tree under the pointer and the sorting of the table.

mod charts;
mod picture;
mod section;

pub use picture::Picture;
pub use section::Section;

use super::plan::Plan;
use super::totals::Totals;
use super::{Options, Report};
use std::fmt::Write;
use tsense_contract::{Detection, GroundEvidence};

/// Most rows of the table of trees; all of them are in `trees.csv`.
const ROWS_MAX: usize = 2_000;

/// What the page shows.
pub struct Page<'a> {
    /// The sums over all tiles.
    pub totals: &'a Totals,
    /// The same as in `report.json`.
    pub report: &'a Report,
    /// Where the plot lies.
    pub plan: &'a Plan,
    /// What was asked for.
    pub options: &'a Options,
}

impl Page<'_> {
    /// The page as text.
    pub fn html(&self, picture: &Picture, section: Option<&Section>) -> Result<String, png::EncodingError> {
        let trees = &self.totals.trees;
        let name = self.options.input.file_name().map_or_else(|| "survey".into(), |name| name.to_string_lossy());
        let voxel_m3 = self.options.voxel_size_m.powi(3);
        let counts = self.totals.timeline.counts();
        let parts = [
            ("{title}", escaped(&format!("Survey of {name}"))),
            ("{system}", escaped(self.report.crs.as_deref().unwrap_or("coordinate system not known"))),
            ("{figures}", self.figures()),
            ("{notes}", list(&self.report.notes)),
            ("{map}", charts::map(&picture.png()?, picture.size_m(), self.plan, trees)),
            ("{histogram}", charts::histogram(trees)),
            ("{section}", section.map(charts::section).unwrap_or_default()),
            ("{free}", charts::occupancy(counts, voxel_m3, true)),
            ("{occupied}", charts::occupancy(counts, voxel_m3, false)),
            ("{rows}", rows(trees)),
            ("{more}", more(trees.len())),
            ("{settings}", self.settings()),
            ("{counters}", self.counters()),
            ("{command}", escaped(&self.options.command)),
            ("{version}", escaped(self.report.version)),
            ("{style}", include_str!("page.css").into()),
            ("{script}", include_str!("page.js").into()),
        ];
        // One pass: what is filled in is not searched again.
        let mut page = String::new();
        let mut rest = include_str!("page.html");
        while let Some((at, (mark, text))) =
            parts.iter().filter_map(|part| Some((rest.find(part.0)?, part))).min_by_key(|(at, _)| *at)
        {
            page.push_str(&rest[..at]);
            page.push_str(text);
            rest = &rest[at + mark.len()..];
        }
        page.push_str(rest);
        Ok(page)
    }

    fn figures(&self) -> String {
        let (trees, report) = (&self.totals.trees, self.report);
        let cell_m2 = self.plan.shape.cell_m.powi(2);
        let known =
            |(evidence, cells): (&GroundEvidence, &u64)| if *evidence == GroundEvidence::Unknown { 0 } else { *cells };
        let area_m2 = self.totals.ground_cells.iter().map(known).sum::<u64>() as f64 * cell_m2;
        let basal_m2: f64 = trees
            .iter()
            .map(|t| f64::from(t.dbh_m))
            .filter(|d| d.is_finite())
            .map(|d| d * d * std::f64::consts::FRAC_PI_4)
            .sum();
        let per_ha = |value: f64| if area_m2 > 0.0 { value / area_m2 * 1e4 } else { 0.0 };
        let figure = |value: String, name: &str| format!("<div><dt>{name}</dt><dd>{value}</dd></div>");
        [
            figure(grouped(trees.len() as u64), "trees"),
            figure(
                report.dbh_mean_m.map_or("–".into(), |d| format!("{:.1} <small>cm</small>", d * 100.0)),
                "mean diameter",
            ),
            figure(format!("{:.0} <small>/ha</small>", per_ha(trees.len() as f64)), "density"),
            figure(format!("{:.1} <small>m²/ha</small>", per_ha(basal_m2)), "basal area"),
            figure(format!("{} <small>m²</small>", grouped(area_m2.round() as u64)), "ground known"),
            figure(grouped(report.rays), "rays"),
        ]
        .concat()
    }

    fn settings(&self) -> String {
        let options = self.options;
        let rows = [
            ("input", options.input.display().to_string()),
            ("coordinate system", self.report.crs.clone().unwrap_or_else(|| "not known".into())),
            ("voxel", format!("{} m", options.voxel_size_m)),
            ("reach", format!("{} m", options.reach_m)),
            ("window of evidence", format!("{} s", options.window_s)),
            ("tiles", format!("{} of {:.1} m", self.report.tiles, self.report.tile_m)),
            ("detector", format!("{:?}", options.classifier.detector).to_lowercase()),
            ("duration", format!("{:.1} s", self.report.duration_s)),
        ];
        table(rows.into_iter().map(|(name, value)| (name.to_owned(), escaped(&value))))
    }

    fn counters(&self) -> String {
        let report = self.report;
        let count = |name: &str, n: u64| (name.to_owned(), grouped(n));
        let ground = report.ground_cells.iter().map(|(evidence, n)| count(&format!("ground cells {evidence}"), *n));
        let things = report.things.iter().map(|(kind, n)| count(kind, *n));
        let rejected = report.rejected.iter().filter(|(_, n)| **n > 0);
        let rejected = rejected.map(|(reason, n)| count(&format!("candidates: {reason}"), *n as u64));
        let dropped = report.dropped.iter().map(|(cause, n)| count(cause, *n));
        let first = [count("rays", report.rays), count("returns", report.returns)];
        table(first.into_iter().chain(ground).chain(things).chain(rejected).chain(dropped))
    }
}

fn table(rows: impl Iterator<Item = (String, String)>) -> String {
    rows.map(|(name, value)| format!("<tr><th scope=\"row\">{name}</th><td>{value}</td></tr>")).collect()
}

fn list(notes: &[String]) -> String {
    let items: String = notes.iter().map(|note| format!("<li>{}</li>", escaped(note))).collect();
    if items.is_empty() { items } else { format!("<ul class=\"notes\">{items}</ul>") }
}

fn more(trees: usize) -> String {
    match trees.checked_sub(ROWS_MAX) {
        None | Some(0) => String::new(),
        Some(rest) => format!("<p>{} more are in trees.csv.</p>", grouped(rest as u64)),
    }
}

/// A row a tree; what was not measured is a dash, which sorts last.
fn rows(trees: &[Detection]) -> String {
    let mut out = String::new();
    for (id, tree) in (1..).zip(trees).take(ROWS_MAX) {
        let number =
            |value: f64, digits: usize| if value.is_finite() { format!("{value:.digits$}") } else { "–".into() };
        let cells = [
            number(f64::from(tree.dbh_m) * 100.0, 1),
            number(f64::from(tree.dbh_std_m) * 100.0, 1),
            number(tree.height_m.into(), 1),
            number(tree.easting_m, 2),
            number(tree.northing_m, 2),
            number(tree.ground_m, 2),
            number(f64::from(tree.position_std_m) * 100.0, 1),
            number(f64::from(tree.arc_coverage) * 100.0, 0),
            number(tree.confidence.into(), 2),
        ];
        // A string takes everything.
        let _ = write!(out, "<tr data-id=\"{id}\"><td>{id}</td><td>{}</td></tr>", cells.join("</td><td>"));
    }
    out
}

/// Digits in groups of three, with narrow spaces between.
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(digit);
    }
    out
}

/// Text that cannot be mistaken for markup.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_and_markup_is_text() {
        assert_eq!([0, 999, 1_000, 1_507_876].map(grouped), ["0", "999", "1\u{202f}000", "1\u{202f}507\u{202f}876"]);
        assert_eq!(escaped("<a href=\"x\">&"), "&lt;a href=&quot;x&quot;&gt;&amp;");
    }
}
