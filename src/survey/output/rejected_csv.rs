//! `rejected.csv`: candidates that are no trees, a line each, with the reason and the figure that decided.
//!
//! Metres, in the input's coordinates; the figure is in the unit of the limit that it missed.

use std::io::Write;
use tsense_classifier::Rejected;

const HEADING: &str = "easting,northing,reason,value";

/// Writes the candidates.
pub fn put(to: &mut dyn Write, rejected: &[Rejected]) -> std::io::Result<()> {
    writeln!(to, "{HEADING}")?;
    rejected.iter().try_for_each(|candidate| writeln!(to, "{}", line(candidate)))
}

fn line(candidate: &Rejected) -> String {
    let [easting, northing] = candidate.at_m;
    format!("{easting:.3},{northing:.3},{},{:.3}", candidate.reason.as_str(), candidate.value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_classifier::Reason;

    #[test]
    fn a_line_says_where_why_and_by_how_much() {
        let candidate = Rejected { at_m: [369_001.25, 3_279_000.5], reason: Reason::RaysPass, value: 0.625 };
        assert_eq!(line(&candidate), "369001.250,3279000.500,rays pass through,0.625");
    }
}
