//! Errors of training, besides those of the engine and of files.

use std::path::PathBuf;

use thiserror::Error;

use crate::run::Suspect;

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
    /// A settings file that cannot be parsed.
    #[error("{}:{line}: {problem}", file.display())]
    Settings {
        /// The file.
        file: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// What is wrong there.
        problem: String,
    },
    /// An image that is encoded cannot be made as small or as good as asked.
    #[error("{target} cannot be reached for this image; ask for more bytes or less quality")]
    Unreachable {
        /// What was asked for.
        target: String,
    },
    /// A compressed picture that cannot be stored: see [`gs_codec::Error`].
    #[error(transparent)]
    Codec(#[from] gs_codec::Error),
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
        /// The loss, NaN or infinite.
        loss: f32,
        /// The Gaussian that most probably caused it.
        suspect: Option<Box<Suspect>>,
    },
    /// An edit of a scene: see [`gs_io::EditError`].
    #[cfg(feature = "edit")]
    #[error(transparent)]
    Edit(#[from] gs_io::EditError),
    /// None of the views that an edit needs shows anything of the scene.
    #[error(
        "none of the {views} views shows any of the {gaussians} Gaussians: the views are of another place, or the scene was moved out of \
         their coordinates; name the data set that the scene was trained with"
    )]
    NothingSeen {
        /// Number of Gaussians.
        gaussians: usize,
        /// Number of views.
        views: usize,
    },
    /// No training view shows any of the first Gaussians.
    #[error(
        "none of the {gaussians} first Gaussians is in sight of any of the {views} views to train with: the cameras look away, or the \
         points are in other world coordinates; correct the poses, or start with Gaussians where the cameras look"
    )]
    NothingInView {
        /// Number of first Gaussians.
        gaussians: usize,
        /// Number of training views.
        views: usize,
    },
    /// The masks of all test views leave out every pixel.
    #[error(
        "the masks of all {views} test views leave out every pixel, so there is nothing to compare: correct the masks, or hold out \
         other views"
    )]
    NothingCounts {
        /// Number of test views.
        views: usize,
    },
    /// A checkpoint belongs to another target.
    #[error("the checkpoint belongs to another target: it was made for {expected}, but this is {found}")]
    WrongTarget {
        /// Size and fingerprint of the checkpoint's target.
        expected: String,
        /// Size and fingerprint of the image given.
        found: String,
    },
    /// The views are not those that blocks were planned with.
    #[error(
        "the data set has {found} views and is not the one of {expected} that the blocks were planned with: give the same data set, \
         --holdout, --images, --alpha and --max-size"
    )]
    OtherViews {
        /// Number of views of the plan.
        expected: usize,
        /// Number of views of the data set.
        found: usize,
    },
    /// Images have been replaced or changed since a checkpoint was made.
    #[error(
        "{} changed since the checkpoint was made (first: {first}): restore them, or begin again without the checkpoint",
        if *count == 1 { "1 image has".to_owned() } else { format!("{count} images have") }
    )]
    OtherImages {
        /// Number of views with another image, mask or depth map.
        count: usize,
        /// Name of the first.
        first: String,
    },
    /// A checkpoint is not from this kind of training.
    #[error("the checkpoint cannot be used: {0}")]
    Checkpoint(String),
    /// No checkpoint is possible at this step, as a resumed run would not continue bit for bit.
    #[error("no checkpoint can be taken at step {step}; the next step at which one can is {next}")]
    BetweenCheckpoints {
        /// Steps done.
        step: u32,
        /// Next step at which a checkpoint is possible.
        next: u32,
    },
    /// All steps have been done.
    #[error("the fit has finished: all {iterations} steps are done")]
    Finished {
        /// Number of steps.
        iterations: u32,
    },
    /// An observer failed.
    #[error("observer: {0}")]
    Observer(String),
}
