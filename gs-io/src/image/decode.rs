//! Decodes an image file: finds the format, checks the file, decodes it, and converts its colours
//! to sRGB.

use std::{
    fs::File,
    io::{BufReader, Seek},
    path::Path,
};

use gs_core::{Image, constants::MAX_SIDE_PX, memory};
use image::{
    DynamicImage, ExtendedColorType, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits,
    codecs::tiff::TiffDecoder, metadata::Orientation as Turn,
};

use super::{
    AnyPixels, ImageRemark, Orientation, StoredImage, color::Colors, kind, whole, wide_tiff::WideTiff, with_pixels,
};
use crate::{atomic::open, error::Error};

/// The most memory a decoder may allocate: an image of the largest size with four 16-bit channels
/// (2 GiB), and half of that for its own tables.
const MAX_DECODER_BYTES: u64 = 3 * (MAX_SIDE_PX as u64) * (MAX_SIDE_PX as u64) * 4;

/// The header of an image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ImageHeader {
    /// Columns and rows as stored, px.
    pub(crate) stored: (u32, u32),
    /// Columns and rows after the EXIF rotation, px.
    pub(crate) upright: (u32, u32),
    /// The remarks of [`decode`].
    pub(crate) remarks: Vec<ImageRemark>,
}

/// Reads the header of an image. If the file seems to end too early, its pixels are decoded to find
/// out.
pub(crate) fn read_header(path: &Path) -> Result<ImageHeader, Error> {
    let mut file = ImageFile::open(path)?;
    if !whole::seems_whole(file.format, &mut file.reader).map_err(|error| Error::read(path, error))? {
        decode(path, Orientation::AsStored)?;
    }
    let format = file.format;
    let (mut decoder, colors) = file.decoder()?;
    let (width, height) = decoder.dimensions();
    let upright = match decoder.orientation().map_err(|error| decoder_error(path, format, error))? {
        Turn::Rotate90 | Turn::Rotate270 | Turn::Rotate90FlipH | Turn::Rotate270FlipH => (height, width),
        _ => (width, height),
    };
    Ok(ImageHeader { stored: (width, height), upright, remarks: Vec::from_iter(colors.remark()) })
}

/// Reads an image in sRGB, with colour and alpha separate. The formats are those of
/// [`read_image_on`](crate::read_image_on).
pub(crate) fn decode(path: &Path, orientation: Orientation) -> Result<StoredImage, Error> {
    let (stored, colors) = read_stored(path, orientation)?;
    Ok(in_srgb(stored, &colors))
}

/// Reads an image in sRGB, in the samples of its file: converted colours are rounded to them.
pub(crate) fn decode_samples(path: &Path, orientation: Orientation) -> Result<AnyPixels, Error> {
    let (decoded, colors) = read_decoded(path, orientation, 0)?;
    finite(path, AnyPixels::of_image(decoded, &colors))
}

/// Reads an image as it is stored, if it can be kept so with its profile, or else in sRGB.
pub(super) fn decode_stored(path: &Path) -> Result<StoredImage, Error> {
    let (stored, colors) = read_stored(path, Orientation::Exif)?;
    Ok(match colors.profile().cloned() {
        None => in_srgb(stored, &colors),
        profile => StoredImage { profile, ..stored },
    })
}

/// Reads a mask: an image whose values are not colours and stay as stored, without rotation. Of integers
/// 0 and 1, the 1 is white.
///
/// A mask may be in alpha, beside a single colour of all pixels that are not transparent. Where both colour and alpha vary, a pixel counts
/// only if it is light and opaque, so their product is returned.
pub(crate) fn decode_mask(path: &Path) -> Result<Image, Error> {
    let (pixels, _) = read_pixels(path, Orientation::AsStored)?;
    let white = match pixels {
        AnyPixels::Bits8(_) => Some(255.0),
        AnyPixels::Bits16(_) => Some(65535.0),
        AnyPixels::Floats(_) => None,
    };
    let (mut image, alpha) = pixels.to_image().map_err(Error::content(path))?;
    let colors = image.pixels_mut();
    if let Some(alpha) = alpha.filter(|alpha| alpha.iter().any(|alpha| *alpha < 1.0)) {
        // What programs store in transparent pixels means nothing.
        let mut visible = colors.iter().zip(&alpha).filter(|(_, alpha)| **alpha > 0.0).map(|(color, _)| color);
        let first = visible.next();
        let has_one_color = visible.all(|color| Some(color) == first);
        for (color, alpha) in colors.iter_mut().zip(alpha) {
            *color = if has_one_color { [alpha; 3] } else { color.map(|value| value * alpha) };
        }
    }
    let largest = colors.iter().flatten().copied().fold(0.0, f32::max);
    if let Some(white) = white.filter(|white| (largest * white).round() == 1.0) {
        colors.iter_mut().flatten().for_each(|value| *value *= white);
    }
    Ok(image)
}

