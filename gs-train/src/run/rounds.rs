//! The rounds of density control in a run.

use gs_core::Error;
use serde::{Deserialize, Serialize};

gs_core::impl_with!(Rounds);

/// Steps after which density control runs: the multiples of `every` in `from..=until`, except the
/// last step of a run, after which nothing could adapt to the edit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Rounds {
    /// Steps from one round to the next; 0 for no density control.
    pub every: u32,
    /// First step, counted from 1, after which there may be a round.
    pub from: u32,
    /// Last step, counted from 1, after which there may be a round.
    pub until: u32,
}

impl Rounds {
    /// No density control.
    pub const NEVER: Self = Self { every: 0, from: 0, until: 0 };

    /// A round every `every` steps until step `until`.
    pub const fn until(every: u32, until: u32) -> Self {
        Self { every, from: every, until }
    }

    /// Progress of the rounds of a run of `iterations` with the round after step `step` (counted
    /// from 1): from just above 0 at the first to 1 at the last; `None` where there is no round.
    pub fn progress(&self, step: u32, iterations: u32) -> Option<f32> {
        let (first, last) = self.span(iterations)?;
        let due = (first * self.every..=last * self.every).contains(&step) && step.is_multiple_of(self.every);
        due.then(|| (step / self.every - first + 1) as f32 / (last - first + 1) as f32)
    }

    /// Step of the last round in a run of `iterations`; 0 where there is none.
    pub fn last(&self, iterations: u32) -> u32 {
        self.span(iterations).map_or(0, |(_, last)| last * self.every)
    }

    /// First and last multiple of `every`.
    fn span(&self, iterations: u32) -> Option<(u32, u32)> {
        if self.every == 0 {
            return None;
        }
        let first = self.from.max(1).div_ceil(self.every);
        let last = self.until.min(iterations.saturating_sub(1)) / self.every;
        (first <= last).then_some((first, last))
    }

    /// Checks that the rounds do not end before they begin.
    ///
    /// # Errors
    /// [`Error::Setting`] where they do.
    pub(crate) fn validate(&self) -> Result<(), Error> {
        if self.every > 0 && self.from > self.until {
            let window = format!("from step {} until {}", self.from, self.until);
            return Err(Error::setting("the window of density control", window, "one that ends after it begins"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_ends_at_one_with_the_last_round() {
        let rounds = Rounds::until(100, 600);
        let due: Vec<_> = (0..=2500).filter_map(|s| rounds.progress(s, 2500).map(|p| (s, p))).collect();
        assert_eq!(due.iter().map(|d| d.0).collect::<Vec<_>>(), [100, 200, 300, 400, 500, 600]);
        assert_eq!(due[5].1, 1.0);
        assert_eq!(due[2].1, 0.5);
        assert_eq!(rounds.last(2500), 600);
    }

    #[test]
    fn no_round_follows_the_last_step() {
        let rounds = Rounds { every: 10, from: 1, until: 1000 };
        assert_eq!(rounds.progress(20, 20), None);
        assert_eq!(rounds.progress(10, 20), Some(1.0));
        assert_eq!(rounds.progress(10, 0), None);
        assert!((0..100).all(|s| Rounds::NEVER.progress(s, 100).is_none()));
        assert_eq!(Rounds { every: 7, from: 8, until: 13 }.progress(7, 100), None);
    }
}
