//! What a run does when it has become worse than it was at first: it begins again, more slowly.
//!
//! Learning rates that are too high drive Gaussians out of the picture, or make them vanish, and pruning can take the last that anyone
//! sees: no gradient leads back from there. Such a run is not over: its first Gaussians were better.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Whether a run that has failed begins again.
///
/// A run has failed when its mean loss over a window of steps (a twentieth of the run, but of 50 steps at least, and all of a run that is
/// shorter) is higher than at its start (each picture once, before any was looked at twice), and more than a quarter of that of an empty
/// picture: a good scene that is trained on may well get worse for a while. Nor is a run judged in the 500 steps after all opacities have been reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Recovery {
    /// It goes on with the Gaussians that it began with (a resumed run: those that it was resumed with), at a tenth of the learning rates
    /// it had, down to a thousandth of those of the settings; from the second time on without density control, which may be what undid it.
    /// One that has failed after its last step ends with its first Gaussians.
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
pub(crate) fn pace(fresh_starts: usize) -> f32 {
    [1.0, 0.1, 0.01, 0.001][fresh_starts.min(3)]
}

/// The mean of some losses.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
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

/// Within so many steps after all opacities have been reset, a run is not judged: it has yet to come back.
const RESET_STEPS: u32 = 500;

/// Steps of the shortest window.
const SHORTEST_WINDOW: u32 = 50;

/// Windows of the longest run.
const MOST_WINDOWS: u32 = 20;

/// The losses by which a run is judged.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Watch {
    /// Those of the start.
    first: Mean,
    /// Those of the window under way.
    window: Mean,
    /// Windows that end before this step are not judged.
    settled_at: u32,
}

impl Watch {
    /// Hears the next loss of a run of so many pictures.
    pub(crate) fn hear(&mut self, loss: f32, pictures: u32) {
        if self.first.count < pictures.clamp(1, SHORTEST_WINDOW) {
            self.first.add(loss);
        }
        self.window.add(loss);
    }

    /// Whether a window ends with step `step`, counted from 1, of so many.
    pub(crate) fn ends_window(step: u32, iterations: u32) -> bool {
        let windows = (iterations / SHORTEST_WINDOW).clamp(1, MOST_WINDOWS);
        let window = |step: u32| u64::from(step) * u64::from(windows) / u64::from(iterations.max(1));
        step > 0 && window(step) > window(step - 1)
    }

    /// Hears that all opacities are reset after step `step`.
    pub(crate) fn hear_reset(&mut self, step: u32) {
        self.settled_at = step.saturating_add(RESET_STEPS);
    }

    /// Ends a window with step `step`: how many steps it had, and their mean loss and that of the start where the first is higher.
    pub(crate) fn end_window(&mut self, step: u32) -> Option<(u32, f64, f64)> {
        let window = std::mem::take(&mut self.window);
        let (loss, first) = (window.value(), self.first.value());
        (loss > first && step >= self.settled_at).then_some((window.count, loss, first))
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
    fn the_start_is_each_picture_once() {
        let mut watch = Watch::default();
        [0.5, 0.25, 9.0, 9.0].iter().for_each(|&loss| watch.hear(loss, 2));
        assert_eq!(watch.end_window(4), Some((4, 4.6875, 0.375)));
        watch.hear(0.375, 2);
        assert_eq!(watch.end_window(5), None, "no worse than at first");
        watch.hear(0.5, 2);
        assert_eq!(watch.end_window(6), Some((1, 0.5, 0.375)));
        watch.hear_reset(6);
        watch.hear(0.5, 2);
        assert_eq!(watch.end_window(505), None, "opacities have been reset");
        watch.hear(0.5, 2);
        assert_eq!(watch.end_window(506), Some((1, 0.5, 0.375)));
    }
}