/// Reads a grey image of numbers that are not colours, with its columns and rows: the integers that
/// are stored, or the floating-point numbers, which need not be finite.
pub(crate) fn decode_grey(path: &Path) -> Result<((u32, u32), Vec<f32>), Error> {
    if let Some(wide) = WideTiff::open(path)? {
        return wide.values();
    }
    let (pixels, _) = read_pixels(path, Orientation::AsStored)?;
    let values = with_pixels!(&pixels, pixels => pixels.grey());
    let values = values.ok_or_else(|| Error::bad_depth(path, "it is an image with colours, but must be grey"))?;
    Ok((pixels.size(), values))
}

/// Columns and rows of an image for [`decode_grey`], from its header.
pub(crate) fn grey_size(path: &Path) -> Result<(u32, u32), Error> {
    match WideTiff::open(path)? {
        Some(wide) => Ok(wide.size),
        None => Ok(read_header(path)?.stored),
    }
}

fn in_srgb(mut stored: StoredImage, colors: &Colors) -> StoredImage {
    colors.apply(stored.image.pixels_mut());
    StoredImage { remarks: Vec::from_iter(colors.remark()), ..stored }
}

/// The image as it is stored, without its profile, and how to convert its colours.
fn read_stored(path: &Path, orientation: Orientation) -> Result<(StoredImage, Colors), Error> {
    let (pixels, colors) = read_pixels(path, orientation)?;
    let (image, alpha) = pixels.to_image().map_err(Error::content(path))?;
    Ok((StoredImage { image, alpha, profile: None, remarks: Vec::new() }, colors))
}

/// The stored pixels, and how to convert their colours.
fn read_pixels(path: &Path, orientation: Orientation) -> Result<(AnyPixels, Colors), Error> {
    let (decoded, colors) = read_decoded(path, orientation, size_of::<[f32; 4]>())?;
    Ok((finite(path, AnyPixels::of_image(decoded, &Colors::AsStored))?, colors))
}

/// The pixels, unless one is NaN or infinite.
fn finite(path: &Path, pixels: AnyPixels) -> Result<AnyPixels, Error> {
    // Integers are finite.
    let AnyPixels::Floats(floats) = &pixels else { return Ok(pixels) };
    let Some(place) = floats.samples.iter().position(|sample| !sample.is_finite()) else { return Ok(pixels) };
    let pixel = (place / floats.channels()) as u32;
    let (x, y, value) = (pixel % floats.width, pixel / floats.width, floats.samples[place]);
    let problem = format!("pixel ({x}, {y}) is {value}, not a finite number");
    Err(Error::unusable(path, problem, "repair it in an image editor"))
}

/// The decoded image, and how to convert its colours. The caller needs `beside`
/// more bytes for each pixel.
fn read_decoded(path: &Path, orientation: Orientation, beside: usize) -> Result<(DynamicImage, Colors), Error> {
    let mut file = ImageFile::open(path)?;
    file.check_end()?;
    let format = file.format;
    let damaged = |error| decoder_error(path, format, error);
    let (mut decoder, colors) = file.decoder()?;
    let turned = decoder.orientation().map_err(damaged)?;
    check_memory(&decoder, beside).map_err(Error::content(path))?;
    let mut decoded = DynamicImage::from_decoder(decoder).map_err(damaged)?;
    if orientation == Orientation::Exif {
        decoded.apply_orientation(turned);
    }
    Ok((decoded, colors))
}

