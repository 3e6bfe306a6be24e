//! Images of the page: rows of RGBA bytes, as in `ImageData`.

use gs_core::{Image, to_8_bits};
use wasm_bindgen::JsError;

use crate::failure;

/// Bytes of a pixel.
const RGBA: usize = 4;

/// The image of opaque pixels; alpha is not read.
pub(crate) fn image_of(rgba: &[u8], width: u32, height: u32) -> Result<Image, JsError> {
    let pixels = rgba.as_chunks::<RGBA>().0.iter();
    let pixels = pixels.map(|&[r, g, b, _]| [r, g, b].map(|byte| f32::from(byte) / 255.0)).collect();
    Image::from_pixels(width, height, pixels).map_err(failure)
}

/// The pixels of an image.
pub(crate) fn rgba_of(image: &Image) -> Vec<u8> {
    with_alpha(image.pixels().iter().map(|pixel| pixel.map(to_8_bits)))
}

/// The difference of two images of one size, `gain` times as strong.
pub(crate) fn difference(image: &Image, target: &Image, gain: f32) -> Vec<u8> {
    let pairs = image.pixels().iter().zip(target.pixels());
    with_alpha(pairs.map(|(a, b)| std::array::from_fn(|k| to_8_bits(gain * (a[k] - b[k]).abs()))))
}

fn with_alpha(pixels: impl Iterator<Item = [u8; 3]>) -> Vec<u8> {
    pixels.flat_map(|[r, g, b]| [r, g, b, 255]).collect()
}
