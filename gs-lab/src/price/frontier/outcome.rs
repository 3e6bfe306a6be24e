//! The result of a search: the times and errors of all measured settings, as a table and as a figure.
//! The JSON form is its serialisation.

use std::fmt;

use gs_core::{RenderSettings, counted, profile::Quantiles};
use serde::Serialize;

use super::{
    super::{
        noise::{Noise, TimeComparison},
        picture_error::PictureError,
        timing::Times,
    },
    Change,
};
use crate::report::{
    Cell, Table,
    figure::{Axis, Dots, Figure, FigurePoint, Marks, Series},
};

/// Smaller errors are drawn at this value; they are due to rounding.
const LEAST_ERROR: f64 = 1e-6;

/// The role of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Role {
    /// The default settings.
    Default,
    /// The default settings measured again, to determine the noise.
    Again,
    /// The settings of 3DGS, as far as the backend supports them.
    ThreeDgs,
    /// No cut-offs.
    Tightest,
    /// A row in which one setting differs from the default.
    Alone,
}

/// A row: settings on a candidate, with their times and error.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Measured {
    /// The backend.
    pub(crate) backend: String,
    /// The machine: "cpu (avx512, 2 threads)".
    pub(crate) machine: String,
    /// Index of the candidate.
    #[serde(skip)]
    pub(crate) candidate: usize,
    /// The role of the row.
    pub(crate) role: Role,
    /// The difference from the backend's default, where there is one.
    pub(crate) change: Option<Change>,
    /// All settings.
    pub(crate) settings: RenderSettings,
    /// Seconds per view, one value for each round.
    pub(crate) seconds: Times,
    /// The error of the pictures.
    pub(crate) error: PictureError,
    /// Whether nothing of the same backend is both quicker and as exact.
    pub(crate) on_frontier: bool,
    /// The time compared with that of the backend's default.
    pub(crate) comparison: TimeComparison,
}

impl Measured {
    /// Median seconds per view.
    pub(crate) fn median(&self) -> f64 {
        self.seconds.spread.median
    }

    /// The difference from the default, in words.
    pub(super) fn name(&self) -> String {
        match self.role {
            Role::Default => "default".to_owned(),
            Role::Again => "default, again".to_owned(),
            Role::ThreeDgs => "3DGS".to_owned(),
            Role::Tightest => "no cut-offs".to_owned(),
            Role::Alone => self.change.as_ref().map_or_else(String::new, Change::to_string),
        }
    }
}

/// Settings that a backend does not support.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Refused {
    /// The backend.
    pub(crate) backend: String,
    /// The settings.
    pub(crate) what: String,
    /// The backend's reason.
    pub(crate) why: String,
}

/// The noise of a backend.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct BackendNoise {
    /// The backend.
    pub(crate) backend: String,
    /// The noise of the backend's times.
    pub(crate) noise: Noise,
}

/// The result of a search. It is displayed as the table, followed by notes on noise, errors and refused settings.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Frontier {
    /// All measured rows, by backend, quickest first.
    pub(crate) rows: Vec<Measured>,
    /// Settings that were not measured because a backend does not support them.
    pub(crate) refused: Vec<Refused>,
    /// The noise of each backend.
    pub(crate) noise: Vec<BackendNoise>,
    /// The backend that rendered the reference, which is its row without cut-offs.
    pub(crate) reference: String,
    /// Number of views.
    pub(crate) views: usize,
}

/// Rows that are drawn alike.
type Kind = (&'static str, Dots, fn(&Measured) -> bool);

impl Frontier {
    /// The figure of error against time, as SVG.
    pub fn svg(&self, title: &str) -> String {
        self.figure(title).svg_file()
    }

    /// Whether a row is the reference of the errors.
    fn is_reference(&self, row: &Measured) -> bool {
        row.role == Role::Tightest && row.backend == self.reference
    }

    /// All rows. Those marked with `*` are on the frontier of their backend.
    fn table(&self) -> Table {
        let columns = [
            "",
            "backend",
            "settings",
            "ms",
            "10 %",
            "90 %",
            "x",
            "than default",
            "max error",
            "mean",
            "PSNR, dB",
            "> 1/255, %",
        ];
        let row = |row: &Measured| -> Vec<Cell> {
            let default = self.rows.iter().find(|other| other.backend == row.backend && other.role == Role::Default);
            let Quantiles { low, median, high } = row.seconds.spread.times(1e3);
            let is_reference = self.is_reference(row);
            let error = match is_reference {
                true => [Cell::Empty, Cell::Empty, Cell::Empty, Cell::Empty],
                false => [
                    Cell::Significant(row.error.max, 2),
                    Cell::Significant(row.error.mean, 2),
                    Cell::Fixed(row.error.psnr, 1),
                    Cell::Fixed(100.0 * row.error.share_visible, 2),
                ],
            };
            let time = vec![
                if row.on_frontier { "*" } else { "" }.into(),
                row.backend.as_str().into(),
                (row.name() + if is_reference { " (reference)" } else { "" }).into(),
                Cell::Fixed(median, 3),
                Cell::Fixed(low, 3),
                Cell::Fixed(high, 3),
                Cell::Fixed(default.map_or(f64::NAN, |default| row.median() / default.median()), 2),
                row.comparison.words().into(),
            ];
            time.into_iter().chain(error).collect()
        };
        Table::new("frontier", "", &columns, self.rows.iter().map(row).collect())
    }

    /// A figure of the largest error against time, both logarithmic: the frontier of each backend as a
    /// line, all other settings as points, the default and 3DGS marked.
    fn figure(&self, title: &str) -> Figure {
        let point = |row: &Measured| {
            let (x, y) = (1e3 * row.median(), row.error.max.max(LEAST_ERROR));
            FigurePoint { x, y, low: y, high: y }
        };
        let kinds: [Kind; 4] = [
            ("best trade-offs", Dots::All, |row| row.on_frontier),
            ("other settings", Dots::Alone, |row| !row.on_frontier && row.role != Role::Again),
            ("default", Dots::Alone, |row| row.role == Role::Default),
            ("as in 3DGS", Dots::Alone, |row| row.role == Role::ThreeDgs),
        ];
        let all = self.noise.iter().flat_map(|noise| kinds.map(|kind| (&noise.backend, kind))).enumerate();
        let series = all.map(|(style, (backend, (name, dots, is_kind)))| {
            let own = self.rows.iter().filter(|row| row.backend == *backend && is_kind(row));
            Series { style, name: format!("{backend}: {name}"), points: own.map(point).collect(), dots }
        });
        Figure {
            name: "frontier".to_owned(),
            title: title.to_owned(),
            x: Axis::logarithmic("time of a view, ms"),
            y: Axis::logarithmic("largest error of a pixel"),
            marks: Marks::Lines(series.filter(|series| !series.points.is_empty()).collect()),
        }
    }
}

impl fmt::Display for Frontier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.table().text())?;
        for Refused { backend, what, why } in &self.refused {
            writeln!(f, "{backend}: {what}: not supported ({why})")?;
        }
        for BackendNoise { backend, noise } in &self.noise {
            write!(
                f,
                "\n{backend}: times that differ by less than {:.1} % count as equal (the default measured again: {:+.1} %)",
                100.0 * (noise.factor - 1.0),
                100.0 * (noise.again - 1.0)
            )?;
        }
        write!(
            f,
            "\n*: on the frontier: no other settings of the backend are both quicker and as exact. x: time divided by the default's. Errors \
             are maxima over all channels and pixels of {}, against a rendering without cut-offs by {}.",
            counted(self.views, "view"),
            self.reference
        )
    }
}
