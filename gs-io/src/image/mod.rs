//! Images: read from common formats into `f32` by [`read_image`], written as PNG by [`write_png`]
//! and as TIFF by [`write_tiff`].

mod alpha;
mod color;
mod decode;
mod folder;
mod geotiff;
mod kind;
mod png_file;
mod profile;
mod remark;
mod samples;
mod stored;
mod whole;
mod wide_tiff;

use std::path::Path;

use gs_core::Image;

pub(crate) use self::{
    alpha::composite,
    decode::{ImageHeader, decode, decode_grey, decode_mask, decode_samples, grey_size, read_header},
    folder::{how_to_convert, is_unreadable},
    samples::{AnyPixels, Pixels, Sample, with_pixels},
};
pub use self::{
    alpha::{premultiplied, straight},
    folder::{heic_files, image_files, unreadable_photographs},
    geotiff::{GeoReference, write_tiff, write_world_file},
    png_file::{PngExtras, png_bytes, png_bytes_with, write_grey_png, write_png, write_png_with},
    profile::IccProfile,
    remark::ImageRemark,
    stored::{StoredImage, read_stored_image},
};
use crate::error::Error;

/// Which way up an image is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Orientation {
    /// Rows and columns as they are stored.
    AsStored,
    /// Rotated as the file's EXIF data says, if it has any.
    Exif,
}

/// An opaque image with information about its file.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LoadedImage {
    /// The pixels. Grey is repeated in all channels, and palettes are looked up.
    pub image: Image,
    /// Whether the file has transparent pixels, which were composited over a colour.
    pub had_alpha: bool,
    /// Remarks, such as that colours were converted.
    pub remarks: Vec<ImageRemark>,
}

/// Reads an image; transparent pixels are composited over white. See [`read_image_on`].
///
/// # Errors
/// Those of [`read_image_on`].
pub fn read_image(path: impl AsRef<Path>) -> Result<LoadedImage, Error> {
    read_image_on(path, [1.0; 3])
}

/// Reads a PNG, JPEG, BMP, TIFF, WebP, GIF or PNM image, recognised by its content. It may have 8
/// or 16 bits per channel, grey, RGB or palette, with or without alpha. Of an animation, the first
/// frame is read.
///
/// Values are those stored, divided by 255 or 65535, without linearisation. Colours that the file
/// declares to be other than sRGB, by an ICC profile or by PNG's cICP, gAMA and cHRM, are converted
/// to sRGB; a colour outside sRGB becomes the nearest inside, channel by channel. A declaration
/// that cannot be followed is ignored. [`LoadedImage::remarks`] says which. Floating-point TIFF is
/// taken as it is. EXIF orientation is applied. Transparent pixels are composited over `behind`, in
/// the stored values, as browsers do: c·α + behind·(1 − α).
///
/// # Errors
/// - [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`] where the file cannot be read.
/// - [`Error::NotAnImage`] for other content and for CMYK.
/// - [`Error::Unusable`] for an image without pixels or with a side longer than
///   [`MAX_SIDE_PX`](gs_core::constants::MAX_SIDE_PX), before memory is allocated for it, for a
///   truncated or damaged file, and for pixels that are not finite.
/// - [`Error::Content`] where memory is not sufficient.
pub fn read_image_on(path: impl AsRef<Path>, behind: [f32; 3]) -> Result<LoadedImage, Error> {
    let path = path.as_ref();
    let stored = decode(path, Orientation::Exif)?;
    let had_alpha = stored.alpha.as_ref().is_some_and(|alpha| alpha.iter().any(|a| *a < 1.0));
    let StoredImage { image, remarks, .. } = stored.on(behind).map_err(Error::content(path))?;
    Ok(LoadedImage { image, had_alpha, remarks })
}

/// Columns and rows of an upright image; only its header is read.
///
/// # Errors
/// Those of [`read_image_on`] that concern the header.
pub fn read_image_size(path: impl AsRef<Path>) -> Result<(u32, u32), Error> {
    Ok(read_header(path.as_ref())?.upright)
}
