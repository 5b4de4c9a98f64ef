//! Pieces of Markdown: tables, figures in fixed places, and the sections of a file that its readers write themselves.

/// Starts and ends a section that is kept when the file is made anew.
const KEPT: [&str; 2] = ["<!-- kept: ", "<!-- /kept -->"];

/// A table.
pub struct TableText {
    text: String,
}

impl TableText {
    /// With its heading.
    pub fn new(columns: &[&str]) -> Self {
        Self { text: format!("| {} |\n|{}\n", columns.join(" | "), "---|".repeat(columns.len())) }
    }

    /// Adds a row.
    pub fn row(&mut self, fields: &[String]) {
        self.text.push_str(&format!("| {} |\n", fields.join(" | ")));
    }

    /// The table as text.
    pub fn end(self) -> String {
        self.text + "\n"
    }
}

/// A length in metres as centimetres with one digit.
pub fn cm(value_m: Option<f64>) -> String {
    value_m.map_or("-".into(), |m| format!("{:.1}", without_minus_zero(100.0 * m, 0.05)))
}

/// The same with its sign.
pub fn signed_cm(value_m: Option<f64>) -> String {
    value_m.map_or("-".into(), |m| format!("{:+.1}", without_minus_zero(100.0 * m, 0.05)))
}

/// A number with two digits.
pub fn two(value: Option<f64>) -> String {
    value.map_or("-".into(), |v| format!("{v:.2}"))
}

/// A share as whole percent.
pub fn percent(share: Option<f64>) -> String {
    share.map_or("-".into(), |s| format!("{:.0} %", 100.0 * s))
}

fn without_minus_zero(value: f64, half: f64) -> f64 {
    if value.abs() < half { 0.0 } else { value }
}

/// A figure that misses its goal stands out.
pub fn marked(text: String, is_met: bool) -> String {
    if is_met { text } else { format!("**{text}**") }
}

/// The kept section of a name, as it stands in an old file or, where it does not, as proposed.
pub fn kept(old: &str, name: &str, proposed: &str) -> String {
    let start = format!("{}{name} -->", KEPT[0]);
    let found = old.split_once(&start).and_then(|(_, rest)| rest.split_once(KEPT[1])).map(|(text, _)| text);
    format!("{start}{}{}\n\n", found.unwrap_or(proposed), KEPT[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kept_section_comes_back_word_for_word() {
        let first = kept("", "limits", "\nNothing yet.\n");
        assert_eq!(first, "<!-- kept: limits -->\nNothing yet.\n<!-- /kept -->\n\n");
        let edited = format!("# Head\n{}\ntail", first.replace("Nothing yet.", "Ditches."));
        assert!(kept(&edited, "limits", "\nNothing yet.\n").contains("\nDitches.\n"));
        assert!(kept(&edited, "other", "\nx\n").contains("\nx\n"));
    }

    #[test]
    fn figures_have_fixed_places_and_no_minus_zero() {
        assert_eq!((cm(Some(0.0123)), cm(None), signed_cm(Some(-0.0002))), ("1.2".into(), "-".into(), "+0.0".into()));
        assert_eq!((percent(Some(0.676)), marked(two(Some(1.0)), false)), ("68 %".into(), "**1.00**".into()));
    }
}
