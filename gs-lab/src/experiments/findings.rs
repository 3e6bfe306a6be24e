//! The findings of an experiment in a form for reports: claims with verdicts, charts, tables and
//! pictures.

use std::fmt;

use gs_core::{Canvas, Image, Scene2d};
use serde::Serialize;

use crate::report::figure::{Figure, ellipses};

/// The results of an experiment.
#[derive(Debug, Clone, PartialEq)]
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

/// A claim of the paper, with what was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Claim {
    /// Short name, in kebab-case, unique within an experiment.
    pub name: &'static str,
    /// What the paper claims, in other words.
    pub statement: &'static str,
    /// Sections and figures of the paper.
    pub section: &'static str,
    /// The conditions that the verdict is computed from.
    pub circumstances: Vec<Circumstance>,
    /// The measurement in words and numbers.
    pub measured: String,
    /// The numbers behind the claim.
    pub numbers: Vec<Number>,
}

impl Claim {
    /// The verdict that follows from the circumstances.
    pub fn verdict(&self) -> ClaimVerdict {
        ClaimVerdict::of(&self.circumstances)
    }
}

/// A condition of a claim, counted over all cases: seeds, angles, targets.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Circumstance {
    /// The condition, such as "600 Gaussians are reached".
    pub what: String,
    /// Number of cases in which the circumstance holds.
    pub held: usize,
    /// Number of cases. Without any case the condition does not hold.
    pub of: usize,
}

impl Circumstance {
    /// A condition with a single case.
    pub fn once(what: impl Into<String>, holds: bool) -> Self {
        Self { what: what.into(), held: holds.into(), of: 1 }
    }

    /// A condition counted over many cases.
    pub fn counted(what: impl Into<String>, each: impl IntoIterator<Item = bool>) -> Self {
        let (held, of) = each.into_iter().fold((0, 0), |(held, of), holds| (held + usize::from(holds), of + 1));
        Self { what: what.into(), held, of }
    }

    /// The verdict: confirmed if the circumstance holds in all cases, refuted if in none.
    pub fn verdict(&self) -> ClaimVerdict {
        match self.held {
            0 => ClaimVerdict::Refuted,
            held if held == self.of => ClaimVerdict::Confirmed,
            _ => ClaimVerdict::Partly,
        }
    }
}

impl fmt::Display for Circumstance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.of {
            1 => f.write_str(&self.what),
            of => write!(f, "{}: {} of {of}", self.what, self.held),
        }
    }
}

/// The verdict on a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClaimVerdict {
    /// All circumstances hold in all cases.
    Confirmed,
    /// No circumstance holds in any case.
    Refuted,
    /// Some circumstances hold, or hold in some cases.
    Partly,
}

impl ClaimVerdict {
    /// The verdict that follows from the circumstances. Without circumstances nothing is confirmed.
    pub fn of(circumstances: &[Circumstance]) -> Self {
        let all = |verdict| circumstances.iter().all(|circumstance| circumstance.verdict() == verdict);
        if all(Self::Refuted) {
            Self::Refuted
        } else if all(Self::Confirmed) {
            Self::Confirmed
        } else {
            Self::Partly
        }
    }
}

impl fmt::Display for ClaimVerdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Confirmed => "confirmed",
            Self::Refuted => "refuted",
            Self::Partly => "partly",
        })
    }
}

/// A measured number.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Number {
    /// What was measured.
    pub what: String,
    /// The value.
    pub value: f64,
    /// The unit, such as "dB"; empty for a pure number.
    pub unit: &'static str,
}

impl Number {
    /// A number with its name and unit.
    pub fn new(what: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self { what: what.into(), value, unit }
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

/// A number with `digits` significant digits, in plain notation where that is short and as a power
/// of ten otherwise.
pub(crate) fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let exponent = value.abs().log10().floor() as i32;
    match exponent {
        -4..=5 => format!("{value:.*}", (digits as i32 - 1 - exponent).max(0) as usize),
        _ => format!("{value:.*e}", digits.saturating_sub(1)),
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
    fn a_verdict_is_what_its_circumstances_come_to() {
        let counted = |held: usize, of: usize| Circumstance::counted("c", (0..of).map(|i| i < held));
        let cases = [
            (vec![counted(3, 3), Circumstance::once("c", true)], ClaimVerdict::Confirmed),
            (vec![counted(3, 3), Circumstance::once("c", false)], ClaimVerdict::Partly),
            (vec![counted(1, 3)], ClaimVerdict::Partly),
            (vec![counted(0, 3), counted(0, 0)], ClaimVerdict::Refuted),
            (vec![counted(3, 3), counted(0, 0)], ClaimVerdict::Partly),
            (vec![], ClaimVerdict::Refuted),
        ];
        for (circumstances, expected) in cases {
            assert_eq!(ClaimVerdict::of(&circumstances), expected, "{circumstances:?}");
        }
        assert_eq!(counted(1, 3).to_string(), "c: 1 of 3");
    }

    #[test]
    fn numbers_are_as_short_as_they_can_be() {
        let cases = [(0.000_234_56, "0.000235"), (1234.5, "1234"), (1.0e-7, "1.00e-7"), (0.0, "0"), (12.345, "12.3")];
        for (value, expected) in cases {
            assert_eq!(significant(value, 3), expected);
        }
        assert_eq!(Cell::from(None::<u32>).to_string(), "");
    }
}
