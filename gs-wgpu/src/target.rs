//! The image that a loss compares with, on the device.

use gs_core::{Error, Loss, TargetImage};

use crate::{gpu::Gpu, unsupported::unsupported};

/// An image that a loss compares with: one `vec4f` per pixel, row by row.
///
/// Clones share the image on the device.
#[derive(Debug, Clone)]
pub struct Target {
    width: u32,
    height: u32,
    pub(crate) buffer: wgpu::Buffer,
    /// Whether the target has neither alpha nor mask. Otherwise the fourth number of a pixel is its
    /// [`TargetImage::coverage`].
    pub(crate) is_complete: bool,
    /// How much each pixel counts; `None` where all count the same.
    pub(crate) weights: Option<wgpu::Buffer>,
}

impl Target {
    pub(crate) fn new(gpu: &Gpu, target: &TargetImage<'_>) -> Result<Self, Error> {
        target.validate()?;
        let (width, height) = target.image.size();
        let mut pixels: Vec<[f32; 4]> = target.image.pixels().iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
        let coverage = target.coverage();
        for (pixel, coverage) in pixels.iter_mut().zip(coverage.iter().flatten()) {
            pixel[3] = *coverage;
        }
        let weights = target.weights.map(|weights| gpu.storage("a target's weights", weights)).transpose()?;
        let (buffer, is_complete) = (gpu.storage("the target", &pixels)?, coverage.is_none());
        Ok(Self { width, height, buffer, is_complete, weights })
    }

    /// Fails where the loss cannot be computed, or where the target's weights cannot be factors of
    /// it.
    pub(crate) fn check_loss(&self, loss: Loss) -> Result<(), Error> {
        loss.validate()?;
        if self.weights.is_some() && !loss.is_pointwise() {
            return Err(unsupported(format!("weights of pixels under loss `{loss}`")));
        }
        Ok(())
    }

    /// Fails unless the target has this size.
    pub(crate) fn check_size(&self, [width, height]: [u32; 2]) -> Result<(), Error> {
        if (self.width, self.height) == (width, height) {
            return Ok(());
        }
        Err(Error::SizesDiffer {
            left_width: width,
            left_height: height,
            right_width: self.width,
            right_height: self.height,
        })
    }
}
