//! Images: read from the usual formats into `f32`, written as PNG.

use std::{
    io::{BufRead, BufReader, Read, Seek},
    path::Path,
};

use gs_core::{Image, constants::MAX_SIDE_PX, image::check_size};
use image::{
    DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageError, ImageFormat, ImageReader, Limits,
    codecs::png::PngEncoder,
};

use crate::{
    atomic::{open, write_atomically},
    error::Error,
};

/// The most memory a decoder may ask for: an image of the largest size with four 16-bit channels (2 GiB), and half as much
/// again for its own tables.
const MAX_DECODER_BYTES: u64 = 3 * (MAX_SIDE_PX as u64) * (MAX_SIDE_PX as u64) * 4;

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
}

/// [`read_image_with`] the default [`AlphaMode`]: transparent pixels are composited over white.
///
/// # Errors
/// Those of [`read_image_with`].
pub fn read_image(path: impl AsRef<Path>) -> Result<LoadedImage, Error> {
    read_image_with(path, AlphaMode::default())
}

/// Reads a PNG, JPEG, BMP, TIFF, WebP or PNM image (told apart by content, not by name) of 8 or 16 bits per channel, grey,
/// RGB or palette, with or without alpha; of an animation, the first frame.
///
/// Values are those stored, divided by 255 or 65535: no linearisation, and colour profiles are not applied. Floating-point
/// TIFF is taken as it is. EXIF orientation is applied.
///
/// # Errors
/// [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`]; [`Error::NotAnImage`] for other content; [`Error::ImageSize`] for
/// no pixels or a side longer than [`MAX_SIDE_PX`], before memory is allocated for them; [`Error::DamagedImage`] for one cut short;
/// [`Error::ImageNotFinite`].
pub fn read_image_with(path: impl AsRef<Path>, alpha: AlphaMode) -> Result<LoadedImage, Error> {
    let decoded = decode(path.as_ref(), Orientation::Exif)?;
    let bits_per_channel = decoded.bits_per_channel;
    let transparent = decoded.alpha.as_ref().is_some_and(|alpha| alpha.iter().any(|a| *a < 1.0));
    let (image, transparency) = match (transparent, alpha) {
        (false, _) => (decoded.image, Transparency::None),
        (true, AlphaMode::Composite(behind)) => (decoded.over(behind), Transparency::Composited),
        (true, AlphaMode::Ignore) => (decoded.image, Transparency::Ignored),
    };
    Ok(LoadedImage { image, bits_per_channel, transparency })
}

/// Which way up the pixels of a file are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Orientation {
    /// Rows and columns as they are stored.
    AsStored,
    /// Turned as the file's EXIF data asks for, if it has any.
    Exif,
}

/// The sides of an image, from its header alone, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ImageSize {
    /// Columns and rows as stored.
    pub(crate) stored: (u32, u32),
    /// Columns and rows when turned as EXIF asks for.
    pub(crate) upright: (u32, u32),
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

/// The size of an image, whose pixels are not decoded.
///
/// # Errors
/// Those of [`read_image_with`] that its header can have.
pub(crate) fn image_size(path: &Path) -> Result<ImageSize, Error> {
    use image::metadata::Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    let mut reader = BufReader::new(open(path, "an image file")?.0);
    let format = format_of(path, &mut reader)?;
    let mut decoder = open_decoder(path, format, reader)?;
    let (width, height) = decoder.dimensions();
    let upright = match decoder.orientation().map_err(|error| decoder_error(path, format, error))? {
        Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH => (height, width),
        _ => (width, height),
    };
    Ok(ImageSize { stored: (width, height), upright })
}

/// Reads an image, colour and alpha apart; what can be read is as for [`read_image_with`].
///
/// # Errors
/// Those of [`read_image_with`].
pub(crate) fn decode(path: &Path, orientation: Orientation) -> Result<Decoded, Error> {
    let mut reader = BufReader::new(open(path, "an image file")?.0);
    let format = format_of(path, &mut reader)?;
    if format == ImageFormat::Jpeg {
        check_jpeg_end(path, &mut reader)?;
    }
    let damaged = |error| decoder_error(path, format, error);
    let mut decoder = open_decoder(path, format, reader)?;
    let turned = decoder.orientation().map_err(damaged)?;
    let mut decoded = DynamicImage::from_decoder(decoder).map_err(damaged)?;
    if orientation == Orientation::Exif {
        decoded.apply_orientation(turned);
    }

    let (width, height) = (decoded.width(), decoded.height());
    let color = decoded.color();
    let pixels = match decoded {
        DynamicImage::ImageLuma8(b) => Pixels::of::<1, u8>(b.as_raw(), 255.0),
        DynamicImage::ImageLumaA8(b) => Pixels::of::<2, u8>(b.as_raw(), 255.0),
        DynamicImage::ImageRgb8(b) => Pixels::of::<3, u8>(b.as_raw(), 255.0),
        DynamicImage::ImageRgba8(b) => Pixels::of::<4, u8>(b.as_raw(), 255.0),
        DynamicImage::ImageLuma16(b) => Pixels::of::<1, u16>(b.as_raw(), 65535.0),
        DynamicImage::ImageLumaA16(b) => Pixels::of::<2, u16>(b.as_raw(), 65535.0),
        DynamicImage::ImageRgb16(b) => Pixels::of::<3, u16>(b.as_raw(), 65535.0),
        DynamicImage::ImageRgba16(b) => Pixels::of::<4, u16>(b.as_raw(), 65535.0),
        DynamicImage::ImageRgb32F(b) => Pixels::of::<3, f32>(b.as_raw(), 1.0),
        other => Pixels::of::<4, f32>(other.into_rgba32f().as_raw(), 1.0),
    };
    if let Some((i, value)) = pixels.first_not_finite() {
        return Err(Error::ImageNotFinite { path: path.to_owned(), x: i as u32 % width, y: i as u32 / width, value });
    }
    let bits_per_channel = 8 * (color.bytes_per_pixel() / color.channel_count());
    let image = Image::from_pixels(width, height, pixels.colors).map_err(Error::content(path))?;
    Ok(Decoded { image, alpha: pixels.alpha, bits_per_channel })
}

