//! The table of trees, a line a tree; a value that was not measured is an empty field.

use std::io::Write;
use tsense_contract::Detection;

const HEADING: &str =
    "id,easting,northing,ground_z,dbh_m,dbh_std_m,height_m,confidence,position_std_m,arc,lean_east_rad,lean_north_rad";

/// Writes the trees, numbered from 1 in the given order. Position at 1.3 m above ground, metres.
pub fn put(to: &mut dyn Write, trees: &[Detection]) -> std::io::Result<()> {
    writeln!(to, "{HEADING}")?;
    trees.iter().enumerate().try_for_each(|(index, tree)| writeln!(to, "{}", line(index + 1, tree)))
}

fn line(id: usize, tree: &Detection) -> String {
    let metres = |value: f32| if value.is_nan() { String::new() } else { format!("{value:.3}") };
    format!(
        "{id},{:.3},{:.3},{:.3},{},{},{},{:.3},{},{},{:.4},{:.4}",
        tree.easting_m,
        tree.northing_m,
        tree.ground_m,
        metres(tree.dbh_m),
        metres(tree.dbh_std_m),
        metres(tree.height_m),
        tree.confidence,
        metres(tree.position_std_m),
        metres(tree.arc_coverage),
        tree.lean_rad[0],
        tree.lean_rad[1],
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn what_was_not_measured_is_an_empty_field() {
        let mut tree = Detection::zeroed();
        (tree.easting_m, tree.dbh_m, tree.dbh_std_m, tree.height_m) = (369_001.25, 0.31, f32::NAN, 12.5);
        assert_eq!(line(7, &tree), "7,369001.250,0.000,0.000,0.310,,12.500,0.000,0.000,0.000,0.0000,0.0000");
    }
}
