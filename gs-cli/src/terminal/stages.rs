//! The progress of work in stages: a bar on a terminal, otherwise a line for a stage.

use std::{
    cell::RefCell,
    time::{Duration, Instant},
};

use gs_core::duration;
use indicatif::ProgressBar;

use super::{
    output,
    progress_bar::{Printer, bar},
};

/// Length of the bar.
const LENGTH: f64 = 1000.0;

/// A display on standard error.
pub(crate) struct Stages {
    bar: Option<ProgressBar>,
    started: Instant,
    /// The least time between two lines.
    pause: Duration,
    /// The stage of the last line, and its time.
    printed: RefCell<(String, Instant)>,
}

impl Stages {
    /// A display with at most one line in this time.
    pub(crate) fn new(pause: Duration) -> Self {
        let now = Instant::now();
        let bar = bar(LENGTH as u64, "{bar:20} {msg}  {elapsed}");
        Self { bar, started: now, pause, printed: RefCell::new((String::new(), now)) }
    }

    /// Prints without disturbing the display.
    pub(crate) fn printer(&self) -> Printer {
        Printer::above(self.bar.clone())
    }

    /// Shows how much of the work is done, 0 to 1, and the stage by its name and in words.
    pub(crate) fn show(&self, stage: &str, words: &str, done: f64) {
        let mut printed = self.printed.borrow_mut();
        match &self.bar {
            Some(bar) => {
                bar.set_message(words.to_owned());
                bar.set_position((LENGTH * done) as u64);
            }
            None if printed.0 != stage && printed.1.elapsed() >= self.pause => {
                output::note(format_args!("{}: {words}", duration(self.started.elapsed().as_secs_f64())));
                *printed = (stage.to_owned(), Instant::now());
            }
            None => {}
        }
    }
}
