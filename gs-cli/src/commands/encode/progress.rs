//! What `gs encode` shows while it encodes one image: a bar on a terminal, a few lines elsewhere.

use std::{
    cell::Cell,
    time::{Duration, Instant},
};

use gs_core::counted;
use gs_train::{EncodeProgress, EncodeWork};
use indicatif::ProgressBar;

use crate::terminal::{output, progress_bar::bar};

/// Length of the bar.
const LENGTH: f64 = 1000.0;

/// The least time between two lines.
const LINE: Duration = Duration::from_secs(1);

/// A display on standard error.
pub(super) struct Display {
    bar: Option<ProgressBar>,
    started: Instant,
    /// The stage of the last line, and its time.
    printed: Cell<(u32, Instant)>,
}

impl Display {
    pub(super) fn new() -> Self {
        let now = Instant::now();
        let bar = bar(LENGTH as u64, "{bar:20} {msg}  {elapsed}");
        Self { bar, started: now, printed: Cell::new((0, now)) }
    }

    /// Shows how far the encoder is.
    pub(super) fn show(&self, progress: EncodeProgress) {
        if let Some(bar) = &self.bar {
            bar.set_message(words(&progress));
            bar.set_position((LENGTH * progress.done) as u64);
            return;
        }
        let (stage, at) = self.printed.get();
        if progress.stage != stage && at.elapsed() >= LINE {
            output::note(format_args!("{:.0} s: {}", self.started.elapsed().as_secs_f64(), words(&progress)));
            self.printed.set((progress.stage, Instant::now()));
        }
    }

    /// Removes the bar.
    pub(super) fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// What the encoder is doing.
fn words(progress: &EncodeProgress) -> String {
    let work = match progress.work {
        EncodeWork::Rounding => "rounding",
        _ => "fitting",
    };
    format!("{work} {}", counted(progress.gaussians, "Gaussian"))
}
