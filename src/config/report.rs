//! Faults of a configuration file as people read them: where, what, the line with a caret, what to write instead.

use std::ops::Range;

/// One fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Report {
    /// Bytes of the text it is about; none where the text does not hold the key.
    pub span: Option<Range<usize>>,
    /// What is wrong, with key and value, and what is allowed.
    pub message: String,
}

/// All faults of one file, in the order of its lines.
pub fn render(file: &str, text: &str, reports: &[Report]) -> String {
    let mut sorted: Vec<&Report> = reports.iter().collect();
    sorted.sort_by_key(|r| r.span.as_ref().map_or(usize::MAX, |s| s.start));
    let faults = if sorted.len() == 1 { "1 fault".to_owned() } else { format!("{} faults", sorted.len()) };
    let mut out = format!("{file}: {faults}\n");
    for report in sorted {
        out.push_str(&one(file, text, report));
    }
    out
}

fn one(file: &str, text: &str, report: &Report) -> String {
    let Some(span) = &report.span else { return format!("{file}: {}\n", report.message) };
    let start = span.start.min(text.len());
    let line_start = text[..start].rfind('\n').map_or(0, |i| i + 1);
    let line_end = text[start..].find('\n').map_or(text.len(), |i| start + i);
    let number = text[..start].matches('\n').count() + 1;
    let column = text[line_start..start].chars().count();
    let width = text[start..span.end.clamp(start, line_end)].chars().count().max(1);
    let line = &text[line_start..line_end];
    let carets = "^".repeat(width);
    format!("{file}:{number}:{}: {}\n{number:5} | {line}\n      | {:column$}{carets}\n", column + 1, report.message, "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_caret_stands_under_the_key_even_behind_other_alphabets() {
        let text = "a = 1\n# ä\nää.b = 2\n";
        let report = Report { span: Some(text.find("b =").map(|i| i..i + 1).unwrap()), message: "b: no".into() };
        let nowhere = Report { span: None, message: "c: missing".into() };
        let shown = render("x.toml", text, &[nowhere, report]);
        assert_eq!(shown, "x.toml: 2 faults\nx.toml:3:4: b: no\n    3 | ää.b = 2\n      |    ^\nx.toml: c: missing\n");
    }
}
