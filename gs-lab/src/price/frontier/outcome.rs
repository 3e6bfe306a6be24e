//! The result of a search: the times and errors of all measured settings.

use gs_core::{RenderSettings, profile::Quantiles};
use serde::Serialize;

use super::{Change, Noise, PictureError, TimeComparison};

/// The role of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Role {
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
    /// Several settings differ.
    Together,
}

/// A row: settings on a contender, with their times and error.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Measured {
    /// The backend.
    pub backend: String,
    /// The machine: "cpu (avx512, 2 threads)".
    pub machine: String,
    /// Index of the contender.
    #[serde(skip)]
    pub contender: usize,
    /// The role of the row.
    pub role: Role,
    /// Differences from the backend's default.
    pub changes: Vec<Change>,
    /// All settings.
    pub settings: RenderSettings,
    /// Seconds per view, one value for each round.
    pub seconds: Vec<f64>,
    /// The error of the pictures.
    pub error: PictureError,
    /// Whether nothing of the same backend is both quicker and as exact.
    pub on_frontier: bool,
    /// The time compared with that of the backend's default.
    pub comparison: TimeComparison,
}

impl Measured {
    /// Median and quantiles of the row's times, seconds.
    pub fn times(&self) -> Quantiles {
        Quantiles::of(&self.seconds)
    }

    /// The differences from the default, in words.
    pub fn name(&self) -> String {
        name(self.role, &self.changes)
    }
}

/// The differences from the default, in words.
pub(super) fn name(role: Role, changes: &[Change]) -> String {
    match role {
        Role::Default => "default".to_owned(),
        Role::Again => "default, again".to_owned(),
        Role::ThreeDgs => "3DGS".to_owned(),
        Role::Tightest => "no cut-offs".to_owned(),
        Role::Alone | Role::Together => changes.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
    }
}

/// Settings that a backend does not support.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Refused {
    /// The backend.
    pub backend: String,
    /// The settings.
    pub what: String,
    /// The backend's reason.
    pub why: String,
}

/// The noise of a backend.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BackendNoise {
    /// The backend.
    pub backend: String,
    /// The noise of the backend's times.
    pub noise: Noise,
}

/// The result of a search.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Frontier {
    /// All measured rows, by backend, quickest first.
    pub rows: Vec<Measured>,
    /// Settings that were not measured because a backend does not support them.
    pub refused: Vec<Refused>,
    /// The noise of each backend.
    pub noise: Vec<BackendNoise>,
    /// Number of views.
    pub views: usize,
    /// Pixels of all views that the oracle computed for every picture.
    pub sampled: usize,
    /// Largest difference between the oracle and the backend rendering that locates the worst
    /// pixels.
    pub uncertainty: f64,
}

impl Frontier {
    /// The noise of a backend; none if it is unknown.
    pub fn noise_of(&self, backend: &str) -> Noise {
        let found = self.noise.iter().find(|noise| noise.backend == backend);
        found.map_or(Noise { factor: 1.0, again: 1.0 }, |found| found.noise)
    }

    /// The rows on the frontier, of all backends, quickest first.
    pub fn steps(&self) -> Vec<&Measured> {
        let mut steps: Vec<&Measured> = self.rows.iter().filter(|row| row.on_frontier).collect();
        steps.sort_by(|a, b| a.times().median.total_cmp(&b.times().median));
        steps
    }
}
