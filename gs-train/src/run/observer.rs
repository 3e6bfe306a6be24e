//! Observers: how a caller watches and stops a run.

use gs_core::{Culled, SavedState, edit::EditCounts};
use gs_io::Checkpoint;

use super::{clamped::Clamped, recovery::FreshStart};
use crate::error::Error;

/// Whether a run continues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Control {
    /// Continue.
    #[default]
    Continue,
    /// Stop at the next step at which a checkpoint is possible; observers are called until then.
    Stop,
}

/// Quality of the 8-bit rendering against the target. Measuring it costs a rendering.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Quality {
    /// Mean absolute difference.
    pub l1: f64,
    /// PSNR, dB; ∞ where there is no difference.
    pub psnr: f64,
    /// Gaussians that the rendering left out.
    pub culled: Culled,
    /// Gaussians whose scales are at a bound.
    pub clamped: Clamped,
    /// PSNR of each view in which some pixel counts, dB, in the order of
    /// [`Evaluation::views`](crate::train::Evaluation::views); empty for a fit of an image.
    pub views: Vec<f64>,
}

/// State of a run after a step and the density control that may follow it.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// Steps done.
    pub step: u32,
    /// Steps in all.
    pub iterations: u32,
    /// Training time, s: initialisation, steps and density control, over all parts of a resumed
    /// run, without observers and without the quality and checkpoints that they request.
    pub seconds: f64,
    /// Number of Gaussians.
    pub count: u32,
    /// The last loss that has arrived: that before step `loss_step`.
    ///
    /// Some backends report losses late, so that they need not wait for the device (gs-wgpu by a
    /// few steps; gs-cpu never). It is the loss before `step` after the first step of a run, after
    /// a round of density control, after the last step, and where the quality was measured.
    pub loss: f32,
    /// Step, counted from 1, of that loss.
    pub loss_step: u32,
    /// Edits of density control after the step, where it ran.
    pub edits: Option<EditCounts>,
    /// Restart after the step, where the run has diverged; `count` is then that of the Gaussians it
    /// continues with.
    pub fresh_start: Option<FreshStart>,
    /// Estimate of PSNR before step `loss_step` from the loss, dB, where the loss is L2 and
    /// pixels have no weights.
    ///
    /// It is that of floats that are not clamped to 0..=1, so it differs a little from
    /// [`Quality::psnr`].
    pub psnr_estimate: Option<f32>,
    /// Quality of the scene after the step and its edits, where an observer requested it.
    pub quality: Option<Quality>,
}

impl Progress {
    /// PSNR, dB: measured or else estimated.
    pub fn psnr(&self) -> Option<f64> {
        self.quality.as_ref().map(|q| q.psnr).or(self.psnr_estimate.map(f64::from))
    }

    /// Whether this was the last step.
    pub fn is_last(&self) -> bool {
        self.step >= self.iterations
    }
}

/// An observer of a run. Every method has a default that does nothing; `()` is an observer.
///
/// The calls after each step are [`wants_quality`](Self::wants_quality), [`on_step`](Self::on_step),
/// [`wants_checkpoint`](Self::wants_checkpoint) and, at once or a few steps later,
/// [`on_losses`](Self::on_losses) and [`on_checkpoint`](Self::on_checkpoint).
pub trait Observer {
    /// Whether to measure the quality; it is then in the `progress` of [`on_step`](Self::on_step).
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        let _ = progress;
        false
    }

    /// A step is done, and so is what follows it: [`Progress::edits`] where density control ran,
    /// [`Progress::fresh_start`] where the run restarts.
    fn on_step(&mut self, progress: &Progress) -> Control {
        let _ = progress;
        Control::Continue
    }

    /// The losses before the steps from `first_step` on, counted from 1, have arrived.
    ///
    /// Every step's loss is reported once, in order, and after the step's
    /// [`on_step`](Self::on_step). All are reported before a checkpoint and before a run ends
    /// without an error.
    fn on_losses(&mut self, first_step: u32, losses: &[f32]) {
        let _ = (first_step, losses);
    }

    /// Whether to take a checkpoint, now or at the next step at which one is possible.
    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        let _ = progress;
        false
    }

    /// The checkpoint that an observer requested. Several observers receive it in order and may add
    /// to its metadata, so the one that stores it should be the last.
    ///
    /// # Errors
    /// Any error of storing it, which ends the run.
    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        let _ = checkpoint;
        Ok(())
    }
}

impl Observer for () {}

impl<O: Observer + ?Sized> Observer for &mut O {
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        (**self).wants_quality(progress)
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        (**self).on_step(progress)
    }

    fn on_losses(&mut self, first_step: u32, losses: &[f32]) {
        (**self).on_losses(first_step, losses);
    }

    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        (**self).wants_checkpoint(progress)
    }

    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        (**self).on_checkpoint(checkpoint)
    }
}

/// Two observers; either can stop the run, and both receive every checkpoint.
impl<A: Observer, B: Observer> Observer for (A, B) {
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        let (first, second) = (self.0.wants_quality(progress), self.1.wants_quality(progress));
        first || second
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        match (self.0.on_step(progress), self.1.on_step(progress)) {
            (Control::Continue, Control::Continue) => Control::Continue,
            _ => Control::Stop,
        }
    }

    fn on_losses(&mut self, first_step: u32, losses: &[f32]) {
        self.0.on_losses(first_step, losses);
        self.1.on_losses(first_step, losses);
    }

    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        let (first, second) = (self.0.wants_checkpoint(progress), self.1.wants_checkpoint(progress));
        first || second
    }

    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        self.0.on_checkpoint(checkpoint)?;
        self.1.on_checkpoint(checkpoint)
    }
}
