//! What is done with a run now and then, while it trains.

use std::time::Instant;

use gs_backend::AnyRasterizer;
use gs_core::Optimizer;
use gs_train::{Trainable, Trainer};

use crate::failure::Failure;

/// What is done with a run between two steps.
pub(crate) trait Pauses<S: Trainable>
where
    AnyRasterizer: Optimizer<S>,
{
    /// The next step after which to pause, or the first one after it that allows it.
    fn next(&self) -> u32;

    /// When the run is to stop, finished or not.
    fn end(&self) -> Option<Instant> {
        None
    }

    /// Does it.
    fn pause(&self, trainer: &mut Trainer<'_, AnyRasterizer, S>) -> Result<(), Failure>;
}