/// Allocates and frees the memory that decoding needs, because decoders abort where allocation
/// fails.
fn check_memory(decoder: &impl ImageDecoder, beside: usize) -> Result<(), gs_core::Error> {
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    let bytes = decoder.total_bytes() + pixels * beside as u64;
    memory::reserved::<u8>(usize::try_from(bytes).unwrap_or(usize::MAX), "decoding the image").map(drop)
}

/// How all decoders read. One type for all of them saves compile time.
type Source<'a> = &'a mut BufReader<File>;

/// A file that begins like an image.
struct ImageFile<'a> {
    path: &'a Path,
    format: ImageFormat,
    reader: BufReader<File>,
}

impl<'a> ImageFile<'a> {
    fn open(path: &'a Path) -> Result<Self, Error> {
        let mut reader = BufReader::new(open(path, "an image file")?.0);
        let format = kind::format_of(path, &mut reader)?;
        Ok(Self { path, format, reader })
    }

    /// Fails if a JPEG ends before its end marker. Decoders silently fill the missing part with
    /// grey.
    fn check_end(&mut self) -> Result<(), Error> {
        if self.format != ImageFormat::Jpeg {
            return Ok(());
        }
        match whole::jpeg_is_cut_at(&mut self.reader).map_err(|error| Error::read(self.path, error))? {
            None => Ok(()),
            Some(end) => {
                let message = format!("it ends at byte {end}, in the middle of the picture");
                Err(Error::damaged_image(self.path, "JPEG", message))
            }
        }
    }

    /// A decoder that has read the header of an image of a valid size, and how to convert colours.
    fn decoder(&mut self) -> Result<(impl ImageDecoder, Colors), Error> {
        let Self { path, format, reader } = self;
        let format = *format;
        let read = |error| Error::read(path, error);
        if format == ImageFormat::Jpeg && whole::jpeg_channels(reader).map_err(read)? == Some(4) {
            return Err(kind::cmyk(path, "jpg"));
        }
        let mut colors = Colors::AsStored;
        if format == ImageFormat::Png {
            // Errors are reported by the other decoder.
            if let Ok(png) = png::Decoder::new(&mut *reader).read_info() {
                colors = Colors::of_png(png.info());
            }
            reader.rewind().map_err(read)?;
        }
        // With limits, this decoder skips profiles that are larger than the image.
        let tiff = (format == ImageFormat::Tiff).then(|| TiffDecoder::new(&mut *reader)?.icc_profile());
        reader.rewind().map_err(read)?;
        let mut decoder = open_decoder(path, format, reader)?;
        let original = decoder.original_color_type();
        if matches!(original, ExtendedColorType::Cmyk8 | ExtendedColorType::Cmyk16) {
            return Err(kind::cmyk(path, "tif"));
        }
        let profile = tiff.unwrap_or_else(|| decoder.icc_profile()).ok().flatten();
        if let Some(icc) = profile.filter(|_| format != ImageFormat::Png) {
            colors = match matches!(original, ExtendedColorType::Rgb32F | ExtendedColorType::Rgba32F) {
                true => Colors::Ignored("the file has a colour profile: its numbers are floating point".to_owned()),
                false => Colors::of_profile(&icc),
            };
        }
        Ok((decoder, colors))
    }
}

/// A decoder that has read the header of an image of a valid size.
fn open_decoder<'a>(path: &Path, format: ImageFormat, reader: Source<'a>) -> Result<impl ImageDecoder + 'a, Error> {
    let mut reader = ImageReader::with_format(reader, format);
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_DECODER_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| decoder_error(path, format, error))?;
    Error::check_image_size(path, decoder.dimensions())?;
    Ok(decoder)
}

fn decoder_error(path: &Path, format: ImageFormat, error: ImageError) -> Error {
    match error {
        ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => Error::read(path, source),
        ImageError::Unsupported(error) => kind::not_supported(path, name_of(format), &one_line(&error.to_string())),
        error => Error::damaged_image(path, name_of(format), one_line(&error.to_string())),
    }
}

fn name_of(format: ImageFormat) -> &'static str {
    match format {
        ImageFormat::Png => "PNG",
        ImageFormat::Jpeg => "JPEG",
        ImageFormat::Bmp => "BMP",
        ImageFormat::Tiff => "TIFF",
        ImageFormat::WebP => "WebP",
        ImageFormat::Gif => "GIF",
        _ => "PNM",
    }
}

fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
