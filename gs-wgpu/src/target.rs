//! The image that a loss compares with, on the device.

use gs_core::{Error, TargetImage};

use crate::gpu::Gpu;

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
        Ok(Self { width, height, buffer: gpu.storage("the target", &pixels)?, is_complete: coverage.is_none() })
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
