//! What is shown while poses are found: a bar on a terminal, otherwise a line for each stage.

use std::time::Instant;

use gs_core::duration;
use gs_poses::{Observer, Stage};
use indicatif::ProgressBar;

use crate::terminal::{
    interrupt::Interrupt,
    output,
    progress_bar::{Printer, bar},
};

/// A display on standard error, and Ctrl-C.
pub(super) struct Display {
    bar: Option<ProgressBar>,
    interrupt: Interrupt,
    started: Instant,
    stage: Option<Stage>,
}

impl Display {
    pub(super) fn new() -> Self {
        let bar = bar(1, "{bar:20} {msg}  {elapsed}");
        let interrupt = Interrupt::listen(Printer::above(bar.clone()), "stopping");
        Self { bar, interrupt, started: Instant::now(), stage: None }
    }

    /// Removes the bar.
    pub(super) fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Observer for Display {
    fn progress(&mut self, stage: Stage, done: usize, total: usize) {
        let is_new = self.stage.replace(stage) != Some(stage);
        match &self.bar {
            Some(bar) => {
                bar.set_length(total.max(1) as u64);
                bar.set_position(done.min(total) as u64);
                bar.set_message(stage.words());
            }
            None if is_new => {
                output::note(format_args!("{}: {}", duration(self.started.elapsed().as_secs_f64()), stage.words()))
            }
            None => {}
        }
    }

    fn note(&mut self, line: &str) {
        Printer::above(self.bar.clone()).print(format_args!("note: {line}"));
    }

    fn is_cancelled(&self) -> bool {
        self.interrupt.requested()
    }
}
