//! Images: read from common formats into `f32` by [`read_image`], written as PNG by [`write_png`].

mod alpha;
mod color;
mod decode;
mod decoded;
mod folder;
mod kind;
mod png_file;
mod profile;
mod remark;
mod stored;
mod whole;
mod wide_tiff;

use std::path::Path;

use gs_core::Image;

pub(crate) use self::{
    alpha::composite,
    decode::{decode, decode_grey, decode_mask, grey_size, read_header},
    decoded::{Decoded, ImageHeader},
    folder::{how_to_convert, is_unreadable},
};
pub use self::{
    alpha::{premultiplied, straight},
    decoded::Orientation,
    folder::{image_files, unreadable_photographs},
    png_file::{PngExtras, png_bytes, png_bytes_with, write_png, write_png_with},
    profile::IccProfile,
    remark::ImageRemark,
    stored::{StoredImage, read_stored_image},
};
use crate::error::Error;

/// The meaning of an alpha channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaMode {
    /// Transparent pixels are composited over this colour: c·α + colour·(1 − α), in the stored
    /// values, as browsers do.
    Composite([f32; 3]),
    /// Alpha is dropped, and transparent pixels keep the colour that the file stores for them.
    Ignore,
}

impl Default for AlphaMode {
    /// Composites over white.
    fn default() -> Self {
        Self::Composite([1.0; 3])
    }
}

/// Whether an image had transparent pixels, and how they were treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Transparency {
    /// No alpha channel, or an opaque one.
    None,
    /// Transparent pixels were composited over a colour.
    Composited,
    /// The alpha of transparent pixels was dropped.
    Ignored,
}

/// An image with information about its file.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LoadedImage {
    /// The pixels. Grey is repeated in all channels, and palettes are looked up.
    pub image: Image,
    /// Bits per channel as decoded: 8, 16 or 32 (floating point).
    pub bits_per_channel: u8,
    /// How transparent pixels were treated.
    pub transparency: Transparency,
    /// Remarks, such as that colours were converted.
    pub remarks: Vec<ImageRemark>,
}

/// Reads an image; transparent pixels are composited over white. See [`read_image_with`].
///
/// # Errors
/// Those of [`read_image_with`].
pub fn read_image(path: impl AsRef<Path>) -> Result<LoadedImage, Error> {
    read_image_with(path, AlphaMode::default())
}

/// Reads a PNG, JPEG, BMP, TIFF, WebP, GIF or PNM image, recognised by its content. It may have 8
/// or 16 bits per channel, grey, RGB or palette, with or without alpha. Of an animation, the first
/// frame is read.
///
/// Values are those stored, divided by 255 or 65535, without linearisation. Colours that the file
/// declares to be other than sRGB, by an ICC profile or by PNG's cICP, gAMA and cHRM, are converted
/// to sRGB; a colour outside sRGB becomes the nearest inside, channel by channel. A declaration
/// that cannot be followed is ignored. [`LoadedImage::remarks`] says which. Floating-point TIFF is
/// taken as it is. EXIF orientation is applied.
///
/// # Errors
/// [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`]; [`Error::NotAnImage`] for other
/// content and for CMYK; [`Error::Unusable`] for no pixels or a side longer than
/// [`MAX_SIDE_PX`](gs_core::constants::MAX_SIDE_PX), before memory is allocated for them;
/// for one cut short, and for pixels that are not finite.
pub fn read_image_with(path: impl AsRef<Path>, alpha: AlphaMode) -> Result<LoadedImage, Error> {
    let path = path.as_ref();
    let mut decoded = decode(path, Orientation::Exif)?;
    let (bits_per_channel, remarks) = (decoded.bits_per_channel, std::mem::take(&mut decoded.remarks));
    let transparent = decoded.alpha.as_ref().is_some_and(|alpha| alpha.iter().any(|a| *a < 1.0));
    let (image, transparency) = match (transparent, alpha) {
        (false, _) => (decoded.image, Transparency::None),
        (true, AlphaMode::Composite(behind)) => {
            (decoded.over(behind).map_err(Error::content(path))?, Transparency::Composited)
        }
        (true, AlphaMode::Ignore) => (decoded.image, Transparency::Ignored),
    };
    Ok(LoadedImage { image, bits_per_channel, transparency, remarks })
}

/// Columns and rows of an upright image; only its header is read.
///
/// # Errors
/// Those of [`read_image_with`] that concern the header.
pub fn read_image_size(path: impl AsRef<Path>) -> Result<(u32, u32), Error> {
    Ok(read_header(path.as_ref())?.upright)
}
