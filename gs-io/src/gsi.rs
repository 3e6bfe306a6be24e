//! `.gsi` files: compressed pictures, read as 2D scenes.

use std::{fs::File, path::Path};

use gs_codec::{Decoded, Extent, MAGIC, decode, is_gsi};
use gs_core::{Blend, RenderSettings};

use crate::{atomic::open, container::read_exactly, error::Error, scene_file::File2d};

/// The extension of compressed pictures.
pub const GSI_EXTENSION: &str = "gsi";

const WHAT: &str = "a .gsi file";

/// Whether a file begins as a `.gsi` file does, or has its extension.
pub(crate) fn may_be_gsi(path: &Path) -> bool {
    let begins = || {
        let mut file = File::open(path).ok()?;
        Some(is_gsi(&read_exactly(&mut file, MAGIC.len() as u64).ok()?))
    };
    path.extension().is_some_and(|ending| ending == GSI_EXTENSION) || begins() == Some(true)
}

/// Reads a `.gsi` file. A truncated file is an error.
///
/// # Errors
/// [`Error::Missing`], [`Error::NotAFile`], [`Error::Read`]; [`Error::Compressed`] for a file that is
/// damaged, truncated or of a later version.
pub fn read_gsi(path: impl AsRef<Path>) -> Result<File2d, Error> {
    let path = path.as_ref();
    let (mut file, metadata) = open(path, WHAT)?;
    let bytes = read_exactly(&mut file, metadata.len()).map_err(|source| Error::read(path, source))?;
    decode_gsi(&bytes, Extent::Whole).map_err(|source| Error::Compressed { path: path.to_owned(), source })
}

/// The scene of the bytes of a `.gsi` file.
///
/// # Errors
/// Those of [`decode`].
pub fn decode_gsi(bytes: &[u8], extent: Extent) -> Result<File2d, gs_codec::Error> {
    let Decoded { width, height, background, scene, .. } = decode(bytes, extent)?;
    Ok(File2d { scene, width, height, settings: RenderSettings::blended(Blend::Sum).on(background) })
}
