//! An object's id as the number of its row.

/// SQLite's integers are signed; ids count from 1 and never get there.
pub(crate) fn id_of(id: u64) -> i64 {
    i64::try_from(id).unwrap_or(i64::MAX)
}
