//! What can be wrong with a file: where, what was expected, what was found, and how to mend it, in one line each.

use std::{
    io,
    path::{Path, PathBuf},
};

use thiserror::Error;

/// An error of reading or writing a file. Its text is one line, made to be shown to the user as it is.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// There is nothing at this path.
    #[error("{}: no such file; check the path", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// A folder, a pipe or a device stands where a file was expected.
    #[error("{}: is {found}, but must be a file; name {wanted}", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
        /// "a folder" or the like.
        found: &'static str,
        /// What kind of file is meant: "an image file".
        wanted: &'static str,
    },
    /// The operating system refused to read.
    #[error("{}: cannot be read: {source}; check the file's permissions and its disk", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The folder to write into is not there.
    #[error("{}: cannot be written: there is no folder {}; create it first", path.display(), folder.display())]
    NoFolder {
        /// The file.
        path: PathBuf,
        /// Its folder.
        folder: PathBuf,
    },
    /// The operating system refused to write. Nothing of the file is left behind, and what stood there before is untouched.
    #[error("{}: cannot be written: {source}; check the folder's permissions and the space left", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file has the name of a result, and no run wrote it.
    #[error("{}: is in the way: no run of gs wrote it into this folder", path.display())]
    InTheWay {
        /// The file.
        path: PathBuf,
    },
    /// A result would replace a file that the run reads.
    #[error("{}: is an input of this run, which is never replaced", path.display())]
    IsInput {
        /// The file, as the result would be called.
        path: PathBuf,
    },
    /// Another run writes into the folder.
    #[error("{}: another run of gs is at work in this folder", folder.display())]
    Busy {
        /// The folder.
        folder: PathBuf,
    },
    /// The operating system refused to remove a file of an earlier run.
    #[error("{}: was written by an earlier run and cannot be removed: {source}", path.display())]
    Remove {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Not an image, or not one of a kind that can be read.
    #[error("{}: {found}; {mend}", path.display())]
    NotAnImage {
        /// The file.
        path: PathBuf,
        /// What it is instead: "is empty", "is a HEIC image, but …".
        found: String,
        /// What to do.
        mend: String,
    },
    /// An image of a known kind that is cut short or damaged.
    #[error("{}: damaged {format} image: {message}; fetch or export it again", path.display())]
    DamagedImage {
        /// The file.
        path: PathBuf,
        /// "PNG" or the like.
        format: &'static str,
        /// What the decoder says.
        message: String,
    },
    /// An image of no size, or larger than a canvas can be; refused before memory is allocated for it.
    #[error("{}: the image is {width}x{height} px, but each side must be 1 to {limit} px; scale it first", path.display())]
    ImageSize {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// The longest side.
        limit: u32,
    },
    /// A floating-point image with a value that is NaN or infinite.
    #[error("{}: pixel ({x}, {y}) is {value}, not a finite number; repair it in an image editor", path.display())]
    ImageNotFinite {
        /// The file.
        path: PathBuf,
        /// Column.
        x: u32,
        /// Row.
        y: u32,
        /// What stands there.
        value: f32,
    },
    /// A folder in which none of the data sets' files was found.
    #[error("{}: is no data set: looked for {looked_for}; {mend}", path.display())]
    NotADataset {
        /// The folder.
        path: PathBuf,
        /// The files, in words.
        looked_for: &'static str,
        /// What to do.
        mend: String,
    },
    /// A data set that names a file outside its folder.
    #[error(
        "{}: {key} `{name}` leads out of the data set's folder{}; copy what it needs into the folder",
        path.display(),
        if *more > 0 { format!(" (and {})", gs_core::counted(*more, "more path")) } else { String::new() }
    )]
    LeavesDataset {
        /// The file that names it.
        path: PathBuf,
        /// As what it is named.
        key: &'static str,
        /// The path that is named.
        name: String,
        /// How many others are outside.
        more: usize,
    },
    /// A photograph of a data set whose content cannot be read.
    #[error("{0}, or remove the file, and the view is left out")]
    BadView(Box<Error>),
    /// A data set of which not one view can be used.
    #[error("{}: this {kind} data set has {}, of which none can be used: {}", path.display(), gs_core::counted(*found, "view"), skipped.join("; "))]
    NoViews {
        /// Its folder.
        path: PathBuf,
        /// "COLMAP" or the like.
        kind: &'static str,
        /// How many there are.
        found: usize,
        /// Why not, each with how many and the first.
        skipped: Vec<String>,
    },
    /// A text file whose line is not what its kind prescribes.
    #[error("{}: line {line}: expected {expected}, found {found}; it is damaged or not {what}: write or fetch it again", path.display())]
    DamagedLine {
        /// The file.
        path: PathBuf,
        /// "a COLMAP cameras.txt" or the like.
        what: &'static str,
        /// Counted from 1.
        line: usize,
        /// What should stand there.
        expected: String,
        /// What does.
        found: String,
    },
    /// A `transforms.json` that is no JSON, or lacks what it must have.
    #[error("{}: {message}; it is damaged or not a transforms.json: write or fetch it again", path.display())]
    DamagedJson {
        /// The file.
        path: PathBuf,
        /// What, with line and column.
        message: String,
    },
    /// A camera model that is not known.
    #[error("{}: camera model {found} is not known (known: {known}); undistort the data set with the program that made it", path.display())]
    UnknownCameraModel {
        /// The file.
        path: PathBuf,
        /// Its name or number.
        found: String,
        /// Those that are known.
        known: String,
    },
    /// A PLY file that is no point cloud: damaged, or without positions.
    #[error("{}: expected a PLY point cloud: {message}; export it again", path.display())]
    NotAPointCloud {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// An image of another shape than what it belongs to.
    #[error("{}: the image is {width}x{height} px, but {expected_width}x{expected_height} px or its shape is needed; put the right one there", path.display())]
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
    /// A scene file or checkpoint whose bytes are not what its kind prescribes.
    #[error("{}: byte {byte}: expected {expected}, found {found}; it is damaged or not {what}: write or fetch it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// "a scene file" or the like.
        what: &'static str,
        /// Where, counted from the start of the file.
        byte: u64,
        /// What should stand there.
        expected: String,
        /// What does.
        found: String,
    },
    /// A file of the right kind, written by a later version of this program.
    #[error("{}: expected {what} of version {supported} or older, found version {found}; update this program", path.display())]
    TooNew {
        /// The file.
        path: PathBuf,
        /// "a scene file" or the like.
        what: &'static str,
        /// The newest version that can be read.
        supported: u32,
        /// The file's.
        found: u32,
    },
    /// A tensor of a scene file or checkpoint is missing, superfluous, or of another shape or type.
    #[error("{}: tensor `{tensor}`: expected {expected}, found {found}; write {what} again", path.display())]
    Tensor {
        /// The file.
        path: PathBuf,
        /// "the scene file" or the like.
        what: &'static str,
        /// The tensor.
        tensor: String,
        /// Type and shape that it should have.
        expected: String,
        /// What it is.
        found: String,
    },
    /// Not a 3D scene, or not one of a kind that can be read.
    #[error(
        "{}: expected a scene (PLY, compressed PLY, .splat, SPZ, .gltf or .glb), found {found}; export it as PLY",
        path.display()
    )]
    NotA3dScene {
        /// The file.
        path: PathBuf,
        /// What its first bytes or its content say.
        found: String,
    },
    /// A scene, a mesh or the like of a known kind that is not read.
    #[error("{}: is {what}, which is not read; {mend}", path.display())]
    ForeignScene {
        /// The file.
        path: PathBuf,
        /// "a SOG scene" or the like.
        what: &'static str,
        /// How to come by a scene that is read.
        mend: &'static str,
    },
    /// A PLY without properties that every Gaussian must have.
    #[error("{}: its vertices have no {}; it is not a scene of Gaussians: export it as a 3DGS PLY", path.display(), names.join(", "))]
    MissingProperties {
        /// The file.
        path: PathBuf,
        /// The properties' names, or the first of them.
        names: Vec<String>,
    },
    /// A scene without Gaussians.
    #[error("{}: a scene without Gaussians, which has nothing to show; at least one is needed", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A compressed file that claims to hold so much more than its size that it is refused before memory is asked for.
    #[error("{}: its {file_bytes} bytes claim to hold {claimed_bytes}, more than can be believed; fetch it again", path.display())]
    Expansion {
        /// The file.
        path: PathBuf,
        /// Its size, with what it refers to.
        file_bytes: u64,
        /// The size of what it claims to hold.
        claimed_bytes: u64,
    },
    /// A file that is right, and uses what is not supported.
    #[error("{}: {what} is not supported; {mend}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it uses.
        what: String,
        /// What to do.
        mend: &'static str,
    },
    /// A 3D scene was to be written into a file whose ending names no kind that can be written.
    #[error("{}: its ending names no kind of scene that can be written; use .ply, .splat, .spz, .gltf or .glb", path.display())]
    UnknownEnding {
        /// The file.
        path: PathBuf,
    },
    /// A file whose form is right but whose content is not possible, such as a NaN among the means; or such a content that was
    /// to be written.
    #[error("{}: {source}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: gs_core::Error,
    },
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

    /// An image of a shape that does not fit.
    pub(crate) fn image_shape(path: &Path, (width, height): (u32, u32), expected: (u32, u32)) -> Self {
        let (expected_width, expected_height) = expected;
        Self::ImageShape { path: path.to_owned(), width, height, expected_width, expected_height }
    }

    /// What a file that is of no known kind seems to be, by its first bytes.
    pub(crate) fn found(start: &[u8]) -> String {
        match start {
            [] => "an empty file".to_owned(),
            start if start.iter().all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace()) => "text".to_owned(),
            start => format!("bytes {:02x?}", &start[..start.len().min(8)]),
        }
    }

    /// Content that the core refuses.
    pub(crate) fn content(path: &Path) -> impl Fn(gs_core::Error) -> Self {
        move |source| Self::Content { path: path.to_owned(), source }
    }
}
