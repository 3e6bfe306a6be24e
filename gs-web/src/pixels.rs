//! Images of the page: rows of RGBA bytes, as in `ImageData`.

use gs_core::{Image, to_8_bits};

/// The pixels of an image.
pub(crate) fn rgba_of(image: &Image) -> Vec<u8> {
    opaque(image.pixels().iter().map(|pixel| pixel.map(to_8_bits)))
}

/// Opaque pixels of these colours.
pub(crate) fn opaque(pixels: impl Iterator<Item = [u8; 3]>) -> Vec<u8> {
    pixels.flat_map(|[r, g, b]| [r, g, b, 255]).collect()
}
