//! `gs blocks work`: trains blocks that other processes work on, too.

use std::{
    fmt::Display,
    sync::atomic::{AtomicUsize, Ordering},
};

use gs_core::counted;
use gs_lab::{
    blocks::{BlockOutcome, BlocksFolder, BlocksWatcher, conduct},
    run::Conducted,
    study::Machine,
};

use super::{arguments::WorkArgs, open, views};
use crate::{
    failure::Failure,
    memory::Need,
    terminal::{
        interrupt::{AT_NEXT_STEP, Interrupt},
        output::{self, quoted},
        progress_bar::Printer,
    },
};

/// Trains blocks until none is left for this process.
pub(super) fn run(args: &WorkArgs) -> Result<(), Failure> {
    let folder = open(&args.folder)?;
    let views = views(&folder, &args.data)?;
    let prepared = &folder.origin().machine;
    let backend = args.backend.or_recorded(prepared).open().map_err(|failure| {
        let hint = "blocks have one backend and SIMD level for all machines: prepare them with one that all have";
        failure.at(format_args!("the blocks are for {}", prepared.name)).hint(hint)
    })?;
    folder.check(&Machine::of(&backend.rasterizer))?;
    if args.retry {
        folder.forget_failures()?;
    }
    check_memory(&folder)?;
    output::note(&backend.reason);
    let interrupt = Interrupt::listen(Printer::above(None), AT_NEXT_STEP);
    let log = Log { folder: &folder, interrupt, done: AtomicUsize::new(0) };
    let conducted = conduct(&folder, &backend.rasterizer, &views, &args.worker.settings(), &log)?;
    let done = counted(log.done.into_inner(), "block");
    let path = quoted(folder.path());
    match conducted {
        Conducted::Stopped => {
            Err(Failure::interrupted(format_args!("stopped after {done}; to go on: gs blocks work {path}")))
        }
        Conducted::Whole => {
            output::result(format_args!("{done} done, none is left; join them with gs blocks merge {path}"))
        }
        _ => output::result(format_args!(
            "{done} done, the others are with other processes; see gs blocks status {path}"
        )),
    }
}

/// Fails where this process may not have the memory of some block that has not ended.
fn check_memory(folder: &BlocksFolder) -> Result<(), Failure> {
    for (block, planned) in folder.plan().blocks.iter().enumerate() {
        if folder.record(block)?.is_none() {
            let what = format!("block {} of {}", block + 1, folder.path().display());
            Need { what, bytes: planned.memory, held: 0, less: "prepare more blocks" }.check()?;
        }
    }
    Ok(())
}

/// Prints a line for each block, as for the log of a job.
struct Log<'a> {
    folder: &'a BlocksFolder,
    interrupt: Interrupt,
    done: AtomicUsize,
}

impl Log<'_> {
    fn note(&self, block: usize, what: impl Display) {
        output::note(format_args!("block {} of {}: {what}", block + 1, self.folder.plan().blocks.len()));
    }
}

impl BlocksWatcher for Log<'_> {
    fn begun(&self, block: usize) {
        let planned = &self.folder.plan().blocks[block];
        self.note(
            block,
            format_args!("{} from {}", counted(planned.steps, "step"), counted(planned.views.len(), "view")),
        );
    }

    fn resumed(&self, block: usize, step: u32) {
        self.note(block, format_args!("note: goes on from its checkpoint at step {step}"));
    }

    fn warned(&self, block: usize, message: &str) {
        self.note(block, format_args!("note: {message}"));
    }

    fn ended(&self, block: usize, outcome: &BlockOutcome) {
        self.done.fetch_add(1, Ordering::Relaxed);
        match outcome {
            BlockOutcome::Finished { gaussians, seconds, .. } => {
                self.note(block, format_args!("{} after {seconds:.1} s", counted(*gaussians, "Gaussian")));
            }
            BlockOutcome::Failed { error } => self.note(block, format_args!("failed: {error}")),
            _ => {}
        }
    }

    fn wants_stop(&self) -> bool {
        self.interrupt.requested()
    }
}
