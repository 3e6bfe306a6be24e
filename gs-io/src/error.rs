//! Errors of reading and writing files. Each names the file, what was expected, what was found, and
//! how to fix it, in one line.

use std::{
    borrow::Cow,
    fmt, io,
    path::{Path, PathBuf},
};

use gs_core::{check_size, constants::MAX_SIDE_PX};
use thiserror::Error;

/// An error of reading or writing a file. Its text is one line that can be shown to the user.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// The file does not exist.
    #[error("{}: no such file; check the path", one_line(path))]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// A folder, pipe or device where a file was expected.
    #[error("{}: is {found}, but must be a file; name {wanted}", one_line(path))]
    NotAFile {
        /// The path.
        path: PathBuf,
        /// What is there instead, such as "a folder".
        found: &'static str,
        /// The expected kind of file: "an image file".
        wanted: &'static str,
    },
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}; check the file's permissions and its disk", one_line(path))]
    Read {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The folder to write into does not exist.
    #[error("{}: cannot be written: there is no folder {}; create it first", one_line(path), one_line(folder))]
    NoFolder {
        /// The file.
        path: PathBuf,
        /// The folder that does not exist.
        folder: PathBuf,
    },
    /// The file cannot be written. No part of it is left behind, and what it would replace is
    /// unchanged.
    #[error("{}: cannot be written: {source}; check the folder's permissions and the space left", one_line(path))]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A result has the name of a file that no run of gs wrote.
    #[error("{}: is in the way: no run of gs wrote it into this folder", one_line(path))]
    InTheWay {
        /// The file.
        path: PathBuf,
    },
    /// A result would replace an input of the run.
    #[error("{}: is an input of this run, which is never replaced", one_line(path))]
    IsInput {
        /// The file under the result's name.
        path: PathBuf,
    },
    /// Another run is writing into the folder.
    #[error("{}: another run of gs is at work in this folder", one_line(folder))]
    Busy {
        /// The folder.
        folder: PathBuf,
    },
    /// A file of an earlier run cannot be removed.
    #[error("{}: was written by an earlier run and cannot be removed: {source}", one_line(path))]
    Remove {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The file is not an image, or an image of a kind that cannot be read.
    #[error("{}: {found}; {hint}", one_line(path))]
    NotAnImage {
        /// The file.
        path: PathBuf,
        /// What the file is: "is empty", "is a HEIC image, but …".
        found: String,
        /// What to do.
        hint: String,
    },
    /// A folder that contains no data set.
    #[error("{}: is no data set: looked for {looked_for}; {hint}", one_line(path))]
    NotADataset {
        /// The folder.
        path: PathBuf,
        /// The files that were searched, in words.
        looked_for: &'static str,
        /// What to do.
        hint: String,
        /// The folder of photographs without poses that it holds.
        photographs: Option<PathBuf>,
    },
    /// A data set refers to a file outside its folder.
    #[error(
        "{}: {key} `{name}` leads out of the data set's folder{}; copy the files into the folder",
        one_line(path),
        if *more > 0 { format!(" (and {})", gs_core::counted(*more, "more path")) } else { String::new() }
    )]
    LeavesDataset {
        /// The file with the reference.
        path: PathBuf,
        /// The key of the reference.
        key: &'static str,
        /// The path that it refers to.
        name: String,
        /// Number of other references that leave the folder.
        more: usize,
    },
    /// A data set without any usable view.
    #[error("{}: this {kind} data set has {}, of which none can be used: {}", one_line(path), gs_core::counted(*found, "view"), skipped.join("; "))]
    NoViews {
        /// The data set's folder.
        path: PathBuf,
        /// The kind of data set, such as "COLMAP".
        kind: &'static str,
        /// Number of views.
        found: usize,
        /// The reasons, each with the number of views and the first of them.
        skipped: Vec<String>,
        /// Whether an image of these names is outside of the folder.
        outside: bool,
    },
    /// Content of a file that its format does not allow.
    #[error(
        "{}: {place}: expected {expected}, found {found}; it is damaged or not {what}: write or fetch it again",
        one_line(path)
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The kind of file, such as "a scene file".
        what: &'static str,
        /// Where in the file: "byte 12", counted from 0, or "line 12", counted from 1.
        place: String,
        /// What the format requires.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A file that can be read but not used. It is of another kind or incomplete, contradicts
    /// itself, exceeds a limit, or has a feature that is not supported.
    #[error("{}: {problem}; {remedy}", one_line(path))]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong: "is a LAS point cloud, which is not read".
        problem: String,
        /// What to do.
        remedy: Cow<'static, str>,
    },
    /// A `.gsi` file that cannot be decoded.
    #[error("{}: {source}; {}", one_line(path), remedy(source))]
    Compressed {
        /// The file.
        path: PathBuf,
        /// Why.
        source: gs_codec::Error,
    },
    /// The extension of an output file is not that of a 3D scene format that can be written.
    #[error("{}: its ending names no kind of scene that can be written; use {endings}", one_line(path))]
    UnknownEnding {
        /// The extensions that can be written.
        endings: String,
        /// The file.
        path: PathBuf,
    },
    /// A well-formed file, or a scene to be written, with impossible values such as NaN among the
    /// means.
    #[error("{}: {source}", one_line(path))]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: gs_core::Error,
    },
}

