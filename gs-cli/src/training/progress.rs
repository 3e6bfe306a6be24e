//! The display of a run: a bar on a terminal, a few lines elsewhere.

use std::time::{Duration, Instant};

use gs_core::{counted, edit::EditCounts};
use gs_train::{Control, Observer, Progress};
use indicatif::ProgressBar;

use super::{problems::Problems, status::Status};
use crate::terminal::{
    output::{self, Verbosity},
    progress_bar::{Printer, bar, columns},
};

/// Time between two drawings of the bar.
const REDRAW: Duration = Duration::from_millis(100);
/// The least time between two measurements of the PSNR, which render an image or many, if the loss
/// gives no estimate.
const MEASURE: Duration = Duration::from_millis(500);
/// Inverse of the share of the time that measurements may take.
const MEASURE_SHARE: u32 = 40;
/// The least time between two lines. There is at most one for each tenth of the run.
const LINE: Duration = Duration::from_secs(1);

/// An observer that shows the progress of a run.
pub(crate) struct Display {
    kind: ProgressForm,
    verbosity: Verbosity,
    started: Instant,
    first_step: u32,
    drawn: Instant,
    /// Time at which the measurement under way was requested.
    measured: Option<Instant>,
    /// Earliest time of the next measurement.
    measure_at: Instant,
    /// The last PSNR, measured or estimated, dB; see [`Status::psnr`].
    psnr: Option<f64>,
    problems: Problems,
    /// The causes of problems that were printed above a bar, which has no room for them.
    reported: [bool; 5],
}

enum ProgressForm {
    Bar(ProgressBar),
    /// Plain lines, and the tenth of the run that the last one was for.
    Lines(u64),
    /// Nothing but problems, where other runs print, too.
    Silent,
}

impl Display {
    /// A display on standard error for a run that begins after `step` of `iterations` steps.
    pub(crate) fn new(step: u32, iterations: u32, verbosity: Verbosity) -> Self {
        // The message has as many words as fit the line: a bar in two lines cannot be removed.
        let kind = match bar(u64::from(iterations), "{bar:10} {pos}/{len}  {msg}") {
            Some(bar) => ProgressForm::Bar(bar.with_position(u64::from(step))),
            None => ProgressForm::Lines(0),
        };
        Self::of_kind(kind, step, verbosity)
    }

    /// Prints problems only.
    pub(crate) fn silent() -> Self {
        Self::of_kind(ProgressForm::Silent, 0, Verbosity::Normal)
    }

    fn of_kind(kind: ProgressForm, first_step: u32, verbosity: Verbosity) -> Self {
        let now = Instant::now();
        Self {
            kind,
            verbosity,
            started: now,
            first_step,
            drawn: now,
            measured: None,
            measure_at: now,
            psnr: None,
            problems: Problems::none(verbosity),
            reported: [false; 5],
        }
    }

    /// Prints without disturbing the display.
    pub(crate) fn printer(&self) -> Printer {
        Printer::above(match &self.kind {
            ProgressForm::Bar(bar) => Some(bar.clone()),
            ProgressForm::Lines(_) | ProgressForm::Silent => None,
        })
    }

    fn status(&self, progress: &Progress) -> Status {
        let Progress { step, iterations, count, loss, .. } = *progress;
        // The rate of this run, which may have resumed another.
        let rate = f64::from(step - self.first_step) / self.started.elapsed().as_secs_f64().max(1e-9);
        let left = f64::from(iterations - step) / rate.max(1e-9);
        Status { steps: iterations, gaussians: count, loss, psnr: self.psnr, rate, left }
    }

    fn line(&self, progress: &Progress) -> String {
        let Progress { step, iterations, .. } = progress;
        format!("step {step}/{iterations}  {}{}", self.status(progress).whole(), self.problems)
    }

    /// Prints problems that are new. Lines show them always.
    fn report_problems(&mut self, progress: &Progress) {
        if !matches!(self.kind, ProgressForm::Lines(_)) && self.problems.are_new(&mut self.reported) {
            self.printer().print(format_args!("note: step {}{}", progress.step, self.problems));
        }
    }
}

/// A line about a round of density control.
fn round(progress: &Progress, counts: &EditCounts) -> String {
    let edits = [
        ("cloned", counts.cloned),
        ("split", counts.split),
        ("seeded", counts.seeded),
        ("pruned as transparent", counts.pruned_transparent),
        ("pruned as too large", counts.pruned_too_large),
        ("pruned as not finite", counts.pruned_not_finite),
        ("pruned as contributing least", counts.pruned_unimportant),
    ];
    let edits = edits.iter().filter(|(_, count)| *count > 0).map(|(edit, count)| format!("{count} {edit}"));
    let edits = edits.collect::<Vec<_>>().join(", ");
    let edits = if edits.is_empty() { "no change" } else { &edits };
    format!("step {}: {edits}; {}", progress.step, counted(progress.count, "Gaussian"))
}

impl Display {
    /// Counts and prints the edits and the restart that followed a step.
    fn report_changes(&mut self, progress: &Progress) {
        if let Some(counts) = &progress.edits {
            self.problems.add_edits(counts);
            if self.verbosity == Verbosity::Verbose {
                self.printer().print(round(progress, counts));
            }
        }
        if let Some(fresh_start) = &progress.fresh_start {
            self.problems.add_restart();
            if progress.is_last() {
                self.printer().print(
                    "note: the last Gaussians are worse than the first, which are the result: lower the learning rates",
                );
            } else {
                self.printer().print(format_args!("note: step {}: {fresh_start}", progress.step));
            }
        }
    }
}

impl Observer for Display {
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        let due = Instant::now() >= self.measure_at;
        let wanted = progress.psnr_estimate.is_none() && matches!(self.kind, ProgressForm::Bar(_)) && due;
        self.measured = wanted.then(Instant::now);
        wanted
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        self.report_changes(progress);
        self.psnr = progress.psnr().or(self.psnr);
        if let Some(quality) = &progress.quality {
            self.problems.measure(quality.culled, quality.clamped);
        }
        self.report_problems(progress);
        if let Some(measured) = self.measured.take() {
            let pause = MEASURE.max(measured.elapsed() * MEASURE_SHARE);
            self.measure_at = Instant::now() + pause;
        }
        let since = self.drawn.elapsed();
        match &self.kind {
            ProgressForm::Bar(bar) if since >= REDRAW || progress.is_last() => {
                bar.set_length(u64::from(progress.iterations));
                bar.set_position(u64::from(progress.step));
                bar.set_message(self.status(progress).within(columns()));
                self.drawn = Instant::now();
            }
            ProgressForm::Lines(last) => {
                let tenth = u64::from(progress.step) * 10 / u64::from(progress.iterations.max(1));
                if (tenth > *last && since >= LINE) || progress.is_last() {
                    output::note(self.line(progress));
                    self.kind = ProgressForm::Lines(tenth);
                    self.drawn = Instant::now();
                }
            }
            ProgressForm::Bar(_) | ProgressForm::Silent => {}
        }
        Control::Continue
    }
}
