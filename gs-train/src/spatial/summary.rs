//! The result of a training in space in one value: what `summary.json` holds.

use gs_core::{Rasterizer, SpatialScene, edit::EditCounts};
use serde::{Deserialize, Serialize};

use crate::{clamped::Clamped, error::Error, joining::Join, recovery::FreshStart};

use super::{evaluation::Evaluation, settings::SpatialSettings, trainer::SpatialTrainer};

/// What a training cost and what came of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpatialSummary {
    /// Gaussians at the end.
    pub gaussians: u32,
    /// Steps done.
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
    /// The last loss that is known; nothing where no step was made.
    pub loss: Option<f32>,
    /// What density control did, all rounds together.
    pub edits: EditCounts,
    /// The effects that joined because they were called for.
    #[serde(default)]
    pub joins: Vec<Join>,
    /// How often the training began again, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fresh_starts: Vec<FreshStart>,
    /// Gaussians whose scales are at a bound.
    #[serde(default)]
    pub clamped: Clamped,
    /// How good the scene is.
    pub evaluation: Evaluation,
    /// All settings, to repeat the training.
    pub settings: SpatialSettings,
}

impl SpatialSummary {
    /// The summary of a training as it stands, whose scene is as good as `evaluation` says.
    ///
    /// # Errors
    /// Those of the backend.
    pub fn new<R: Rasterizer<SpatialScene>>(
        trainer: &SpatialTrainer<'_, R>,
        evaluation: Evaluation,
    ) -> Result<Self, Error> {
        Ok(Self {
            gaussians: trainer.count(),
            iterations: trainer.step(),
            seconds: trainer.seconds(),
            train_views: trainer.views().train.len(),
            test_views: trainer.views().test.len(),
            backend: trainer.backend(),
            threads: None,
            seed: trainer.settings().seed,
            loss: trainer.loss(),
            edits: *trainer.edits(),
            joins: trainer.joins().joins.clone(),
            fresh_starts: trainer.fresh_starts().to_vec(),
            clamped: trainer.clamped()?,
            evaluation,
            settings: trainer.settings().clone(),
        })
    }
}
