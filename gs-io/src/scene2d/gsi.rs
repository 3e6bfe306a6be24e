//! `.gsi` files: compressed pictures, read as 2D scenes.

use std::{fs::File, path::Path};

use gs_codec::{Decoded, DecodedAlpha, Extent, MAGIC, decode};
use gs_core::{Blend, RenderSettings, Scene as _, Scene2d};

use super::File2d;
use crate::{
    atomic::{read_exactly, read_file},
    error::Error,
    image::IccProfile,
};

/// The extension of compressed pictures.
pub const GSI_EXTENSION: &str = "gsi";

/// A decoded `.gsi` file.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct GsiFile {
    /// The colours, premultiplied by alpha.
    pub colors: File2d,
    /// Alpha, as the red of another scene of that size; `None` for an opaque picture.
    pub alpha: Option<File2d>,
    /// Layers that were decoded whole, and all that the file was made with.
    pub layers: (usize, usize),
}

impl GsiFile {
    /// The picture on a colour of its own colour space, as one scene: the sum c + `behind`·(1 − α).
    /// Readers of images show transparent pixels on white, `[1.0; 3]`.
    pub fn on(self, behind: [f32; 3]) -> File2d {
        let Self { colors: mut file, alpha, .. } = self;
        let Some(File2d { scene, settings, .. }) = alpha else { return file };
        let [alpha, ..] = settings.background_color();
        let background = file.settings.background_color();
        let background = std::array::from_fn(|k| background[k] + behind[k] * (1.0 - alpha));
        file.settings = file.settings.on(background);
        for gaussian in scene.iter() {
            let color = -gaussian.color.x * glam::Vec3::from(behind);
            file.scene.push(gs_core::Gaussian2d { color, ..gaussian });
        }
        file
    }
}

/// An opaque picture, of any other file of a 2D scene.
impl From<File2d> for GsiFile {
    fn from(colors: File2d) -> Self {
        Self { colors, alpha: None, layers: (1, 1) }
    }
}

/// Whether a file begins as a `.gsi` file does, or has its extension.
pub fn is_gsi(path: impl AsRef<Path>) -> bool {
    let path = path.as_ref();
    let begins = || {
        let mut file = File::open(path).ok()?;
        Some(gs_codec::is_gsi(&read_exactly(&mut file, MAGIC.len() as u64).ok()?))
    };
    path.extension().is_some_and(|ending| ending == GSI_EXTENSION) || begins() == Some(true)
}

/// Reads a `.gsi` file. [`Extent::Prefix`] reads what is there of a file that may be truncated.
///
/// # Errors
/// [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`] where the file cannot be read;
/// [`Error::Compressed`] where it is damaged, of a later version, or truncated. With
/// [`Extent::Prefix`], a truncated file is an error only if it ends within its header.
pub fn read_gsi(path: impl AsRef<Path>, extent: Extent) -> Result<GsiFile, Error> {
    let path = path.as_ref();
    let bytes = read_file(path, "a .gsi file")?;
    decode_gsi(&bytes, extent).map_err(|source| Error::Compressed { path: path.to_owned(), source })
}

/// Decodes the bytes of a `.gsi` file.
///
/// # Errors
/// Those of [`decode`].
pub fn decode_gsi(bytes: &[u8], extent: Extent) -> Result<GsiFile, gs_codec::Error> {
    let Decoded { width, height, background, scene, alpha, profile, layers, .. } = decode(bytes, extent)?;
    let file = |scene: Scene2d, background, profile| {
        let settings = RenderSettings::blended(Blend::Sum).on(background);
        File2d { scene, width, height, settings, profile }
    };
    let colors = file(scene, background, IccProfile::new(&profile));
    let alpha = alpha.map(|DecodedAlpha { background, scene, .. }| file(scene, [background; 3], None));
    Ok(GsiFile { colors, alpha, layers })
}
