//! What `gs fit` and `gs train` share: arguments, the training run itself, progress, checkpoints,
//! and common results.

pub(crate) mod arguments;
pub(crate) mod checkpoints;
pub(crate) mod job;
mod observers;
mod pauses;
pub(crate) mod phases;
mod problems;
mod progress;
pub(crate) mod results;
mod status;

use std::time::Instant;

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::Optimizer;
use gs_lab::report::curve::CurvePoint;
use gs_train::{Error, MetricsLog, Observer as _, Outcome, Trainable, Trainer};

pub(crate) use self::pauses::Pauses;
use self::{
    checkpoints::{Checkpoints, StoreCheckpoints},
    job::Run,
    observers::{Curve, LogFile, StopIf},
    progress::Display,
    results::Summary,
};
use crate::{
    failure::Failure,
    files::output_folder::OutputFolder,
    terminal::{
        interrupt::{AT_NEXT_STEP, Interrupt},
        output,
    },
};

/// Trains to the last step, until the end of its time or until Ctrl-C, then writes the results and prints the
/// summary.
pub(crate) fn run<S: Trainable, T: Summary>(
    run: &Run,
    checkpoints: Checkpoints,
    (trainer, log): (Trainer<'_, AnyRasterizer, S>, MetricsLog),
    pauses: Option<&dyn Pauses<S>>,
    write_results: impl FnOnce(&Trainer<'_, AnyRasterizer, S>, &MetricsLog, &[CurvePoint]) -> Result<T, Failure>,
) -> Result<(), Failure>
where
    AnyRasterizer: Optimizer<S>,
{
    let Run { job, folder, .. } = run;
    let display = Display::new(trainer.step(), trainer.iterations(), job.verbosity);
    let interrupt = Interrupt::listen(display.printer(), AT_NEXT_STEP);
    let watched = Watched { display, interrupt: &interrupt, pauses };
    let ended = complete(watched, folder, checkpoints, (trainer, log), write_results)?;
    if job.json {
        output::json(&ended.summary)?;
    } else {
        output::note(ended.summary.text(folder.path(), job.verbosity));
    }
    ended.finish()
}

/// How a run is watched, and what ends it before its last step.
pub(crate) struct Watched<'a, S: Trainable>
where
    AnyRasterizer: Optimizer<S>,
{
    display: Display,
    interrupt: &'a Interrupt,
    /// What is done between steps.
    pauses: Option<&'a dyn Pauses<S>>,
}

impl<'a, S: Trainable> Watched<'a, S>
where
    AnyRasterizer: Optimizer<S>,
{
    /// A run beside others, which prints problems only.
    pub(crate) fn silently(interrupt: &'a Interrupt) -> Self {
        Self { display: Display::silent(), interrupt, pauses: None }
    }
}

/// A run that has written its results.
pub(crate) struct Ended<T> {
    pub(crate) summary: T,
    checkpoints: Checkpoints,
    outcome: Outcome,
    step: u32,
    /// Whether the end of its time stopped it.
    is_over: bool,
}

impl<T> Ended<T> {
    /// Fails where the run was stopped, or a requested checkpoint could not be stored.
    pub(crate) fn finish(&self) -> Result<(), Failure> {
        match self.checkpoints.finish(self.outcome, self.step) {
            Err(failure) if self.is_over && self.checkpoints.failure.is_none() => {
                output::note(format_args!(
                    "note: the time limit ended the run before the last step: {}",
                    failure.message()
                ));
                Ok(())
            }
            finished => finished,
        }
    }
}

/// Trains, then writes the results.
pub(crate) fn complete<S: Trainable, T>(
    watched: Watched<'_, S>,
    folder: &OutputFolder,
    mut checkpoints: Checkpoints,
    (mut trainer, mut log): (Trainer<'_, AnyRasterizer, S>, MetricsLog),
    write_results: impl FnOnce(&Trainer<'_, AnyRasterizer, S>, &MetricsLog, &[CurvePoint]) -> Result<T, Failure>,
) -> Result<Ended<T>, Failure>
where
    AnyRasterizer: Optimizer<S>,
{
    let trained =
        train(watched, &mut trainer, &mut log, folder, &mut checkpoints).and_then(|(outcome, curve, is_over)| {
            let summary = write_results(&trainer, &log, &curve.0)?;
            Ok((outcome, summary, is_over))
        });
    let (outcome, summary, is_over) = trained.map_err(|failure| checkpoints.with_resume_hint(failure))?;
    checkpoints.remove_unrequested(outcome);
    Ok(Ended { summary, checkpoints, outcome, step: trainer.step(), is_over })
}

/// Trains with the observers of a run. The curve holds what they saw; the last value is whether the
/// end of the time stopped the run.
fn train<S: Trainable>(
    Watched { mut display, interrupt, pauses }: Watched<'_, S>,
    trainer: &mut Trainer<'_, AnyRasterizer, S>,
    log: &mut MetricsLog,
    folder: &OutputFolder,
    checkpoints: &mut Checkpoints,
) -> Result<(Outcome, Curve, bool), Failure>
where
    AnyRasterizer: Optimizer<S>,
{
    let printer = display.printer();
    let mut curve = Curve::begun_by(log);
    let mut is_over = false;
    let mut file = LogFile::begin(folder, log, printer.clone())?;
    let mut store = StoreCheckpoints::new(checkpoints, printer.clone());
    let outcome = loop {
        // Stopping and going on changes nothing about the result of a run.
        let (pause, end) = (pauses.map(Pauses::next), pauses.and_then(Pauses::end));
        let is_pause = |step: u32| pause.is_some_and(|at| step >= at);
        let mut stops = StopIf(|step| {
            is_over |= end.is_some_and(|end| Instant::now() >= end);
            is_over || interrupt.requested() || is_pause(step)
        });
        let outcome = trainer.run(&mut ((&mut display, &mut file), (&mut curve, (&mut store, &mut stops)))).block_on();
        let is_paused = is_pause(trainer.step()) && matches!(outcome, Ok(Outcome::Stopped));
        match pauses {
            Some(pauses) if is_paused && !interrupt.requested() && !is_over => pauses.pause(trainer)?,
            _ => break outcome,
        }
    };
    printer.clear_bar();
    let outcome = match outcome {
        Ok(Outcome::Stopped) => {
            // The results are written even if this checkpoint fails.
            store_now(trainer, log, checkpoints);
            Outcome::Stopped
        }
        // An image that cannot be read leaves the scene as the steps before made it.
        Err(error @ Error::Io(_)) if trainer.step() > 0 => {
            store_now(trainer, log, checkpoints);
            return Err(checkpoints.with_stored(error.into()));
        }
        outcome => outcome?,
    };
    Ok((outcome, curve, is_over && !interrupt.requested()))
}

/// Stores a checkpoint of the current step.
fn store_now<S: Trainable>(
    trainer: &mut Trainer<'_, AnyRasterizer, S>,
    log: &mut MetricsLog,
    checkpoints: &mut Checkpoints,
) where
    AnyRasterizer: Optimizer<S>,
{
    let taken = trainer.saved().block_on().and_then(|mut checkpoint| {
        log.on_checkpoint(&mut checkpoint)?;
        Ok(checkpoint)
    });
    match taken {
        Ok(checkpoint) => checkpoints.store(&checkpoint),
        Err(error) => checkpoints.failure = Some(error.into()),
    }
}
