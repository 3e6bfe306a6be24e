//! The result files of an experiment: tables and curves as CSV, figures as PNG and SVG, pictures as
//! PNG.

use gs_io::png_bytes;

use super::Findings;
use crate::{error::Error, report::figure::Figure, result::csv_row};

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
            files.push(file(format!("{}.csv", table.name), table.csv().into_bytes()));
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
    let mut csv = csv_row(["series", &figure.x.label, &figure.y.label]);
    for series in figure.lines() {
        for point in &series.points {
            csv += &csv_row([series.name.as_str(), &point.x.to_string(), &point.y.to_string()]);
        }
    }
    csv
}
