//! The implementation of the traits: checks the arguments and sends the stages to the device.

use std::sync::{Arc, PoisonError, atomic::Ordering::Relaxed};

use gs_core::{
    AdamRates, Backend, CameraGradient, Culled, DensityStatistics, EditPlan, Error, Image, Loss, MeanNoise, Optimizer,
    Parameterization, Rasterizer, RenderSettings, SplatsState, TargetImage, TrainStep, Wait, check_same_size,
};

use crate::{
    WgpuSettings,
    adapter::AdapterSummary,
    blend::Differentiated,
    dispatch::Commands,
    fault::unsupported,
    forward_pass::{ForwardPass, Gradients},
    gpu::{Gpu, STORAGE, UNIFORM},
    in_flight::Request,
    kind::{Kind, State as _},
    layout::{Status, Step},
    shaders::Kernels,
    splats::Splats,
    target::Target,
    workspace::{Pools, Workspace},
};

/// The GPU backend. It owns its device and the buffers that its forward passes use in turn.
#[derive(Debug)]
pub struct WgpuRasterizer {
    pub(crate) gpu: Gpu,
    pub(crate) pools: Pools,
}

impl WgpuRasterizer {
    /// A rasterizer with a device of its own.
    ///
    /// # Errors
    /// [`Error::Backend`] if no adapter is found, none has that name, or it cannot open a device.
    pub async fn new(settings: WgpuSettings) -> Result<Self, Error> {
        Ok(Self::with(Gpu::open(&settings).await?))
    }

    /// A rasterizer on a device of the host program, for instance to draw into its textures.
    ///
    /// [`WgpuSettings::adapter`] has no effect. The device's limits on buffer sizes bound the size
    /// of a scene. Kernels use subgroups if the device has [`wgpu::Features::SUBGROUP`]. The host
    /// program keeps its error handlers: an error that wgpu reports to them is not an [`Error`]
    /// here unless the device is lost.
    ///
    /// # Errors
    /// [`Error::Backend`] naming each limit that is too low: [`wgpu::Limits::default`] is enough.
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue, settings: WgpuSettings) -> Result<Self, Error> {
        Ok(Self::with(Gpu::shared(device, queue, &settings)?))
    }

    fn with(gpu: Gpu) -> Self {
        Self { gpu, pools: Pools::default() }
    }

    /// The adapter in use.
    pub fn adapter(&self) -> &AdapterSummary {
        &self.gpu.adapter
    }

    /// The reason why this adapter was chosen, for example "the only adapter".
    pub fn reason(&self) -> &str {
        &self.gpu.reason
    }

    /// The kind of kernels in use.
    pub fn kernels(&self) -> Kernels {
        self.gpu.kernels
    }

    /// Bytes moved between host and device so far, in both directions, including uniforms.
    pub fn bytes_moved(&self) -> u64 {
        self.gpu.moved.load(Relaxed)
    }

    /// Number of times that the host has waited for the device so far.
    ///
    /// A training step waits only if [`STEPS_IN_FLIGHT`](crate::STEPS_IN_FLIGHT) steps are pending.
    pub fn waits(&self) -> u64 {
        self.gpu.waits.load(Relaxed)
    }

    /// Destroys the device, as a crash of the driver would. Every later call is an
    /// [`Error::Backend`].
    #[cfg(feature = "test-hooks")]
    pub fn lose_device(&self) {
        self.gpu.lose();
    }

    /// Gradients of a forward pass; `encode` records all stages until `blend_bwd`.
    async fn differentiate<S: Kind>(
        &self,
        splats: &Splats<S>,
        mut pass: ForwardPass<S>,
        loss: Option<Loss>,
        encode: impl FnOnce(&mut Workspace<S>, &mut Commands) -> Result<(), Error>,
    ) -> Result<(Status, Gradients<S>), Error> {
        let gpu = &self.gpu;
        let workspace = pass.workspace.as_mut().expect("a forward pass has its workspace until it is dropped");
        if workspace.version != Some(splats.version) {
            return Err(Error::State(
                "the forward pass was made from other splats, or before an edit of these".to_owned(),
            ));
        }
        splats.settle(gpu).await?;
        workspace.write_step(gpu, &workspace.describe(gpu, splats, loss, None));
        let mut commands = Commands::new(gpu);
        encode(workspace, &mut commands)?;
        workspace.encode_project_bwd(gpu, &mut commands, splats)?;
        let mut buffers = Vec::new();
        for source in workspace.gradient_buffers() {
            let buffer = gpu.allocate("gradients", source.size(), STORAGE)?;
            commands.encoder().copy_buffer_to_buffer(source, 0, &buffer, 0, source.size());
            buffers.push(buffer);
        }
        commands.submit(gpu);
        let status = workspace.tiles.read_status(gpu).await?;
        status.check()?;
        let view = workspace.view.clone().expect("a forward pass has a view");
        let settings = workspace.tiles.settings;
        let by_camera = status.camera_gradient(&settings);
        let gradients = Gradients { buffers, len: splats.len, view, settings, by_camera };
        Ok((status, gradients))
    }
}

