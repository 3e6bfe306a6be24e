//! What a fit shows while it runs: a bar on a terminal, a few lines elsewhere.

use std::{
    io::{IsTerminal, stderr},
    time::{Duration, Instant},
};

use gs_core::edit::EditCounts;
use gs_train::{Control, Observer, Progress};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::{fit::arguments::Detail, output};

/// Time between two drawings of the bar: fast enough for the eye.
const REDRAW: Duration = Duration::from_millis(100);
/// Time between two measurements of the quality, which cost a rendering each, where the loss does not tell it.
const MEASURE: Duration = Duration::from_millis(500);
/// Time between two lines, at least; there is at most one for each tenth of the fit.
const LINE: Duration = Duration::from_secs(1);

/// An observer that shows how far the fit is.
pub(crate) struct Display {
    kind: Kind,
    detail: Detail,
    started: Instant,
    first_step: u32,
    drawn: Instant,
    measured: Option<Instant>,
    /// The last PSNR that was measured or estimated, dB.
    psnr: Option<f64>,
}

enum Kind {
    Bar(ProgressBar),
    /// Plain lines; the tenth of the fit that the last one told of.
    Lines(u64),
}

impl Display {
    /// A display on standard error for a fit that begins after `step` of `iterations` steps.
    pub(crate) fn new(step: u32, iterations: u32, detail: Detail) -> Self {
        let kind = if stderr().is_terminal() {
            let target = ProgressDrawTarget::stderr_with_hz(10);
            let bar = ProgressBar::with_draw_target(Some(u64::from(iterations)), target).with_position(u64::from(step));
            let template = "{bar:24} {pos}/{len}  {msg}  {per_sec}  {eta} left";
            bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
            Kind::Bar(bar)
        } else {
            Kind::Lines(0)
        };
        let now = Instant::now();
        Self { kind, detail, started: now, first_step: step, drawn: now, measured: None, psnr: None }
    }

    /// Takes the bar away, so that what follows is written below nothing.
    pub(crate) fn clear(&self) {
        if let Kind::Bar(bar) = &self.kind {
            bar.finish_and_clear();
        }
    }

    fn state(&self, progress: &Progress) -> String {
        let psnr = self.psnr.map_or_else(String::new, |psnr| format!("  PSNR {psnr:.2} dB"));
        format!("{} Gaussians  loss {:.3e}{psnr}", progress.count, progress.loss)
    }

    fn line(&self, progress: &Progress) -> String {
        let rate = f64::from(progress.step - self.first_step) / self.started.elapsed().as_secs_f64().max(1e-9);
        let left = f64::from(progress.iterations - progress.step) / rate.max(1e-9);
        let Progress { step, iterations, .. } = progress;
        format!("step {step}/{iterations}  {}  {rate:.0} it/s  {left:.0} s left", self.state(progress))
    }
}

/// One line about a round of density control: what came, what went, and why.
fn round(progress: &Progress, counts: &EditCounts) -> String {
    let causes = [
        ("cloned", counts.cloned),
        ("split", counts.split),
        ("seeded", counts.seeded),
        ("pruned as transparent", counts.pruned_transparent),
        ("pruned as too large", counts.pruned_too_large),
        ("pruned as not finite", counts.pruned_not_finite),
        ("pruned as contributing least", counts.pruned_unimportant),
    ];
    let told: Vec<String> =
        causes.iter().filter(|(_, count)| *count > 0).map(|(cause, count)| format!("{count} {cause}")).collect();
    let told = if told.is_empty() { "nothing to do".to_owned() } else { told.join(", ") };
    format!("step {}: {told}; {} Gaussians", progress.step, progress.count)
}

impl Observer for Display {
    fn on_edit(&mut self, progress: &Progress, counts: &EditCounts) {
        if self.detail == Detail::Rounds {
            let line = round(progress, counts);
            match &self.kind {
                Kind::Bar(bar) => bar.suspend(|| output::note(line)),
                Kind::Lines(_) => output::note(line),
            }
        }
    }

    fn wants_quality(&mut self, progress: &Progress) -> bool {
        let due = self.measured.is_none_or(|measured| measured.elapsed() >= MEASURE);
        let wanted = progress.psnr_estimate.is_none() && matches!(self.kind, Kind::Bar(_)) && due;
        if wanted {
            self.measured = Some(Instant::now());
        }
        wanted
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        self.psnr = progress.psnr().or(self.psnr);
        let since = self.drawn.elapsed();
        match &self.kind {
            Kind::Bar(bar) if since >= REDRAW || progress.is_last() => {
                bar.set_position(u64::from(progress.step));
                bar.set_message(self.state(progress));
                self.drawn = Instant::now();
            }
            Kind::Lines(told) => {
                let tenth = u64::from(progress.step) * 10 / u64::from(progress.iterations.max(1));
                if (tenth > *told && since >= LINE) || progress.is_last() {
                    output::note(self.line(progress));
                    self.kind = Kind::Lines(tenth);
                    self.drawn = Instant::now();
                }
            }
            Kind::Bar(_) => {}
        }
        Control::Continue
    }
}
