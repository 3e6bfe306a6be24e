//! The stages that visit every pixel, `blend` and `blend_bwd`, as commands.

use gs_core::{Error, Loss};

use crate::{
    collect::Collected,
    dispatch::{Commands, dispatch, dispatch_some},
    gpu::Gpu,
    loss::LossSum,
    shaders::{Kernels, Pass, Variant},
    target::Target,
    tiles::Tiles,
};

/// Where `walk.wgsl` has the part of the lists that a dispatch walks along: after all bindings of any blend kernel.
const SEGMENT: u32 = 9;

/// What `blend_bwd` differentiates: the loss by this target, or half the image's square.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Differentiated<'a> {
    Loss(&'a Target),
    Image,
}

impl Tiles {
    /// Whether a training step blends, compares and differentiates in one pass: where lanes are a CPU's, the loss is one of each pixel alone,
    /// the order that of the lists, and none of those too long for one walk. The numbers are the same as in three passes, bit for bit: whether
    /// lists are too long is found out again by a run that resumes.
    pub(crate) fn fuses(&self, gpu: &Gpu, loss: Loss) -> bool {
        let pointwise = !matches!(loss, Loss::L1Dssim { .. });
        gpu.kernels == Kernels::Vectors && pointwise && !self.orders_by_pixel() && self.segments.is_empty()
    }

    /// A kernel that walks along the tiles' lists, as often as it takes to reach their ends.
    fn encode_walks(
        &self,
        gpu: &Gpu,
        commands: &mut Commands,
        entry_point: &'static str,
        variant: Variant,
        bindings: &[&wgpu::Buffer],
    ) {
        let groups = || gpu.groups(self.count()).into();
        if self.segments.is_empty() {
            return dispatch(gpu, commands, entry_point, variant, bindings, groups());
        }
        let numbers: Vec<u32> = (0..bindings.len() as u32).chain([SEGMENT]).collect();
        for segment in &self.segments {
            let buffers = [bindings, &[segment]].concat();
            dispatch_some(gpu, commands, entry_point, variant, (&numbers, &buffers), groups());
        }
    }

    /// Stage `blend`.
    pub(crate) fn encode_blend(&self, gpu: &Gpu, commands: &mut Commands) {
        if self.orders_by_pixel() {
            let bindings = [&self.step, &self.tile_start.buffer, &self.queue.buffer, &self.status, &self.image.buffer];
            let groups = gpu.groups(self.count()).into();
            return dispatch(gpu, commands, "blend_by_depth", self.variant(), &bindings, groups);
        }
        let mut bindings = self.lists().to_vec();
        bindings.push(&self.image.buffer);
        let entry_point = if gpu.kernels == Kernels::Vectors { "blend_vectors" } else { "blend" };
        self.encode_walks(gpu, commands, entry_point, self.variant(), &bindings);
    }

    /// Stage `blend_bwd`, from `v_image`, or from the image itself.
    pub(crate) fn encode_blend_bwd(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        of: Differentiated<'_>,
    ) -> Result<(), Error> {
        self.ensure_slots(gpu)?;
        let variant = Variant { pass: Pass::Backward, ..self.variant() };
        let image = &self.image.buffer;
        // An image that is differentiated itself is compared with nothing, and nothing is collected of it.
        let (v_image, target) = match of {
            Differentiated::Loss(target) => (&self.v_image.buffer, &target.buffer),
            Differentiated::Image => (image, image),
        };
        let errors = variant.collected == Collected::PixelErrors;
        let (slots, totals) = (&self.slots.buffer, &self.totals.buffer);
        let (entry_point, mut bindings) = match gpu.kernels {
            _ if self.orders_by_pixel() => {
                commands.encoder().clear_buffer(totals, 0, None);
                let lists = [&self.step, &self.tile_start.buffer, &self.queue.buffer];
                let mut reads = [&lists[..], &[v_image, image, totals]].concat();
                if errors {
                    reads.push(target);
                }
                dispatch(gpu, commands, "units", variant, &reads, gpu.groups(self.count()).into());
                ("blend_by_depth", [&lists[..], &[&self.status, v_image, image, slots, totals]].concat())
            }
            Kernels::Vectors => ("blend_vectors", [&self.lists()[..], &[slots, v_image]].concat()),
            _ => ("blend_bwd", [&self.lists()[..], &[v_image, slots]].concat()),
        };
        if (variant.over || errors) && !self.orders_by_pixel() {
            bindings.push(image);
        }
        if errors {
            bindings.push(target);
        }
        if self.orders_by_pixel() {
            dispatch(gpu, commands, entry_point, variant, &bindings, gpu.groups(self.count()).into());
        } else {
            self.encode_walks(gpu, commands, entry_point, variant, &bindings);
        }
        Ok(())
    }

    /// Stages `blend` to `blend_bwd` for a training step: in one pass where adapter and loss allow it.
    pub(crate) fn encode_image_and_gradient(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        target: &Target,
        loss: Loss,
    ) -> Result<(), Error> {
        if !self.fuses(gpu, loss) {
            self.encode_blend(gpu, commands);
            self.encode_loss(gpu, commands, target, Some(loss))?;
            return self.encode_blend_bwd(gpu, commands, Differentiated::Loss(target));
        }
        self.ensure_slots(gpu)?;
        let kind = if loss == Loss::L2 { 1 } else { 2 };
        let tiles = self.count();
        self.partial.ensure(gpu, tiles * 4)?;
        let variant = Variant { pass: Pass::Fused, constant: Some(("KIND", kind)), ..self.variant() };
        let mut bindings = self.lists().to_vec();
        bindings.extend([&self.slots.buffer, &target.buffer, &self.partial.buffer]);
        dispatch(gpu, commands, "blend_vectors", variant, &bindings, gpu.groups(tiles).into());
        self.encode_loss_sum(gpu, commands, LossSum::Tiles);
        Ok(())
    }

    /// What every blend kernel reads.
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