/// A path with its control characters escaped, so that an error stays one line.
fn one_line(path: &Path) -> String {
    let escape = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    path.to_string_lossy().chars().map(escape).collect()
}

impl Error {
    /// An error of the operating system while reading.
    pub(crate) fn read(path: &Path, source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => Self::Missing { path: path.to_owned() },
            _ => Self::Read { path: path.to_owned(), source },
        }
    }

    /// An error of the operating system while writing.
    pub(crate) fn write(path: &Path, source: io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// A file that cannot be used, with what to do about it.
    pub(crate) fn unusable(path: &Path, problem: impl Into<String>, remedy: impl Into<Cow<'static, str>>) -> Self {
        Self::Unusable { path: path.to_owned(), problem: problem.into(), remedy: remedy.into() }
    }

    /// A feature that is not supported, of a file that is right.
    pub(crate) fn unsupported(path: &Path, what: impl fmt::Display, hint: &'static str) -> Self {
        Self::unusable(path, format!("{what} is not supported"), hint)
    }

    /// A file that a later version of this program wrote.
    pub(crate) fn too_new(path: &Path, what: &str, supported: impl fmt::Display, found: impl fmt::Display) -> Self {
        let problem = format!("expected {what} of version {supported} or older, found version {found}");
        Self::unusable(path, problem, "update this program")
    }

    /// A known kind of file that cannot be read as a scene.
    pub(crate) fn foreign_scene(path: &Path, what: &str, hint: &'static str) -> Self {
        Self::unusable(path, format!("is {what}, which is not read"), hint)
    }

    /// A file that is not a 3D scene.
    pub(crate) fn not_a_3d_scene(path: &Path, found: &str) -> Self {
        Self::unusable(path, format!("expected a 3D scene, found {found}"), "export it as PLY")
    }

    /// A scene without Gaussians.
    pub(crate) fn empty(path: &Path) -> Self {
        Self::unusable(path, "a scene without Gaussians, which has nothing to show", "at least one is needed")
    }

    /// A truncated or damaged image of a format.
    pub(crate) fn damaged_image(path: &Path, format: &str, message: impl fmt::Display) -> Self {
        Self::unusable(path, format!("damaged {format} image: {message}"), "fetch or export it again")
    }

    /// Fails for an image without pixels, or larger than a canvas can be, before memory is allocated for it.
    pub(crate) fn check_image_size(path: &Path, (width, height): (u32, u32)) -> Result<(), Self> {
        check_size(width, height).map_err(|_| {
            let problem = format!("the image is {width}x{height} px, but each side must be 1 to {MAX_SIDE_PX} px");
            Self::unusable(path, problem, "scale it first")
        })
    }

    /// An image whose size does not fit what it belongs to.
    pub(crate) fn image_shape(path: &Path, (width, height): (u32, u32), needed: (u32, u32)) -> Self {
        let needed = format!("{}x{} px or its shape is needed", needed.0, needed.1);
        Self::unusable(path, format!("the image is {width}x{height} px, but {needed}"), "put the right one there")
    }

    /// A depth map that cannot be used.
    pub(crate) fn bad_depth(path: &Path, message: impl Into<String>) -> Self {
        Self::unusable(path, message, "write this depth map again, or remove it")
    }

    /// An unknown camera model.
    pub(crate) fn unknown_camera_model(path: &Path, found: impl fmt::Display, known: &str) -> Self {
        let problem = format!("camera model {found} is not known (known: {known})");
        Self::unusable(path, problem, "undistort the data set with the program that made it")
    }

    /// Describes a file of an unknown kind by its first bytes.
    pub(crate) fn found(start: &[u8]) -> String {
        match start {
            [] => "an empty file".to_owned(),
            start if start.iter().all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace()) => "text".to_owned(),
            start => format!("bytes {:02x?}", &start[..start.len().min(8)]),
        }
    }

    /// Turns an error of gs-core into [`Error::Content`].
    pub(crate) fn content(path: &Path) -> impl Fn(gs_core::Error) -> Self {
        move |source| Self::Content { path: path.to_owned(), source }
    }
}

/// What to do about a damaged `.gsi` file.
fn remedy(error: &gs_codec::Error) -> &'static str {
    match error {
        gs_codec::Error::Truncated { part: "a layer", .. } => {
            "fetch it again, or let gs decode --partial show what is there"
        }
        _ => "fetch or encode it again",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_with_a_line_break_stays_on_one_line() {
        let error = Error::Missing { path: "a\nb.png".into() };
        assert_eq!(error.to_string(), "a\\nb.png: no such file; check the path");
    }
}
