//! Files of 3D scenes in common formats.
//!
//! [`read_3d`] and [`write_3d`] read and write files, [`decode_3d`] and [`encode_3d`] their bytes. Each
//! format has a module of its own.
//!
//! | format | read | written | keeps |
//! |---|---|---|---|
//! | 3DGS PLY: text, binary of either byte order | any degree up to 4 (3 kept) | binary little endian | everything, bit for bit, but infinite logits |
//! | PlayCanvas compressed PLY | yes | – | 16 bytes a Gaussian, and one for each higher coefficient |
//! | `.splat` | yes | yes | means and scales; degree 0 only, colours, opacities and rotations to 8 bits |
//! | SOG, bundled and unbundled | version 2 | version 2 | all degrees, everything rounded |
//! | streamed SOG, `lod-meta.json` | the finest level, or a cut through the levels ([`StreamedSog`]) | yes, with levels of detail | as SOG |
//! | `.ksplat` | yes | – | degree 2 at most |
//! | SPZ | versions 2, 3, 4 | versions 4, 3 | all degrees, everything rounded |
//! | glTF `KHR_gaussian_splatting`, `.gltf` and `.glb` | yes, nodes applied | yes | means and SH bit for bit, the others to rounding |
//!
//! World axes are those of COLMAP's data sets: x right, y down, z forward. PLY and `.splat` use
//! them by convention; SPZ (right, up, back) and glTF (left, up, forward) are converted.

mod conversion_loss;
pub(crate) mod foreign;
mod format;
mod formats;
mod gltf;
mod ksplat;
pub(crate) mod number;
mod options;
mod parts;
pub(crate) mod ply;
mod range;
mod sog;
pub(crate) mod source;
mod splat;
mod spz;
mod streamed;
mod trained_with;
mod values;

