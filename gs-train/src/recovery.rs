//! What a run does when it has become worse than it was at first: it begins again, more slowly.
//!
//! Learning rates that are too high drive Gaussians out of the picture, or make them vanish, and pruning can take the last that anyone
//! sees: no gradient leads back from there. Such a run is not over: its first Gaussians were better.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Whether a run that has failed begins again.
///
/// A run has failed when its mean loss over a window of steps (a twentieth of the run, but of 50 steps at least, and all of a run that is
/// shorter) is higher by a twentieth than at its start (the first steps, as many as there are pictures, 50 at most), and more than a quarter of
/// that of an empty picture: a good scene that is trained on may well get worse for a while. While pictures are off by less than a hundredth
/// of the range on average, or at the end by less than half a step of a display, nothing has failed. The 500 steps after all opacities have been reset
/// do not count.
///
/// To go back, the host keeps a copy of the Gaussians that the run began with; for a resumed run these are those it was resumed with, and its
/// start is where it was resumed. So a run that fails ends otherwise where it was resumed than where it was not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Recovery {
    /// It goes on with the Gaussians that it began with, and the effects, at a tenth of the learning rates it had, down to a thousandth of those
    /// of the settings; from the second time on without density control, which may be what undid it. After the last step the last scene is
    /// compared with the first where the last window was no better than the start, and the better is the result.
    #[default]
    BeginAgain,
    /// It goes on. For who studies failures.
    Never,
}

impl Recovery {
    /// Whether it is the default; settings files and the digests of settings leave out what says nothing.
    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// That a run began again, and why.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct FreshStart {
    /// Steps done before.
    pub step: u32,
    /// The mean loss of the steps before it.
    pub loss: f64,
    /// The mean loss at the start of the run.
    pub first: f64,
}

impl fmt::Display for FreshStart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { loss, first, .. } = self;
        write!(
            f,
            "the loss is {loss:.2e}, at the start it was {first:.2e}: beginning again with the first Gaussians, more slowly"
        )
    }
}

/// What is left of the learning rates after so many fresh starts.
pub(crate) fn lr_scale(fresh_starts: usize) -> f32 {
    [1.0, 0.1, 0.01, 0.001][fresh_starts.min(3)]
}

/// The mean of some losses.
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

    /// NaN of none.
    pub(crate) fn value(self) -> f64 {
        self.sum / f64::from(self.count)
    }
}

/// So many steps after all opacities have been reset are not judged: the scene has yet to come back.
const RESET_STEPS: u32 = 500;

/// Steps of the shortest window.
const SHORTEST_WINDOW: u32 = 50;

/// Windows of the longest run.
const MOST_WINDOWS: u32 = 20;

/// What is higher than the start by less than this factor is not worse.
const MARGIN: f64 = 1.05;

/// The losses by which a run is judged.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    /// Those of the start.
    first: Mean,
    /// Those of the window under way that count.
    window: Mean,
    /// Those of steps up to this one do not.
    settled_after: u32,
}

/// How a window has gone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Judgement {
    /// The mean loss.
    pub(crate) loss: f64,
    /// That of the start.
    pub(crate) first: f64,
}

impl Judgement {
    /// Whether the run has become worse, if an empty picture has not four times the loss.
    pub(crate) fn is_worse(self) -> bool {
        self.loss > MARGIN * self.first
    }
}

impl Watch {
    /// Hears the loss of step `step`, counted from 1, of a run of so many pictures.
    pub(crate) fn hear(&mut self, step: u32, loss: f32, pictures: u32) {
        if self.first.count < pictures.clamp(1, SHORTEST_WINDOW) {
            self.first.add(loss);
        }
        if step > self.settled_after {
            self.window.add(loss);
        }
    }

    /// Hears that all opacities are reset after step `step`.
    pub(crate) fn hear_reset(&mut self, step: u32) {
        self.settled_after = step.saturating_add(RESET_STEPS);
    }

    /// Whether a window ends with step `step`, counted from 1, of so many.
    pub(crate) fn ends_window(step: u32, iterations: u32) -> bool {
        let windows = (iterations / SHORTEST_WINDOW).clamp(1, MOST_WINDOWS);
        let window = |step: u32| u64::from(step) * u64::from(windows) / u64::from(iterations.max(1));
        step > 0 && window(step) > window(step - 1)
    }

    /// Ends a window: how it has gone, where any of its losses count.
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
        [0.5, 0.25, 9.0, 9.0].iter().zip(1..).for_each(|(&loss, step)| watch.hear(step, loss, 2));
        let judgement = watch.end_window().unwrap();
        assert_eq!(judgement, Judgement { loss: 4.6875, first: 0.375 });
        assert!(judgement.is_worse());
        watch.hear(5, 0.39, 2);
        assert!(!watch.end_window().unwrap().is_worse(), "by less than a twentieth");
        let mut many = Watch::default();
        (1..=80).for_each(|step| many.hear(step, if step <= 50 { 1.0 } else { 2.0 }, 1000));
        assert_eq!(many.end_window().unwrap().first, 1.0, "no more than are in the shortest window");
    }

    #[test]
    fn what_follows_a_reset_does_not_count() {
        let mut watch = Watch::default();
        watch.hear(1, 0.5, 1);
        watch.hear(2, 0.25, 1);
        watch.hear_reset(2);
        assert_eq!(watch.end_window(), Some(Judgement { loss: 0.375, first: 0.5 }), "what came before does");
        (3..=502).for_each(|step| watch.hear(step, 9.0, 1));
        assert_eq!(watch.end_window(), None);
        (503..=504).for_each(|step| watch.hear(step, 0.25, 1));
        assert_eq!(watch.end_window(), Some(Judgement { loss: 0.25, first: 0.5 }));
    }
}
