//! Errors of reading and writing files. Each names the file, what was expected, what was found, and
//! how to fix it, in one line.

use std::{
    io,
    path::{Path, PathBuf},
};

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
    /// A truncated or damaged image.
    #[error("{}: damaged {format} image: {message}; fetch or export it again", one_line(path))]
    DamagedImage {
        /// The file.
        path: PathBuf,
        /// The format, such as "PNG".
        format: &'static str,
        /// The decoder's message.
        message: String,
    },
    /// An image without pixels, or larger than a canvas can be. It is refused before memory is
    /// allocated.
    #[error(
        "{}: the image is {width}x{height} px, but each side must be 1 to {limit} px; scale it first",
        one_line(path)
    )]
    ImageSize {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// The longest side allowed.
        limit: u32,
    },
    /// A floating-point image contains NaN or ∞.
    #[error("{}: pixel ({x}, {y}) is {value}, not a finite number; repair it in an image editor", one_line(path))]
    ImageNotFinite {
        /// The file.
        path: PathBuf,
        /// Column.
        x: u32,
        /// Row.
        y: u32,
        /// The value.
        value: f32,
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
    /// The image of a view cannot be read.
    #[error("{0}, or remove the file, and the view is left out")]
    BadView(Box<Error>),
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
    /// A data set whose views for training cannot be used, but others can.
    #[error("{}: no view for training can be used: {}", one_line(path), skipped.join("; "))]
    NoTrainingViews {
        /// The data set's folder.
        path: PathBuf,
        /// The reasons, each with the number of views and the first of them.
        skipped: Vec<String>,
    },
    /// A list of a data set's split that names none of its frames.
    #[error(
        "{}: {key} names no frame of the data set: it begins with `{first}`, the frames with `{frame}`; correct the \
         names or remove the list",
        one_line(path)
    )]
    SplitMatchesNothing {
        /// The file.
        path: PathBuf,
        /// The key of the list.
        key: &'static str,
        /// The first name in the list.
        first: String,
        /// The name of the first frame.
        frame: String,
    },
    /// A text file in UTF-16.
    #[error("{}: is text in UTF-16, but must be in UTF-8; save it again with that encoding", one_line(path))]
    NotUtf8 {
        /// The file.
        path: PathBuf,
    },
    /// A text file with a line that its format does not allow.
    #[error(
        "{}: line {line}: expected {expected}, found {found}; it is damaged or not {what}: write or fetch it again",
        one_line(path)
    )]
    DamagedLine {
        /// The file.
        path: PathBuf,
        /// The kind of file, such as "a COLMAP cameras.txt".
        what: &'static str,
        /// The line, counted from 1.
        line: usize,
        /// What the format requires.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A `transforms.json` that is not JSON or lacks a required value.
    #[error("{}: {message}; it is damaged or not a transforms.json: write or fetch it again", one_line(path))]
    DamagedJson {
        /// The file.
        path: PathBuf,
        /// The problem, with line and column.
        message: String,
    },
    /// An unknown camera model.
    #[error(
        "{}: camera model {found} is not known (known: {known}); undistort the data set with the program that made it",
        one_line(path)
    )]
    UnknownCameraModel {
        /// The file.
        path: PathBuf,
        /// The model's name or number.
        found: String,
        /// The known models.
        known: String,
    },
    /// A PLY file that is not a point cloud: it is damaged or has no positions.
    #[error("{}: expected a PLY point cloud: {message}; export it again", one_line(path))]
    NotAPointCloud {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// An image whose size does not fit what it belongs to.
    #[error(
        "{}: the image is {width}x{height} px, but {expected_width}x{expected_height} px or its shape is needed; put the right one there",
        one_line(path)
    )]
    ImageShape {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Columns that are needed.
        expected_width: u32,
        /// Rows that are needed.
        expected_height: u32,
    },
    /// A 360° image of a camera with another model, whose views would all be wrong.
    #[error(
        "{}: it is twice as wide as high, and its borders meet as those of a 360° image do, but its camera has a perspective \
         model; set the camera's model to EQUIRECTANGULAR, or cut a few columns off if it is no 360° image",
        one_line(path)
    )]
    UnsplitPanorama {
        /// The image.
        path: PathBuf,
    },
    /// A depth map that cannot be used.
    #[error("{}: {message}; write this depth map again, or remove it", one_line(path))]
    BadDepth {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A scene file or checkpoint with bytes that its format does not allow.
    #[error(
        "{}: byte {byte}: expected {expected}, found {found}; it is damaged or not {what}: write or fetch it again",
        one_line(path)
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The kind of file, such as "a scene file".
        what: &'static str,
        /// Position in the file, counted from 0.
        byte: u64,
        /// What the format requires.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A `.gsi` file that cannot be decoded.
    #[error("{}: {source}; {}", one_line(path), remedy(source))]
    Compressed {
        /// The file.
        path: PathBuf,
        /// Why.
        source: gs_codec::Error,
    },
    /// A file that a later version of this program wrote.
    #[error(
        "{}: expected {what} of version {supported} or older, found version {found}; update this program",
        one_line(path)
    )]
    TooNew {
        /// The file.
        path: PathBuf,
        /// The kind of file, such as "a scene file".
        what: &'static str,
        /// The newest version that can be read.
        supported: u32,
        /// The file's version.
        found: u32,
    },
    /// A tensor of a scene file or checkpoint is missing, unexpected, or of another shape or type.
    #[error("{}: tensor `{tensor}`: expected {expected}, found {found}; write {what} again", one_line(path))]
    Tensor {
        /// The file.
        path: PathBuf,
        /// The kind of file, such as "a scene file".
        what: &'static str,
        /// The tensor.
        tensor: String,
        /// Type and shape that it should have.
        expected: String,
        /// The tensor's type and shape, or "none".
        found: String,
    },
    /// The file is not a 3D scene of a kind that can be read.
    #[error("{}: expected a 3D scene, found {found}; export it as PLY", one_line(path))]
    NotA3dScene {
        /// The file.
        path: PathBuf,
        /// What the file's first bytes or its content are.
        found: String,
    },
    /// A scene, mesh or the like of a known kind that cannot be read.
    #[error("{}: is {what}, which is not read; {hint}", one_line(path))]
    ForeignScene {
        /// The file.
        path: PathBuf,
        /// The kind of file, such as "a SOG scene".
        what: &'static str,
        /// How to get a scene that can be read.
        hint: &'static str,
    },
    /// A PLY that lacks properties of Gaussians.
    #[error("{}: its vertices have no {}; it is not a scene of Gaussians: export it as a 3DGS PLY", one_line(path), names.join(", "))]
    MissingProperties {
        /// The file.
        path: PathBuf,
        /// The missing properties, or the first of them.
        names: Vec<String>,
    },
    /// A folder without a scene.
    #[error("{}: holds no scene: looked for {looked_for}; name the scene's file", one_line(path))]
    NoScene {
        /// The folder.
        path: PathBuf,
        /// The files that would be one, by their names.
        looked_for: String,
    },
    /// A scene without Gaussians.
    #[error("{}: a scene without Gaussians, which has nothing to show; at least one is needed", one_line(path))]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A compressed file that claims to hold much more than its size allows. It is refused before
    /// memory is allocated.
    #[error(
        "{}: its {file_bytes} bytes declare {claimed_bytes} of content, more than its size allows; fetch it again",
        one_line(path)
    )]
    Expansion {
        /// The file.
        path: PathBuf,
        /// The size of the file and the files it refers to.
        file_bytes: u64,
        /// The claimed size.
        claimed_bytes: u64,
    },
    /// A valid file with a feature that is not supported.
    #[error("{}: {what} is not supported; {hint}", one_line(path))]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature.
        what: String,
        /// What to do.
        hint: &'static str,
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

    /// An image with a size that does not fit.
    pub(crate) fn image_shape(path: &Path, (width, height): (u32, u32), expected: (u32, u32)) -> Self {
        let (expected_width, expected_height) = expected;
        Self::ImageShape { path: path.to_owned(), width, height, expected_width, expected_height }
    }

    /// A depth map that cannot be used.
    pub(crate) fn bad_depth(path: &Path, message: impl Into<String>) -> Self {
        Self::BadDepth { path: path.to_owned(), message: message.into() }
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
