//! Problems that do not end a run, by cause. They are printed wherever they are not zero.

use std::fmt;

use gs_core::{Culled, counted, edit::EditCounts};
use gs_train::{Clamped, FreshStart};

use crate::terminal::output::Verbosity;

/// Numbers of Gaussians with problems, and of restarts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Problems {
    /// Whether scales at their bounds are included. Most runs have some.
    verbosity: Verbosity,
    /// Gaussians removed so far because they were not finite.
    removed: u32,
    /// Gaussians that the last measurement did not draw because they were not finite.
    not_finite: u32,
    /// Gaussians that the last measurement did not draw because they were degenerate.
    degenerate: u32,
    /// Gaussians held at a bound of the optimizer's scales in the last measurement.
    clamped: Clamped,
    /// Restarts at a lower learning rate.
    fresh_starts: u32,
}

impl Problems {
    /// No problems yet.
    pub(crate) fn none(verbosity: Verbosity) -> Self {
        Self { verbosity, ..Self::default() }
    }

    /// Counts the problems of a finished run.
    pub(crate) fn new(
        verbosity: Verbosity,
        edits: &EditCounts,
        culled: Culled,
        clamped: Clamped,
        fresh_starts: &[FreshStart],
    ) -> Self {
        let mut problems = Self { verbosity, fresh_starts: fresh_starts.len() as u32, ..Self::default() };
        problems.add_edits(edits);
        problems.measure(culled, clamped);
        problems
    }

    /// Adds a round of density control.
    pub(crate) fn add_edits(&mut self, counts: &EditCounts) {
        self.removed = self.removed.saturating_add(counts.pruned_not_finite);
    }

    /// Adds a restart.
    pub(crate) fn add_restart(&mut self) {
        self.fresh_starts = self.fresh_starts.saturating_add(1);
    }

    /// Takes a measurement. Gaussians outside of the view, too near or transparent are not
    /// problems.
    pub(crate) fn measure(&mut self, culled: Culled, clamped: Clamped) {
        (self.not_finite, self.degenerate) = (culled.not_finite, culled.degenerate);
        if self.verbosity == Verbosity::Verbose {
            self.clamped = clamped;
        }
    }

    /// Whether there is a cause that was not `reported`; it is from now on. Restarts are reported by themselves.
    pub(crate) fn are_new(&self, reported: &mut [bool; 5]) -> bool {
        let before = *reported;
        reported.iter_mut().zip(self.causes()).for_each(|(reported, (count, ..))| *reported |= count > 0);
        before != *reported
    }

    /// The counts, each with its noun and its cause.
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

/// A list that begins with a comma, to be appended to other words; empty without problems.
impl fmt::Display for Problems {
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
    fn counts_of_zero_are_left_out() {
        let mut problems = Problems::none(Verbosity::Verbose);
        assert_eq!(problems.to_string(), "");
        problems.measure(Culled { outside: 7, ..Culled::default() }, Clamped { smallest: 3, largest: 0 });
        assert_eq!(problems.to_string(), ", 3 Gaussians held at the smallest size allowed");
        let lost = EditCounts { pruned_not_finite: 2, cloned: 9, ..EditCounts::default() };
        problems.add_edits(&lost);
        problems.add_edits(&lost);
        problems.measure(Culled { degenerate: 1, ..Culled::default() }, Clamped::default());
        assert_eq!(
            problems.to_string(),
            ", 4 Gaussians removed as not finite, 1 Gaussian not drawn, as without extent"
        );
        let mut brief = Problems::none(Verbosity::Normal);
        brief.measure(Culled::default(), Clamped { smallest: 3, largest: 1 });
        assert_eq!(brief.to_string(), "", "sizes at their bounds are for --verbose");
    }

    #[test]
    fn each_cause_is_new_once() {
        let clamped = |smallest| Problems { clamped: Clamped { smallest, largest: 0 }, ..Problems::default() };
        let mut reported = [false; 5];
        assert!(!Problems::default().are_new(&mut reported) && clamped(1).are_new(&mut reported));
        // A problem that comes and goes is reported once.
        assert!(!clamped(0).are_new(&mut reported) && !clamped(6).are_new(&mut reported));
        assert!(Problems { degenerate: 1, ..clamped(3) }.are_new(&mut reported));
        assert!(!Problems { fresh_starts: 1, ..clamped(3) }.are_new(&mut reported));
    }
}
