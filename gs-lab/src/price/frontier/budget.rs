//! Finds the quickest settings that are exact enough, or the most exact that are quick enough, and
//! verifies them on views that the search has not used.

use crate::result::median;
use gs_core::Error;
use serde::Serialize;

use super::{
    super::{noise::TimeComparison, picture_error::PictureError, reference::Verifiable},
    Frontier, Measured, Role, Sweep,
    pareto::ROUNDING,
};

/// A limit on error or time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Budget {
    /// The largest error of any channel of any pixel.
    MaxError(f64),
    /// Seconds a view.
    MaxSeconds(f64),
}

/// The error and time of settings on views that the search has not used.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Verification {
    /// Number of views.
    pub(super) views: usize,
    /// The error of their pictures.
    pub(super) error: PictureError,
    /// Median seconds a view.
    pub(super) seconds: f64,
}

/// Settings that keep a budget, also on views that the search has not used.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Choice {
    /// Index of their row.
    #[serde(skip)]
    pub(super) row: usize,
    /// Error and time on the other views.
    pub(super) verification: Verification,
    /// Number of better settings that kept the budget on the search's views only.
    pub(super) failed: usize,
    /// Number of other settings whose times do not differ from theirs beyond the noise.
    pub(super) within_noise: usize,
}

/// Why no settings are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Missed {
    /// No measured settings keep the budget. Holds the least error, or the shortest time, that was
    /// measured.
    OutOfReach(f64),
    /// No settings keep the budget on all views: this many keep it on the search's views, but not
    /// on the others.
    NotElsewhere(usize),
}

impl Budget {
    fn is_kept(self, error: f64, seconds: f64) -> bool {
        match self {
            Self::MaxError(most) => error <= most,
            Self::MaxSeconds(most) => seconds <= most,
        }
    }

    /// The rows that keep the budget by their own measurement and that flags choose, best first. Times decide by their
    /// medians, even within the noise, so that settings that are more exact than necessary are not
    /// preferred. Errors below a rounding are equal.
    fn ranked(self, frontier: &Frontier) -> Vec<usize> {
        let of = |row: &Measured| (row.median(), row.error.max);
        let is_kept = |&i: &usize| {
            let row = &frontier.rows[i];
            let (seconds, error) = of(row);
            row.role != Role::Again && row.flags.is_some() && self.is_kept(error, seconds)
        };
        let mut rows: Vec<usize> = (0..frontier.rows.len()).filter(is_kept).collect();
        rows.sort_by(|&a, &b| {
            let (a, b) = (&frontier.rows[a], &frontier.rows[b]);
            let ((a_seconds, a_error), (b_seconds, b_error)) = (of(a), of(b));
            let by_time = a_seconds.total_cmp(&b_seconds);
            match self {
                Self::MaxError(_) => by_time.then(a_error.total_cmp(&b_error)),
                Self::MaxSeconds(_) => a_error.max(ROUNDING).total_cmp(&b_error.max(ROUNDING)).then(by_time),
            }
        });
        rows
    }

    /// The best settings of a frontier that keep the budget both on its views and on `unseen` ones,
    /// which are timed for `seconds`.
    ///
    /// Settings that a backend cannot render the unseen views with do not keep it. The inner error
    /// says why no settings are chosen.
    ///
    /// # Errors
    /// Those of rendering, and of the oracle; [`Error::Setting`] if `unseen` is empty.
    pub(super) fn choose<S: Verifiable>(
        self,
        sweep: &Sweep<'_, S>,
        frontier: &Frontier,
        unseen: &[S::View],
        seconds: f64,
    ) -> Result<Result<Choice, Missed>, Error> {
        if unseen.is_empty() {
            return Err(Error::setting("the number of views to verify on", 0, "at least 1"));
        }
        let references = sweep.references(unseen)?;
        let ranked = self.ranked(frontier);
        for (failed, &row) in ranked.iter().enumerate() {
            let measured = &frontier.rows[row];
            if sweep.refusal(measured.candidate, &measured.settings, unseen)?.is_some() {
                continue;
            }
            let error = sweep.error(measured.candidate, &measured.settings, unseen, &references)?;
            let times = sweep.times(std::slice::from_ref(measured), unseen, seconds / ranked.len() as f64)?;
            let verification = Verification { views: unseen.len(), error, seconds: median(&times[0]) };
            if self.is_kept(error.max, verification.seconds) {
                let noise = frontier.noise_of(&measured.backend);
                let is_alike = |other: &usize| {
                    let seconds = frontier.rows[*other].median();
                    *other != row && noise.compare(seconds, measured.median()) == TimeComparison::NoDifference
                };
                let within_noise = ranked.iter().filter(|other| is_alike(other)).count();
                return Ok(Ok(Choice { row, verification, failed, within_noise }));
            }
        }
        if !ranked.is_empty() {
            return Ok(Err(Missed::NotElsewhere(ranked.len())));
        }
        let least = |of: fn(&Measured) -> f64| frontier.rows.iter().map(of).fold(f64::INFINITY, f64::min);
        Ok(Err(Missed::OutOfReach(match self {
            Self::MaxError(_) => least(|row| row.error.max),
            Self::MaxSeconds(_) => least(|row| row.median()),
        })))
    }
}

#[cfg(test)]
mod tests {
    use gs_core::RenderSettings;

    use super::*;
    use crate::price::{frontier::outcome::BackendNoise, noise::Noise};

    fn row(seconds: f64, error: f64, on_frontier: bool) -> Measured {
        Measured {
            backend: "cpu".to_owned(),
            machine: "one thread".to_owned(),
            flags: Some("--threads 1".to_owned()),
            candidate: 0,
            role: Role::Alone,
            change: None,
            settings: RenderSettings::default(),
            seconds: vec![seconds].into(),
            error: PictureError::new(error, [0.0; 3]),
            on_frontier,
            comparison: TimeComparison::NoDifference,
        }
    }

    /// The frontier contains the more exact of two settings though it took longer, with a noise of
    /// a third.
    #[test]
    fn noise_does_not_make_a_slower_setting_the_quickest() {
        let rows = vec![row(1.3, 1e-4, true), row(1.0, 1e-3, false), row(1.1, 9e-4, false), row(9.0, 1e-8, true)];
        let noise = vec![BackendNoise { backend: "cpu".to_owned(), noise: Noise { factor: 1.33, again: 1.0 } }];
        let frontier = Frontier { rows, refused: Vec::new(), noise, views: 1, sampled: 0, uncertainty: 0.0 };
        assert_eq!(Budget::MaxError(2e-3).ranked(&frontier), [1, 2, 0, 3]);
        assert_eq!(Budget::MaxError(5e-4).ranked(&frontier), [0, 3]);
        assert_eq!(Budget::MaxSeconds(2.0).ranked(&frontier), [0, 2, 1]);
        let mut no_flags = frontier.clone();
        no_flags.rows[2].flags = None;
        assert_eq!(Budget::MaxSeconds(2.0).ranked(&no_flags), [0, 1]);
    }
}
