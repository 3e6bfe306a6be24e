//! Commands of stage `loss`: the loss and its gradient by the image, pointwise or with D-SSIM.

use gs_core::{Error, Image, Loss};

use crate::{
    dispatch::{Commands, Groups, dispatch, dispatch_some},
    gpu::Gpu,
    shaders::{DSSIM_GROUP, SSIM_SEGMENT, Variant},
    target::Target,
    tiles::{PIXEL_BYTES, Tiles, groups_of},
};

/// Bytes per channel and pixel of D-SSIM's moments, and of its derivatives with padding.
pub(crate) const MOMENTS_BYTES: u64 = 16;

/// Width of the strips in which D-SSIM's derivatives are stored.
const STRIP: u64 = 8;

/// What `loss` makes of a pixel and its target: the values of `KIND` in `loss.wgsl`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Comparison {
    /// The difference, without a loss.
    Difference = 0,
    /// The squared difference, L2.
    Square = 1,
    /// The difference's magnitude, L1.
    Magnitude = 2,
    /// The pixel itself, without a loss.
    Image = 3,
}

/// The partial sums of the loss: the values of `SUM_OF` in `loss.wgsl`.
#[derive(Debug, Clone, Copy)]
enum LossSum {
    /// Partial sums of `loss`, by blocks of pixels.
    Pixels = 0,
    /// Partial sums of `dssim_derivatives` and `dssim_gradient`.
    Dssim = 1,
}

impl Tiles {
    /// Records stage `loss`: the loss into the status, its gradient into `v_image`.
    pub(crate) fn encode_loss(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        target: &Target,
        loss: Loss,
    ) -> Result<(), Error> {
        let pixels = self.pixels();
        self.v_image.ensure(gpu, pixels * PIXEL_BYTES)?;
        if !target.is_complete {
            self.completed.ensure(gpu, pixels * PIXEL_BYTES)?;
            let bindings = [&self.step, &self.image.buffer, &target.buffer, &self.completed.buffer];
            let variant = Variant { packed: target.is_8_bit, ..Variant::default() };
            dispatch(gpu, commands, "complete", variant, &bindings, groups_of(gpu, pixels, 256));
        }
        let comparison = match loss {
            Loss::L2 => Comparison::Square,
            Loss::L1 => Comparison::Magnitude,
            Loss::L1Dssim { .. } => {
                let compared = self.compared(target).clone();
                return self.encode_dssim(gpu, commands, &compared);
            }
        };
        self.encode_comparison(gpu, commands, target, comparison)?;
        self.encode_loss_sum(gpu, commands, LossSum::Pixels);
        Ok(())
    }

    /// Records the comparison of each pixel with the target: partial sums of the loss, and `v_image`.
    pub(crate) fn encode_comparison(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        target: &Target,
        comparison: Comparison,
    ) -> Result<(), Error> {
        let pixels = self.pixels();
        let groups = pixels.div_ceil(1024);
        self.v_image.ensure(gpu, pixels * PIXEL_BYTES)?;
        self.partial.ensure(gpu, groups * 4)?;
        let weighted = target.weights.is_some();
        let variant = Variant { constant: Some(("KIND", comparison as u32)), weighted, ..Variant::default() };
        let (image, compared) = (&self.image.buffer, self.compared(target));
        let mut numbers = vec![0, 1, 2, 3, 4];
        let mut bindings = vec![&self.step, image, compared, &self.v_image.buffer, &self.partial.buffer];
        if let Some(weights) = &target.weights {
            numbers.push(6);
            bindings.push(weights);
        }
        dispatch_some(gpu, commands, "loss", variant, (&numbers, &bindings), gpu.groups(groups).into());
        Ok(())
    }

    /// Writes the gradient of a loss of the caller's own, of the pass's size, into `v_image`.
    pub(crate) fn write_v_image(&mut self, gpu: &Gpu, v_image: &Image) -> Result<(), Error> {
        self.v_image.ensure(gpu, self.pixels() * PIXEL_BYTES)?;
        let pixels: Vec<[f32; 4]> = v_image.pixels().iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
        gpu.write(&self.v_image.buffer, bytemuck::cast_slice(&pixels));
        Ok(())
    }

    /// The colours that the image is compared with, after stage `loss`.
    pub(crate) fn compared<'a>(&'a self, target: &'a Target) -> &'a wgpu::Buffer {
        if target.is_complete { &target.buffer } else { &self.completed.buffer }
    }

    /// Records stage `loss` for L1 + D-SSIM.
    fn encode_dssim(&mut self, gpu: &Gpu, commands: &mut Commands, target: &wgpu::Buffer) -> Result<(), Error> {
        let [width, height] = self.size.map(u64::from);
        let groups = |lines: u64, length: u64| {
            (3 * lines * length.div_ceil(u64::from(SSIM_SEGMENT))).div_ceil(u64::from(DSSIM_GROUP))
        };
        let (down, along) = (groups(width, height), groups(height, width));
        self.partial.ensure(gpu, (down + along) * 4)?;
        self.moments.ensure(gpu, 3 * width * height * MOMENTS_BYTES)?;
        self.derivatives.ensure(gpu, (3 * width).next_multiple_of(STRIP) * height * MOMENTS_BYTES)?;
        let (step, image, target, v_image) = (&self.step, &self.image.buffer, target, &self.v_image.buffer);
        let (moments, derivatives, partial) = (&self.moments.buffer, &self.derivatives.buffer, &self.partial.buffer);
        let (plain, [down, along]) = (Variant::default(), [down, along].map(|groups| gpu.groups(groups).into()));
        dispatch(gpu, commands, "dssim_moments", plain, &[step, image, target, moments], down);
        let bindings = (&[0, 3, 4, 6][..], &[step, moments, derivatives, partial][..]);
        dispatch_some(gpu, commands, "dssim_derivatives", plain, bindings, along);
        let bindings = (&[0, 1, 2, 4, 5, 6][..], &[step, image, target, derivatives, v_image, partial][..]);
        dispatch_some(gpu, commands, "dssim_gradient", plain, bindings, down);
        self.encode_loss_sum(gpu, commands, LossSum::Dssim);
        Ok(())
    }

    fn encode_loss_sum(&self, gpu: &Gpu, commands: &mut Commands, of: LossSum) {
        let variant = Variant { constant: Some(("SUM_OF", of as u32)), ..Variant::default() };
        let bindings = (&[0, 4, 5][..], &[&self.step, &self.partial.buffer, &self.status][..]);
        dispatch_some(gpu, commands, "loss_sum", variant, bindings, Groups::Direct(1, 1));
    }
}
