//! What keeps scales from going to zero, and fits that diverge without it.

use gs_train::Error;

use super::textbook::Guards;

/// Length of the needle whose other scale goes to zero, px.
pub(super) const NEEDLE_PX: f32 = 10.0;

/// What keeps scales from going to zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Guard {
    /// No guard.
    Off,
    /// ε = 1e-6 px⁴ added to the determinant.
    Epsilon,
    /// The paper's guards: no scale below 1 px, and ε.
    Paper,
    /// This project's guards, as in the product.
    Project,
}

impl Guard {
    pub(crate) const ALL: [Self; 4] = [Self::Off, Self::Epsilon, Self::Paper, Self::Project];

    /// The name in reports.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Off => "none",
            Self::Epsilon => "ε = 1e-6 on the determinant",
            Self::Paper => "the paper's: σ ≥ 1 px and ε",
            Self::Project => "this project's: σ ≥ 0.25 px",
        }
    }

    /// The guards of the textbook solver; `None` for the product, which has its own.
    pub(super) fn of_textbook(self) -> Option<Guards> {
        match self {
            Self::Off => Some(Guards::OFF),
            Self::Epsilon => Some(Guards::EPSILON),
            Self::Paper => Some(Guards::PAPER),
            Self::Project => None,
        }
    }
}

/// `None` for a fit that diverged.
pub(super) fn unless_diverged<T>(made: Result<T, Error>) -> Result<Option<T>, Error> {
    match made {
        Ok(made) => Ok(Some(made)),
        Err(Error::Diverged { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_divergence_is_counted_and_other_errors_are_not() {
        let diverged = Error::Diverged { step: 3, loss: f32::NAN, suspect: None };
        assert_eq!(unless_diverged::<()>(Err(diverged)).unwrap(), None);
        assert_eq!(unless_diverged(Ok(7)).unwrap(), Some(7));
        assert!(unless_diverged::<()>(Err(Error::Finished { iterations: 3 })).is_err());
    }
}
