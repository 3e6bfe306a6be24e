//! What goes wrong in a training without ending it, by cause: said where it is not zero, so that it is never hidden.

use std::fmt;

use gs_core::{Culled, counted, edit::EditCounts};
use gs_train::{Clamped, FreshStart};

use crate::training_arguments::Detail;

/// Gaussians with which something is wrong, and how often the whole training went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Trouble {
    /// Whether sizes at their bounds are said, too. They are no trouble: most trainings have some.
    detail: Detail,
    /// Those that stopped being finite and were removed, so far.
    removed: u32,
    /// Those that the last measurement left out as not finite, and as degenerate.
    not_finite: u32,
    degenerate: u32,
    /// Those whose scales the optimiser's bounds held then.
    clamped: Clamped,
    /// How often it began again.
    fresh_starts: u32,
}

impl Trouble {
    /// None yet, to be said in this detail.
    pub(crate) fn with(detail: Detail) -> Self {
        Self { detail, ..Self::default() }
    }

    /// That of a finished training.
    pub(crate) fn new(
        detail: Detail,
        edits: &EditCounts,
        culled: Culled,
        clamped: Clamped,
        fresh_starts: &[FreshStart],
    ) -> Self {
        let mut trouble = Self { detail, fresh_starts: fresh_starts.len() as u32, ..Self::default() };
        trouble.add_edits(edits);
        trouble.see(culled, clamped);
        trouble
    }

    /// Adds what a round of density control did.
    pub(crate) fn add_edits(&mut self, counts: &EditCounts) {
        self.removed = self.removed.saturating_add(counts.pruned_not_finite);
    }

    /// Counts that the training begins again.
    pub(crate) fn add_fresh_start(&mut self) {
        self.fresh_starts = self.fresh_starts.saturating_add(1);
    }

    /// Takes note of a measurement. What is outside, near or transparent is no trouble: so are views.
    pub(crate) fn see(&mut self, culled: Culled, clamped: Clamped) {
        (self.not_finite, self.degenerate) = (culled.not_finite, culled.degenerate);
        if self.detail == Detail::Rounds {
            self.clamped = clamped;
        }
    }

    /// Whether it is worth saying again after the worst that was told: a cause is new, or its count has doubled.
    pub(crate) fn is_news_after(&self, told: &Self) -> bool {
        let mut pairs = self.causes().into_iter().zip(told.causes());
        pairs.any(|((now, ..), (told, ..))| now > 0 && u64::from(now) >= 2 * u64::from(told))
    }

    /// The larger of each count.
    pub(crate) fn worst(&self, other: &Self) -> Self {
        let Clamped { smallest, largest } = self.clamped;
        Self {
            detail: self.detail,
            removed: self.removed.max(other.removed),
            not_finite: self.not_finite.max(other.not_finite),
            degenerate: self.degenerate.max(other.degenerate),
            clamped: Clamped {
                smallest: smallest.max(other.clamped.smallest),
                largest: largest.max(other.clamped.largest),
            },
            fresh_starts: self.fresh_starts.max(other.fresh_starts),
        }
    }

    /// Each count with what it counts, and what is the matter with that.
    fn causes(&self) -> [(u32, &'static str, &'static str); 6] {
        let Self { removed, not_finite, degenerate, clamped: Clamped { smallest, largest }, fresh_starts, .. } = *self;
        [
            (removed, "Gaussian", " removed as not finite"),
            (not_finite, "Gaussian", " not drawn, as not finite"),
            (degenerate, "Gaussian", " not drawn, as without extent"),
            (smallest, "Gaussian", " held at the smallest size allowed"),
            (largest, "Gaussian", " held at the largest size allowed"),
            (fresh_starts, "restart", " at a lower learning rate"),
        ]
    }
}

/// To be put behind other words: nothing where nothing is wrong.
impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let causes = self.causes();
        let mut there = causes.iter().filter(|(count, ..)| *count > 0);
        there.try_for_each(|(count, noun, cause)| write!(f, ", {}{cause}", counted(*count, noun)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_zero_is_not_told() {
        let mut trouble = Trouble::with(Detail::Rounds);
        assert_eq!(trouble.to_string(), "");
        trouble.see(Culled { outside: 7, ..Culled::default() }, Clamped { smallest: 3, largest: 0 });
        assert_eq!(trouble.to_string(), ", 3 Gaussians held at the smallest size allowed");
        let lost = EditCounts { pruned_not_finite: 2, cloned: 9, ..EditCounts::default() };
        trouble.add_edits(&lost);
        trouble.add_edits(&lost);
        trouble.see(Culled { degenerate: 1, ..Culled::default() }, Clamped::default());
        assert_eq!(trouble.to_string(), ", 4 Gaussians removed as not finite, 1 Gaussian not drawn, as without extent");
        let mut brief = Trouble::with(Detail::Steps);
        brief.see(Culled::default(), Clamped { smallest: 3, largest: 1 });
        assert_eq!(brief.to_string(), "", "sizes at their bounds are said where all is");
    }

    #[test]
    fn a_new_cause_and_a_doubled_count_are_news_and_nothing_else_is() {
        let clamped = |smallest| Trouble { clamped: Clamped { smallest, largest: 0 }, ..Trouble::default() };
        let mut told = Trouble::default();
        assert!(!Trouble::default().is_news_after(&told) && clamped(1).is_news_after(&told));
        told = clamped(3).worst(&told);
        assert!(!clamped(5).is_news_after(&told) && clamped(6).is_news_after(&told));
        // What comes and goes is told once.
        told = clamped(0).worst(&told);
        assert!(!clamped(3).is_news_after(&told));
        assert!(Trouble { degenerate: 1, ..clamped(3) }.is_news_after(&told));
        let most = clamped(u32::MAX);
        assert!(!most.is_news_after(&most.worst(&told)), "counts that cannot double");
    }
}
