//! Scenes that are read and written as a whole.

use std::{borrow::Cow, path::Path};

use glam::{DVec3, Vec3};
use gs_core::{Scene as _, Scene3d, examination::SMALLEST_LOG_SCALE};

use super::{
    conversion_loss::ConversionLoss,
    file::{Encoded3d, File3d, move_scene},
    foreign,
    format::Format3d,
    options::{ToWrite, WriteOptions3d},
    range,
    source::{FilesInMemory, Source},
    values::finite_logit,
};
use crate::{WorldFrame, atomic::read_file, error::Error};

pub(super) const WANTED: &str = "a scene file";

/// Bytes that are enough to recognise a file.
pub(super) const START_BYTES: usize = 64;

/// The file with zero scales raised and infinite logits made finite, if all other values are finite.
pub(crate) fn checked(mut file: File3d, path: &Path) -> Result<File3d, Error> {
    file.losses.extend(raise_zero_scales(&mut file.scene));
    file.losses.extend(ConversionLoss::of_infinite_logits(&file.scene));
    file.scene.opacity_logits.iter_mut().for_each(|logit| *logit = finite_logit(*logit));
    file.scene.validate().map_err(Error::content(path))?;
    Ok(file)
}

pub(super) fn raise_zero_scales(scene: &mut Scene3d) -> Option<ConversionLoss> {
    let is_zero = |scales: &Vec3| scales.to_array().contains(&f32::NEG_INFINITY);
    let zero: Vec<usize> = (0..scene.len()).filter(|&index| is_zero(&scene.log_scales[index])).collect();
    let raised = |scale: f32| if scale == f32::NEG_INFINITY { SMALLEST_LOG_SCALE } else { scale };
    zero.iter().for_each(|&index| scene.log_scales[index] = scene.log_scales[index].map(raised));
    (!zero.is_empty()).then_some(ConversionLoss::ZeroScales { gaussians: zero.len() })
}

/// Reads a 3D scene as [`read_3d`](super::read_3d) does, but allows values that are NaN or infinite, including
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
    decode_3d_with(format, bytes, path, None)
}

/// Decodes a scene file as [`decode_3d`] does; a SOG's images are taken from `beside` where it is given.
pub(super) fn decode_3d_with(
    format: Format3d,
    bytes: &[u8],
    path: &Path,
    beside: Option<&FilesInMemory>,
) -> Result<File3d, Error> {
    let row = format.row();
    let mut file = (row.read)(&Source { path, what: row.what, bytes, beside }, format)?;
    if file.scene.is_empty() {
        return Err(Error::empty(path));
    }
    file.bytes = file.bytes.saturating_add(bytes.len() as u64);
    Ok(file)
}

/// A scene that a file of this format can have, and the options for it: in coordinates of the world if these
/// are wanted and files of the format have no frame.
pub(super) fn writable<'a>(
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

/// Encodes a scene as [`write_3d`](super::write_3d) does, but writes nothing; not as a streamed SOG.
///
/// # Errors
/// Those of [`write_3d`](super::write_3d), except for those of writing.
pub fn encode_3d(path: impl AsRef<Path>, scene: &Scene3d, options: &WriteOptions3d) -> Result<Encoded3d, Error> {
    let path = path.as_ref();
    let format = Format3d::to_write(path).ok_or_else(|| Format3d::unknown_ending(path))?;
    if scene.is_empty() {
        return Err(Error::empty(path));
    }
    let (scene, options) = writable(path, format, Cow::Borrowed(scene), options)?;
    (format.row().encode)(&ToWrite { format, path, scene: &scene, options: &options })
}
