//! How a run begins again that has become worse than it was at first; see [`Recovery`].

use gs_core::{Binning, Rasterizer, Wait, guards::Guard};

use super::Trainer;
use crate::{
    course::{Course, Due, RunSettings, Trainable},
    error::Error,
    recovery::{FreshStart, Recovery, Watch},
};

/// Of so many steps at most the loss of an empty picture is the mean: no picture's differs so much from the others'.
const MOST_EMPTY_STEPS: u32 = 50;

impl<R: Rasterizer<S>, S: Trainable> Trainer<'_, R, S> {
    /// Whether the run is judged after the step just done.
    pub(super) fn is_judged(&self) -> bool {
        self.recovers() && Watch::ends_window(self.record.step, self.record.settings.iterations())
    }

    fn recovers(&self) -> bool {
        self.record.settings.recovery() == Recovery::BeginAgain && Guard::FreshStart.is_on()
    }

    /// Keeps the Gaussians that this run begins with, where it may have to go back to them.
    pub(super) fn keep_start(&mut self) -> Result<(), Error> {
        if self.start.is_none() && self.recovers() {
            self.start = Some(self.rasterizer.download(&self.cloud)?);
        }
        Ok(())
    }

    /// Begins again where the run is judged and has failed.
    pub(super) fn begin_again(&mut self) -> Result<Option<FreshStart>, Error> {
        if !self.is_judged() {
            return Ok(None);
        }
        let Some((steps, loss, first)) = self.record.watch.end_window(self.record.step) else { return Ok(None) };
        let Some(start) = self.start.take() else { return Ok(None) };
        if loss > self.loss_of_nothing(steps.min(MOST_EMPTY_STEPS))? / 4.0 {
            self.cloud = self.rasterizer.upload(&start, self.record.settings.chart())?;
            self.record.fresh_starts.push(FreshStart { step: self.record.step, loss, first });
            self.binning = Binning::Fresh;
        }
        self.start = Some(start);
        Ok(self.record.fresh_starts.last().copied().filter(|start| start.step == self.record.step))
    }

    /// The mean loss of an empty scene in the last so many steps.
    fn loss_of_nothing(&mut self, steps: u32) -> Result<f64, Error> {
        let settings = &self.record.settings;
        let mut empty = self.rasterizer.upload(&S::default(), settings.chart())?;
        let mut losses = Vec::new();
        for step in self.record.step - steps..self.record.step {
            let effects = settings.effects_after(step, &self.record.joins);
            let due = Due { step, effects, pace: 0.0, binning: Binning::Fresh };
            self.course.send(self.rasterizer, &mut empty, settings, due)?;
            self.rasterizer.losses(&mut empty, Wait::All, &mut losses)?;
        }
        Ok(losses.iter().map(|&loss| f64::from(loss)).sum::<f64>() / losses.len() as f64)
    }
}
