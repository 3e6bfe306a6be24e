//! The result of a training in 3D in one value: what `summary.json` holds.

use gs_core::{Optimizer, Scene3d, edit::EditCounts};
use serde::{Deserialize, Serialize};

use crate::{clamped::Clamped, error::Error, recovery::FreshStart, shortfall::Shortfall};

use super::{
    evaluation::{Evaluation, TrainingViews},
    settings::TrainSettings,
    trainer::Trainer3d,
};

/// A scene that fits its training views better than held-out views by more than this has learnt these views rather than what they show, dB.
/// At 3 dB the error of held-out views is twice that of training views.
pub const DRIFT_DB: f64 = 3.0;

/// What a training cost and what came of it.
///
/// Figures of quality are those of the 8-bit images that are written of the scene. All numbers but the cost (steps and seconds) describe the
/// scene as it is, also where the training returned to its first Gaussians at the end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainSummary {
    /// Gaussians of the scene.
    pub gaussians: u32,
    /// That there are clearly fewer than the settings allow, and why. Nothing where the settings name no number of their own and the policy
    /// aims at none, as 3DGS's does not: then theirs is a bound, not a goal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shortfall: Option<Shortfall>,
    /// Steps done, those before a fresh start included.
    pub iterations: u32,
    /// Time spent training, s; see [`Progress::seconds`](crate::Progress::seconds).
    pub seconds: f64,
    /// Views trained with.
    pub train_views: usize,
    /// Views held out; without any, `evaluation` is of a few of those trained with.
    pub test_views: usize,
    /// The backend and what it runs on.
    pub backend: String,
    /// Threads that computed, where the caller knows.
    pub threads: Option<u32>,
    /// The seed of all random numbers.
    pub seed: u32,
    /// The loss of the scene: [`TrainingViews::loss`].
    pub loss: Option<f32>,
    /// What density control did to its Gaussians, all rounds together; of those before a fresh start nothing is left.
    pub edits: EditCounts,
    /// How often the training began again, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fresh_starts: Vec<FreshStart>,
    /// Gaussians whose scales are at a bound.
    #[serde(default)]
    pub clamped: Clamped,
    /// How good the scene is.
    pub evaluation: Evaluation,
    /// How well it fits views that it was trained with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<TrainingViews>,
    /// All settings, to repeat the training.
    pub settings: TrainSettings,
}

impl TrainSummary {
    /// The summary of a training as it stands, whose scene is as good as `evaluation` says.
    ///
    /// # Errors
    /// Those of the backend.
    pub async fn new<R: Optimizer<Scene3d>>(trainer: &Trainer3d<'_, R>, evaluation: Evaluation) -> Result<Self, Error> {
        let training = trainer.training_views().await?;
        let settings = trainer.settings();
        let is_bound = settings.gaussians == TrainSettings::default().gaussians && !settings.policy.aims_at_budget();
        Ok(Self {
            gaussians: trainer.count(),
            shortfall: Shortfall::of(trainer, &settings.policy).filter(|_| !is_bound),
            iterations: trainer.step(),
            seconds: trainer.seconds(),
            train_views: trainer.views().train.len(),
            test_views: trainer.views().test.len(),
            backend: trainer.backend(),
            threads: None,
            seed: settings.seed,
            loss: Some(training.loss),
            edits: *trainer.edits(),
            fresh_starts: trainer.fresh_starts().to_vec(),
            clamped: trainer.clamped().await?,
            evaluation,
            training: Some(training),
            settings: settings.clone(),
        })
    }

    /// By how many dB the scene fits views that it was trained with better than held-out views, where that is more than [`DRIFT_DB`].
    pub fn drift(&self) -> Option<f64> {
        let training = self.training.filter(|_| self.test_views > 0)?.psnr?;
        Some(training - self.evaluation.psnr).filter(|&drift| drift > DRIFT_DB)
    }
}
