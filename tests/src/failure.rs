//! Why a comparison or a conformance case does not pass.

use gs_core::Error;
use thiserror::Error as ThisError;

/// A backend does not do what it must.
#[derive(Debug, Clone, PartialEq, ThisError)]
#[non_exhaustive]
pub enum Failure {
    /// The comparison would compare nothing, so its success would mean nothing.
    #[error("nothing to compare: {0}")]
    Nothing(String),
    /// A number is further from the oracle's than the table of tolerances allows.
    #[error("{what}: expected {expected:e} ± {tolerance:e}, found {found:e} (and {others} more)")]
    Differs {
        /// Which number.
        what: String,
        /// The oracle's.
        expected: f64,
        /// The backend's.
        found: f64,
        /// How far they may be apart.
        tolerance: f64,
        /// How many further numbers differ too much.
        others: usize,
    },
    /// More numbers than allowed are on the other side of a discontinuity.
    #[error("{what}: {found} of {count} needed the allowance for discontinuities, at most {allowed} may")]
    TooManyFlips {
        /// Which numbers.
        what: &'static str,
        /// How many needed it.
        found: usize,
        /// Of how many.
        count: usize,
        /// How many may.
        allowed: usize,
    },
    /// Something that is not a number's distance from another.
    #[error("{0}")]
    Broken(String),
    /// The backend answered with an error where it must not.
    #[error("unexpected error: {0}")]
    Backend(#[from] Error),
    /// One of the suite's cases, and why it fails.
    #[error("case {case}: {cause}")]
    Case {
        /// Its name.
        case: &'static str,
        /// Why.
        cause: Box<Self>,
    },
    /// Several of the above.
    #[error("{} failed:{}", .0.len(), .0.iter().map(|f| format!("\n  {f}")).collect::<String>())]
    Several(Vec<Self>),
}

impl Failure {
    /// Fails with a text unless `condition` holds.
    ///
    /// # Errors
    /// [`Failure::Broken`].
    pub fn unless(condition: bool, text: impl FnOnce() -> String) -> Result<(), Self> {
        if condition { Ok(()) } else { Err(Self::Broken(text())) }
    }

    /// The same failure with where it happened in front.
    #[must_use]
    pub fn at(self, place: impl std::fmt::Display) -> Self {
        match self {
            Self::Differs { what, expected, found, tolerance, others } => {
                Self::Differs { what: format!("{place}: {what}"), expected, found, tolerance, others }
            }
            Self::Nothing(text) => Self::Nothing(format!("{place}: {text}")),
            other => Self::Broken(format!("{place}: {other}")),
        }
    }
}
