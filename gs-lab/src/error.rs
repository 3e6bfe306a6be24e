//! Errors of a study as a whole. A failing run is no error but a row of the study.

use std::path::PathBuf;

use thiserror::Error;

/// An error of a study.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A study file that is not TOML, or has an unknown key or a value of the wrong type.
    #[error("{origin}: line {line}: {message}")]
    Form {
        /// The file.
        origin: String,
        /// The line of the mistake, counted from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A study that is not possible, such as one without seeds.
    #[error("study `{study}`: {what}: {hint}")]
    Study {
        /// The study's name.
        study: String,
        /// What is wrong, and where.
        what: String,
        /// How to fix it.
        hint: &'static str,
    },
    /// An arm whose settings are not possible.
    #[error("study `{study}`: arm `{arm}`: {message}")]
    Arm {
        /// The study's name.
        study: String,
        /// The arm's name.
        arm: String,
        /// What is wrong with the arm's settings, beginning with the key where it is known.
        message: String,
    },
    /// No file and no built-in study has this name.
    #[error("{name}: is neither a file nor a study that comes with the program: those are {known}")]
    Unknown {
        /// The name that was given.
        name: String,
        /// The built-in studies.
        known: String,
    },
    /// An image of the study is neither a file nor a synthetic target.
    #[error("{image}: is neither an image file nor a synthetic target: those are {known}")]
    NoTarget {
        /// The image, as the study names it.
        image: String,
        /// The synthetic targets.
        known: String,
    },
    /// An image or a data set of the study was not found.
    #[error("{name}: no such {what} in {looked}: name the folder that has it with --data or GS_DATA")]
    NotFound {
        /// The image or the scene, as the study names it.
        name: String,
        /// "file" or "data set".
        what: &'static str,
        /// The folders that were searched.
        looked: String,
    },
    /// The output folder cannot be used for this study.
    #[error("{}: {what}: {hint}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What is wrong with it.
        what: String,
        /// How to fix it.
        hint: &'static str,
    },
    /// Two computations of a run ended in different results, though nothing that is known differs.
    /// The first result is kept.
    #[error(
        "row {row} ({run}): was computed twice, with different results (scene {found} instead of {recorded}), though nothing that is known \
         differs: repeat the study on both machines in other folders, with --arms, --budgets and --seeds of this row alone, and leave out the one that is wrong"
    )]
    TwoResults {
        /// The row.
        row: usize,
        /// The run in words.
        run: String,
        /// Digest of the scene that was recorded first.
        recorded: String,
        /// Digest of the scene found now.
        found: String,
    },
    /// A command line that the study does not allow, such as for its clock.
    #[error("{message}")]
    Work {
        /// What is wrong, and what to do instead.
        message: String,
    },
    /// An error of jobs that processes share: see [`gs_jobs::Error`].
    #[error(transparent)]
    Jobs(#[from] gs_jobs::Error),
    /// The backend failed for good during a run, such as a GPU that was lost. Nothing is recorded
    /// of the run.
    #[error("row {row} ({run}): {source}: nothing is lost but the runs under way; start gs study again with --resume")]
    Backend {
        /// The row.
        row: usize,
        /// The run in words.
        run: String,
        /// The backend's error.
        source: gs_core::Error,
    },
    /// An error of a file: see [`gs_io::Error`].
    #[error(transparent)]
    Io(#[from] gs_io::Error),
    /// An error of a fit: see [`gs_train::Error`].
    #[error(transparent)]
    Fit(#[from] gs_train::Error),
    /// A folder or a file cannot be read or created.
    #[error("{}: {source}", path.display())]
    Path {
        /// The path.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A picture cannot be drawn or encoded.
    #[error("{name}: cannot be drawn: {message}")]
    Picture {
        /// The picture's file name.
        name: String,
        /// What the drawing library reports.
        message: String,
    },
}

impl From<gs_core::Error> for Error {
    fn from(error: gs_core::Error) -> Self {
        Self::Fit(error.into())
    }
}
