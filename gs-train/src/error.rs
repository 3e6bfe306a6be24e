//! What can go wrong in a fit, beyond what the engine and the files report themselves.

use std::path::PathBuf;

use thiserror::Error;

use crate::suspect::Suspect;

/// An error of training.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting, a size, a plan or the backend: see [`gs_core::Error`].
    #[error(transparent)]
    Core(#[from] gs_core::Error),
    /// A file: see [`gs_io::Error`].
    #[error(transparent)]
    Io(#[from] gs_io::Error),
    /// A settings file that cannot be understood.
    #[error("{}:{line}: {problem}", file.display())]
    Settings {
        /// The file.
        file: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What is wrong there.
        problem: String,
    },
    /// Settings that have no form in TOML.
    #[error("the settings cannot be written as TOML: {0}")]
    UnwritableSettings(String),
    /// The loss stopped being finite.
    #[error(
        "the training diverged: the loss is {loss} at step {step}{}; lower the learning rates",
        suspect.as_ref().map_or_else(String::new, |s| format!(", probably by {s}"))
    )]
    Diverged {
        /// The step, counted from 1, whose loss it was.
        step: u32,
        /// NaN or infinite.
        loss: f32,
        /// The Gaussian that most probably did it.
        suspect: Option<Box<Suspect>>,
    },
    /// No view that is trained with looks at any of the first Gaussians.
    #[error(
        "none of the {gaussians} first Gaussians is in sight of any of the {views} views to train with: the cameras look away, or the \
         points are in another world than they; mend the poses, or start with Gaussians where the cameras look"
    )]
    NothingInView {
        /// First Gaussians.
        gaussians: usize,
        /// Views that are trained with.
        views: usize,
    },
    /// No pixel counts of any view by which a scene is to be judged.
    #[error(
        "the masks of all {views} views to judge by leave out every pixel, so there is nothing to compare: mend the masks, or hold out \
         other views"
    )]
    NothingCounts {
        /// Views to judge by.
        views: usize,
    },
    /// A checkpoint was made for another target than the one given.
    #[error("the checkpoint belongs to another target: it was made for {expected}, but this is {found}")]
    WrongTarget {
        /// Size and fingerprint of the checkpoint's target.
        expected: String,
        /// Size and fingerprint of the image given.
        found: String,
    },
    /// A checkpoint whose metadata are not those of a 2D fit.
    #[error("the checkpoint cannot be used: {0}")]
    Checkpoint(String),
    /// A checkpoint was asked for between two of the steps at which a resumed run can go on bit for bit.
    #[error("no checkpoint can be taken at step {step}; the next step at which one can is {next}")]
    BetweenCheckpoints {
        /// Steps done.
        step: u32,
        /// The next possible one.
        next: u32,
    },
    /// All steps have been done.
    #[error("the fit has finished: all {iterations} steps are done")]
    Finished {
        /// How many.
        iterations: u32,
    },
    /// An observer could not do its work.
    #[error("observer: {0}")]
    Observer(String),
}
