//! The trait's implementation: checks what comes in, and sends the stages to the device.

use std::sync::{Arc, PoisonError};

use gs_core::{
    AdamRates, DensityStatistics, EditPlan, Error, Image, Loss, Parameterization, Rasterizer, RenderSettings, Scene2d,
    Scene3d, SplatsState, TrainStep, Wait,
    profile::Profiler,
    settings::{Cut, Extent},
    statistics::Culled,
};

use crate::{
    ForwardPass2d, ForwardPass3d, Gradients2d, Gradients3d, Splats2d, Splats3d, WgpuSettings,
    adapter::AdapterSummary,
    blend::Differentiated,
    dispatch::Commands,
    forward_pass::{ForwardPass, Gradients, Pool},
    gpu::{BACKEND, Gpu, STORAGE},
    in_flight::Request,
    kind::SceneKind,
    layout::{Status, Step},
    shaders::Kernels,
    splats::{Splats, UNIFORM},
    target::Target,
    workspace::Workspace,
};

/// The GPU backend: owns its device, and the buffers that its forward passes use in turn.
#[derive(Debug)]
pub struct WgpuRasterizer {
    pub(crate) gpu: Gpu,
    pub(crate) pool_2d: Arc<Pool<Scene2d>>,
    pub(crate) pool_3d: Arc<Pool<Scene3d>>,
}

impl WgpuRasterizer {
    /// A rasterizer with a device of its own.
    ///
    /// # Errors
    /// [`Error::Backend`] where there is no adapter, none of that name, or it gives no device.
    pub fn new(settings: WgpuSettings) -> Result<Self, Error> {
        Ok(Self { gpu: Gpu::new(&settings)?, pool_2d: Arc::default(), pool_3d: Arc::default() })
    }

    /// This rasterizer for 2D scenes alone, where the types of the arguments do not say which kind of scene is meant.
    pub fn for_2d(
        &self,
    ) -> &impl Profiler<Scene2d, Splats = Splats2d, ForwardPass = ForwardPass2d, Gradients = Gradients2d, Target = Target>
    {
        self
    }

    /// This rasterizer for 3D scenes alone, as [`Self::2D`].
    pub fn for_3d(
        &self,
    ) -> &impl Profiler<Scene3d, Splats = Splats3d, ForwardPass = ForwardPass3d, Gradients = Gradients3d, Target = Target>
    {
        self
    }

    /// The adapter in use.
    pub fn adapter(&self) -> &AdapterSummary {
        &self.gpu.adapter
    }

    /// Why this adapter: "the only adapter".
    pub fn reason(&self) -> &str {
        &self.gpu.reason
    }

    /// How the kernels that visit every pixel are written.
    pub fn kernels(&self) -> Kernels {
        self.gpu.kernels
    }

    /// Bytes that have moved between host and device so far, in both directions, uniforms included.
    pub fn bytes_moved(&self) -> u64 {
        self.gpu.moved()
    }

    /// How often the host has waited for the device so far. Training steps wait only where [`STEPS_IN_FLIGHT`](crate::STEPS_IN_FLIGHT) are
    /// under way already.
    pub fn waits(&self) -> u64 {
        self.gpu.waits()
    }

    /// Gives the device up, as if the driver had crashed: every later call is an [`Error::Backend`].
    #[cfg(feature = "test-hooks")]
    pub fn lose_device(&self) {
        self.gpu.lose();
    }

    /// Runs `encode` on lists made anew, with more room until they fit; what became of it.
    pub(crate) fn with_lists<S: SceneKind>(
        &self,
        workspace: &mut Workspace<S>,
        splats: &Splats<S>,
        step: impl Fn(&Workspace<S>) -> Step,
        mut encode: impl FnMut(&mut Workspace<S>, &mut Commands) -> Result<(), Error>,
    ) -> Result<Status, Error> {
        loop {
            workspace.write_step(&self.gpu, &step(workspace));
            let mut commands = Commands::new(&self.gpu);
            workspace.encode_lists(&self.gpu, &mut commands, splats, true);
            encode(workspace, &mut commands)?;
            commands.submit(&self.gpu);
            let status = workspace.tiles.read_status(&self.gpu)?;
            if status.overflow == 0 {
                status.check()?;
                workspace.edition = Some(splats.edition);
                return Ok(status);
            }
            workspace.make_room(&self.gpu, &status)?;
        }
    }
}

