//! Images of one pixel per Gaussian.

use std::io::Cursor;

use image_webp::{ColorType, EncoderParams, WebPDecoder, WebPEncoder};

use super::bundle::Files;
use crate::error::Error;

/// The longest side of a WebP image, px.
const MAX_SIDE: usize = 16_384;

/// A decoded image.
#[derive(Debug)]
pub(super) struct Plane {
    pub(super) width: usize,
    pixels: Vec<[u8; 4]>,
}

impl Plane {
    /// Reads the image of this index in a list of names; it must have `count` pixels or more.
    pub(super) fn read(files: &mut Files<'_>, names: &[String], index: usize, count: usize) -> Result<Self, Error> {
        let name = names.get(index).ok_or_else(|| files.damaged(format!("{} images in a list", index + 1), "fewer"))?;
        let bytes = files.get(name)?;
        let damaged = |found: String| files.damaged(format!("{name:?} as a WebP image of {count} pixels"), found);
        let mut decoder =
            WebPDecoder::new(Cursor::new(bytes.as_slice())).map_err(|error| damaged(error.to_string()))?;
        let (width, height) = decoder.dimensions();
        let pixels = u64::from(width) * u64::from(height);
        if pixels < count as u64 {
            return Err(damaged(format!("{width}x{height}")));
        }
        files.check_claim(4 * pixels)?;
        let size = decoder.output_buffer_size().ok_or_else(|| damaged(format!("{width}x{height}")))?;
        let mut buffer = vec![0; size];
        decoder.read_image(&mut buffer).map_err(|error| damaged(error.to_string()))?;
        let mut pixels: Vec<[u8; 4]> = if decoder.has_alpha() {
            buffer.as_chunks::<4>().0.to_vec()
        } else {
            buffer.as_chunks::<3>().0.iter().map(|&[r, g, b]| [r, g, b, 255]).collect()
        };
        pixels.truncate(count);
        Ok(Self { width: width as usize, pixels })
    }

    pub(super) fn pixel(&self, index: usize) -> &[u8; 4] {
        &self.pixels[index]
    }
}

/// The size of an image, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneSize {
    pub(super) width: usize,
    pub(super) height: usize,
}

impl PlaneSize {
    /// Most pixels of an image.
    pub(super) const MAX_PIXELS: u32 = (MAX_SIDE * MAX_SIDE) as u32;

    /// A nearly square image for this many pixels. Sides are multiples of 4, as textures need.
    pub(super) fn for_count(count: usize) -> Self {
        let width = ((count as f64).sqrt() / 4.0).ceil() as usize * 4;
        Self { width, height: count.div_ceil(4 * width.max(1)) * 4 }
    }

    /// An image of pixels in rows; pixels after the last are black and opaque.
    pub(super) fn encode(self, pixels: impl Iterator<Item = [u8; 4]>) -> Vec<u8> {
        let count = self.width * self.height;
        let filled = pixels.chain(std::iter::repeat([0, 0, 0, 255])).take(count);
        let bytes: Vec<u8> = filled.flatten().collect();
        let opaque = bytes.as_chunks::<4>().0.iter().all(|pixel| pixel[3] == 255);
        let (bytes, color) = if opaque {
            (bytes.as_chunks::<4>().0.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect(), ColorType::Rgb8)
        } else {
            (bytes, ColorType::Rgba8)
        };
        // Prediction from neighbours helps where they are alike, and harms where they are not.
        let coded = [false, true].map(|predicted| {
            let mut coded = Vec::new();
            let mut encoder = WebPEncoder::new(&mut coded);
            let mut params = EncoderParams::default();
            params.use_predictor_transform = predicted;
            encoder.set_params(params);
            // Sizes are checked before, and memory takes all that is written.
            let written = encoder.encode(&bytes, self.width as u32, self.height as u32, color);
            debug_assert!(written.is_ok());
            coded
        });
        let [plain, predicted] = coded;
        if predicted.len() < plain.len() { predicted } else { plain }
    }
}