/// A decoder that has read the header, of an image of a possible size.
fn open_decoder<'a>(
    path: &Path,
    format: ImageFormat,
    reader: impl BufRead + Seek + 'a,
) -> Result<impl ImageDecoder + 'a, Error> {
    let mut reader = ImageReader::with_format(reader, format);
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_DECODER_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| decoder_error(path, format, error))?;
    let (width, height) = decoder.dimensions();
    let limit = MAX_SIDE_PX;
    check_size(width, height).map_err(|_| Error::ImageSize { path: path.to_owned(), width, height, limit })?;
    Ok(decoder)
}

/// Writes an 8-bit RGB PNG, atomically: values are clamped to 0..=1 and rounded to the nearest of 256 steps; NaN becomes 0.
///
/// # Errors
/// Those of [`write_atomically`].
pub fn write_png(path: impl AsRef<Path>, image: &Image) -> Result<(), Error> {
    let bytes = image.to_8_bits();
    write_atomically(path, |file| {
        let encoder = PngEncoder::new(file);
        encoder.write_image(&bytes, image.width(), image.height(), ExtendedColorType::Rgb8).map_err(|error| match error
        {
            ImageError::IoError(error) => error,
            other => std::io::Error::other(other),
        })
    })
}

/// The format that the first bytes announce.
fn format_of(path: &Path, reader: &mut (impl Read + Seek)) -> Result<ImageFormat, Error> {
    let mut start = Vec::new();
    reader.take(32).read_to_end(&mut start).and_then(|_| reader.rewind()).map_err(|e| Error::read(path, e))?;
    let found = match image::guess_format(&start) {
        Ok(format) if format.reading_enabled() => return Ok(format),
        Ok(other) => format!("{other:?}, which is not supported"),
        Err(_) => Error::found(&start),
    };
    Err(Error::NotAnImage { path: path.to_owned(), found })
}

/// Fails where a JPEG ends before its end marker: decoders fill what is missing with grey and say nothing.
fn check_jpeg_end(path: &Path, reader: &mut (impl Read + Seek)) -> Result<(), Error> {
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes).and_then(|_| reader.rewind()).map_err(|e| Error::read(path, e))?;
    // Image data never holds these two bytes of a marker by chance: after each 0xff it has a 0.
    let last = |marker: u8| bytes.windows(2).rposition(|pair| pair == [0xff, marker]);
    let (scan_start, image_end) = (last(0xda), last(0xd9));
    if scan_start.is_some() && image_end < scan_start {
        let message = format!("it ends at byte {}, in the middle of the picture", bytes.len());
        return Err(Error::DamagedImage { path: path.to_owned(), format: "JPEG", message });
    }
    Ok(())
}

fn decoder_error(path: &Path, format: ImageFormat, error: ImageError) -> Error {
    match error {
        ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => Error::read(path, source),
        ImageError::Unsupported(error) => {
            Error::NotAnImage { path: path.to_owned(), found: one_line(&error.to_string()) }
        }
        error => {
            let format = match format {
                ImageFormat::Png => "PNG",
                ImageFormat::Jpeg => "JPEG",
                ImageFormat::Bmp => "BMP",
                ImageFormat::Tiff => "TIFF",
                ImageFormat::WebP => "WebP",
                _ => "PNM",
            };
            Error::DamagedImage { path: path.to_owned(), format, message: one_line(&error.to_string()) }
        }
    }
}

fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Colours and alpha made of stored samples.
struct Pixels {
    colors: Vec<[f32; 3]>,
    alpha: Option<Vec<f32>>,
}

impl Pixels {
    /// Of `CHANNELS` = 1 (grey), 2 (grey, alpha), 3 (RGB) or 4 (RGB, alpha) samples a pixel, of which `white` stands for 1.
    fn of<const CHANNELS: usize, S: Copy + Into<f32>>(samples: &[S], white: f32) -> Self {
        let pixels = samples.as_chunks::<CHANNELS>().0;
        let value = |pixel: &[S; CHANNELS], k: usize| pixel[k].into() / white;
        let colors = pixels.iter().map(|pixel| match CHANNELS {
            1 | 2 => [value(pixel, 0); 3],
            _ => [value(pixel, 0), value(pixel, 1), value(pixel, 2)],
        });
        let alpha = CHANNELS.is_multiple_of(2).then(|| pixels.iter().map(|pixel| value(pixel, CHANNELS - 1)).collect());
        Self { colors: colors.collect(), alpha }
    }

    /// The first pixel with a value that is NaN or infinite, and that value.
    fn first_not_finite(&self) -> Option<(usize, f32)> {
        let color =
            self.colors.iter().flatten().position(|v| !v.is_finite()).map(|k| (k / 3, self.colors[k / 3][k % 3]));
        let alpha = self.alpha.iter().flatten().position(|v| !v.is_finite());
        let alpha = alpha.and_then(|k| Some((k, self.alpha.as_ref()?[k])));
        color.into_iter().chain(alpha).min_by_key(|(pixel, _)| *pixel)
    }
}
