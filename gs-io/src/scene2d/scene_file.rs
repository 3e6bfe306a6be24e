//! Lossless files of 2D scenes, in the safetensors format, which any tensor library can open.
//!
//! | tensor | type, shape | unit |
//! |---|---|---|
//! | `mean` | F32 `[N, 2]` | px |
//! | `log_scale` | F32 `[N, 2]` | ln(px) |
//! | `rotation` | F32 `[N]` | rad, from +x towards +y |
//! | `opacity_logit` | F32 `[N]`, absent where every Gaussian is opaque | logit, ±∞ allowed |
//! | `color` | F32 `[N, 3]` | RGB as in the image file |
//!
//! The metadata entry `gs` is JSON:
//! `{"format": "gs-scene-2d", "version": 1, "program": …, "content": {"width": …, "height": …, "settings": …}}`,
//! with the canvas size in px and the render settings as gs-core serialises them. The content also has
//! a `profile`, an ICC profile in base64, where colours are not sRGB.

use std::path::Path;

use glam::{Vec2, Vec3};
use gs_core::{Image, RenderSettings, Scene, Scene2d, check_size};
use serde::{Deserialize, Serialize};

use crate::{
    atomic::write_durably,
    container::{self, FileKind, TensorWords},
    error::Error,
    image::IccProfile,
};

/// The extension of scene files: `kodim04.gs2d.safetensors`. Files with other names can be read,
/// too.
pub const SCENE_EXTENSION: &str = "gs2d.safetensors";

const KIND: FileKind = FileKind { format: "gs-scene-2d", version: 1, what: "a scene file" };
const TENSORS: [&str; 5] = ["mean", "log_scale", "rotation", "opacity_logit", "color"];

/// A 2D scene with its canvas and render settings.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct File2d {
    /// The Gaussians.
    pub scene: Scene2d,
    /// Columns of the image that the scene was made for.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// How to render the scene.
    pub settings: RenderSettings,
    /// The profile of the colours; `None` for sRGB.
    pub profile: Option<IccProfile>,
}

impl File2d {
    /// A rendering of the scene in sRGB: as it is if its colours are, or else clamped and converted.
    #[must_use]
    pub fn in_srgb(&self, mut rendering: Image) -> Image {
        if let Some(profile) = &self.profile {
            profile.to_srgb(&mut rendering);
        }
        rendering
    }

    /// Checks scene, size and settings, as [`write_2d`] and [`read_2d`] do.
    ///
    /// # Errors
    /// Those of [`Scene2d::validate`](Scene::validate), [`check_size`] and
    /// [`RenderSettings::validate`].
    pub fn validate(&self) -> Result<(), gs_core::Error> {
        self.validate_view()?;
        self.scene.validate()
    }

    fn validate_view(&self) -> Result<(), gs_core::Error> {
        check_size(self.width, self.height)?;
        self.settings.validate()
    }
}

#[derive(Serialize, Deserialize)]
struct Content {
    width: u32,
    height: u32,
    settings: RenderSettings,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    profile: Option<IccProfile>,
}

/// Writes a scene losslessly and atomically. Equal scenes give equal bytes.
///
/// # Errors
/// [`Error::Content`] where [`File2d::validate`] fails; those of
/// [`write_durably`](crate::write_durably).
pub fn write_2d(path: impl AsRef<Path>, file: &File2d) -> Result<(), Error> {
    let path = path.as_ref();
    let encoded = encoded(file).map_err(Error::content(path))?;
    write_durably(path, |to| encoded.write(to))
}

/// The bytes of the file that [`write_2d`] writes.
///
/// # Errors
/// Those of [`File2d::validate`].
pub fn encode_2d(file: &File2d) -> Result<Vec<u8>, gs_core::Error> {
    let mut bytes = Vec::new();
    let written = encoded(file)?.write(&mut bytes);
    written.map_err(|error| gs_core::Error::State(error.to_string()))?;
    Ok(bytes)
}

