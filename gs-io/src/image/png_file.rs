//! Images as PNG files.

use std::{
    borrow::Cow,
    io::{self, Write},
    path::Path,
};

use gs_core::{Image, check_len, to_8_bits};

use super::IccProfile;
use crate::{atomic::write_atomically, error::Error};

/// Bytes that are compressed before they are written.
const CHUNK_BYTES: usize = 1 << 16;

/// What a PNG holds besides colours.
#[derive(Debug, Clone, Copy, Default)]
pub struct PngExtras<'a> {
    /// Alpha of each pixel, `[height · width]`, row-major; colours are not premultiplied.
    pub alpha: Option<&'a [f32]>,
    /// The profile of the colours; `None` for sRGB.
    pub profile: Option<&'a IccProfile>,
}

/// Writes an 8-bit RGB PNG, atomically. Values are clamped to 0..=1 and rounded to the nearest of
/// 256 steps; NaN becomes 0.
///
/// # Errors
/// Those of [`write_atomically`].
pub fn write_png(path: impl AsRef<Path>, image: &Image) -> Result<(), Error> {
    write_png_with(path, image, PngExtras::default())
}

/// Writes an 8-bit PNG as [`write_png`] does, with alpha or a profile.
///
/// # Errors
/// Those of [`write_atomically`]; [`Error::Content`] for an alpha that is not as long as the image.
pub fn write_png_with(path: impl AsRef<Path>, image: &Image, extras: PngExtras<'_>) -> Result<(), Error> {
    let path = path.as_ref();
    let pixels = image.pixels().len();
    check_len("alpha", pixels, extras.alpha.map_or(pixels, <[f32]>::len)).map_err(Error::content(path))?;
    write_atomically(path, |file| encode_png(image, extras, file))
}

/// Writes a grey PNG of 16 bits, such as a depth map, atomically: `[height · width]` values, row-major.
///
/// # Errors
/// Those of [`write_atomically`]; [`Error::Content`] for values that are not as many as the pixels.
pub fn write_grey_png(path: impl AsRef<Path>, (width, height): (u32, u32), values: &[u16]) -> Result<(), Error> {
    let path = path.as_ref();
    check_len("grey", width as usize * height as usize, values.len()).map_err(Error::content(path))?;
    write_atomically(path, |file| {
        let mut encoder = png::Encoder::new(file, width, height);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&values.iter().flat_map(|value| value.to_be_bytes()).collect::<Vec<_>>())?;
        Ok(writer.finish()?)
    })
}

/// The bytes of the file that [`write_png`] writes.
pub fn png_bytes(image: &Image) -> Vec<u8> {
    png_bytes_with(image, PngExtras::default())
}

/// The bytes of the file that [`write_png_with`] writes.
///
/// # Panics
/// For an alpha that is not as long as the image.
pub fn png_bytes_with(image: &Image, extras: PngExtras<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode_png(image, extras, &mut bytes)
        .expect("memory can be written to, every image has a size that PNG has, and alpha has that of the image");
    bytes
}

fn encode_png(image: &Image, PngExtras { alpha, profile }: PngExtras<'_>, to: impl Write) -> io::Result<()> {
    let mut info = png::Info::with_size(image.width(), image.height());
    info.color_type = if alpha.is_some() { png::ColorType::Rgba } else { png::ColorType::Rgb };
    info.bit_depth = png::BitDepth::Eight;
    info.icc_profile = profile.map(|profile| Cow::Borrowed(profile.bytes()));
    let mut encoder = png::Encoder::with_info(to, info)?;
    encoder.set_compression(png::Compression::Fast);
    encoder.set_filter(png::Filter::Adaptive);
    let mut writer = encoder.write_header()?;
    // Row by row, so that neither the image's bytes nor the compressed ones are in memory as a
    // whole.
    let mut stream = writer.stream_writer_with_size(CHUNK_BYTES)?;
    for y in 0..image.height() {
        let colors = image.row(y);
        match alpha {
            None => stream.write_all(&bytes_of(colors))?,
            Some(alpha) => {
                let alpha = alpha.iter().skip(y as usize * colors.len());
                let pixel = |(color, &alpha): (&[f32; 3], &f32)| [color[0], color[1], color[2], alpha].map(to_8_bits);
                stream.write_all(colors.iter().zip(alpha).map(pixel).collect::<Vec<_>>().as_flattened())?;
            }
        }
    }
    stream.finish()?;
    Ok(writer.finish()?)
}

/// Pixels in 8 bits a channel.
fn bytes_of(pixels: &[[f32; 3]]) -> Vec<u8> {
    pixels.as_flattened().iter().map(|&value| to_8_bits(value)).collect()
}
