//! Progress bars on standard error, and lines above them.

use std::{
    fmt,
    io::{IsTerminal, stderr},
};

use console::Term;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::output;

/// Redrawings of a bar in a second.
const REDRAWS: u8 = 10;

/// A bar on standard error; `None` where that is not a terminal.
pub(crate) fn bar(length: u64, template: &str) -> Option<ProgressBar> {
    stderr().is_terminal().then(|| {
        let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr_with_hz(REDRAWS));
        bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar
    })
}

/// Prints lines on standard error from any thread, above the bar if there is one.
#[derive(Debug, Clone)]
pub(crate) struct Printer(Option<ProgressBar>);

impl Printer {
    /// Prints above this bar.
    pub(crate) fn above(bar: Option<ProgressBar>) -> Self {
        Self(bar)
    }

    /// Prints one line.
    pub(crate) fn print(&self, line: impl fmt::Display) {
        match &self.0 {
            Some(bar) => bar.suspend(|| output::note(line)),
            None => output::note(line),
        }
    }

    /// Removes the bar.
    pub(crate) fn clear_bar(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}

/// Room for what a terminal echoes, columns: that of Ctrl-C twice.
const ECHO: u16 = 4;

/// Columns of standard error that a line with a bar may fill. If the terminal echoes Ctrl-C behind a full
/// line, the line breaks, and the bar can no longer be removed.
pub(crate) fn columns() -> usize {
    usize::from(Term::stderr().size().1.saturating_sub(ECHO))
}
