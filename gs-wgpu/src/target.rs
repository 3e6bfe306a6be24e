//! The image that a loss compares with, on the device.

use gs_core::{Error, Loss, TargetImage, check_same_size, to_8_bits};

use crate::{fault::BACKEND, gpu::Gpu};

/// An image that a loss compares with, row by row: four bytes a pixel where it is compact and of 8 bits, or
/// else one `vec4f`.
///
/// Clones share the image on the device.
#[derive(Debug, Clone)]
pub struct Target {
    width: u32,
    height: u32,
    pub(crate) buffer: wgpu::Buffer,
    /// Whether the target has neither alpha nor mask, and is not in four bytes a pixel. Otherwise the fourth
    /// number of a pixel is its [`TargetImage::coverage`].
    pub(crate) is_complete: bool,
    /// Whether a pixel is four bytes: its colour and its alpha, or [`EXCLUDED`].
    pub(crate) is_8_bit: bool,
    /// How much each pixel counts; `None` where all count the same.
    pub(crate) weights: Option<wgpu::Buffer>,
}

/// A pixel that does not count, where pixels are four bytes: transparent pixels have no colour otherwise.
pub(crate) const EXCLUDED: u32 = 1;

/// A colour and its coverage, all of 8 bits, in four bytes.
fn in_4_bytes(pixel: [f32; 4]) -> u32 {
    match pixel[3] {
        excluded if excluded < 0.0 => EXCLUDED,
        0.0 => 0,
        _ => u32::from_le_bytes(pixel.map(to_8_bits)),
    }
}

impl Target {
    pub(crate) fn new(gpu: &Gpu, target: &TargetImage<'_>) -> Result<Self, Error> {
        target.validate()?;
        let (width, height) = target.image.size();
        let (coverage, is_8_bit) = (target.coverage(), target.compact && target.is_8_bit());
        let coverage_of = |index: usize| coverage.as_ref().map_or(1.0, |coverage| coverage[index]);
        let pixels = target.image.pixels().iter().enumerate().map(|(index, &[r, g, b])| [r, g, b, coverage_of(index)]);
        let buffer = if is_8_bit {
            gpu.storage("the target", &pixels.map(in_4_bytes).collect::<Vec<_>>())?
        } else {
            gpu.storage("the target", &pixels.collect::<Vec<_>>())?
        };
        let weights = target.weights.map(|weights| gpu.storage("a target's weights", weights)).transpose()?;
        Ok(Self { width, height, buffer, is_complete: coverage.is_none() && !is_8_bit, is_8_bit, weights })
    }

    /// Fails where the loss cannot be computed, or where the target's weights cannot be factors of
    /// it.
    pub(crate) fn check_loss(&self, loss: Loss) -> Result<(), Error> {
        loss.check_weights(BACKEND, self.weights.is_some())
    }

    /// Fails unless the target has this size.
    pub(crate) fn check_size(&self, size: [u32; 2]) -> Result<(), Error> {
        check_same_size(size.into(), (self.width, self.height))
    }
}

#[cfg(test)]
mod tests {
    use gs_core::Image;
    use pollster::FutureExt as _;

    use super::*;
    use crate::{WgpuRasterizer, WgpuSettings};

    #[test]
    fn compact_targets_take_four_bytes_a_pixel() {
        let wgpu =
            WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
        let bytes = |value, compact| {
            let image = Image::filled(32, 32, [value; 3]).unwrap();
            let target = TargetImage { compact, mask: Some(&[true; 1024]), ..TargetImage::from(&image) };
            Target::new(&wgpu.gpu, &target).unwrap().buffer.size()
        };
        assert_eq!(bytes(0.2, true), 4 * 1024);
        assert_eq!([bytes(0.2, false), bytes(0.3001, true)], [16 * 1024; 2]);
    }
}
