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
    #[error("study `{study}`: arm `{arm}`: {message}")]
    Arm {
        /// The study's name.
        study: String,
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
    /// A replay that did not end in the recorded scene.
    #[error(
        "row {row}: the scene is not the recorded one ({found} instead of {recorded}); the row was computed by version {version} on {machine}"
    )]
    NotReplayed {
        /// The row.
        row: usize,
        /// Digest of the recorded scene.
        recorded: String,
        /// Digest of the scene found.
        found: String,
        /// The version of the program that recorded it.
        version: String,
        /// What it computed on.
        machine: String,
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
