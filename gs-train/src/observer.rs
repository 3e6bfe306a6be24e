//! What a caller sees of a fit while it runs, and how it steers it.

use gs_core::{edit::EditCounts, statistics::Culled};
use gs_io::Checkpoint;

use crate::{clamped::Clamped, error::Error, recovery::FreshStart};

/// Whether to go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Control {
    /// Go on.
    #[default]
    Continue,
    /// Stop at the next step at which a checkpoint can be taken; observers go on being called until then.
    Stop,
}

/// How close the rendering, as it is written in 8 bits, is to the target. Measuring it costs a rendering.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Mean absolute difference.
    pub l1: f64,
    /// dB; ∞ where there is no difference.
    pub psnr: f64,
    /// Gaussians that the rendering left out.
    pub culled: Culled,
    /// Gaussians whose scales are held back.
    pub clamped: Clamped,
}

/// Where a fit stands after a step and the density control that may follow it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Steps done.
    pub step: u32,
    /// Steps in all.
    pub iterations: u32,
    /// Time spent fitting, s: initialising, stepping and density control, over all the runs of a resumed fit, but not observers,
    /// nor the quality and checkpoints they ask for.
    pub seconds: f64,
    /// Gaussians now.
    pub count: u32,
    /// The last loss that is known: that before step `loss_step`. Some backends tell it late, so that they need not wait for the device
    /// (gs-wgpu by a few steps; gs-cpu never). The loss before `step` itself stands here after the first step of a run, after a round
    /// of density control, after the last step, and where the quality was measured.
    pub loss: f32,
    /// The step, counted from 1, whose loss that is.
    pub loss_step: u32,
    /// What density control did after the step, where it ran.
    pub edits: Option<EditCounts>,
    /// That the run begins again after the step, where it has become worse than it was at first; the count is that of the Gaussians it
    /// goes on with.
    pub fresh_start: Option<FreshStart>,
    /// An estimate of PSNR before step `loss_step` from the loss, dB, where the loss is L2. It is that of floats that are not held to 0..=1,
    /// so it differs a little from [`Quality::psnr`].
    pub psnr_estimate: Option<f32>,
    /// How good the scene is after all that, where an observer asked.
    pub quality: Option<Quality>,
}

impl Progress {
    /// PSNR, dB: as measured, or else as estimated.
    pub fn psnr(&self) -> Option<f64> {
        self.quality.map(|q| q.psnr).or(self.psnr_estimate.map(f64::from))
    }

    /// Whether this was the last step.
    pub fn is_last(&self) -> bool {
        self.step >= self.iterations
    }
}

/// Someone who watches a fit. Every method has a default that asks for nothing; `()` is an observer.
///
/// After each step: [`on_edit`](Self::on_edit) where density control ran,
/// [`on_fresh_start`](Self::on_fresh_start) where the run begins again, [`wants_quality`](Self::wants_quality),
/// [`on_step`](Self::on_step), [`wants_checkpoint`](Self::wants_checkpoint) and, at once or a few steps later,
/// [`on_losses`](Self::on_losses) and [`on_checkpoint`](Self::on_checkpoint).
pub trait Observer {
    /// Density control ran after the step; `counts` are also in `progress.edits`.
    fn on_edit(&mut self, progress: &Progress, counts: &EditCounts) {
        let _ = (progress, counts);
    }

    /// The run begins again after the step; `fresh_start` is also in `progress`.
    fn on_fresh_start(&mut self, progress: &Progress, fresh_start: &FreshStart) {
        let _ = (progress, fresh_start);
    }

    /// Whether to measure the quality now; it will be in the `progress` of [`on_step`](Self::on_step).
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        let _ = progress;
        false
    }

    /// A step is done.
    fn on_step(&mut self, progress: &Progress) -> Control {
        let _ = progress;
        Control::Continue
    }

    /// The losses before the steps from `first_step` on, counted from 1, have become known. Every step's loss is told once, in order, and
    /// after the step's [`on_step`](Self::on_step); when a checkpoint is made and when a run ends well, all have been told.
    fn on_losses(&mut self, first_step: u32, losses: &[f32]) {
        let _ = (first_step, losses);
    }

    /// Whether to take a checkpoint, now or at the next step at which one can be taken.
    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        let _ = progress;
        false
    }

    /// The checkpoint that an observer wanted. Of several observers the first sees it first, and may add to its metadata; whoever
    /// stores it should come last.
    ///
    /// # Errors
    /// Whatever keeps it from being stored; it ends the run.
    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint) -> Result<(), Error> {
        let _ = checkpoint;
        Ok(())
    }
}

impl Observer for () {}

impl<O: Observer + ?Sized> Observer for &mut O {
    fn on_edit(&mut self, progress: &Progress, counts: &EditCounts) {
        (**self).on_edit(progress, counts);
    }

    fn on_fresh_start(&mut self, progress: &Progress, fresh_start: &FreshStart) {
        (**self).on_fresh_start(progress, fresh_start);
    }

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

    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint) -> Result<(), Error> {
        (**self).on_checkpoint(checkpoint)
    }
}

/// Two observers side by side; either can stop the run, and both see every checkpoint.
impl<A: Observer, B: Observer> Observer for (A, B) {
    fn on_edit(&mut self, progress: &Progress, counts: &EditCounts) {
        self.0.on_edit(progress, counts);
        self.1.on_edit(progress, counts);
    }

    fn on_fresh_start(&mut self, progress: &Progress, fresh_start: &FreshStart) {
        self.0.on_fresh_start(progress, fresh_start);
        self.1.on_fresh_start(progress, fresh_start);
    }

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

    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint) -> Result<(), Error> {
        self.0.on_checkpoint(checkpoint)?;
        self.1.on_checkpoint(checkpoint)
    }
}
