//! Looks at a run's scene now and then, while it trains.

use gs_backend::AnyRasterizer;
use gs_core::Optimizer;
use gs_train::{Trainable, Trainer};

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
