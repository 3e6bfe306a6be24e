//! Recovery of diverging runs: they restart with lower learning rates.
//!
//! Learning rates that are too high move Gaussians out of the image or make them vanish, and
//! pruning can remove the last visible ones; no gradient brings them back. The first Gaussians of
//! such a run were better.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Whether a diverging run restarts.
///
/// A run diverges when its mean loss over a window of steps is higher by a twentieth than at its
/// start, and more than a quarter of that of an empty image: a good scene may well get worse for a
/// while. A window is a twentieth of the run, but at least 50 steps, or the whole of a shorter run.
/// The start is the first steps, as many as there are images, at most 50. A run does not diverge
/// while images are wrong by less than a hundredth of the range on average, or at the end by less
/// than half a display step. The 500 steps after a reset of opacities do not count.
///
/// The host keeps a copy of the Gaussians that the run started with, or that it was resumed with.
/// So a diverging run ends differently if it was resumed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Recovery {
    /// The run restarts from its first Gaussians at a tenth of the learning rates, down to a
    /// thousandth of those of the settings.
    ///
    /// From the second restart on there is no density control, which may be the cause. After the
    /// last step, if the last window was no better than the start, the last scene is compared with
    /// the first, and the better one is the result.
    #[default]
    BeginAgain,
    /// The run continues. For studies of failures.
    Never,
}

impl Recovery {
    /// Whether the recovery is the default, which settings files and the digests of settings leave
    /// out.
    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// A restart of a run, and its cause.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct FreshStart {
    /// Steps done before the restart.
    pub step: u32,
    /// Mean loss of the steps before the restart.
    pub loss: f64,
    /// Mean loss at the start of the run.
    pub first: f64,
}

impl fmt::Display for FreshStart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { loss, first, .. } = self;
        write!(
            f,
            "the loss is {loss:.2e}, at the start it was {first:.2e}: restarting with the first Gaussians at a tenth of the learning rate"
        )
    }
}

/// Learning-rate scale after this many restarts.
pub(crate) fn lr_scale(fresh_starts: usize) -> f32 {
    [1.0, 0.1, 0.01, 0.001][fresh_starts.min(3)]
}

/// A running mean of losses.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Mean {
    sum: f64,
    count: u32,
}

impl Mean {
    pub(crate) fn add(&mut self, loss: f32) {
        self.sum += f64::from(loss);
        self.count += 1;
    }

    /// The mean; NaN without losses.
    pub(crate) fn value(self) -> f64 {
        self.sum / f64::from(self.count)
    }
}

/// Number of steps after a reset of opacities whose losses do not count, as the scene has not
/// recovered.
const RESET_STEPS: u32 = 500;

/// Steps of the shortest window.
const SHORTEST_WINDOW: u32 = 50;

/// Largest number of windows.
const MOST_WINDOWS: u32 = 20;

/// Factor by which a loss must exceed that of the start to be worse.
const MARGIN: f64 = 1.05;

/// The losses by which divergence is detected.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    /// Losses of the start.
    first: Mean,
    /// Losses of the current window that count.
    window: Mean,
    /// Losses of steps up to this one do not count.
    settled_after: u32,
}

/// Result of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Judgement {
    /// Mean loss of the window.
    pub(crate) loss: f64,
    /// Mean loss of the start.
    pub(crate) first: f64,
}

impl Judgement {
    /// Whether the loss is worse than that of the start.
    pub(crate) fn is_worse(self) -> bool {
        self.loss > MARGIN * self.first
    }
}

impl Watch {
    /// Records the loss of step `step`, counted from 1, of a run with this many images.
    pub(crate) fn record(&mut self, step: u32, loss: f32, images: u32) {
        if self.first.count < images.clamp(1, SHORTEST_WINDOW) {
            self.first.add(loss);
        }
        if step > self.settled_after {
            self.window.add(loss);
        }
    }

    /// Records a reset of opacities after step `step`.
    pub(crate) fn record_reset(&mut self, step: u32) {
        self.settled_after = step.saturating_add(RESET_STEPS);
    }

    /// Whether a window ends with step `step`, counted from 1, of a run of this many steps.
    pub(crate) fn ends_window(step: u32, iterations: u32) -> bool {
        let windows = (iterations / SHORTEST_WINDOW).clamp(1, MOST_WINDOWS);
        let window = |step: u32| u64::from(step) * u64::from(windows) / u64::from(iterations.max(1));
        step > 0 && window(step) > window(step - 1)
    }

    /// Ends a window; `None` where none of its losses count.
    pub(crate) fn end_window(&mut self) -> Option<Judgement> {
        let window = std::mem::take(&mut self.window);
        (window.count > 0).then(|| Judgement { loss: window.value(), first: self.first.value() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_cover_a_run_whole() {
        for (iterations, expected) in [(1, 1), (49, 1), (99, 1), (100, 2), (310, 6), (30_000, 20), (u32::MAX, 20)] {
            assert!(Watch::ends_window(iterations, iterations), "{iterations}");
            if iterations < 1_000_000 {
                let ends: Vec<u32> = (0..=iterations).filter(|&step| Watch::ends_window(step, iterations)).collect();
                assert_eq!(ends.len(), expected, "{ends:?} of {iterations}");
                assert!(ends.windows(2).all(|pair| pair[1] - pair[0] >= SHORTEST_WINDOW), "{ends:?}");
            }
        }
        assert!(!Watch::ends_window(0, 0));
    }

    #[test]
    fn the_start_is_as_many_steps_as_there_are_pictures() {
        let mut watch = Watch::default();
        [0.5, 0.25, 9.0, 9.0].iter().zip(1..).for_each(|(&loss, step)| watch.record(step, loss, 2));
        let judgement = watch.end_window().unwrap();
        assert_eq!(judgement, Judgement { loss: 4.6875, first: 0.375 });
        assert!(judgement.is_worse());
        watch.record(5, 0.39, 2);
        assert!(!watch.end_window().unwrap().is_worse(), "by less than a twentieth");
        let mut many = Watch::default();
        (1..=80).for_each(|step| many.record(step, if step <= 50 { 1.0 } else { 2.0 }, 1000));
        assert_eq!(many.end_window().unwrap().first, 1.0, "no more than are in the shortest window");
    }

    #[test]
    fn steps_after_a_reset_do_not_count() {
        let mut watch = Watch::default();
        watch.record(1, 0.5, 1);
        watch.record(2, 0.25, 1);
        watch.record_reset(2);
        assert_eq!(watch.end_window(), Some(Judgement { loss: 0.375, first: 0.5 }), "what came before does");
        (3..=502).for_each(|step| watch.record(step, 9.0, 1));
        assert_eq!(watch.end_window(), None);
        (503..=504).for_each(|step| watch.record(step, 0.25, 1));
        assert_eq!(watch.end_window(), Some(Judgement { loss: 0.25, first: 0.5 }));
    }
}
