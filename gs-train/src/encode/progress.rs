//! What an encoder reports while it works.

use std::cell::Cell;

use crate::run::{Control, Observer, Progress};

/// The work of a stage of encoding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum EncodeWork {
    /// Fitting Gaussians to the image.
    Fit,
    /// Rounding the Gaussians of a fit to what the file stores.
    Rounding,
}

/// How far an encoder is.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct EncodeProgress {
    /// The stage, counted from 1. Fits and roundings repeat until the target is met, so how many there
    /// are is not known before the end.
    pub stage: u32,
    /// The work of the stage.
    pub work: EncodeWork,
    /// Number of Gaussians of the stage.
    pub gaussians: usize,
    /// Share of the stage that is done, 0..=1.
    pub done: f64,
}

/// Counts the stages, and reports to the caller.
pub(super) struct Report<'a> {
    to: &'a dyn Fn(EncodeProgress),
    stages: Cell<u32>,
}

impl<'a> Report<'a> {
    pub(super) fn new(to: &'a dyn Fn(EncodeProgress)) -> Self {
        Self { to, stages: Cell::new(0) }
    }

    /// Begins a stage of as many parts as there are bands.
    pub(super) fn begin(&self, work: EncodeWork, gaussians: usize, bands: usize) -> Stage<'_> {
        self.stages.set(self.stages.get() + 1);
        let stage = Stage { to: self.to, progress: self.at(work, gaussians), bands, band: 0 };
        stage.report(0.0);
        stage
    }

    fn at(&self, work: EncodeWork, gaussians: usize) -> EncodeProgress {
        EncodeProgress { stage: self.stages.get(), work, gaussians, done: 0.0 }
    }
}

/// A stage of encoding; as an observer, it reports the steps of a fit of its current band.
pub(super) struct Stage<'a> {
    to: &'a dyn Fn(EncodeProgress),
    progress: EncodeProgress,
    bands: usize,
    band: usize,
}

impl Stage<'_> {
    /// Reports how much of the current band is done.
    pub(super) fn report(&self, done: f64) {
        let done = (self.band as f64 + done) / self.bands.max(1) as f64;
        (self.to)(EncodeProgress { done, ..self.progress });
    }

    /// Goes on to the next band.
    pub(super) fn end_band(&mut self) {
        self.band += 1;
    }
}

impl Observer for Stage<'_> {
    fn on_step(&mut self, progress: &Progress) -> Control {
        self.report(f64::from(progress.step) / f64::from(progress.iterations.max(1)));
        Control::Continue
    }
}
