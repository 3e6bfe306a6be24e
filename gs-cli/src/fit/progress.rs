//! What a fit shows while it runs: a bar on a terminal, a few lines elsewhere.

use std::{
    fmt,
    io::{IsTerminal, stderr},
    time::{Duration, Instant},
};

use gs_core::{counted, edit::EditCounts};
use gs_train::{Control, FreshStart, Observer, Progress};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle, TermLike};

use crate::{
    fit::{status::Status, terminal::Terminal, trouble::Trouble},
    output,
    training_arguments::Detail,
};

/// Time between two drawings of the bar: fast enough for the eye.
const REDRAW: Duration = Duration::from_millis(100);
/// Time between two measurements of the quality, which cost a rendering or many, where the loss does not tell it.
const MEASURE: Duration = Duration::from_millis(500);
/// A measurement may take one part in so many of the time.
const MEASURE_SHARE: u32 = 40;
/// Time between two lines, at least; there is at most one for each tenth of the fit.
const LINE: Duration = Duration::from_secs(1);

/// An observer that shows how far the fit is.
pub(crate) struct Display {
    kind: Kind,
    detail: Detail,
    started: Instant,
    first_step: u32,
    drawn: Instant,
    /// When a measurement was last asked for.
    measured: Option<Instant>,
    /// When the next may be.
    measure_at: Instant,
    /// The last PSNR that was measured or estimated, dB; see [`Status::psnr`].
    psnr: Option<f64>,
    /// What is wrong, as far as it is known.
    trouble: Trouble,
    /// The worst of it that has been said above a bar, in which there is no room for it.
    warned: Trouble,
}

/// Says something from any thread, above the bar where there is one.
#[derive(Debug, Clone)]
pub(crate) struct Voice(Option<ProgressBar>);

impl Voice {
    /// A voice above this bar, or a plain one.
    pub(crate) fn above(bar: Option<ProgressBar>) -> Self {
        Self(bar)
    }

    /// One line on standard error.
    pub(crate) fn say(&self, line: impl fmt::Display) {
        match &self.0 {
            Some(bar) => bar.suspend(|| output::note(line)),
            None => output::note(line),
        }
    }

    /// Takes the bar away, so that what follows is written below nothing.
    pub(crate) fn clear(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
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
            let target = ProgressDrawTarget::term_like_with_hz(Box::new(Terminal::default()), 10);
            let bar = ProgressBar::with_draw_target(Some(u64::from(iterations)), target).with_position(u64::from(step));
            // What follows the bar has as many words as fit the line: one that is broken cannot be taken back.
            let template = "{wide_bar} {pos}/{len}  {msg}";
            bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
            Kind::Bar(bar)
        } else {
            Kind::Lines(0)
        };
        let now = Instant::now();
        Self {
            kind,
            detail,
            started: now,
            first_step: step,
            drawn: now,
            measured: None,
            measure_at: now,
            psnr: None,
            trouble: Trouble::with(detail),
            warned: Trouble::with(detail),
        }
    }

    /// What speaks without disturbing the display.
    pub(crate) fn voice(&self) -> Voice {
        Voice::above(match &self.kind {
            Kind::Bar(bar) => Some(bar.clone()),
            Kind::Lines(_) => None,
        })
    }

    fn status(&self, progress: &Progress) -> Status {
        let Progress { step, iterations, count, loss, .. } = *progress;
        let rate = self.rate(progress);
        let left = f64::from(iterations - step) / rate.max(1e-9);
        Status { steps: iterations, gaussians: count, loss, psnr: self.psnr, rate, left }
    }

    fn line(&self, progress: &Progress) -> String {
        let Progress { step, iterations, .. } = progress;
        format!("step {step}/{iterations}  {}{}", self.status(progress).whole(), self.trouble)
    }

    /// Says what is wrong, and that it has become worse, where there is a bar; lines have room to say it in each.
    fn warn(&mut self, progress: &Progress) {
        if matches!(self.kind, Kind::Bar(_)) && self.trouble.is_news_after(&self.warned) {
            self.voice().say(format_args!("note: step {}{}", progress.step, self.trouble));
            self.warned = self.trouble.worst(&self.warned);
        }
    }

    /// Steps per second of this run, which may not be the first of its fit.
    fn rate(&self, progress: &Progress) -> f64 {
        f64::from(progress.step - self.first_step) / self.started.elapsed().as_secs_f64().max(1e-9)
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
    format!("step {}: {told}; {}", progress.step, counted(progress.count, "Gaussian"))
}

impl Observer for Display {
    fn on_edit(&mut self, progress: &Progress, counts: &EditCounts) {
        self.trouble.add_edits(counts);
        if self.detail == Detail::Rounds {
            self.voice().say(round(progress, counts));
        }
    }

    fn on_fresh_start(&mut self, progress: &Progress, fresh_start: &FreshStart) {
        // Said here, so there is no need to warn of it.
        self.trouble.add_fresh_start();
        self.warned.add_fresh_start();
        if progress.is_last() {
            self.voice().say(
                "note: the last Gaussians are worse than the first, which are the result: lower the learning rates",
            );
        } else {
            self.voice().say(format_args!("note: step {}: {fresh_start}", progress.step));
        }
    }

    fn wants_quality(&mut self, progress: &Progress) -> bool {
        let due = Instant::now() >= self.measure_at;
        let wanted = progress.psnr_estimate.is_none() && matches!(self.kind, Kind::Bar(_)) && due;
        self.measured = wanted.then(Instant::now);
        wanted
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        self.psnr = progress.psnr().or(self.psnr);
        if let Some(quality) = &progress.quality {
            self.trouble.see(quality.culled, quality.clamped);
        }
        self.warn(progress);
        if let Some(measured) = self.measured.take() {
            let pause = MEASURE.max(measured.elapsed() * MEASURE_SHARE);
            self.measure_at = Instant::now() + pause;
        }
        let since = self.drawn.elapsed();
        match &self.kind {
            Kind::Bar(bar) if since >= REDRAW || progress.is_last() => {
                bar.set_position(u64::from(progress.step));
                bar.set_message(self.status(progress).within(Terminal::default().width().into()));
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
