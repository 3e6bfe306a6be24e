//! The findings of an experiment in a form for reports: claims with verdicts, charts, tables and
//! pictures.

use std::fmt;

use gs_core::{Canvas, Image, Scene2d};

pub(crate) use crate::result::significant;
use crate::{
    report::figure::{Figure, ellipses},
    result::Claim,
};

/// The results of an experiment.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Findings {
    /// The method in a few sentences: target, settings, number of fits.
    pub method: String,
    /// The paper's claims, with what was measured.
    pub claims: Vec<Claim>,
    /// Curves.
    pub charts: Vec<Figure>,
    /// Numbers in rows.
    pub tables: Vec<Table>,
    /// Reconstructions.
    pub pictures: Vec<Picture>,
}

impl Findings {
    /// Adds those of another part of the experiment.
    pub fn add(&mut self, mut other: Self) {
        let space = if self.method.is_empty() { "" } else { " " };
        self.method += &(space.to_owned() + &other.method);
        self.claims.append(&mut other.claims);
        self.charts.append(&mut other.charts);
        self.tables.append(&mut other.tables);
        self.pictures.append(&mut other.pictures);
    }
}

/// A table.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// File name without extension, in kebab-case.
    pub name: &'static str,
    /// The title: what the table shows, one line.
    pub title: String,
    /// Headings, with units.
    pub columns: Vec<&'static str>,
    /// Rows, each as long as the headings.
    pub rows: Vec<Vec<Cell>>,
}

/// A cell of a table.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Cell {
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

/// A picture, with ellipses that are drawn over it.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// File name without extension, in kebab-case.
    pub name: &'static str,
    /// The caption: what the picture shows.
    pub caption: String,
    /// The pixels, not clamped.
    pub image: Image,
    /// Gaussians to draw as ellipses, and the canvas that the image shows.
    pub ellipses: Option<(Scene2d, Canvas)>,
}

impl Picture {
    /// The pixels with the ellipses drawn over them.
    pub(crate) fn drawn(&self) -> Image {
        let mut image = self.image.clone();
        if let Some((scene, canvas)) = &self.ellipses {
            ellipses::draw(&mut image, scene, canvas);
        }
        image
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
}
