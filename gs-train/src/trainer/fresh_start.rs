//! How a run begins again that has become worse than it was at first; see [`Recovery`].

use gs_core::{Binning, Loss, Optimizer, Wait, constants::HALF_DISPLAY_STEP, edit::EditCounts};

use super::Trainer;
use crate::{
    error::Error,
    recovery::{FreshStart, Judgement, Recovery, Watch},
    task::{RunSettings, StepContext, Trainable, TrainingTask},
};

/// A scene's loss is the mean of at most so many steps.
const MOST_STEPS: u32 = 50;

/// What a run began with.
pub(super) struct Start<S> {
    scene: S,
    /// What density control had done before.
    edits: EditCounts,
}

/// A run whose pictures are off by less on the way, as a share of the range, has not failed, whatever it began with. Where the first picture is
/// as good as exact, such as one of a single colour, all that a run does makes it worse for a while.
const SMALL_ERROR: f32 = 0.01;

/// The loss of pictures that are off by so much.
fn loss_of_error(loss: Loss, error: f32) -> f64 {
    let error = f64::from(error);
    match loss {
        Loss::L2 => error * error,
        Loss::L1 => error,
        Loss::L1Dssim { lambda } => (1.0 - f64::from(lambda)) * error,
    }
}

impl<R: Optimizer<S>, S: Trainable> Trainer<'_, R, S> {
    /// Whether the run is judged after the step just done.
    pub(super) fn is_judged(&self) -> bool {
        self.recovers() && Watch::ends_window(self.record.step, self.record.settings.iterations())
    }

    fn recovers(&self) -> bool {
        self.record.settings.recovery() == Recovery::BeginAgain
    }

    /// Keeps the Gaussians that this run begins with, where it may have to go back to them.
    pub(super) async fn keep_start(&mut self) -> Result<(), Error> {
        if self.start.is_none() && self.recovers() {
            let edits = self.record.edits;
            self.start = Some(Start { scene: self.rasterizer.download(&self.splats).await?, edits });
        }
        Ok(())
    }

    /// Begins again where the run is judged and has failed.
    pub(super) async fn begin_again(&mut self) -> Result<Option<FreshStart>, Error> {
        if !self.is_judged() {
            return Ok(None);
        }
        let Some(judgement) = self.watch.end_window() else { return Ok(None) };
        let Some(start) = self.start.take() else { return Ok(None) };
        let outcome = self.go_back_if_failed(judgement, &start).await;
        self.start = Some(start);
        outcome
    }

    async fn go_back_if_failed(&mut self, judgement: Judgement, start: &Start<S>) -> Result<Option<FreshStart>, Error> {
        if !self.has_failed(judgement, &start.scene).await? {
            return Ok(None);
        }
        self.splats = self.rasterizer.upload(&start.scene, self.record.settings.parameterization())?;
        self.binning = Binning::Fresh;
        self.record.edits = start.edits;
        let fresh_start = FreshStart { step: self.record.step, loss: judgement.loss, first: judgement.first };
        self.record.fresh_starts.push(fresh_start);
        Ok(Some(fresh_start))
    }

    /// Whether what there is, is worse than the start: by the window; after the last step, which no other follows, by the scene itself.
    async fn has_failed(&mut self, judgement: Judgement, start: &S) -> Result<bool, Error> {
        let doubtful = judgement.is_worse() || self.is_finished() && judgement.loss > judgement.first;
        if !doubtful {
            return Ok(false);
        }
        if judgement.loss <= self.loss_of(&S::default()).await? / 4.0 {
            return Ok(false);
        }
        let kind = self.record.settings.loss();
        if !self.is_finished() {
            return Ok(judgement.loss > loss_of_error(kind, SMALL_ERROR));
        }
        let scene = self.rasterizer.download(&self.splats).await?;
        let loss = self.loss_of(&scene).await?;
        Ok(loss > loss_of_error(kind, HALF_DISPLAY_STEP) && loss > self.loss_of(start).await?)
    }

    /// The mean loss of a scene in the last steps, as many as there are pictures.
    async fn loss_of(&mut self, scene: &S) -> Result<f64, Error> {
        let settings = &self.record.settings;
        let mut splats = self.rasterizer.upload(scene, settings.parameterization())?;
        let mut losses = Vec::new();
        let steps = self.task.pictures().min(MOST_STEPS);
        for step in self.record.step.saturating_sub(steps)..self.record.step {
            let effects = settings.effects_after(step);
            // The loss is that before the step, so it does not matter where the step leads; it may not lead far, as there are others.
            let context = StepContext { step, effects, lr_scale: 0.0, binning: Binning::Fresh };
            self.task.send(self.rasterizer, &mut splats, settings, context).await?;
            self.rasterizer.losses(&mut splats, Wait::All, &mut losses).await?;
        }
        Ok(losses.iter().map(|&loss| f64::from(loss)).sum::<f64>() / losses.len() as f64)
    }
}
