//! The failure of a comparison or a conformance case.

use gs_core::Error;
use thiserror::Error as ThisError;

/// The failure of a comparison or a conformance case.
#[derive(Debug, Clone, PartialEq, ThisError)]
#[non_exhaustive]
pub enum Failure {
    /// Nothing to compare, so a success would be meaningless.
    #[error("nothing to compare: {0}")]
    Nothing(String),
    /// A number differs from the oracle's by more than the tolerance.
    #[error("{what}: expected {expected:e} ± {tolerance:e}, found {found:e} (and {others} more)")]
    Differs {
        /// Name of the number.
        what: String,
        /// The oracle's number.
        expected: f64,
        /// The backend's number.
        found: f64,
        /// The tolerance.
        tolerance: f64,
        /// Count of further numbers that differ too much.
        others: usize,
    },
    /// More numbers than allowed are on the other side of a discontinuity.
    #[error("{what}: {found} of {count} needed the allowance for discontinuities, at most {allowed} may")]
    TooManyFlips {
        /// Name of the numbers.
        what: &'static str,
        /// Count of numbers that needed the allowance.
        found: usize,
        /// Count of all numbers.
        count: usize,
        /// Largest count that is allowed.
        allowed: usize,
    },
    /// Any other failure.
    #[error("{0}")]
    Broken(String),
    /// An unexpected error of the backend.
    #[error("unexpected error: {0}")]
    Backend(#[from] Error),
    /// The failure of one of the suite's cases.
    #[error("case {case}: {cause}")]
    Case {
        /// Name of the case.
        case: &'static str,
        /// The failure.
        cause: Box<Self>,
    },
    /// Several failures.
    #[error("{} failed:{}", .0.len(), .0.iter().map(|f| format!("\n  {f}")).collect::<String>())]
    Several(Vec<Self>),
}

impl Failure {
    /// Fails with `text` unless `condition` holds.
    ///
    /// # Errors
    /// [`Failure::Broken`].
    pub fn unless(condition: bool, text: impl FnOnce() -> String) -> Result<(), Self> {
        if condition { Ok(()) } else { Err(Self::Broken(text())) }
    }

    /// Returns this failure with its place in front.
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
