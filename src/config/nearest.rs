//! The known word nearest to an unknown one, for suggestions.

/// The candidate nearest to `word`, if one is near: two letters or a third of them differ, or one holds the other.
pub fn nearest<'c>(word: &str, candidates: impl IntoIterator<Item = &'c str>) -> Option<&'c str> {
    let scored = candidates.into_iter().map(|candidate| (distance(word, candidate), candidate));
    let (differences, candidate) = scored.min_by_key(|(differences, _)| *differences)?;
    let length = word.chars().count();
    // Two exchanged letters count as two differences.
    let near = differences <= if length < 4 { 1 } else { (length / 3).max(2) };
    let within = word.len() >= 3 && (candidate.contains(word) || word.contains(candidate));
    (near || within).then_some(candidate)
}

/// Letters to insert, remove or replace to get from `a` to `b`.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_counted_by_hand() {
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(distance("", "abc"), 3);
        assert_eq!(distance("voxxel", "voxel"), 1);
    }

    #[test]
    fn a_slip_is_recognised_and_a_stranger_is_not() {
        let known = ["voxel_size_m", "snapshot_hz", "frequency_hz"];
        assert_eq!(nearest("voxxel_size", known), Some("voxel_size_m"));
        assert_eq!(nearest("snapshot", known), Some("snapshot_hz"));
        assert_eq!(nearest("nmae", ["name", "log"]), Some("name"));
        assert_eq!(nearest("banana", known), None);
    }
}
