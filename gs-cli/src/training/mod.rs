//! What `gs fit` and `gs train` share: arguments, the training run itself, progress, checkpoints,
//! and common results.

pub(crate) mod arguments;
pub(crate) mod checkpoints;
mod observers;
mod problems;
mod progress;
pub(crate) mod results;
mod status;

use std::time::Instant;

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::Optimizer;
use gs_lab::figure::curve::CurvePoint;
use gs_train::{MetricsLog, Observer as _, Outcome, Trainable, Trainer};

use self::{
    arguments::OutputArgs,
    checkpoints::{Checkpoints, StoreCheckpoints},
    observers::{Curve, LogFile, StopAtEnd, StopOnInterrupt},
    progress::Display,
    results::Summary,
};
use crate::{
    failure::Failure,
    interrupt::{AT_NEXT_STEP, Interrupt},
    output,
    output_folder::OutputFolder,
};

/// Trains to the last step, until `end` or until Ctrl-C, then writes the results and prints the
/// summary.
pub(crate) fn run<S: Trainable, T: Summary>(
    args: &OutputArgs,
    folder: &OutputFolder,
    mut checkpoints: Checkpoints,
    (mut trainer, mut log): (Trainer<'_, AnyRasterizer, S>, MetricsLog),
    end: Option<Instant>,
    write_results: impl FnOnce(&Trainer<'_, AnyRasterizer, S>, &MetricsLog, &[CurvePoint]) -> Result<T, Failure>,
) -> Result<(), Failure>
where
    AnyRasterizer: Optimizer<S>,
{
    let trained =
        train(args, (&mut trainer, end), &mut log, folder, &mut checkpoints).and_then(|(outcome, curve, is_over)| {
            let summary = write_results(&trainer, &log, &curve.0)?;
            Ok((outcome, summary, is_over))
        });
    let (outcome, summary, is_over) = trained.map_err(|failure| checkpoints.with_resume_hint(failure))?;
    checkpoints.remove_unrequested(outcome);
    if args.json {
        output::json(&summary)?;
    } else {
        output::note(summary.text(folder.path(), args.verbosity()));
    }
    match checkpoints.finish(outcome, trainer.step()) {
        Err(failure) if is_over && checkpoints.failure.is_none() => {
            output::note(format_args!(
                "note: the time limit ended the run before the last step: {}",
                failure.message()
            ));
            Ok(())
        }
        finished => finished,
    }
}

/// Trains with the observers of a run. The curve holds what they saw; the last value is whether the
/// end of the time stopped the run.
fn train<S: Trainable>(
    args: &OutputArgs,
    (trainer, end): (&mut Trainer<'_, AnyRasterizer, S>, Option<Instant>),
    log: &mut MetricsLog,
    folder: &OutputFolder,
    checkpoints: &mut Checkpoints,
) -> Result<(Outcome, Curve, bool), Failure>
where
    AnyRasterizer: Optimizer<S>,
{
    let mut display = Display::new(trainer.step(), trainer.iterations(), args.verbosity());
    let printer = display.printer();
    let interrupt = Interrupt::listen(printer.clone(), AT_NEXT_STEP);
    let mut curve = Curve::begun_by(log);
    let stop = StopOnInterrupt(&interrupt);
    let mut at_end = StopAtEnd::new(end);
    let mut file = LogFile::begin(folder, log, printer.clone())?;
    let store = StoreCheckpoints::new(checkpoints, printer.clone());
    let outcome = trainer.run(&mut ((&mut display, &mut file), (&mut curve, (store, (stop, &mut at_end))))).block_on();
    printer.clear_bar();
    let outcome = outcome?;
    if outcome == Outcome::Stopped {
        // The results are written even if this checkpoint fails.
        let taken = trainer.saved().block_on().and_then(|mut checkpoint| {
            log.on_checkpoint(&mut checkpoint)?;
            Ok(checkpoint)
        });
        match taken {
            Ok(checkpoint) => checkpoints.store(&checkpoint),
            Err(error) => checkpoints.failure = Some(error.into()),
        }
    }
    Ok((outcome, curve, at_end.stopped && !interrupt.requested()))
}
