//! What can go wrong with a study as a whole. A single run that goes wrong is a row of the study, not an error of it.

use std::path::PathBuf;

use thiserror::Error;

/// An error of a study.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A study's file that is no study: not TOML, an unknown key, a value of the wrong kind.
    #[error("{origin}: line {line}: {message}")]
    Form {
        /// The file.
        origin: String,
        /// Its line, counted from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A study that says something impossible.
    #[error("study `{study}`: {what}: {mend}")]
    Study {
        /// Its name.
        study: String,
        /// What is wrong, and where.
        what: String,
        /// How to mend it.
        mend: &'static str,
    },
    /// Settings of an arm that are not possible.
    #[error("study `{study}`: {}arm `{arm}`: {message}", line.map_or_else(String::new, |line| format!("line {line}: ")))]
    Arm {
        /// The study's name.
        study: String,
        /// The line of the study's file on which the arm has its name, counted from 1; nothing where it is from no file.
        line: Option<usize>,
        /// The arm's name.
        arm: String,
        /// What is wrong with its settings.
        message: String,
    },
    /// There is neither a file nor a built-in study of this name.
    #[error("{name}: is neither a file nor a study that comes with the program: those are {known}")]
    Unknown {
        /// What was asked for.
        name: String,
        /// The built-in ones.
        known: String,
    },
    /// An image of the study is nowhere to be found.
    #[error("{image}: no such file in {looked}: name the folder that has it with --data or GS_DATA")]
    NoImage {
        /// As the study names it.
        image: String,
        /// The folders that were looked into.
        looked: String,
    },
    /// An image of the study is neither a file nor a synthetic target.
    #[error("{image}: is neither an image file nor a synthetic target: those are {known}")]
    NoTarget {
        /// As the study names it.
        image: String,
        /// The synthetic targets.
        known: String,
    },
    /// A folder that holds something else than this study.
    #[error("{}: {what}: {mend}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What is wrong with it.
        what: String,
        /// How to mend it.
        mend: &'static str,
    },
    /// A row that a study does not have.
    #[error("row {row}: the study has rows 1 to {rows}")]
    NoRow {
        /// What was asked for.
        row: usize,
        /// How many there are.
        rows: usize,
    },
    /// The backend failed for good in a run, such as a GPU that is lost. Nothing is recorded of the run.
    #[error("row {row} ({run}): {source}: nothing is lost but the runs under way; start gs study again with --resume")]
    Backend {
        /// The row.
        row: usize,
        /// Which run that is, in words.
        run: String,
        /// What the backend says.
        source: gs_core::Error,
    },
    /// A replay on something else than computed the row, which would end in another scene.
    #[error("row {row}: recorded on {recorded}, but this is {found}: {mend}")]
    OtherMachine {
        /// The row.
        row: usize,
        /// What computed it.
        recorded: String,
        /// What would compute it now.
        found: String,
        /// How to choose the first.
        mend: String,
    },
    /// A replay by another program than recorded the row, which may end in another scene.
    #[error(
        "row {row}: recorded by version {recorded}, but this is {found}: replay it with that version, or do the study again"
    )]
    OtherVersion {
        /// The row.
        row: usize,
        /// The version that recorded it.
        recorded: String,
        /// This version.
        found: &'static str,
    },
    /// A replay of a row whose settings or image have changed since it was recorded.
    #[error(
        "row {row}: its settings or its image are not those recorded (address {found} instead of {recorded}): put study.toml and the images \
         back as they were, or let gs study --resume do the row again"
    )]
    OtherRun {
        /// The row.
        row: usize,
        /// Its address as recorded.
        recorded: String,
        /// Its address now.
        found: String,
    },
    /// A replay that should have ended in the recorded scene and did not.
    #[error(
        "row {row}: the scene is not the recorded one ({found} instead of {recorded}), though nothing that is known differs"
    )]
    NotReplayed {
        /// The row.
        row: usize,
        /// Digest of the recorded scene.
        recorded: String,
        /// Digest of the scene found.
        found: String,
    },
    /// A file: see [`gs_io::Error`].
    #[error(transparent)]
    Io(#[from] gs_io::Error),
    /// A fit that was replayed: see [`gs_train::Error`].
    #[error(transparent)]
    Fit(#[from] gs_train::Error),
    /// A folder or a file that cannot be read or made.
    #[error("{}: {source}", path.display())]
    Path {
        /// Which.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// A picture that could not be drawn or packed.
    #[error("{name}: cannot be drawn: {message}")]
    Picture {
        /// Its file.
        name: String,
        /// What the drawing library says.
        message: String,
    },
}
