//! The stored record of a run on an image or a scene.

use std::{collections::BTreeMap, fmt};

use gs_core::{Culled, edit::EditCounts};
use gs_train::MetricsRow;
use serde::{Deserialize, Deserializer, Serialize};

use crate::study::{Column, Machine};

/// The content of a run's file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Record {
    /// Digest of all other fields but the outcome; also the file's name.
    pub(crate) address: String,
    /// The version of the program.
    pub(crate) version: String,
    /// The machine that computed the run.
    #[serde(flatten)]
    pub(crate) machine: Machine,
    /// The image or the scene, as the study names it.
    pub(crate) image: String,
    /// Digest of the image or the data set.
    pub(crate) target: String,
    /// Fingerprint of a policy that settings cannot name.
    pub(crate) policy: Option<String>,
    /// All settings as TOML; `gs fit --settings` or `gs train --settings` reads them.
    pub(crate) settings: String,
    /// Whether the run finished, and its numbers.
    pub(crate) outcome: RunOutcome,
}

/// The outcome of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "kebab-case")]
pub enum RunOutcome {
    /// All steps were done.
    Finished(Box<Finished>),
    /// The fit or the training failed.
    Failed {
        /// The error.
        error: String,
    },
}

impl RunOutcome {
    /// The numbers of a run that finished; `None` if it failed.
    pub(crate) fn finished(&self) -> Option<&Finished> {
        match self {
            Self::Finished(finished) => Some(finished),
            Self::Failed { .. } => None,
        }
    }
}

impl fmt::Display for RunOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Finished(finished) => write!(f, "{:.2} dB after {:.1} s", finished.psnr, finished.seconds),
            Self::Failed { error } => write!(f, "failed: {error}"),
        }
    }
}

/// The numbers of a finished run. Quality is that of the 8-bit image, as in
/// [`gs_train::FitSummary`], or for scenes the mean over the held-out views, as in
/// [`gs_train::train::Evaluation`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Finished {
    /// Gaussians at the end.
    pub gaussians: u32,
    /// Bytes of their parameters as 32-bit floats.
    #[serde(default)]
    pub(crate) bytes: u64,
    /// Steps done.
    pub(crate) iterations: u32,
    /// PSNR, dB; ∞ for equal images, which JSON stores as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// Structural similarity.
    pub(crate) ssim: f64,
    /// Multi-scale structural similarity; `None` for images that are too small for it.
    pub(crate) ms_ssim: Option<f64>,
    /// Mean absolute difference.
    pub(crate) l1: f64,
    /// Loss of the final scene; `None` for a training.
    pub(crate) loss: Option<f32>,
    /// Edits by density control, summed over all rounds.
    pub(crate) edits: EditCounts,
    /// Gaussians that were left out of the last rendering.
    pub(crate) culled: Culled,
    /// Digest of the scene. The same run always ends in the same.
    pub(crate) scene: String,
    /// Time spent fitting, s.
    pub seconds: f64,
    /// The backend, with its threads.
    pub(crate) backend: String,
    /// Number of runs that were done side by side.
    pub(crate) side_by_side: usize,
    /// Count, loss and, in some rows, quality over steps and time.
    pub(crate) trajectory: Vec<MetricsRow>,
    /// Each held-out view in which some pixel counts; none for a fit.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) views: Vec<ViewResult>,
    /// What the study measures besides, as far as it is finite.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) measured: BTreeMap<Column, f64>,
}

/// The quality of a trained scene on a held-out view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct ViewResult {
    /// Name of the view in the data set.
    pub(crate) name: String,
    /// PSNR, dB; ∞, which JSON stores as `null`, for equal images.
    #[serde(deserialize_with = "infinite_where_null")]
    pub(crate) psnr: f64,
    /// Structural similarity.
    pub(crate) ssim: f64,
    /// Multi-scale structural similarity; `None` for images that are too small for it.
    pub(crate) ms_ssim: Option<f64>,
    /// Mean absolute difference.
    pub(crate) l1: f64,
    /// PSNR, dB, in those rows of the run's trajectory that have a PSNR.
    #[serde(deserialize_with = "all_infinite_where_null")]
    pub(crate) curve: Vec<f64>,
    /// Whether the run has a picture of the view. Pictures are in the order of the views.
    pub(crate) is_shown: bool,
}

/// Reads `null` as ∞, which JSON cannot represent.
fn infinite_where_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

/// Reads each `null` as ∞.
fn all_infinite_where_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    let values = Vec::<Option<f64>>::deserialize(deserializer)?;
    Ok(values.into_iter().map(|value| value.unwrap_or(f64::INFINITY)).collect())
}

impl Finished {
    /// The numbers that do not depend on the clock, nor on how many threads and runs shared the
    /// machine.
    pub(crate) fn without_clock(&self) -> Self {
        let still = |row: &MetricsRow| MetricsRow { seconds: 0.0, ..*row };
        let trajectory = self.trajectory.iter().map(still).collect();
        Self { seconds: 0.0, backend: String::new(), side_by_side: 1, trajectory, ..self.clone() }
    }

