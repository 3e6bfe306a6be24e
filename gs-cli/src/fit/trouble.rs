//! What goes wrong in a training without ending it, by cause: told where it is not zero, so that it is never hidden.

use std::fmt;

use gs_core::{edit::EditCounts, statistics::Culled};
use gs_train::Clamped;

/// Gaussians with which something is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Trouble {
    /// Those that stopped being finite and were removed, so far.
    removed: u32,
    /// Those that the last measurement left out as not finite, and as degenerate.
    not_finite: u32,
    degenerate: u32,
    /// Those whose scales the optimiser's bounds held then.
    clamped: Clamped,
}

impl Trouble {
    /// That of a finished training.
    pub(crate) fn new(edits: &EditCounts, culled: Culled, clamped: Clamped) -> Self {
        let mut trouble = Self::default();
        trouble.add_edits(edits);
        trouble.see(culled, clamped);
        trouble
    }

    /// Adds what a round of density control did.
    pub(crate) fn add_edits(&mut self, counts: &EditCounts) {
        self.removed = self.removed.saturating_add(counts.pruned_not_finite);
    }

    /// Takes note of a measurement. What is outside, near or transparent is no trouble: so are views.
    pub(crate) fn see(&mut self, culled: Culled, clamped: Clamped) {
        (self.not_finite, self.degenerate, self.clamped) = (culled.not_finite, culled.degenerate, clamped);
    }

    /// Whether Gaussians are lost by it. Being held at a bound is what bounds are for.
    pub(crate) fn is_serious(&self) -> bool {
        self.removed > 0 || self.not_finite > 0 || self.degenerate > 0
    }
}

/// To be put behind other words: nothing where nothing is wrong.
impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { removed, not_finite, degenerate, clamped: Clamped { smallest, largest } } = *self;
        let causes = [
            (removed, "removed as not finite"),
            (not_finite, "left out as not finite"),
            (degenerate, "left out as degenerate"),
            (smallest, "as small as may be"),
            (largest, "as large as may be"),
        ];
        causes.iter().filter(|(count, _)| *count > 0).try_for_each(|(count, cause)| write!(f, ", {count} {cause}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_zero_is_not_told() {
        let mut trouble = Trouble::default();
        assert_eq!((trouble.to_string(), trouble.is_serious()), (String::new(), false));
        trouble.see(Culled { outside: 7, ..Culled::default() }, Clamped { smallest: 3, largest: 0 });
        assert_eq!((trouble.to_string().as_str(), trouble.is_serious()), (", 3 as small as may be", false));
        let lost = EditCounts { pruned_not_finite: 2, cloned: 9, ..EditCounts::default() };
        trouble.add_edits(&lost);
        trouble.add_edits(&lost);
        trouble.see(Culled { degenerate: 1, ..Culled::default() }, Clamped::default());
        assert_eq!(trouble.to_string(), ", 4 removed as not finite, 1 left out as degenerate");
        assert!(trouble.is_serious());
    }
}
