//! Findings in a form for reports and files: claims with verdicts, charts, tables and pictures.

use std::fmt;

use gs_core::Image;
use gs_io::png_bytes;

use super::{Table, figure::Figure};
use crate::result::{Claim, csv_row};

/// What was found, by an experiment or about a scene.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Findings {
    /// The method in a few sentences: target, settings, number of fits.
    pub(crate) method: String,
    /// Claims, with what was measured.
    pub(crate) claims: Vec<Claim>,
    /// Curves.
    pub(crate) charts: Vec<Figure>,
    /// Numbers in rows.
    pub(crate) tables: Vec<Table>,
    /// Reconstructions.
    pub(crate) pictures: Vec<Picture>,
}

/// A picture with its caption.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Picture {
    /// File name without extension, in kebab-case.
    pub(crate) name: &'static str,
    /// The caption: what the picture shows.
    pub(crate) caption: String,
    /// The pixels, not clamped.
    pub(crate) image: Image,
}

impl Findings {
    /// Adds those of another part of an experiment.
    pub(crate) fn add(&mut self, mut other: Self) {
        let space = if self.method.is_empty() { "" } else { " " };
        self.method += &(space.to_owned() + &other.method);
        self.claims.append(&mut other.claims);
        self.charts.append(&mut other.charts);
        self.tables.append(&mut other.tables);
        self.pictures.append(&mut other.pictures);
    }

    /// Names and contents of files: tables and curves as CSV, figures as SVG, pictures as PNG.
    /// All names begin with `prefix`, such as `edges/`.
    pub fn files(&self, prefix: &str) -> Vec<(String, Vec<u8>)> {
        let file = |name: String, bytes: Vec<u8>| (format!("{prefix}{name}"), bytes);
        let mut files = Vec::new();
        for table in &self.tables {
            files.push(file(format!("{}.csv", table.name), table.csv().into_bytes()));
        }
        for figure in &self.charts {
            let name = |kind: &str| format!("{}-chart.{kind}", figure.name);
            files.push(file(name("csv"), figure_csv(figure).into_bytes()));
            files.push(file(name("svg"), figure.svg_file().into_bytes()));
        }
        for Picture { name, image, .. } in &self.pictures {
            files.push(file(format!("{name}.png"), png_bytes(image)));
        }
        files
    }
}

/// The tables, each below its title.
impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.tables.iter().try_for_each(|table| write!(f, "{}\n{}", table.title, table.text()))
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
