//! Errors of finding poses. Each is one line that says what, where and what to do.

use std::{io, path::PathBuf};

use thiserror::Error;

use crate::colmap::program::{Program, dotted};

/// An error of finding the poses of photographs.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// What was named is no folder.
    #[error("{}: there is no such folder or video; name the folder that holds the photographs", path.display())]
    NotAFolder {
        /// The path that was named.
        path: PathBuf,
    },
    /// Too few photographs for a scene.
    #[error("{}: holds {found}, but poses need at least 2 (20 to 200 are usual) that overlap by two thirds", folder.display())]
    TooFew {
        /// The folder.
        folder: PathBuf,
        /// What was found: "no photograph", "1 photograph".
        found: String,
    },
    /// There is no COLMAP.
    #[error(
        "poses are found by COLMAP, which is not installed (no `colmap` on the PATH, no pycolmap in {python}): on Linux \
         apt install colmap, on macOS brew install colmap, on Windows unpack a release of github.com/colmap/colmap and add \
         its folder to the PATH; or anywhere {python} -m pip install pycolmap"
    )]
    NoColmap {
        /// The Python that was tried.
        python: String,
    },
    /// COLMAP is too old or does not say its version.
    #[error("{program} is COLMAP {version}, but {oldest} or later is needed: {how}")]
    TooOld {
        /// The program.
        program: String,
        /// Its version.
        version: String,
        /// The oldest version that is used.
        oldest: String,
        /// How to install a newer one.
        how: String,
    },
    /// There is no ffmpeg.
    #[error(
        "{}: the frames of a video are read by ffmpeg, which is not installed (no `ffmpeg` and `ffprobe` on the PATH): on \
         Linux apt install ffmpeg, on macOS brew install ffmpeg, on Windows winget install ffmpeg", path.display()
    )]
    NoFfmpeg {
        /// The video.
        path: PathBuf,
    },
    /// There is no program that converts HEIC photographs.
    #[error(
        "{}: HEIC photographs are converted by heif-convert or ImageMagick, neither of which is installed: on Linux apt \
         install libheif-examples, on macOS brew install libheif, on Windows winget install ImageMagick.ImageMagick",
        path.display()
    )]
    NoConverter {
        /// A photograph.
        path: PathBuf,
    },
    /// A video that gives no photographs.
    #[error("{}: {problem}", path.display())]
    Video {
        /// The video.
        path: PathBuf,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// COLMAP failed, or was killed.
    #[error("COLMAP {how} while {stage}{}: see {}; what is done so far is kept, and --resume continues", said.as_ref().map_or_else(String::new, |said| format!(" ({said})")), log.display())]
    Failed {
        /// What it did, such as "matching the photographs".
        stage: &'static str,
        /// How it ended: "ended with status 1", "was killed by signal 9 (out of memory?)".
        how: String,
        /// The last error that it wrote.
        said: Option<String>,
        /// Its log.
        log: PathBuf,
    },
    /// The photographs cannot be reconstructed.
    #[error("{}: no poses were found: {why}; COLMAP's log is {}", folder.display(), log.display())]
    NoPoses {
        /// The folder of the photographs.
        folder: PathBuf,
        /// Why, and what to do.
        why: String,
        /// COLMAP's log.
        log: PathBuf,
    },
    /// [`Reporter::is_cancelled`](crate::Reporter::is_cancelled) ended the work.
    #[error("stopped while {stage}; what is done so far is kept")]
    Cancelled {
        /// What was being done.
        stage: &'static str,
    },
    /// The folder for the data set has a model that would be read instead.
    #[error("{}: has camera poses already", path.display())]
    HasPoses {
        /// The file of the model.
        path: PathBuf,
    },
    /// A model that COLMAP wrote cannot be understood.
    #[error("{}: is not a model of COLMAP: {what}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: &'static str,
    },
    /// A file or folder cannot be read or written.
    #[error("{}: {source}", path.display())]
    Path {
        /// The path.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// An error of reading or writing a file.
    #[error(transparent)]
    Io(#[from] gs_io::Error),
}

impl Error {
    /// An error about a version, if it is known.
    pub(crate) fn too_old(program: &Program, version: Option<[u32; 3]>, oldest: [u32; 3]) -> Self {
        let how = match program {
            Program::Colmap(_) => "install a newer one".to_owned(),
            Program::Python(python) => format!("{} -m pip install --upgrade pycolmap", python.to_string_lossy()),
        };
        let version = version.map_or_else(|| "of unknown version".to_owned(), dotted);
        Self::TooOld { program: program.to_string(), version, oldest: dotted(oldest), how }
    }

    /// An error of the operating system at a path.
    pub(crate) fn at(path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| Self::Path { path, source }
    }
}
