//! Commands of the stages that visit every pixel, `blend` and `blend_bwd`.

use gs_core::{Error, Loss};

use crate::{
    collect::Collected,
    dispatch::{Commands, dispatch},
    gpu::Gpu,
    shaders::{Pass, Variant},
    target::Target,
    tiles::Tiles,
};

/// The function that `blend_bwd` differentiates: the loss, half the image's square, or one of the
/// caller's own, whose gradient by the image is in `v_image`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Differentiated<'a> {
    Loss(&'a Target),
    Image,
    Own,
}

impl Tiles {
    /// Records stage `blend`.
    pub(crate) fn encode_blend(&self, gpu: &Gpu, commands: &mut Commands) {
        if self.orders_by_pixel() {
            let bindings = [&self.step, &self.tile_start.buffer, &self.queue.buffer, &self.status, &self.image.buffer];
            let groups = gpu.groups(self.count()).into();
            return dispatch(gpu, commands, "blend_by_depth", self.variant(), &bindings, groups);
        }
        let mut bindings = self.lists().to_vec();
        bindings.push(&self.image.buffer);
        dispatch(gpu, commands, "blend", self.variant(), &bindings, gpu.groups(self.count()).into());
    }

    /// Records stage `blend_bwd`, from `v_image` or from the image itself.
    pub(crate) fn encode_blend_bwd(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        of: Differentiated<'_>,
    ) -> Result<(), Error> {
        self.ensure_slots(gpu)?;
        let variant = Variant { pass: Pass::Backward, ..self.variant() };
        let image = &self.image.buffer;
        // Without a target the errors of pixels, which some statistics need, are 0.
        let (v_image, target) = match of {
            Differentiated::Loss(target) => (&self.v_image.buffer, self.compared(target)),
            Differentiated::Image => (image, image),
            Differentiated::Own => (&self.v_image.buffer, image),
        };
        let errors = variant.collected == Collected::PixelErrors;
        let (slots, totals) = (&self.slots.buffer, &self.totals.buffer);
        let groups = || gpu.groups(self.count()).into();
        let (entry_point, mut bindings) = if self.orders_by_pixel() {
            commands.encoder().clear_buffer(totals, 0, None);
            let lists = [&self.step, &self.tile_start.buffer, &self.queue.buffer];
            let mut reads = [&lists[..], &[v_image, image, totals]].concat();
            if errors {
                reads.push(target);
            }
            dispatch(gpu, commands, "units", variant, &reads, groups());
            ("blend_by_depth", [&lists[..], &[&self.status, v_image, image, slots, totals]].concat())
        } else {
            ("blend_bwd", [&self.lists()[..], &[v_image, slots]].concat())
        };
        if (variant.over || errors) && !self.orders_by_pixel() {
            bindings.push(image);
        }
        if errors {
            bindings.push(target);
        }
        dispatch(gpu, commands, entry_point, variant, &bindings, groups());
        Ok(())
    }

    /// Records stages `blend` to `blend_bwd` of a training step.
    pub(crate) fn encode_image_and_gradient(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        target: &Target,
        loss: Loss,
    ) -> Result<(), Error> {
        self.encode_blend(gpu, commands);
        self.encode_loss(gpu, commands, target, loss)?;
        self.encode_blend_bwd(gpu, commands, Differentiated::Loss(target))
    }

    /// The buffers that every blend kernel reads.
    fn lists(&self) -> [&wgpu::Buffer; 5] {
        [
            &self.step,
            &self.tile_start.buffer,
            &self.order[self.sorted()].buffer,
            &self.entries.buffer,
            &self.projected.buffer,
        ]
    }
}
