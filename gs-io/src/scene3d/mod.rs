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
//! | streamed SOG, `lod-meta.json` | the finest level, or a cut through the levels ([`LodFile3d`]) | yes, with levels of detail | as SOG |
//! | RAD, of Spark | as streamed SOG | yes, with levels of detail | all degrees; means bit for bit, the others rounded |
//! | 3D Tiles, `tileset.json` | each `.glb` alone | yes, with levels of detail | as SPZ, but means nearly exactly |
//! | `.ksplat` | yes | – | degree 2 at most |
//! | SPZ | versions 2, 3, 4 | versions 4, 3 | all degrees, everything rounded |
//! | glTF `KHR_gaussian_splatting`, `.gltf` and `.glb` | yes, nodes applied | yes | means and SH bit for bit, the others to rounding |
//!
//! World axes are those of COLMAP's data sets: x right, y down, z forward. PLY, `.splat` and
//! RAD use them by convention; SPZ (right, up, back) and glTF (left, up, forward) are converted.

mod conversion_loss;
mod file;
pub(crate) mod foreign;
mod format;
mod formats;
mod gltf;
mod ksplat;
mod options;
mod parts;
pub(crate) mod ply;
mod rad;
mod range;
mod sog;
pub(crate) mod source;
mod splat;
mod spz;
mod streamed;
mod trained_with;
pub(crate) mod values;
mod whole;

use std::path::Path;

use glam::DAffine3;
use gs_core::{Scene, Scene3d};

#[cfg(feature = "write")]
pub use self::streamed::write_levels_of_parts_3d;
pub(crate) use self::whole::{checked, decode_recognised, read_3d_unchecked};
pub use self::{
    conversion_loss::ConversionLoss,
    file::{Encoded3d, File3d, Written3d, move_scene},
    format::Format3d,
    options::{Coordinates, SpzVersion, WriteOptions3d},
    parts::{Parts3d, write_parts_3d, writes_parts_3d},
    source::FilesInMemory,
    streamed::{LevelsInMemory, LodFile3d},
    trained_with::TrainedWith,
    whole::{decode_3d, encode_3d},
};
use self::{
    values::transform,
    whole::{START_BYTES, WANTED},
};
use crate::{
    atomic::{open, read_exactly, write_durably},
    error::Error,
};

/// Size of a file that is read part by part, bytes.
const LARGE_BYTES: u64 = 64 << 20;

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

/// Writes a scene, atomically, in the format of the file's extension: `.ply`, `.splat`, `.spz`,
/// `.rad`, `.gltf`, `.glb` or `.sog`; or as a SOG in a folder for the name `meta.json`, which is written
/// after the images; or with levels of detail as a streamed SOG for the name `lod-meta.json`, or as 3D Tiles for
/// `tileset.json`, whose folder, which need not exist, gets this file last. Infinite opacity logits are written as
/// finite ones with the same picture.
///
/// # Errors
/// [`Error::UnknownEnding`]; [`Error::Content`] where [`Scene3d::validate`](Scene::validate) fails,
/// or a quaternion is too short to be a rotation and the format needs one; [`Error::Unusable`] for no
/// Gaussians, or too many for the format; those of [`write_durably`], and for levels of detail those of
/// [`FolderClaim::begin`](crate::FolderClaim::begin).
pub fn write_3d(path: impl AsRef<Path>, scene: &Scene3d, options: &WriteOptions3d) -> Result<Written3d, Error> {
    let path = path.as_ref();
    match Format3d::to_write(path) {
        Some(Format3d::Ply) => return write_parts_3d(path, scene.len(), options, [Ok::<_, Error>(scene)]),
        #[cfg(feature = "write")]
        Some(format) if streamed::writes_levels(format) => return streamed::write(path, format, scene, options),
        _ => {}
    }
    let Encoded3d { bytes, beside, written } = encode_3d(path, scene, options)?;
    for (path, bytes) in &beside {
        write_durably(path, |file| file.write_all(bytes))?;
    }
    write_durably(path, |file| file.write_all(&bytes))?;
    Ok(written)
}
