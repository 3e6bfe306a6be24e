//! What can go wrong in a fit, beyond what the engine and the files report themselves.

use std::fmt;

use thiserror::Error;

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
    /// A checkpoint whose metadata are not those of a planar fit.
    #[error("the checkpoint cannot be resumed: {0}")]
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

/// A Gaussian suspected of a divergence: the first whose parameters are not finite, or else the one with the largest.
#[derive(Debug, Clone, PartialEq)]
pub struct Suspect {
    /// Its index in the scene.
    pub index: usize,
    /// Its parameters but the opacity, by name and unit, when the loss was seen: after the step, or, where the backend tells losses late, a
    /// few steps later.
    pub parameters: Vec<(&'static str, Vec<f32>)>,
    /// Its opacity's logit then.
    pub opacity_logit: f32,
    /// How many Gaussians of the scene have parameters that are not finite.
    pub not_finite: usize,
}

impl fmt::Display for Suspect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Gaussian {} (", self.index)?;
        for (name, values) in &self.parameters {
            match values.as_slice() {
                [value] => write!(f, "{name} {value}, ")?,
                // Of many, such as SH coefficients, the first few tell enough.
                values => write!(f, "{name} {:?}, ", &values[..values.len().min(6)])?,
            }
        }
        write!(f, "opacity logit {})", self.opacity_logit)?;
        if self.not_finite > 1 {
            write!(f, " or another of the {} that are not finite", self.not_finite)?;
        }
        Ok(())
    }
}
