//! What became of a case on a backend, and a table of that.

use std::{fmt, time::Duration};

use crate::{Failure, tolerance::Agreement};

/// What became of one case on one backend.
#[derive(Debug, Clone)]
pub struct Record {
    /// The case.
    pub case: String,
    /// The backend, as it describes itself.
    pub backend: String,
    /// What it did, or how that is not what was expected.
    pub outcome: Result<Observed, Failure>,
    /// How long the case took.
    pub took: Duration,
}

/// What a backend did that was expected.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Observed {
    /// How the image agrees with the oracle's, where the two are compared.
    pub image: Option<Agreement>,
    /// How the gradients do.
    pub gradients: Option<Agreement>,
    /// Gaussians drawn, and left out.
    pub drawn: [u64; 2],
    /// Loss before the first training step, and before the last.
    pub losses: Option<[f32; 2]>,
    /// Runs that were made for this record: more than one where a value is put into many places.
    pub runs: usize,
}

impl Record {
    /// Whether the backend did what was expected.
    pub fn is_as_expected(&self) -> bool {
        self.outcome.is_ok()
    }
}

/// One line of the table: case, outcome, worst errors in roundings and as they are.
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
                // Of a parameter by which all gradients are 0, nothing is a share.
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
