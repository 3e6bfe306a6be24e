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
    Ok(read(path.as_ref(), Extent::Whole)?.0)
}

/// Reads what is there of a `.gsi` file that may be truncated, and returns it with the numbers of
/// layers that are whole and that the file was made with.
///
/// # Errors
/// Those of [`read_gsi`], but for a file that ends after its header.
pub fn read_gsi_prefix(path: impl AsRef<Path>) -> Result<(File2d, (usize, usize)), Error> {
    read(path.as_ref(), Extent::Prefix)
}

fn read(path: &Path, extent: Extent) -> Result<(File2d, (usize, usize)), Error> {
    let (mut file, metadata) = open(path, WHAT)?;
    let bytes = read_exactly(&mut file, metadata.len()).map_err(|source| Error::read(path, source))?;
    let decoded = decode(&bytes, extent).map_err(|source| Error::Compressed { path: path.to_owned(), source })?;
    let layers = decoded.layers;
    Ok((scene_of(decoded), layers))
}

/// The scene of the bytes of a `.gsi` file.
///
/// # Errors
/// Those of [`decode`].
pub fn decode_gsi(bytes: &[u8], extent: Extent) -> Result<File2d, gs_codec::Error> {
    decode(bytes, extent).map(scene_of)
}

fn scene_of(Decoded { width, height, background, scene, .. }: Decoded) -> File2d {
    File2d { scene, width, height, settings: RenderSettings::blended(Blend::Sum).on(background) }
}
