//! Images as they are stored, for files that keep alpha and profiles.

use std::path::Path;

use gs_core::{Image, to_8_bits};

use super::{IccProfile, ImageRemark, alpha::composite, decode::decode_stored};
use crate::error::Error;

/// An image as its file stores it.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredImage {
    /// The colours, not premultiplied.
    pub image: Image,
    /// Alpha of each pixel, `[height · width]`, row-major, 0..=1; `None` where all are 1 in 8 bits.
    pub alpha: Option<Vec<f32>>,
    /// The profile of the colours; `None` for sRGB.
    pub profile: Option<IccProfile>,
    /// Remarks, such as that colours were converted.
    pub remarks: Vec<ImageRemark>,
}

/// Reads an image as [`read_image_on`](super::read_image_on) does, but with its alpha, and with
/// colours that are not converted if they have an ICC profile of RGB by a matrix and curves, of at most
/// 4,096 bytes, that is not sRGB.
///
/// # Errors
/// Those of [`read_image_on`](super::read_image_on).
pub fn read_stored_image(path: impl AsRef<Path>) -> Result<StoredImage, Error> {
    let mut stored = decode_stored(path.as_ref())?;
    stored.alpha = stored.alpha.filter(|alpha| alpha.iter().any(|&alpha| to_8_bits(alpha) < u8::MAX));
    Ok(stored)
}

impl StoredImage {
    /// The opaque image on a colour of its own colour space: c·α + `behind`·(1 − α).
    ///
    /// # Errors
    /// [`gs_core::Error::Length`] where alpha is not as long as the image.
    pub fn on(mut self, behind: [f32; 3]) -> Result<Self, gs_core::Error> {
        if let Some(alpha) = self.alpha.take() {
            composite(&mut self.image, &alpha, behind)?;
        }
        Ok(self)
    }

    /// The image in sRGB, and on white: what [`read_image`](super::read_image) reads.
    ///
    /// # Errors
    /// [`gs_core::Error::Length`] where alpha is not as long as the image.
    pub fn shown(&self) -> Result<Image, gs_core::Error> {
        let mut image = self.image.clone();
        if let Some(profile) = &self.profile {
            profile.to_srgb(&mut image);
        }
        if let Some(alpha) = &self.alpha {
            composite(&mut image, alpha, [1.0; 3])?;
        }
        Ok(image)
    }
}
