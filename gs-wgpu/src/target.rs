//! An image to compare with, on the device.

use gs_core::{Error, Image};

use crate::gpu::Gpu;

/// An image to compare with: one `vec4f` a pixel, row by row. A clone is the same image on the device, and costs nothing.
#[derive(Debug, Clone)]
pub struct Target {
    width: u32,
    height: u32,
    pub(crate) buffer: wgpu::Buffer,
}

impl Target {
    pub(crate) fn new(gpu: &Gpu, image: &Image) -> Result<Self, Error> {
        let (width, height) = image.size();
        let pixels: Vec<[f32; 4]> = image.pixels().iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
        Ok(Self { width, height, buffer: gpu.storage("the target", &pixels)? })
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
