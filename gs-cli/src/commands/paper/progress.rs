//! The progress of `gs paper`: on a terminal a bar over the steps of the fit under way, otherwise a
//! line now and then.

use std::time::{Duration, Instant};

use gs_lab::experiments::{Experiment, Watch};
use gs_train::Progress;
use indicatif::ProgressBar;

use crate::{
    output,
    progress_bar::{Printer, bar},
};

/// Time between two drawings of the bar.
const REDRAW: Duration = Duration::from_millis(100);

/// Time between two lines about fits if there is no bar.
const LINE: Duration = Duration::from_secs(10);

/// Shows the progress of the experiments.
pub(crate) struct Display {
    bar: Option<ProgressBar>,
    experiments: usize,
    begun: usize,
    experiment: &'static str,
    fits: u32,
    drawn: Instant,
}

impl Display {
    /// A display on standard error for this number of experiments.
    pub(crate) fn new(experiments: usize) -> Self {
        let bar = bar(0, "{prefix}  {wide_msg} {bar:20} {pos}/{len}");
        Self { bar, experiments, begun: 0, experiment: "", fits: 0, drawn: Instant::now() }
    }

    /// Prints without disturbing the display.
    pub(crate) fn printer(&self) -> Printer {
        Printer::above(self.bar.clone())
    }

    /// Begins the next experiment.
    pub(crate) fn begin(&mut self, experiment: Experiment) {
        self.begun += 1;
        self.fits = 0;
        self.experiment = experiment.name();
        if let Some(bar) = &self.bar {
            bar.set_prefix(format!("{} {}/{}", self.experiment, self.begun, self.experiments));
        }
    }
}

impl Watch for Display {
    fn on_fit(&mut self, label: &str) {
        self.fits += 1;
        match &self.bar {
            Some(bar) => bar.set_message(label.to_owned()),
            None if self.drawn.elapsed() >= LINE => {
                let Self { experiment, begun, experiments, fits, .. } = self;
                output::note(format_args!("{experiment} ({begun} of {experiments}), fit {fits}: {label}"));
                self.drawn = Instant::now();
            }
            None => {}
        }
    }

    fn on_step(&mut self, progress: &Progress) {
        if let Some(bar) = &self.bar
            && (self.drawn.elapsed() >= REDRAW || progress.step == 1)
        {
            bar.set_length(progress.iterations.into());
            bar.set_position(progress.step.into());
            self.drawn = Instant::now();
        }
    }
}