use std::{
    borrow::Cow,
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use glam::{DAffine3, DVec3, Vec3};
use gs_core::{RenderSettings, Scene, Scene3d, examination::SMALLEST_LOG_SCALE};

#[cfg(feature = "write")]
pub use self::streamed::write_levels_of_parts_3d;
pub use self::{
    conversion_loss::ConversionLoss,
    format::Format3d,
    options::{Coordinates, SpzVersion, WriteOptions3d},
    parts::{Parts3d, write_parts_3d, writes_parts_3d},
    streamed::StreamedSog,
    trained_with::TrainedWith,
    values::Rounding,
};
use self::{
    options::ToWrite,
    source::Source,
    values::{finite_logit, transform},
};
use crate::{
    WorldFrame,
    atomic::{open, read_exactly, read_file, write_durably},
    error::Error,
};

/// Size of a file that is read part by part, bytes.
const LARGE_BYTES: u64 = 64 << 20;

/// Bytes that are enough to recognise a file.
const START_BYTES: usize = 64;

/// A scene with information about its file.
#[derive(Debug, Clone, PartialEq)]
pub struct File3d {
    /// The Gaussians.
    pub scene: Scene3d,
    /// The format of the file.
    pub format: Format3d,
    /// Size of the file and of the files it refers to, bytes.
    pub bytes: u64,
    /// Files that the scene file refers to: buffers of a glTF, images of a SOG.
    pub beside: Vec<PathBuf>,
    /// What of the file is not in the scene.
    pub losses: Vec<ConversionLoss>,
    /// How the scene was trained, as far as the file says.
    pub trained_with: TrainedWith,
    /// All settings that the scene is rendered with; a checkpoint has them, scene files do not.
    pub settings: Option<RenderSettings>,
}

impl File3d {
    /// A scene of which nothing else is known.
    pub(crate) fn of(format: Format3d, scene: Scene3d) -> Self {
        let (beside, losses, trained_with) = (Vec::new(), Vec::new(), TrainedWith::default());
        Self { scene, format, bytes: 0, beside, losses, trained_with, settings: None }
    }

    /// The file with the further files that were read for it, and their sizes.
    pub(crate) fn beside(self, files: BTreeMap<PathBuf, u64>) -> Self {
        let bytes = files.values().fold(0_u64, |sum, bytes| sum.saturating_add(*bytes));
        Self { bytes, beside: files.into_keys().collect(), ..self }
    }

    /// Takes the scene into another frame, such as that of a data set to train it with.
    pub fn move_to(&mut self, frame: WorldFrame) {
        move_scene(&mut self.scene, &self.trained_with.frame, &frame);
        self.trained_with.frame = frame;
    }
}

/// Takes a scene from one frame to another.
pub fn move_scene(scene: &mut Scene3d, from: &WorldFrame, to: &WorldFrame) {
    if from != to {
        transform(scene, &from.to(to));
    }
}

/// Takes a scene by an affine map p′ = A p + t; colours turn with it. Returns what is lost where A is not a
/// similarity: a rotation, possibly a reflection, times a scale.
pub fn transform_scene(scene: &mut Scene3d, map: &DAffine3) -> Option<ConversionLoss> {
    transform(scene, map)
}

/// The format of a scene file by its content; `None` for another kind of file.
///
/// # Errors
/// [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`]; [`Error::Unusable`] for a known
/// kind that cannot be read.
pub fn format_3d(path: impl AsRef<Path>) -> Result<Option<Format3d>, Error> {
    let path = path.as_ref();
    let (mut file, metadata) = open(path, WANTED)?;
    let start = read_exactly(&mut file, metadata.len().min(START_BYTES as u64)).map_err(|e| Error::read(path, e))?;
    match Format3d::recognise(&start, path) {
        Some(format) => Ok(Some(format)),
        None => foreign::refusal(&start, path).map_or(Ok(None), Err),
    }
}

/// Reads a scene of any format, recognised by content first and extension second, and checks every
/// value. Scales of 0 are raised ([`ConversionLoss::ZeroScales`]), and infinite opacity logits are
/// made finite ([`ConversionLoss::InfiniteLogits`]).
///
/// # Errors
/// [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`]; [`Error::Unusable`] for another kind of
/// file; those of [`decode_3d`]; [`Error::Content`] for other values that are NaN or infinite.
pub fn read_3d(path: impl AsRef<Path>) -> Result<File3d, Error> {
    let path = path.as_ref();
    match parts::joined(path, LARGE_BYTES)? {
        Some(file) => Ok(file),
        None => checked(read_3d_unchecked(path)?, path),
    }
}

/// The file with zero scales raised and infinite logits made finite, if all other values are finite.
pub(crate) fn checked(mut file: File3d, path: &Path) -> Result<File3d, Error> {
    file.losses.extend(raise_zero_scales(&mut file.scene));
    file.losses.extend(ConversionLoss::of_infinite_logits(&file.scene));
    file.scene.opacity_logits.iter_mut().for_each(|logit| *logit = finite_logit(*logit));
    file.scene.validate().map_err(Error::content(path))?;
    Ok(file)
}

fn raise_zero_scales(scene: &mut Scene3d) -> Option<ConversionLoss> {
    let is_zero = |scales: &Vec3| scales.to_array().contains(&f32::NEG_INFINITY);
    let zero: Vec<usize> = (0..scene.len()).filter(|&index| is_zero(&scene.log_scales[index])).collect();
    let raised = |scale: f32| if scale == f32::NEG_INFINITY { SMALLEST_LOG_SCALE } else { scale };
    zero.iter().for_each(|&index| scene.log_scales[index] = scene.log_scales[index].map(raised));
    (!zero.is_empty()).then_some(ConversionLoss::ZeroScales { gaussians: zero.len() })
}

/// Reads a 3D scene as [`read_3d`] does, but allows values that are NaN or infinite, including
/// ln-scales of −∞.
pub(crate) fn read_3d_unchecked(path: &Path) -> Result<File3d, Error> {
    decode_recognised(&read_file(path, WANTED)?, path)
}

/// Decodes the bytes of a file of any format; see [`decode_3d`].
pub(crate) fn decode_recognised(bytes: &[u8], path: &Path) -> Result<File3d, Error> {
    let start = &bytes[..bytes.len().min(START_BYTES)];
    let Some(format) = Format3d::recognise(start, path) else {
        let unknown = || Error::not_a_3d_scene(path, &Error::found(start));
        return Err(foreign::refusal(start, path).unwrap_or_else(unknown));
    };
    decode_3d(format, bytes, path)
}

/// Decodes the bytes of a scene file; values may be NaN or infinite. `path` is used for errors, and
/// to find a glTF's buffers and a SOG's images. Memory is limited by the number of bytes.
///
/// # Errors
/// [`Error::Damaged`] for bytes that are not what their kind prescribes;
/// [`Error::Unusable`] for a later version, for what is right but not read, for missing properties, for a bomb, for no
/// Gaussians, and for a glTF of something else; for a glTF's buffer or a SOG's image those of opening it.
pub fn decode_3d(format: Format3d, bytes: &[u8], path: &Path) -> Result<File3d, Error> {
    let row = format.row();
    let mut file = (row.read)(&Source { path, what: row.what, bytes }, format)?;
    if file.scene.is_empty() {
        return Err(Error::empty(path));
    }
    file.bytes = file.bytes.saturating_add(bytes.len() as u64);
    Ok(file)
}

/// The result of writing a scene.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Written3d {
    /// The format of the file.
    pub format: Format3d,
    /// What of the scene is not in the file.
    pub losses: Vec<ConversionLoss>,
    /// The further files: the separate buffer of a glTF, the images of a SOG in a folder.
    pub beside: Vec<PathBuf>,
    /// The number in the scene of each Gaussian in the file, where the format sorts them.
    pub order: Option<Vec<u32>>,
}