    /// A PSNR at a position of the trajectory, dB: interpolated between measurements, constant
    /// before the first and after the last. It is the run's own, or that of one view.
    fn psnr_at(&self, place: f64, view: Option<usize>, of: impl Fn(&MetricsRow) -> f64) -> Option<f64> {
        let rows = &self.trajectory;
        let is_measured = |index: &usize| rows[*index].psnr.is_some();
        let value = |index: usize| match view {
            None => rows[index].psnr,
            Some(view) => {
                let before = (0..index).filter(is_measured).count();
                self.views.get(view)?.curve.get(before).copied()
            }
        };
        let split = rows.partition_point(|row| of(row) <= place);
        let [before, after] = [(0..split).rev().find(is_measured), (split..rows.len()).find(is_measured)];
        let (Some(before), Some(after)) = (before, after) else { return value(before.or(after)?) };
        let (low, high) = (value(before)?, value(after)?);
        let [from, to] = [before, after].map(|index| of(&rows[index]));
        let share = (place - from) / (to - from);
        // Infinite values cannot be interpolated.
        Some(if share > 0.0 && low.is_finite() && high.is_finite() { low + (high - low) * share } else { low })
    }

    /// The count at a position of the trajectory: that of the last row before it.
    pub(crate) fn count_at(&self, place: f64, of: impl Fn(&MetricsRow) -> f64) -> Option<f64> {
        let before = self.trajectory.partition_point(|row| of(row) <= place);
        self.trajectory.get(before.checked_sub(1)?).map(|row| f64::from(row.count))
    }

    /// PSNR after `steps` steps, dB, interpolated between measurements; of one view, if asked.
    pub(crate) fn psnr_after(&self, steps: u32, view: Option<usize>) -> Option<f64> {
        self.psnr_at(f64::from(steps), view, |row| f64::from(row.step))
    }

    /// PSNR after `seconds` of training, dB, likewise.
    pub(crate) fn psnr_within(&self, seconds: f64, view: Option<usize>) -> Option<f64> {
        self.psnr_at(seconds, view, |row| row.seconds)
    }
}

#[cfg(test)]
pub(crate) mod tests {

    use super::*;

    /// A run that ended with `psnr` after 100 steps and 2 s, rising linearly from 10 dB after 20
    /// steps and 1 s.
    pub(crate) fn finished(psnr: f64) -> Finished {
        let row = |step, seconds, psnr| MetricsRow {
            step,
            seconds,
            count: step,
            edits: EditCounts::default(),
            loss: 0.5,
            l1: None,
            psnr,
            culled: None,
            clamped: None,
            fresh_start: None,
        };
        Finished {
            gaussians: 100,
            bytes: 3200,
            iterations: 100,
            psnr,
            ssim: 0.5,
            ms_ssim: None,
            l1: 0.1,
            loss: Some(0.25),
            edits: EditCounts::default(),
            culled: Culled::default(),
            scene: "0".to_owned(),
            seconds: 2.0,
            backend: "test".to_owned(),
            side_by_side: 1,
            trajectory: vec![row(20, 1.0, Some(10.0)), row(60, 1.5, None), row(100, 2.0, Some(psnr))],
            views: Vec::new(),
            measured: BTreeMap::new(),
        }
    }

    #[test]
    fn quality_is_known_at_every_point_of_the_curve() {
        let run = finished(30.0);
        assert_eq!(
            [0, 20, 60, 100, 999].map(|step| run.psnr_after(step, None).unwrap()),
            [10.0, 10.0, 20.0, 30.0, 30.0]
        );
        assert_eq!(run.psnr_within(1.75, None), Some(25.0));
        assert_eq!(Finished { trajectory: vec![], ..run }.psnr_after(3, None), None);
        let exact = finished(f64::INFINITY);
        assert_eq!(
            [20, 99, 100, 999].map(|step| exact.psnr_after(step, None).unwrap()),
            [10.0, 10.0, f64::INFINITY, f64::INFINITY]
        );
    }

    fn view(psnr: f64, curve: Vec<f64>) -> ViewResult {
        let name = "0001.png".to_owned();
        ViewResult { name, psnr, ssim: 0.5, ms_ssim: Some(0.75), l1: 0.1, curve, is_shown: true }
    }

    #[test]
    fn each_view_has_a_curve_of_its_own() {
        let views = vec![view(30.0, vec![12.0, 30.0]), view(20.0, vec![8.0, 20.0])];
        let run = Finished { views, ..finished(25.0) };
        assert_eq!([0, 60, 100].map(|step| run.psnr_after(step, Some(0)).unwrap()), [12.0, 21.0, 30.0]);
        assert_eq!((run.psnr_within(1.5, Some(1)), run.psnr_within(1.5, Some(2))), (Some(14.0), None));
        assert_eq!(run.psnr_after(60, None), Some(17.5));
    }

    #[test]
    fn a_record_comes_back_bit_for_bit() {
        let mut run = finished(0.1 + 0.2);
        run.views = vec![view(f64::INFINITY, vec![1.0 / 3.0, f64::INFINITY])];
        run.seconds = 1.0 / 3.0;
        let outcomes = [RunOutcome::Finished(Box::new(run)), RunOutcome::Failed { error: "diverged".to_owned() }];
        for outcome in outcomes {
            let json = serde_json::to_string(&outcome).unwrap();
            assert_eq!(serde_json::from_str::<RunOutcome>(&json).unwrap(), outcome, "{json}");
        }
        let perfect = serde_json::to_string(&finished(f64::INFINITY)).unwrap();
        assert_eq!(serde_json::from_str::<Finished>(&perfect).unwrap().psnr, f64::INFINITY);
    }
}
