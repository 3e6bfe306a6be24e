//! The verdict on a difference.

use super::statistics::Interval;

/// The verdict on a difference between two arms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Verdict {
    /// The whole interval lies above 0.
    Better,
    /// The whole interval lies below 0.
    Worse,
    /// 0 lies in the interval.
    CannotTell,
    /// There is no interval, or a remark forbids a verdict: the remarks of the difference say why.
    None,
}

impl Verdict {
    /// The verdict that follows from an interval alone, of a metric of which more is better.
    pub(crate) fn of(interval: Interval) -> Self {
        if interval.low > 0.0 {
            Self::Better
        } else if interval.high < 0.0 {
            Self::Worse
        } else {
            Self::CannotTell
        }
    }

    /// The verdict as reports print it.
    pub(crate) const fn words(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "worse",
            Self::CannotTell => "can't tell",
            Self::None => "no verdict",
        }
    }
}