/// Writes a scene, atomically, in the format of the file's extension: `.ply`, `.splat`, `.spz`,
/// `.gltf`, `.glb` or `.sog`; or as a SOG in a folder for the name `meta.json`, which is written
/// after the images; or with levels of detail as a streamed SOG for the name `lod-meta.json`, whose
/// folder, which need not exist, gets its `lod-meta.json` last. Infinite opacity logits are written as
/// finite ones with the same picture.
///
/// # Errors
/// [`Error::UnknownEnding`]; [`Error::Content`] where [`Scene3d::validate`](Scene::validate) fails,
/// or a quaternion is too short to be a rotation and the format needs one; [`Error::Unusable`] for no
/// Gaussians, or too many for the format; those of [`write_durably`], and for a streamed SOG those of
/// [`FolderClaim::begin`](crate::FolderClaim::begin).
pub fn write_3d(path: impl AsRef<Path>, scene: &Scene3d, options: &WriteOptions3d) -> Result<Written3d, Error> {
    let path = path.as_ref();
    match Format3d::to_write(path) {
        Some(Format3d::Ply) => return write_parts_3d(path, scene.len(), options, [Ok::<_, Error>(scene)]),
        #[cfg(feature = "write")]
        Some(Format3d::StreamedSog) => return streamed::write(path, scene, options),
        _ => {}
    }
    let Encoded3d { bytes, beside, written } = encode_3d(path, scene, options)?;
    for (path, bytes) in &beside {
        write_durably(path, |file| file.write_all(bytes))?;
    }
    write_durably(path, |file| file.write_all(&bytes))?;
    Ok(written)
}

/// The files that [`write_3d`] writes.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Encoded3d {
    /// The content of the file.
    pub bytes: Vec<u8>,
    /// The further files.
    pub beside: Vec<(PathBuf, Vec<u8>)>,
    /// What [`write_3d`] returns.
    pub written: Written3d,
}

impl Encoded3d {
    /// A single file.
    pub(crate) fn of(format: Format3d, bytes: Vec<u8>, losses: Vec<ConversionLoss>) -> Self {
        Self { bytes, beside: Vec::new(), written: Written3d { format, losses, beside: Vec::new(), order: None } }
    }

    /// The file with further ones.
    pub(crate) fn beside(mut self, files: Vec<(PathBuf, Vec<u8>)>) -> Self {
        self.written.beside = files.iter().map(|(path, _)| path.clone()).collect();
        Self { beside: files, ..self }
    }
}

/// A scene that a file of this format can have, and the options for it: in coordinates of the world if these
/// are wanted and files of the format have no frame.
fn writable<'a>(
    path: &Path,
    format: Format3d,
    scene: Cow<'a, Scene3d>,
    options: &WriteOptions3d,
) -> Result<(Cow<'a, Scene3d>, WriteOptions3d), Error> {
    scene.validate().map_err(Error::content(path))?;
    range::check(path, format, &scene, options)?;
    let Some(frame) = options.world().filter(|_| !format.row().stores_frame) else { return Ok((scene, *options)) };
    if frame.origin != DVec3::ZERO {
        let what = format!("a scene in world coordinates around {}, which need 64 bits,", frame.origin);
        return Err(Error::unsupported(path, what, "write a PLY or a glTF"));
    }
    let mut scene = scene.into_owned();
    move_scene(&mut scene, &frame, &WorldFrame::WORLD);
    Ok((Cow::Owned(scene), options.with(|s| s.trained_with.frame = WorldFrame::WORLD)))
}

/// Encodes a scene as [`write_3d`] does, but writes nothing; not as a streamed SOG.
///
/// # Errors
/// Those of [`write_3d`], except for those of writing.
pub fn encode_3d(path: impl AsRef<Path>, scene: &Scene3d, options: &WriteOptions3d) -> Result<Encoded3d, Error> {
    let path = path.as_ref();
    let format = Format3d::to_write(path).ok_or_else(|| Format3d::unknown_ending(path))?;
    if scene.is_empty() {
        return Err(Error::empty(path));
    }
    let (scene, options) = writable(path, format, Cow::Borrowed(scene), options)?;
    (format.row().encode)(&ToWrite { format, path, scene: &scene, options: &options })
}

const WANTED: &str = "a scene file";