fn encoded(file: &File2d) -> Result<container::Encoded<'_>, gs_core::Error> {
    file.validate()?;
    let File2d { scene, width, height, settings, profile } = file;
    let n = scene.len();
    let mut tensors = vec![
        TensorWords::f32(&[n, 2], scene.means.iter().flat_map(|v| v.to_array())),
        TensorWords::f32(&[n, 2], scene.log_scales.iter().flat_map(|v| v.to_array())),
        TensorWords::f32(&[n], scene.rotations.iter().copied()),
        TensorWords::f32(&[n], scene.opacity_logits.iter().copied()),
        TensorWords::f32(&[n, 3], scene.colors.iter().flat_map(|v| v.to_array())),
    ];
    let mut names = TENSORS.map(str::to_owned).to_vec();
    if !scene.has_opacity() {
        (_, _) = (names.remove(3), tensors.remove(3));
    }
    let content = Content { width: *width, height: *height, settings: *settings, profile: profile.clone() };
    container::Encoded::new(&KIND, &content, names.into_iter().zip(tensors).collect())
}

/// Whether a file is a 2D scene. Only its header is read, so the rest may be damaged.
pub(crate) fn is_2d(path: &Path) -> bool {
    container::format_of(path).is_some_and(|format| format == KIND.format)
}

/// Reads what [`write_2d`] wrote: the same scene, bit for bit. The scene may be empty.
///
/// # Errors
/// - [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`] where the file cannot be read.
/// - [`Error::Damaged`] for a truncated file or another kind of file.
/// - [`Error::Unusable`] for a file of a later version, and a tensor of the wrong type or shape.
/// - [`Error::Content`] for an impossible canvas, impossible settings, and values such as NaN.
pub fn read_2d(path: impl AsRef<Path>) -> Result<File2d, Error> {
    let path = path.as_ref();
    let file = read_2d_unchecked(path)?;
    file.validate().map_err(Error::content(path))?;
    Ok(file)
}

/// Reads a 2D scene as [`read_2d`] does, but allows Gaussians with NaN and ∞.
pub(crate) fn read_2d_unchecked(path: &Path) -> Result<File2d, Error> {
    scene_of(container::read::<Content>(path, &KIND)?, path)
}

/// Reads the bytes of a file that [`write_2d`] wrote; `name` is its name for errors.
///
/// # Errors
/// Those of [`read_2d`] that concern the content.
pub(crate) fn decode_2d(bytes: &[u8], name: &Path) -> Result<File2d, Error> {
    let file = scene_of(container::read_from::<Content>(bytes, bytes.len() as u64, name, &KIND)?, name)?;
    file.validate().map_err(Error::content(name))?;
    Ok(file)
}

fn scene_of(file: container::Container<Content>, path: &Path) -> Result<File2d, Error> {
    let Some(&[n, 2]) = file.shape("mean") else {
        return Err(file.tensor_error("mean", "F32 [N, 2]".to_owned()));
    };
    if let Some(unknown) = file.names().into_iter().find(|name| !TENSORS.contains(&name.as_str())) {
        return Err(file.tensor_error(&unknown, "none of this name".to_owned()));
    }
    let pairs = |name| Ok(file.f32(name, &[n, 2])?.as_chunks::<2>().0.iter().map(|&v| Vec2::from_array(v)).collect());
    let scene = Scene2d {
        means: pairs("mean")?,
        log_scales: pairs("log_scale")?,
        rotations: file.f32("rotation", &[n])?,
        opacity_logits: match file.shape("opacity_logit") {
            Some(_) => file.f32("opacity_logit", &[n])?,
            None => Vec::new(),
        },
        colors: file.f32("color", &[n, 3])?.as_chunks::<3>().0.iter().map(|&v| Vec3::from_array(v)).collect(),
    };
    let Content { width, height, settings, profile } = file.content;
    let file = File2d { scene, width, height, settings, profile };
    file.validate_view().map_err(Error::content(path))?;
    Ok(file)
}
