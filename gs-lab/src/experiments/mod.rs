//! The experiments of the paper (§3 to §5.4, Figs. 6 to 9).
//!
//! An [`Experiment`] is one or several [studies](Experiment::studies) that come with the program,
//! whose files hold the paper's claims: [`Results::claims`](crate::Results::claims) judges them. What
//! no study can express, [`Experiment::run`] measures: fits without the product's guards, and a camera
//! flight in 3D. [`page()`] compares all claims with what was measured.

mod experiment;
mod files;
mod findings;
mod instability;
mod page;
mod popping;

use gs_core::{Optimizer, Scene2d, Scene3d};

pub use self::{
    experiment::{Chapter, Experiment, ExperimentSize},
    files::ResultFile,
    findings::{Findings, Picture},
    page::{PageSetting, page},
};
pub use crate::report::{Cell, Table};
use gs_train::Error;

impl Experiment {
    /// What the experiment measures besides its [studies](Self::studies); `None` if nothing. Lines about
    /// the progress go to `note`.
    ///
    /// # Errors
    /// Those of the backend. Fits that diverge are counted instead.
    pub fn run<R: Optimizer<Scene2d> + Optimizer<Scene3d>>(
        self,
        rasterizer: &R,
        size: ExperimentSize,
        note: &dyn Fn(&str),
    ) -> Result<Option<Findings>, Error> {
        Ok(match self {
            Self::Instability => Some(instability::measure(rasterizer, size, note)?.findings()),
            Self::Popping => Some(popping::measure(rasterizer, size, note)?.findings()),
            _ => None,
        })
    }
}