/// An error for an effect that this backend does not offer.
pub(crate) fn unsupported(effect: impl Into<String>) -> Error {
    Error::Unsupported { backend: BACKEND, effect: effect.into() }
}

/// Fails where a setting is not possible for any kind of scene.
pub(crate) fn check_settings(settings: &RenderSettings) -> Result<(), Error> {
    settings.validate()?;
    if settings.accuracy.cut != Cut::Hard {
        return Err(unsupported("a smooth cut, which would touch every pixel"));
    }
    if let Extent::Sigmas(k) = settings.accuracy.extent {
        return Err(unsupported(format!(
            "an extent of {k} standard deviations: its kernels have one cut for all Gaussians"
        )));
    }
    Ok(())
}

impl<S: SceneKind> Rasterizer<S> for WgpuRasterizer {
    type Splats = Splats<S>;
    type ForwardPass = ForwardPass<S>;
    type Gradients = Gradients<S>;
    type Target = Target;

    fn describe(&self) -> String {
        let AdapterSummary { name, kind, interface, .. } = &self.gpu.adapter;
        format!("wgpu ({name}, {kind}, {interface})")
    }

    fn upload(&self, scene: &S, parameterization: Parameterization) -> Result<Splats<S>, Error> {
        Splats::new(&self.gpu, scene, parameterization)
    }

    fn download(&self, splats: &Splats<S>) -> Result<S, Error> {
        splats.settle(&self.gpu)?;
        S::download(&self.gpu, &splats.state, splats.len)
    }

    fn len(&self, splats: &Splats<S>) -> usize {
        splats.len
    }

    fn upload_target(&self, image: &Image) -> Result<Target, Error> {
        image.check_finite("the target")?;
        Target::new(&self.gpu, image)
    }

    fn save(&self, splats: &Splats<S>) -> Result<SplatsState, Error> {
        splats.settle(&self.gpu)?;
        splats.save(&self.gpu)
    }

    fn restore(&self, state: &SplatsState) -> Result<Splats<S>, Error> {
        Splats::restore(&self.gpu, state)
    }

    fn forward(&self, splats: &Splats<S>, view: &S::View, settings: &RenderSettings) -> Result<ForwardPass<S>, Error> {
        S::check(view, settings)?;
        splats.settle(&self.gpu)?;
        let mut workspace = S::pool(self).take(&self.gpu)?;
        workspace.set(&self.gpu, splats, view, settings)?;
        let status = self.with_lists(
            &mut workspace,
            splats,
            |w| w.describe(&self.gpu, splats, None, None),
            |w, commands| {
                w.tiles.encode_blend(&self.gpu, commands);
                Ok(())
            },
        )?;
        Ok(ForwardPass { workspace: Some(workspace), status, pool: Arc::clone(S::pool(self)) })
    }

    fn image(&self, pass: &ForwardPass<S>) -> Result<Image, Error> {
        pass.image(&self.gpu)
    }

    fn culled(&self, pass: &ForwardPass<S>) -> Result<Culled, Error> {
        Ok(pass.culled())
    }

    fn backward(
        &self,
        splats: &Splats<S>,
        mut pass: ForwardPass<S>,
        target: &Target,
        loss: &Loss,
    ) -> Result<(f32, Gradients<S>), Error> {
        loss.validate()?;
        let gpu = &self.gpu;
        let workspace = pass.workspace.as_mut().expect("a forward pass has its workspace until it is dropped");
        target.check_size(workspace.tiles.size)?;
        if workspace.edition != Some(splats.edition) {
            return Err(Error::State("the forward pass is of other splats, or of this one before an edit".to_owned()));
        }
        splats.settle(gpu)?;
        workspace.write_step(gpu, &workspace.describe(gpu, splats, Some(*loss), None));
        let mut commands = Commands::new(gpu);
        workspace.tiles.encode_loss(gpu, &mut commands, target, Some(*loss))?;
        workspace.tiles.encode_blend_bwd(gpu, &mut commands, Differentiated::Loss(target))?;
        workspace.encode_project_bwd(gpu, &mut commands, splats)?;
        let mut buffers = Vec::new();
        for source in workspace.gradient_buffers() {
            let buffer = gpu.allocate("gradients", source.size(), STORAGE)?;
            commands.encoder().copy_buffer_to_buffer(source, 0, &buffer, 0, source.size());
            buffers.push(buffer);
        }
        commands.submit(gpu);
        let status = workspace.tiles.read_status(gpu)?;
        status.check()?;
        let view = workspace.view.clone().expect("a forward pass has a view");
        Ok((status.loss, Gradients { buffers, len: splats.len, view, settings: workspace.tiles.settings }))
    }

