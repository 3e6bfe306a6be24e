//! The summary of a training in 3D, as in `summary.json`.

use gs_core::{Optimizer, Scene3d, edit::EditCounts};
use gs_io::WorldFrame;
use serde::{Deserialize, Serialize};

use crate::{
    error::Error,
    run::{Clamped, FreshStart, Shortfall},
};

use super::{
    evaluation::{Evaluation, TrainingViews},
    exposure::ExposureReport,
    poses::PosesReport,
    settings::TrainSettings,
    trainer::Trainer3d,
    trial::report::TrialReport,
};

/// Difference in PSNR between training views and held-out views above which a scene is overfitted,
/// dB. At 3 dB the error of held-out views is twice that of training views.
pub const DRIFT_DB: f64 = 3.0;

/// Cost and quality of a training.
///
/// Quality is measured on the 8-bit images of the scene. All numbers except the cost
/// (steps and seconds) describe the final scene, also where the training returned to its first
/// Gaussians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct TrainSummary {
    /// Number of Gaussians of the scene.
    pub gaussians: u32,
    /// Why there are clearly fewer Gaussians than the settings allow, where this is so:
    /// [`Trainer::shortfall`](crate::Trainer::shortfall).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortfall: Option<Shortfall>,
    /// Steps done, those before a restart included.
    pub iterations: u32,
    /// Training time, s; see [`Progress::seconds`](crate::Progress::seconds).
    pub seconds: f64,
    /// Number of training views.
    pub train_views: usize,
    /// Number of held-out views; without any, `evaluation` is of a few training views.
    pub test_views: usize,
    /// Name of the backend and what it runs on.
    pub backend: String,
    /// Number of threads, where the caller knows it.
    pub threads: Option<u32>,
    /// The frame of the scene, if its coordinates are not those of the data set.
    #[serde(default, skip_serializing_if = "WorldFrame::is_world")]
    pub frame: WorldFrame,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Loss of the scene: [`TrainingViews::loss`].
    pub loss: Option<f32>,
    /// Edits of density control since the start or the last restart.
    pub edits: EditCounts,
    /// Restarts of the training.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fresh_starts: Vec<FreshStart>,
    /// Gaussians whose scales are at a bound.
    #[serde(default)]
    pub clamped: Clamped,
    /// Quality on held-out views.
    pub evaluation: Evaluation,
    /// Quality on training views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<TrainingViews>,
    /// Differences in exposure that the training found between its views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<ExposureReport>,
    /// What a trial before the first step found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trial: Option<TrialReport>,
    /// Refinement of the training views' poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<PosesReport>,
    /// All settings, to repeat the training.
    pub settings: TrainSettings,
}

impl TrainSummary {
    /// The summary of a training in its current state, with an evaluation of its scene.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn new<R: Optimizer<Scene3d>>(trainer: &Trainer3d<'_, R>, evaluation: Evaluation) -> Result<Self, Error> {
        let training = trainer.training_views().await?;
        let settings = trainer.settings();
        Ok(Self {
            gaussians: trainer.count(),
            shortfall: trainer.shortfall(),
            iterations: trainer.step(),
            seconds: trainer.seconds(),
            train_views: trainer.views().train.len(),
            test_views: trainer.views().test.len(),
            backend: trainer.backend(),
            threads: None,
            frame: trainer.views().frame,
            seed: settings.seed,
            loss: Some(training.loss),
            edits: *trainer.edits(),
            fresh_starts: trainer.fresh_starts().to_vec(),
            clamped: trainer.clamped().await?,
            evaluation,
            training: Some(training),
            exposure: trainer.exposure(),
            trial: trainer.trial().copied(),
            poses: trainer.poses(),
            settings: trainer.settings_to_repeat().clone(),
        })
    }

    /// Overfitting, dB: PSNR on training views less that on held-out views, where that is more than
    /// [`DRIFT_DB`]. If the exposure of images is corrected, that with matched colours counts.
    pub fn drift(&self) -> Option<f64> {
        let training = self.training.filter(|_| self.test_views > 0)?.psnr?;
        let corrected = self.exposure.is_some_and(|exposure| exposure.used);
        let held_out = match self.evaluation.color_matched {
            Some(matched) if corrected => matched.psnr,
            _ => self.evaluation.psnr,
        };
        Some(training - held_out).filter(|&drift| drift > DRIFT_DB)
    }
}
