//! A table: for terminals in columns, for pages cell by cell, and as CSV with all digits.

use std::fmt;

use crate::result::{csv_row, significant};

/// A table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table {
    /// File name without extension, in kebab-case.
    pub(crate) name: &'static str,
    /// The title: what the table shows, one line.
    pub(crate) title: String,
    /// Headings, with units.
    pub(crate) columns: Vec<&'static str>,
    /// Rows, each as long as the headings.
    pub(crate) rows: Vec<Vec<Cell>>,
}

/// A cell of a table.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub(crate) enum Cell {
    /// Text.
    Text(String),
    /// A whole number.
    Count(u64),
    /// A number with this many decimals.
    Fixed(f64, usize),
    /// A number of unknown magnitude, with this many significant digits.
    Significant(f64, usize),
    /// An empty cell, where nothing was measured or reached.
    Empty,
}

impl Table {
    /// A table of rows whose cells are in the order of the columns.
    pub(crate) fn new(
        name: &'static str,
        title: impl Into<String>,
        columns: &[&'static str],
        rows: Vec<Vec<Cell>>,
    ) -> Self {
        Self { name, title: title.into(), columns: columns.to_vec(), rows }
    }

    /// The table as CSV (RFC 4180). Numbers have all their digits.
    pub(crate) fn csv(&self) -> String {
        let exact = |cell: &Cell| match cell {
            Cell::Fixed(value, _) | Cell::Significant(value, _) => value.to_string(),
            other => other.to_string(),
        };
        let rows = self.rows.iter().map(|row| csv_row(row.iter().map(exact)));
        std::iter::once(csv_row(&self.columns)).chain(rows).collect()
    }

    /// The table as lines in columns as wide as their widest cells: text on the left, numbers on the
    /// right.
    pub(crate) fn text(&self) -> String {
        let heads = self.columns.iter().map(|&head| head.to_owned()).collect();
        let rows: Vec<Vec<String>> = std::iter::once(heads)
            .chain(self.rows.iter().map(|row| row.iter().map(Cell::to_string).collect()))
            .collect();
        let is_text = |column: usize| self.rows.iter().any(|row| matches!(row[column], Cell::Text(_)));
        let columns: Vec<(bool, usize)> = (0..self.columns.len())
            .map(|column| (is_text(column), rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0)))
            .collect();
        let padded = |(cell, &(is_text, width)): (&String, &(bool, usize))| match is_text {
            true => format!("{cell:<width$}"),
            false => format!("{cell:>width$}"),
        };
        let line = |row: &Vec<String>| row.iter().zip(&columns).map(padded).collect::<Vec<_>>().join("  ");
        rows.iter().map(|row| line(row).trim_end().to_owned() + "\n").collect()
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<u32> for Cell {
    fn from(count: u32) -> Self {
        Self::Count(count.into())
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Self {
        Self::Count(count as u64)
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(cell: Option<T>) -> Self {
        cell.map_or(Self::Empty, Into::into)
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            Self::Count(count) => write!(f, "{count}"),
            Self::Fixed(value, digits) => write!(f, "{value:.digits$}"),
            Self::Significant(value, digits) => f.write_str(&significant(*value, *digits)),
            Self::Empty => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_short_as_they_can_be() {
        let cases = [(0.000_234_56, "0.000235"), (1234.5, "1234"), (1.0e-7, "1.00e-7"), (0.0, "0"), (12.345, "12.3")];
        for (value, expected) in cases {
            assert_eq!(significant(value, 3), expected);
        }
        assert_eq!(Cell::from(None::<u32>).to_string(), "");
    }

    #[test]
    fn files_have_all_digits_and_quoted_cells() {
        let table = Table::new("t", "", &["a, px", "b"], vec![vec!["x \"y\"".into(), Cell::Fixed(0.125, 1)]]);
        assert_eq!(table.csv(), "\"a, px\",b\n\"x \"\"y\"\"\",0.125\n");
    }

    #[test]
    fn text_is_on_the_left_and_numbers_on_the_right() {
        let rows = vec![vec!["long".into(), Cell::Count(7), "why".into()], vec!["a".into(), Cell::Empty, Cell::Empty]];
        let table = Table::new("t", "", &["name", "count", "reason"], rows);
        assert_eq!(table.text(), "name  count  reason\nlong      7  why\na\n");
    }
}
