//! One pass through the stages: the tiles, what is the kind of scene's own, and the order in which the stages' commands are recorded.

use gs_core::{AdamRates, Error, Loss, RenderSettings};

use crate::{
    cloud::Cloud,
    dispatch::Commands,
    gpu::Gpu,
    kind::Kind,
    layout::{Status, Step},
    tiles::{Growing, Tiles},
};

/// One pass's inputs and results.
#[derive(Debug)]
pub struct Workspace<S: Kind> {
    pub(crate) tiles: Tiles,
    /// Once there was a pass.
    pub(crate) view: Option<S::View>,
    pub(crate) own: S::Own,
    /// As many as the kind of scene has, once there was a backward pass.
    pub(crate) gradients: Vec<Growing>,
    /// The cloud's edition that the lists were made for.
    pub(crate) edition: Option<u64>,
}

impl<S: Kind> Workspace<S> {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, Error> {
        Ok(Self { tiles: Tiles::new(gpu)?, view: None, own: S::own(gpu)?, gradients: Vec::new(), edition: None })
    }

    /// Makes the pass one of this cloud, view and settings; lists that were made for anything else are forgotten.
    pub(crate) fn set(
        &mut self,
        gpu: &Gpu,
        cloud: &Cloud<S>,
        view: &S::View,
        settings: &RenderSettings,
    ) -> Result<(), Error> {
        let seen = self.view.as_ref() == Some(view) && self.tiles.settings == *settings;
        if !(S::LISTS_LAST && seen && self.edition == Some(cloud.edition)) {
            self.edition = None;
        }
        self.view = Some(view.clone());
        self.tiles.set(gpu, cloud.len, S::size(view), settings)?;
        S::ensure(self, gpu, cloud)
    }

    /// What this pass tells the device.
    pub(crate) fn describe(&self, gpu: &Gpu, cloud: &Cloud<S>, loss: Option<Loss>, rates: Option<&AdamRates>) -> Step {
        let mut step = self.tiles.describe(gpu, loss, rates);
        if let Some(view) = &self.view {
            S::describe(view, &self.tiles.settings, cloud, &mut step);
        }
        step
    }

    pub(crate) fn write_step(&self, gpu: &Gpu, step: &Step) {
        gpu.write(&self.tiles.step, bytemuck::bytes_of(step));
        if let Some(view) = &self.view {
            S::write_view(self, gpu, view);
        }
    }

    /// Stages `project` to `ranges`; without `lists` only `project`, and the last lists stay.
    pub(crate) fn encode_lists(&self, gpu: &Gpu, commands: &mut Commands, cloud: &Cloud<S>, lists: bool) {
        self.encode_project(gpu, commands, cloud, lists);
        if lists {
            self.tiles.encode_offsets(gpu, commands);
            self.tiles.encode_bin(gpu, commands);
            self.tiles.encode_sort(gpu, commands);
            self.tiles.encode_ranges(gpu, commands);
        }
    }

    /// Stage `project`; with `lists` it counts the tiles that each Gaussian touches.
    pub(crate) fn encode_project(&self, gpu: &Gpu, commands: &mut Commands, cloud: &Cloud<S>, lists: bool) {
        self.tiles.encode_clear(commands, lists);
        S::encode_project(self, gpu, commands, cloud, lists);
    }

    /// Stage `project_bwd`, and room for the gradients that it leaves: a pass that is only looked at needs none.
    pub(crate) fn encode_project_bwd(
        &mut self,
        gpu: &Gpu,
        commands: &mut Commands,
        cloud: &Cloud<S>,
    ) -> Result<(), Error> {
        let sizes = S::gradient_bytes(cloud);
        while self.gradients.len() < sizes.len() {
            self.gradients.push(Growing::new(gpu, "gradients")?);
        }
        for (gradients, bytes) in self.gradients.iter_mut().zip(sizes) {
            gradients.ensure(gpu, bytes)?;
        }
        S::encode_project_bwd(self, gpu, commands, cloud);
        Ok(())
    }

    /// The gradients that `project_bwd` leaves.
    pub(crate) fn gradient_buffers(&self) -> Vec<&wgpu::Buffer> {
        self.gradients.iter().map(|growing| &growing.buffer).collect()
    }

    /// Stage `adam`, in a pass whose lists may not have fitted, or whose pixels may have given up: then it does nothing.
    pub(crate) fn encode_adam(&self, gpu: &Gpu, commands: &mut Commands, cloud: &Cloud<S>) {
        self.tiles.encode_stop(gpu, commands);
        let Tiles { step, indirect, .. } = &self.tiles;
        S::encode_adam(gpu, commands, cloud, step, &self.gradient_buffers(), Some(indirect));
    }

    /// Makes room for what a pass asked for in vain, and forgets that it did.
    pub(crate) fn make_room(&mut self, gpu: &Gpu, status: &Status) -> Result<(), Error> {
        self.edition = None;
        self.tiles.make_room(gpu, status)
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{Canvas, Chart, Image, Loss, PlanarGaussian, PlanarScene, Rasterizer, RenderSettings};

    use crate::{WgpuRasterizer, WgpuSettings};

    #[test]
    fn what_is_only_looked_at_has_no_room_for_gradients() {
        let wgpu = WgpuRasterizer::new(WgpuSettings::default()).expect("`cargo xtask test` installs a driver");
        let gaussian = PlanarGaussian {
            mean: Vec2::splat(8.0),
            log_scale: Vec2::ONE,
            rotation: 0.0,
            opacity_logit: 0.0,
            color: Vec3::ONE,
        };
        let scene: PlanarScene = [gaussian].into_iter().collect();
        let cloud = wgpu.upload(&scene, Chart::ScaleRotation).unwrap();
        let frame = wgpu.forward(&cloud, &Canvas::new(16, 16), &RenderSettings::default()).unwrap();
        assert!(frame.workspace().gradients.is_empty());
        let target = wgpu.planar().upload_target(&Image::filled(16, 16, [0.5; 3]).unwrap()).unwrap();
        let (_, gradients) = wgpu.backward(&cloud, frame, &target, &Loss::L2).unwrap();
        assert_ne!(wgpu.download_gradients(&cloud, &gradients).unwrap().colors, [Vec3::ZERO]);
    }
}
