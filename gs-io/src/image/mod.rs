//! Images: read from the usual formats into `f32`, written as PNG.

mod color;
mod decode;
mod kind;
mod remark;
mod whole;

use std::{
    io::{self, Write},
    path::Path,
};

use gs_core::{Image, image::to_8_bits};

pub(crate) use self::decode::{decode, decode_mask, read_header};
pub use self::remark::ImageRemark;
use crate::{atomic::write_atomically, error::Error};

/// What an alpha channel means for the image that is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaMode {
    /// Transparent pixels let this colour shine through: c·α + colour·(1 − α), in the stored values, as browsers do.
    Composite([f32; 3]),
    /// Alpha is dropped; transparent pixels have whatever colour the file stores for them.
    Ignore,
}

impl Default for AlphaMode {
    /// Over white.
    fn default() -> Self {
        Self::Composite([1.0; 3])
    }
}

/// Whether an image had transparent pixels, and what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transparency {
    /// No alpha channel, or an opaque one.
    None,
    /// They were composited over a colour.
    Composited,
    /// Their alpha was dropped.
    Ignored,
}

/// An image, and what is worth telling about its file.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedImage {
    /// The pixels: grey repeated in all channels, palettes looked up.
    pub image: Image,
    /// Bits per channel as decoded: 8, 16 or 32 (floating point).
    pub bits_per_channel: u8,
    /// What became of transparent pixels.
    pub transparency: Transparency,
    /// What else is worth knowing, such as that colours were converted.
    pub remarks: Vec<ImageRemark>,
}

/// [`read_image_with`] the default [`AlphaMode`]: transparent pixels are composited over white.
///
/// # Errors
/// Those of [`read_image_with`].
pub fn read_image(path: impl AsRef<Path>) -> Result<LoadedImage, Error> {
    read_image_with(path, AlphaMode::default())
}

/// Reads a PNG, JPEG, BMP, TIFF, WebP, GIF or PNM image (told apart by content, not by name) of 8 or 16 bits per channel, grey,
/// RGB or palette, with or without alpha; of an animation, the first frame.
///
/// Values are those stored, divided by 255 or 65535, without linearisation. Colours that the file declares to be other than sRGB, by an
/// ICC profile or by PNG's cICP, gAMA and cHRM, are converted to sRGB; a colour outside sRGB becomes the nearest inside, channel by
/// channel. A declaration that cannot be followed is ignored. [`LoadedImage::remarks`] says which. Floating-point TIFF is taken as it is.
/// EXIF orientation is applied.
///
/// # Errors
/// [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`]; [`Error::NotAnImage`] for other content and for CMYK; [`Error::ImageSize`]
/// for no pixels or a side longer than [`MAX_SIDE_PX`](gs_core::constants::MAX_SIDE_PX), before memory is allocated for them;
/// [`Error::DamagedImage`] for one cut short; [`Error::ImageNotFinite`].
pub fn read_image_with(path: impl AsRef<Path>, alpha: AlphaMode) -> Result<LoadedImage, Error> {
    let mut decoded = decode(path.as_ref(), Orientation::Exif)?;
    let (bits_per_channel, remarks) = (decoded.bits_per_channel, std::mem::take(&mut decoded.remarks));
    let transparent = decoded.alpha.as_ref().is_some_and(|alpha| alpha.iter().any(|a| *a < 1.0));
    let (image, transparency) = match (transparent, alpha) {
        (false, _) => (decoded.image, Transparency::None),
        (true, AlphaMode::Composite(behind)) => (decoded.over(behind), Transparency::Composited),
        (true, AlphaMode::Ignore) => (decoded.image, Transparency::Ignored),
    };
    Ok(LoadedImage { image, bits_per_channel, transparency, remarks })
}

/// Columns and rows of an image, upright, from its header alone.
///
/// # Errors
/// Those of [`read_image_with`] that a header can have.
pub fn read_image_size(path: impl AsRef<Path>) -> Result<(u32, u32), Error> {
    Ok(read_header(path.as_ref())?.upright)
}

/// Which way up the pixels of a file are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Orientation {
    /// Rows and columns as they are stored.
    AsStored,
    /// Turned as the file's EXIF data asks for, if it has any.
    Exif,
}

/// What an image's header says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ImageHeader {
    /// Columns and rows as stored, px.
    pub(crate) stored: (u32, u32),
    /// Columns and rows when turned as EXIF asks for, px.
    pub(crate) upright: (u32, u32),
    /// What [`decode`] will say about it.
    pub(crate) remarks: Vec<ImageRemark>,
}

/// An image as its file has it, colour and alpha apart.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Decoded {
    /// The colours, whatever their alpha.
    pub(crate) image: Image,
    /// Row-major like the image; `None` where the file has no such channel.
    pub(crate) alpha: Option<Vec<f32>>,
    /// 8, 16 or 32.
    pub(crate) bits_per_channel: u8,
    /// What is worth knowing about the file.
    pub(crate) remarks: Vec<ImageRemark>,
}

impl Decoded {
    /// c·α + behind·(1 − α).
    pub(crate) fn over(mut self, behind: [f32; 3]) -> Image {
        if let Some(alpha) = self.alpha {
            composite(&mut self.image, &alpha, behind);
        }
        self.image
    }
}

/// Puts a colour behind an image: c·α + behind·(1 − α), in the stored values. `alpha` is row-major and as long as the image.
pub(crate) fn composite(image: &mut Image, alpha: &[f32], behind: [f32; 3]) {
    for (color, &alpha) in image.pixels_mut().iter_mut().zip(alpha).filter(|(_, alpha)| **alpha < 1.0) {
        *color = std::array::from_fn(|k| color[k] * alpha + behind[k] * (1.0 - alpha));
    }
}

/// Writes an 8-bit RGB PNG, atomically: values are clamped to 0..=1 and rounded to the nearest of 256 steps; NaN becomes 0.
///
/// # Errors
/// Those of [`write_atomically`].
pub fn write_png(path: impl AsRef<Path>, image: &Image) -> Result<(), Error> {
    write_atomically(path, |file| encode_png(image, file))
}

/// The bytes of the file that [`write_png`] writes.
pub fn png_bytes(image: &Image) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode_png(image, &mut bytes).expect("memory can be written to, and every image has a size that PNG has");
    bytes
}

fn encode_png(image: &Image, to: impl Write) -> io::Result<()> {
    let mut encoder = png::Encoder::new(to, image.width(), image.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_filter(png::Filter::Adaptive);
    let mut writer = encoder.write_header()?;
    // Row by row: neither the bytes of a large image nor what they are packed into is in memory as a whole.
    let mut stream = writer.stream_writer_with_size(CHUNK_BYTES)?;
    (0..image.height()).try_for_each(|y| stream.write_all(&bytes_of(image.row(y))))?;
    stream.finish()?;
    Ok(writer.finish()?)
}

/// Bytes of a PNG that are packed before they are written.
const CHUNK_BYTES: usize = 1 << 16;

/// Pixels in 8 bits a channel, as [`write_png`] has them.
pub(crate) fn bytes_of(pixels: &[[f32; 3]]) -> Vec<u8> {
    pixels.as_flattened().iter().map(|&value| to_8_bits(value)).collect()
}
