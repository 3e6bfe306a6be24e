//! Restarts of diverging runs; see [`Recovery`].

use gs_core::{Binning, Loss, Optimizer, Wait, constants::HALF_DISPLAY_STEP, edit::EditCounts};

use crate::run::trainer::Trainer;
use crate::{
    error::Error,
    run::{
        recovery::{FreshStart, Judgement, Recovery, Watch},
        task::{RunSettings, StepContext, Trainable, TrainingTask},
    },
};

/// Largest number of steps whose mean is a scene's loss.
const MOST_STEPS: u32 = 50;

/// The state that a run started with.
pub(super) struct Start<S> {
    scene: S,
    /// Edits of density control before.
    edits: EditCounts,
}

/// Mean error of images, as a share of the range, below which a run has not diverged. Where the
/// first image is nearly exact, such as one of a single colour, training makes it worse for a
/// while.
const SMALL_ERROR: f32 = 0.01;

/// The loss of images with this error at every pixel.
fn loss_of_error(loss: Loss, error: f32) -> f64 {
    let error = f64::from(error);
    match loss {
        Loss::L2 => error * error,
        Loss::L1 => error,
        Loss::L1Dssim { lambda } => (1.0 - f64::from(lambda)) * error,
    }
}

impl<R: Optimizer<S>, S: Trainable> Trainer<'_, R, S> {
    /// Whether divergence is checked after the step just done.
    pub(super) fn is_judged(&self) -> bool {
        self.recovers() && Watch::ends_window(self.record.step, self.iterations())
    }

    fn recovers(&self) -> bool {
        self.record.settings.of_loop().recovery == Recovery::BeginAgain
    }

    /// Keeps the Gaussians that this run starts with, for a restart.
    pub(super) async fn keep_start(&mut self) -> Result<(), Error> {
        if self.start.is_none() && self.recovers() {
            let edits = self.record.edits;
            self.start = Some(Start { scene: self.rasterizer.download(&self.splats).await?, edits });
        }
        Ok(())
    }

    /// Restarts the run if it has diverged.
    pub(super) async fn restart_if_diverged(&mut self) -> Result<Option<FreshStart>, Error> {
        if !self.is_judged() {
            return Ok(None);
        }
        let Some(judgement) = self.watch.end_window() else { return Ok(None) };
        let Some(start) = self.start.take() else { return Ok(None) };
        let outcome = self.restart(judgement, &start).await;
        self.start = Some(start);
        outcome
    }

    async fn restart(&mut self, judgement: Judgement, start: &Start<S>) -> Result<Option<FreshStart>, Error> {
        if !self.has_diverged(judgement, &start.scene).await? {
            return Ok(None);
        }
        self.splats = self.rasterizer.upload(&start.scene, self.record.settings.parameterization())?;
        self.forget_average();
        self.binning = Binning::Fresh;
        self.record.edits = start.edits;
        let fresh_start = FreshStart { step: self.record.step, loss: judgement.loss, first: judgement.first };
        self.record.fresh_starts.push(fresh_start);
        Ok(Some(fresh_start))
    }

    /// Whether the run is worse than its start: by the window, and after the last step by the scene
    /// itself.
    async fn has_diverged(&mut self, judgement: Judgement, start: &S) -> Result<bool, Error> {
        let doubtful = judgement.is_worse() || self.is_finished() && judgement.loss > judgement.first;
        if !doubtful {
            return Ok(false);
        }
        if judgement.loss <= self.loss_of(&S::default()).await? / 4.0 {
            return Ok(false);
        }
        let kind = self.record.settings.of_loop().loss;
        if !self.is_finished() {
            return Ok(judgement.loss > loss_of_error(kind, SMALL_ERROR));
        }
        let scene = self.rasterizer.download(&self.splats).await?;
        let loss = self.loss_of(&scene).await?;
        Ok(loss > loss_of_error(kind, HALF_DISPLAY_STEP) && loss > self.loss_of(start).await?)
    }

    /// Mean loss of a scene in the last steps, as many as there are images.
    async fn loss_of(&mut self, scene: &S) -> Result<f64, Error> {
        let settings = &self.record.settings;
        let mut splats = self.rasterizer.upload(scene, settings.parameterization())?;
        let mut losses = Vec::new();
        let steps = self.task.images().min(MOST_STEPS);
        for step in self.record.step.saturating_sub(steps)..self.record.step {
            let effects = settings.effects_after(step);
            // The loss is that before the step; the scale of 0 keeps the scene for the other steps.
            let context = StepContext { step, effects, full_depth: 0.0, lr_scale: 0.0, binning: Binning::Fresh };
            self.task.send(self.rasterizer, &mut splats, settings, context).await?;
            self.rasterizer.losses(&mut splats, Wait::All, &mut losses).await?;
        }
        Ok(losses.iter().map(|&loss| f64::from(loss)).sum::<f64>() / losses.len() as f64)
    }
}
