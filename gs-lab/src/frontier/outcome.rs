//! What a search found: every setting that was measured, with its time, its error, and whether it lies on the frontier.

use gs_core::{RenderSettings, profile::Quantiles};
use serde::Serialize;

use super::{Change, Comparison, Noise, PictureError};

/// Why a row is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// How the scene is shown if nothing else is asked for.
    Default,
    /// The default once more, as if it were another setting: what it differs by is noise.
    Again,
    /// What 3DGS does, as far as the backend can.
    ThreeDgs,
    /// No approximation at all that can be left out.
    Tightest,
    /// One setting differs from the default.
    Alone,
    /// Several do.
    Together,
}

/// One row.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Measured {
    /// The backend.
    pub backend: String,
    /// What computes: "cpu (avx512, 2 threads)".
    pub machine: String,
    /// Its place among the contenders.
    #[serde(skip)]
    pub contender: usize,
    /// Why it is there.
    pub role: Role,
    /// In what it differs from the backend's default.
    pub changes: Vec<Change>,
    /// All settings.
    pub settings: RenderSettings,
    /// Seconds a view, one for each round.
    pub seconds: Vec<f64>,
    /// How far the pictures are from what they should be.
    pub error: PictureError,
    /// Whether nothing of the same backend is both quicker and as exact.
    pub on_frontier: bool,
    /// How its time compares with that of the backend's default.
    pub comparison: Comparison,
}

impl Measured {
    /// Median and quantiles of its times, seconds.
    pub fn times(&self) -> Quantiles {
        Quantiles::of(&self.seconds)
    }

    /// What differs from the default, in words.
    pub fn name(&self) -> String {
        name(self.role, &self.changes)
    }
}

/// What differs from the default, in words.
pub(super) fn name(role: Role, changes: &[Change]) -> String {
    match role {
        Role::Default => "default".to_owned(),
        Role::Again => "default, again".to_owned(),
        Role::ThreeDgs => "3DGS".to_owned(),
        Role::Tightest => "no cut-offs".to_owned(),
        Role::Alone | Role::Together => changes.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
    }
}

/// What a backend does not offer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Refused {
    /// The backend.
    pub backend: String,
    /// What was tried.
    pub what: String,
    /// What it says.
    pub why: String,
}

/// The noise of a backend.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BackendNoise {
    /// The backend.
    pub backend: String,
    /// Below what its times do not differ.
    pub noise: Noise,
}

/// What a search found.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Frontier {
    /// All that was measured: by backend, within it quickest first.
    pub rows: Vec<Measured>,
    /// What was not, because the backend does not offer it.
    pub refused: Vec<Refused>,
    /// Below what times do not differ, by backend.
    pub noise: Vec<BackendNoise>,
    /// Views that were looked at.
    pub views: usize,
    /// Pixels of all views at which the oracle was asked whatever the picture.
    pub sampled: usize,
    /// How far the rendering that says where a picture is worst is itself from the oracle, at most.
    pub uncertainty: f64,
}

impl Frontier {
    /// The noise of a backend; none known is none.
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