    fn download_gradients(&self, splats: &Splats<S>, gradients: &Gradients<S>) -> Result<S, Error> {
        gradients.check_len(splats)?;
        splats.settle(&self.gpu)?;
        S::derivatives(&self.gpu, splats, gradients)
    }

    fn step(&self, splats: &mut Splats<S>, gradients: &Gradients<S>, rates: &AdamRates) -> Result<(), Error> {
        gradients.check_len(splats)?;
        rates.validate()?;
        S::check_rates(rates)?;
        let gpu = &self.gpu;
        splats.settle(gpu)?;
        S::prepare(gpu, &mut splats.state, splats.len)?;
        let mut workspace = S::pool(self).take(gpu)?;
        workspace.set(gpu, splats, &gradients.view, &gradients.settings)?;
        let step = workspace.describe(gpu, splats, None, Some(rates));
        let uniform = gpu.allocate("step", size_of::<Step>() as u64, UNIFORM)?;
        gpu.write(&uniform, bytemuck::bytes_of(&step));
        let mut commands = Commands::new(gpu);
        let buffers: Vec<&wgpu::Buffer> = gradients.buffers.iter().collect();
        S::encode_adam(gpu, &mut commands, splats, &uniform, &buffers, None);
        commands.submit(gpu);
        S::pool(self).give(workspace);
        gpu.check()
    }

    fn train_step(
        &self,
        splats: &mut Splats<S>,
        view: &S::View,
        target: &Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        S::check(view, step.settings)?;
        step.loss.validate()?;
        step.rates.validate()?;
        S::check_rates(step.rates)?;
        target.check_size(S::size(view))?;
        S::prepare(&self.gpu, &mut splats.state, splats.len)?;
        splats.in_flight().train(&self.gpu, S::pool(self), splats, Request::new(view, target, step))
    }

    fn losses(&self, splats: &mut Splats<S>, wait: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        splats.in_flight().settle(&self.gpu, splats, wait)?;
        losses.append(self.unread_losses(splats));
        Ok(())
    }

    fn unread_losses<'c>(&self, splats: &'c mut Splats<S>) -> &'c mut Vec<f32> {
        &mut splats.in_flight.get_mut().unwrap_or_else(PoisonError::into_inner).losses
    }

    fn solve_colors(
        &self,
        splats: &mut Splats<S>,
        view: &S::View,
        target: &Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        S::check(view, settings)?;
        target.check_size(S::size(view))?;
        S::solve_colors(self, splats, view, target, settings, iterations)
    }

    fn statistics(&self, splats: &Splats<S>) -> Result<DensityStatistics, Error> {
        splats.settle(&self.gpu)?;
        splats.density_statistics(&self.gpu)
    }

    fn edit(&self, splats: &mut Splats<S>, plan: &EditPlan<S::Gaussian>) -> Result<(), Error> {
        splats.settle(&self.gpu)?;
        splats.edit(&self.gpu, plan)
    }
}

#[cfg(test)]
mod tests {
    use gs_core::Accuracy;

    use super::*;

    #[test]
    fn an_extent_in_standard_deviations_is_refused_by_its_name() {
        let mut settings = RenderSettings::default();
        check_settings(&settings).unwrap();
        settings.accuracy = Accuracy { extent: Extent::Sigmas(3.0), ..Accuracy::default() };
        let message = check_settings(&settings).unwrap_err().to_string();
        assert!(message.contains("wgpu") && message.contains("3 standard deviations"), "{message}");
    }
}
