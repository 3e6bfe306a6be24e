//! An image as its file stores it, with all that decoding tells of it.

use gs_core::Image;

use super::{IccProfile, ImageRemark, composite};

/// Which way up an image is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Orientation {
    /// Rows and columns as they are stored.
    AsStored,
    /// Rotated as the file's EXIF data says, if it has any.
    Exif,
}

/// The header of an image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ImageHeader {
    /// Columns and rows as stored, px.
    pub(crate) stored: (u32, u32),
    /// Columns and rows after the EXIF rotation, px.
    pub(crate) upright: (u32, u32),
    /// The remarks of [`decode`](super::decode()).
    pub(crate) remarks: Vec<ImageRemark>,
}

/// An image as stored, with colour and alpha separate.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Decoded {
    /// The colours, whatever their alpha.
    pub(crate) image: Image,
    /// Row-major like the image; `None` without an alpha channel.
    pub(crate) alpha: Option<Vec<f32>>,
    /// The profile of colours that are not sRGB.
    pub(crate) profile: Option<IccProfile>,
    /// Bits per channel: 8, 16 or 32.
    pub(crate) bits_per_channel: u8,
    /// What is worth knowing about the file.
    pub(crate) remarks: Vec<ImageRemark>,
}

impl Decoded {
    /// The image composited over a colour: c·α + behind·(1 − α).
    pub(crate) fn over(mut self, behind: [f32; 3]) -> Result<Image, gs_core::Error> {
        if let Some(alpha) = self.alpha {
            composite(&mut self.image, &alpha, behind)?;
        }
        Ok(self.image)
    }
}
