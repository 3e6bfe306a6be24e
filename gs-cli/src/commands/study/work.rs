//! `gs study work`: does runs of a study that other processes work on, too.

use std::{
    fmt::Display,
    sync::atomic::{AtomicUsize, Ordering},
};

use gs_backend::Chosen;
use gs_core::counted;
use gs_lab::{
    Plan, conduct,
    run::{Conducted, RunOutcome, Watcher},
    study::{Machine, Run},
};

use super::{
    arguments::WorkArgs,
    prepare::{held, rasterizers},
};
use crate::{
    failure::Failure,
    terminal::{
        interrupt::{AT_NEXT_STEP, Interrupt},
        output::{self, quoted},
        progress_bar::Printer,
    },
};

/// Does runs until none is left for this process.
pub(super) fn run(args: &WorkArgs) -> Result<(), Failure> {
    let held = held(&args.study, false)?;
    let folder = &held.folder;
    let backends = open(args, folder.machine())?;
    let plan = held.plan(Machine::of(&backends[0].rasterizer))?;
    folder.check(&plan)?;
    output::note(&backends[0].reason);
    let printer = Printer::above(None);
    let log = Log { plan: &plan, interrupt: Interrupt::listen(printer, AT_NEXT_STEP), done: AtomicUsize::new(0) };
    let conducted = conduct(&plan, &rasterizers(&backends), folder, &args.worker.settings(), &log)?;
    let done = counted(log.done.into_inner(), "run");
    let folder = quoted(folder.path());
    match conducted {
        Conducted::Stopped => {
            Err(Failure::interrupted(format_args!("stopped after {done}; to go on: gs study work {folder}")))
        }
        Conducted::Whole => output::result(format_args!("{done} done, none is left; see gs study report {folder}")),
        _ => output::result(format_args!(
            "{done} done, the others are with other processes; see gs study status {folder}"
        )),
    }
}

/// The backends of the study, or those that the flags ask for.
fn open(args: &WorkArgs, recorded: Option<Machine>) -> Result<Vec<Chosen>, Failure> {
    let Some(recorded) = recorded else { return args.backend.open_several(args.jobs.into()) };
    args.backend.or_recorded(&recorded).open_several(args.jobs.into()).map_err(|failure| {
        let hint = "a study has one backend and SIMD level for all machines: prepare it with one that all have";
        failure.at(format_args!("the study is on {}", recorded.name)).hint(hint)
    })
}

/// Prints a line for each run, as for the log of a job.
struct Log<'a> {
    plan: &'a Plan,
    interrupt: Interrupt,
    done: AtomicUsize,
}

impl Log<'_> {
    /// Prints a line about a run that has not ended.
    fn note(&self, run: &Run, what: impl Display) {
        output::note(format_args!("note: row {} ({}): {what}", run.row, self.plan.describe(run)));
    }
}

impl Watcher for Log<'_> {
    fn ended(&self, run: &Run, outcome: &RunOutcome) {
        self.done.fetch_add(1, Ordering::Relaxed);
        let end = match outcome {
            RunOutcome::Finished(finished) => format!("{:.2} dB after {:.1} s", finished.psnr, finished.seconds),
            RunOutcome::Failed { error } => format!("failed: {error}"),
        };
        output::note(format_args!("row {} ({}): {end}", run.row, self.plan.describe(run)));
    }

    fn resumed(&self, run: &Run, step: u32) {
        self.note(run, format_args!("goes on from its checkpoint at step {step} of {}", run.iterations()));
    }

    fn warned(&self, run: &Run, message: &str) {
        self.note(run, message);
    }

    fn wants_stop(&self) -> bool {
        self.interrupt.requested()
    }
}