gs_core::impl_for_kinds!(WgpuRasterizer);

impl Backend for WgpuRasterizer {
    fn describe(&self) -> String {
        let AdapterSummary { name, kind, interface, .. } = &self.gpu.adapter;
        format!("wgpu ({name}, {kind}, {interface})")
    }
}

impl<S: Kind> Rasterizer<S> for WgpuRasterizer {
    type Splats = Splats<S>;
    type ForwardPass = ForwardPass<S>;
    type Gradients = Gradients<S>;
    type Target = Target;

    fn upload(&self, scene: &S, parameterization: Parameterization) -> Result<Splats<S>, Error> {
        Splats::new(&self.gpu, scene, parameterization)
    }

    async fn forward(
        &self,
        splats: &Splats<S>,
        view: &S::View,
        settings: &RenderSettings,
    ) -> Result<ForwardPass<S>, Error> {
        S::check(view, settings)?;
        splats.settle(&self.gpu).await?;
        let mut workspace = S::pool(&self.pools).take(&self.gpu)?;
        workspace.set(&self.gpu, splats, view, settings)?;
        let describe = |w: &Workspace<S>| w.describe(&self.gpu, splats, None, None);
        let blend = |w: &mut Workspace<S>, commands: &mut Commands| {
            w.tiles.encode_blend(&self.gpu, commands);
            Ok(())
        };
        let status = workspace.with_lists(&self.gpu, splats, describe, blend).await?;
        Ok(ForwardPass { workspace: Some(workspace), status, pool: Arc::clone(S::pool(&self.pools)) })
    }

    async fn image(&self, pass: &ForwardPass<S>) -> Result<Image, Error> {
        pass.image(&self.gpu).await
    }

    fn culled(&self, pass: &ForwardPass<S>) -> Culled {
        pass.culled()
    }

    fn upload_target<'a>(&self, target: impl Into<TargetImage<'a>>) -> Result<Target, Error> {
        Target::new(&self.gpu, &target.into())
    }

    async fn backward(
        &self,
        splats: &Splats<S>,
        pass: ForwardPass<S>,
        target: &Target,
        loss: &Loss,
    ) -> Result<(f32, Gradients<S>), Error> {
        target.check_loss(*loss)?;
        target.check_size(pass.workspace().tiles.size)?;
        let encode = |workspace: &mut Workspace<S>, commands: &mut Commands| {
            workspace.tiles.encode_loss(&self.gpu, commands, target, *loss)?;
            workspace.tiles.encode_blend_bwd(&self.gpu, commands, Differentiated::Loss(target))
        };
        let (status, gradients) = self.differentiate(splats, pass, Some(*loss), encode).await?;
        Ok((status.loss, gradients))
    }

    async fn image_vjp(
        &self,
        splats: &Splats<S>,
        pass: ForwardPass<S>,
        v_image: &Image,
    ) -> Result<Gradients<S>, Error> {
        check_same_size(pass.workspace().tiles.size.into(), v_image.size())?;
        v_image.check_finite("the gradient of an image")?;
        let encode = |workspace: &mut Workspace<S>, commands: &mut Commands| {
            workspace.tiles.write_v_image(&self.gpu, v_image)?;
            workspace.tiles.encode_blend_bwd(&self.gpu, commands, Differentiated::Own)
        };
        Ok(self.differentiate(splats, pass, None, encode).await?.1)
    }

    async fn gradients(&self, splats: &Splats<S>, gradients: &Gradients<S>) -> Result<S, Error> {
        gradients.check_len(splats)?;
        splats.settle(&self.gpu).await?;
        S::derivatives(&self.gpu, splats, &gradients.buffers, gradients.len).await
    }

    async fn camera_gradient(&self, gradients: &Gradients<S>) -> Result<CameraGradient, Error> {
        gradients.by_camera.ok_or_else(CameraGradient::not_requested)
    }

    async fn download(&self, splats: &Splats<S>) -> Result<S, Error> {
        splats.settle(&self.gpu).await?;
        splats.state.scene(&self.gpu, splats.len).await
    }

    fn len(&self, splats: &Splats<S>) -> usize {
        splats.len
    }
}

