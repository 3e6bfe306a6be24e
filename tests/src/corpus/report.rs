//! The outcome of a case on a backend, and a table of outcomes.

use std::{fmt, time::Duration};

use crate::{Failure, tolerance::Agreement};

/// The outcome of one case on one backend.
#[derive(Debug, Clone)]
pub struct Record {
    /// The case.
    pub case: String,
    /// The backend's description.
    pub backend: String,
    /// The observed outcome, or the failure.
    pub outcome: Result<Observed, Failure>,
    /// Duration of the case.
    pub took: Duration,
}

/// An outcome as expected.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Observed {
    /// Agreement of the image with the oracle's, if compared.
    pub image: Option<Agreement>,
    /// Agreement of the gradients with the oracle's, if compared.
    pub gradients: Option<Agreement>,
    /// Numbers of drawn and culled Gaussians.
    pub drawn: [u64; 2],
    /// Loss before the first training step, and before the last.
    pub losses: Option<[f32; 2]>,
    /// Number of runs of this record: several for tests of many values.
    pub runs: usize,
}

impl Record {
    /// Whether the outcome is as expected.
    pub fn is_as_expected(&self) -> bool {
        self.outcome.is_ok()
    }
}

/// A row of the table: case, outcome, worst errors in roundings and absolute.
impl fmt::Display for Record {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:58} {:6.2} s  ", self.case, self.took.as_secs_f64())?;
        match &self.outcome {
            Err(failure) => write!(f, "NOT AS EXPECTED: {failure}"),
            Ok(observed) => observed.fmt(f),
        }
    }
}

impl fmt::Display for Observed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.runs > 1 {
            return write!(f, "{} runs", self.runs);
        }
        let [drawn, left] = self.drawn;
        if drawn + left == 0 && self.losses.is_none() {
            return f.write_str("refused");
        }
        write!(f, "{drawn} drawn")?;
        if left > 0 {
            write!(f, ", {left} left out")?;
        }
        for (what, agreement) in [("image", self.image), ("gradients", self.gradients)] {
            if let Some(Agreement { worst_roundings, worst_share, .. }) = agreement {
                write!(f, ", {what} {worst_roundings:.2} roundings")?;
                // If all gradients by a parameter are 0, there is no relative difference.
                if worst_share < 1.0 {
                    write!(f, " ({worst_share:.0e})")?;
                }
            }
        }
        if let Some([first, last]) = self.losses {
            write!(f, ", loss {first:.1e} → {last:.1e}")?;
        }
        Ok(())
    }
}
