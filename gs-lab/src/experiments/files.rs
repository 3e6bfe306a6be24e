//! The result files of an experiment: tables and curves as CSV, figures as PNG and SVG, pictures as
//! PNG.

use gs_io::png_bytes;

use super::{Findings, Table};
use crate::{error::Error, report::figure::Figure, result::quoted};

/// A result file of an experiment.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResultFile {
    /// Path in the results folder, with `/`.
    pub name: String,
    /// The file's content.
    pub bytes: Vec<u8>,
}

impl Findings {
    /// Tables, figures and pictures as files. All names begin with `part`, such as `edges/`.
    ///
    /// # Errors
    /// [`Error::Picture`] where a figure cannot be drawn.
    pub fn files(&self, part: &str) -> Result<Vec<ResultFile>, Error> {
        let file = |name: String, bytes: Vec<u8>| ResultFile { name: format!("{part}{name}"), bytes };
        let mut files = Vec::new();
        for table in &self.tables {
            files.push(file(format!("{}.csv", table.name), table_csv(table).into_bytes()));
        }
        for figure in &self.charts {
            let name = |kind: &str| format!("{}-chart.{kind}", figure.name);
            files.push(file(name("csv"), figure_csv(figure).into_bytes()));
            files.push(file(name("png"), png_bytes(&figure.image()?)));
            files.push(file(name("svg"), figure.svg_file()?.into_bytes()));
        }
        for picture in &self.pictures {
            files.push(file(format!("{}.png", picture.name), png_bytes(&picture.drawn())));
        }
        Ok(files)
    }
}

fn figure_csv(figure: &Figure) -> String {
    let mut csv = String::new();
    add_row(&mut csv, ["series", &figure.x.label, &figure.y.label]);
    for series in figure.lines() {
        for point in &series.points {
            add_row(&mut csv, [series.name.as_str(), &point.x.to_string(), &point.y.to_string()]);
        }
    }
    csv
}

fn table_csv(table: &Table) -> String {
    let mut csv = String::new();
    add_row(&mut csv, table.columns.iter().copied());
    for row in &table.rows {
        add_row(&mut csv, row.iter().map(ToString::to_string));
    }
    csv
}

fn add_row<T: AsRef<str>>(csv: &mut String, cells: impl IntoIterator<Item = T>) {
    let cells: Vec<String> = cells.into_iter().map(|cell| quoted(cell.as_ref())).collect();
    csv.push_str(&(cells.join(",") + "\n"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_quoted_where_they_must_be() {
        let table = Table {
            name: "t",
            title: String::new(),
            columns: vec!["a, px", "b"],
            rows: vec![vec!["x \"y\"".into(), 3u32.into()]],
        };
        assert_eq!(table_csv(&table), "\"a, px\",b\n\"x \"\"y\"\"\",3\n");
    }
}
