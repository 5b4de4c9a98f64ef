//! Tables with a heading (CSV without quotes): columns by name.
//!
//! In: the text of a file. Out: rows whose fields are numbers or empty (NaN). Errors name the line.

use crate::commands::Failure;
use std::path::Path;

/// A table as read.
pub struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    /// Reads a file; fields that are no numbers count as not given.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let bytes = super::read(path)?;
        let text = String::from_utf8_lossy(&bytes);
        Self::parse(&text).map_err(|fault| Failure::new(6, format!("{}: {fault}", path.display())))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let (_, heading) = lines.next().ok_or("the table is empty; a heading is wanted")?;
        let columns: Vec<String> = heading.split(',').map(|name| name.trim().to_owned()).collect();
        let mut rows = Vec::new();
        for (number, line) in lines {
            let row: Vec<f64> = line.split(',').map(|field| field.trim().parse().unwrap_or(f64::NAN)).collect();
            if row.len() != columns.len() {
                return Err(format!("line {}: {} fields under {} columns", number + 1, row.len(), columns.len()));
            }
            rows.push(row);
        }
        Ok(Self { columns, rows })
    }

    /// Rows of the named columns; `?` before a name: NaN where the table has no such column.
    pub fn columns<const N: usize>(&self, path: &Path, names: [&str; N]) -> Result<Vec<[f64; N]>, Failure> {
        let mut places = [None; N];
        for (place, name) in places.iter_mut().zip(names) {
            let wanted = name.trim_start_matches('?');
            *place = self.columns.iter().position(|column| column == wanted);
            if place.is_none() && !name.starts_with('?') {
                let there = self.columns.join(", ");
                return Err(Failure::new(6, format!("{}: no column '{wanted}' among {there}", path.display())));
            }
        }
        Ok(self.rows.iter().map(|row| places.map(|place| place.map_or(f64::NAN, |i| row[i]))).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_come_by_name_and_what_is_not_there_is_nan() {
        let table = Table::parse("id,x,kind\n1,2.5,oak\n2,,elm\n").unwrap();
        let rows = table.columns(Path::new("t.csv"), ["x", "id", "?y"]).unwrap();
        assert_eq!((rows[0][0], rows[0][1], rows[1][1]), (2.5, 1.0, 2.0));
        assert!(rows[1][0].is_nan() && rows[0][2].is_nan());
        assert!(table.columns(Path::new("t.csv"), ["z"]).unwrap_err().message.contains("no column 'z'"));
        assert!(Table::parse("a,b\n1\n").err().unwrap().contains("line 2"));
    }
}
