//! Looks at a run's scene now and then, while it trains.

use gs_backend::AnyRasterizer;
use gs_core::Optimizer;
use gs_train::{Control, Observer, Progress, Trainable, Trainer};

use crate::failure::Failure;

/// What looks at the scene of a run, between two steps.
pub(crate) trait Frames<S: Trainable>
where
    AnyRasterizer: Optimizer<S>,
{
    /// The next step after which to look, or the first one after it that allows it.
    fn next(&self) -> u32;

    /// Looks at the scene.
    fn take(&self, trainer: &Trainer<'_, AnyRasterizer, S>) -> Result<(), Failure>;
}

/// Pauses the run at a step, if any; going on changes nothing about its result.
pub(super) struct PauseAt(pub(super) Option<u32>);

impl PauseAt {
    /// Whether the run has come there after `step` steps.
    pub(super) fn is_reached(&self, step: u32) -> bool {
        self.0.is_some_and(|at| step >= at)
    }
}

impl Observer for PauseAt {
    fn on_step(&mut self, progress: &Progress) -> Control {
        if self.is_reached(progress.step) { Control::Stop } else { Control::Continue }
    }
}