impl<S: Kind> Optimizer<S> for WgpuRasterizer {
    async fn train_step(
        &self,
        splats: &mut Splats<S>,
        view: &S::View,
        target: &Target,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        S::check(view, step.settings)?;
        target.check_loss(step.loss)?;
        step.rates.validate()?;
        S::check_rates(step.rates)?;
        target.check_size(S::size(view))?;
        S::prepare(&self.gpu, splats, Some(step.rates)).await?;
        let mut in_flight = splats.in_flight().await;
        in_flight.train(&self.gpu, S::pool(&self.pools), splats, Request::new(view, target, step)).await
    }

    async fn losses(&self, splats: &mut Splats<S>, wait: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        let mut in_flight = splats.in_flight().await;
        in_flight.settle(&self.gpu, splats, wait).await?;
        losses.append(&mut in_flight.losses);
        Ok(())
    }

    async fn camera_gradients(
        &self,
        splats: &mut Splats<S>,
        wait: Wait,
        gradients: &mut Vec<CameraGradient>,
    ) -> Result<(), Error> {
        let mut in_flight = splats.in_flight().await;
        in_flight.settle(&self.gpu, splats, wait).await?;
        gradients.append(&mut in_flight.camera_gradients);
        Ok(())
    }

    async fn step(&self, splats: &mut Splats<S>, gradients: &Gradients<S>, rates: &AdamRates) -> Result<(), Error> {
        gradients.check_len(splats)?;
        rates.validate()?;
        S::check_rates(rates)?;
        let gpu = &self.gpu;
        splats.settle(gpu).await?;
        S::prepare(gpu, splats, Some(rates)).await?;
        let mut workspace = S::pool(&self.pools).take(gpu)?;
        workspace.set(gpu, splats, &gradients.view, &gradients.settings)?;
        let step = workspace.describe(gpu, splats, None, Some(rates));
        let uniform = gpu.allocate("step", size_of::<Step>() as u64, UNIFORM)?;
        gpu.write(&uniform, bytemuck::bytes_of(&step));
        let mut commands = Commands::new(gpu);
        let buffers: Vec<&wgpu::Buffer> = gradients.buffers.iter().collect();
        S::encode_adam(gpu, &mut commands, splats, &uniform, &buffers, None);
        commands.submit(gpu);
        S::pool(&self.pools).give(workspace);
        gpu.check()
    }

    async fn statistics(&self, splats: &Splats<S>) -> Result<DensityStatistics, Error> {
        splats.settle(&self.gpu).await?;
        splats.density_statistics(&self.gpu).await
    }

    async fn edit(&self, splats: &mut Splats<S>, plan: &EditPlan<S::Gaussian>) -> Result<(), Error> {
        splats.settle(&self.gpu).await?;
        splats.edit(&self.gpu, plan).await
    }

    fn add_noise(&self, splats: &mut Splats<S>, noise: &MeanNoise) -> Result<(), Error> {
        noise.validate()?;
        if splats.len == 0 || !splats.state.has_opacity_with(&[]) {
            return Ok(());
        }
        let home = splats.in_flight.get_mut().unwrap_or_else(PoisonError::into_inner);
        let mut in_flight = std::mem::take(home.in_flight());
        let sent = in_flight.add_noise(&self.gpu, splats, noise);
        *splats.in_flight.get_mut().unwrap_or_else(PoisonError::into_inner).in_flight() = in_flight;
        sent.and_then(|()| self.gpu.check())
    }

    async fn solve_colors(
        &self,
        splats: &mut Splats<S>,
        view: &S::View,
        target: &Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        S::check(view, settings)?;
        target.check_size(S::size(view))?;
        if !target.is_complete {
            return Err(unsupported("solving for the colours where the target has an alpha or a mask, or is compact"));
        }
        S::solve_colors(&self.gpu, &self.pools, splats, view, target, settings, iterations).await
    }

    async fn save(&self, splats: &Splats<S>) -> Result<SplatsState, Error> {
        splats.settle(&self.gpu).await?;
        splats.save(&self.gpu).await
    }

    fn restore(&self, state: &SplatsState) -> Result<Splats<S>, Error> {
        Splats::restore(&self.gpu, state)
    }
}
