//! The stored record of a run.

use gs_core::{Culled, edit::EditCounts};
use gs_train::MetricsRow;
use serde::{Deserialize, Deserializer, Serialize};

use crate::machine::Machine;

/// The content of a run's file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Record {
    /// Digest of all other fields but the outcome; also the file's name.
    pub address: String,
    /// The version of the program.
    pub version: String,
    /// The machine that computed the run.
    #[serde(flatten)]
    pub machine: Machine,
    /// The image, as the study names it.
    pub image: String,
    /// Digest of the image.
    pub target: String,
    /// Fingerprint of a policy that settings cannot name.
    pub policy: Option<String>,
    /// All settings as TOML; `gs fit --settings` reads them.
    pub settings: String,
    /// Whether the run finished, and its numbers.
    pub outcome: RunOutcome,
}

/// The outcome of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "kebab-case")]
pub enum RunOutcome {
    /// All steps were done.
    Finished(Box<Finished>),
    /// The fit failed.
    Failed {
        /// The error.
        error: String,
    },
}

impl RunOutcome {
    /// The numbers of a run that finished; `None` if it failed.
    pub fn finished(&self) -> Option<&Finished> {
        match self {
            Self::Finished(finished) => Some(finished),
            Self::Failed { .. } => None,
        }
    }
}

/// The numbers of a finished run. Quality is that of the 8-bit image, as in
/// [`gs_train::FitSummary`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Finished {
    /// Gaussians at the end.
    pub gaussians: u32,
    /// Steps done.
    pub iterations: u32,
    /// PSNR, dB; ∞ for equal images, which JSON stores as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// Structural similarity.
    pub ssim: f64,
    /// Multi-scale structural similarity; `None` for images that are too small for it.
    pub ms_ssim: Option<f64>,
    /// Mean absolute difference.
    pub l1: f64,
    /// Loss of the final scene.
    pub loss: Option<f32>,
    /// Edits by density control, summed over all rounds.
    pub edits: EditCounts,
    /// Gaussians that were left out of the last rendering.
    pub culled: Culled,
    /// Digest of the scene. A replay must end in the same.
    pub scene: String,
    /// Time spent fitting, s.
    pub seconds: f64,
    /// The backend, with its threads.
    pub backend: String,
    /// Number of runs that were done side by side.
    pub side_by_side: usize,
    /// Count, loss and, in some rows, quality over steps and time.
    pub trajectory: Vec<MetricsRow>,
}

/// Reads `null` as ∞, which JSON cannot represent.
fn infinite_where_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

impl Finished {
    /// The numbers that do not depend on the clock, nor on how many threads and runs shared the
    /// machine.
    pub(crate) fn without_clock(&self) -> Self {
        let still = |row: &MetricsRow| MetricsRow { seconds: 0.0, ..*row };
        let trajectory = self.trajectory.iter().map(still).collect();
        Self { seconds: 0.0, backend: String::new(), side_by_side: 1, trajectory, ..self.clone() }
    }

    /// PSNR at a position of the trajectory, dB: interpolated between measurements, constant before
    /// the first and after the last.
    fn psnr_at(&self, place: f64, of: impl Fn(&MetricsRow) -> f64) -> Option<f64> {
        let points: Vec<(f64, f64)> = self.trajectory.iter().filter_map(|row| Some((of(row), row.psnr?))).collect();
        let after = points.partition_point(|&(x, _)| x <= place);
        let (Some(&last), Some(&first)) = (points.last(), points.first()) else { return None };
        let Some(&(from, low)) = after.checked_sub(1).and_then(|before| points.get(before)) else {
            return Some(first.1);
        };
        let Some(&(to, high)) = points.get(after) else { return Some(last.1) };
        let share = (place - from) / (to - from);
        // Infinite values cannot be interpolated.
        Some(if share > 0.0 && low.is_finite() && high.is_finite() { low + (high - low) * share } else { low })
    }

    /// PSNR after `steps` steps, dB, interpolated between measurements.
    pub(crate) fn psnr_after(&self, steps: u32) -> Option<f64> {
        self.psnr_at(f64::from(steps), |row| f64::from(row.step))
    }

    /// PSNR after `seconds` of fitting, dB, interpolated between measurements.
    pub(crate) fn psnr_within(&self, seconds: f64) -> Option<f64> {
        self.psnr_at(seconds, |row| row.seconds)
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
        }
    }

    #[test]
    fn quality_is_known_at_every_point_of_the_curve() {
        let run = finished(30.0);
        assert_eq!([0, 20, 60, 100, 999].map(|step| run.psnr_after(step).unwrap()), [10.0, 10.0, 20.0, 30.0, 30.0]);
        assert_eq!(run.psnr_within(1.75), Some(25.0));
        assert_eq!(Finished { trajectory: vec![], ..run }.psnr_after(3), None);
        let exact = finished(f64::INFINITY);
        assert_eq!(
            [20, 99, 100, 999].map(|step| exact.psnr_after(step).unwrap()),
            [10.0, 10.0, f64::INFINITY, f64::INFINITY]
        );
    }

    #[test]
    fn a_record_comes_back_bit_for_bit() {
        let mut run = finished(0.1 + 0.2);
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
