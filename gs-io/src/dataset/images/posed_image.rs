//! An image for training with its alpha and mask.

use gs_core::Image;

use crate::image::composite;

/// An image for training: of the size of [`View::camera`](crate::dataset::View::camera), without distortion.
#[derive(Debug, Clone, PartialEq)]
pub struct PosedImage {
    /// The colours as stored, not multiplied by alpha.
    pub image: Image,
    /// Opacity, 0 to 1, row-major `[height · width]`; `None` without an alpha channel, or where it
    /// is a mask ([`AlphaMeaning::Mask`](crate::dataset::AlphaMeaning::Mask)).
    pub alpha: Option<Vec<f32>>,
    /// Which pixels count, row-major `[height · width]`: masked pixels and those outside the lens's
    /// view do not. `None` if all do.
    pub mask: Option<Vec<bool>>,
}

impl PosedImage {
    /// The image composited over a background: c·α + background·(1 − α), in the stored values.
    ///
    /// # Errors
    /// [`gs_core::Error::Length`] where alpha is not as long as the image.
    pub fn over(mut self, background: [f32; 3]) -> Result<Image, gs_core::Error> {
        if let Some(alpha) = &self.alpha {
            composite(&mut self.image, alpha, background)?;
        }
        Ok(self.image)
    }
}
