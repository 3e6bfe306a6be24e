//! The trait's implementation: checks what comes in, and sends the stages to the device.

use std::sync::{Arc, PoisonError};

use gs_core::{
    AdamRates, Blend, Canvas, Chart, CloudState, DensityStatistics, EditPlan, Error, Image, Loss, Participants,
    PlanarGaussian, PlanarScene, Rasterizer, RenderSettings, TrainStep, Wait,
    effects::{Antialias, Order, Outputs, Statistics},
    settings::Cut,
    statistics::Culled,
};

use crate::{
    PlanarCloud, PlanarFrame, PlanarGradients, PlanarTarget, WgpuSettings,
    cloud::UNIFORM,
    dispatch::Commands,
    frame::Pool,
    gpu::{AdapterSummary, BACKEND, Gpu},
    in_flight::Request,
    layout::{Status, Step},
    shaders::Kernels,
    workspace::{Differentiated, Workspace, encode_adam},
};

/// The GPU backend: owns its device, and the buffers that its frames use in turn.
#[derive(Debug)]
pub struct WgpuRasterizer {
    pub(crate) gpu: Gpu,
    pub(crate) pool: Arc<Pool>,
}

impl WgpuRasterizer {
    /// A rasterizer with a device of its own.
    ///
    /// # Errors
    /// [`Error::Backend`] where there is no adapter, none of that name, or it gives no device.
    pub fn new(settings: WgpuSettings) -> Result<Self, Error> {
        Ok(Self { gpu: Gpu::new(&settings)?, pool: Arc::default() })
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

    /// Gives the device up, as if the driver had crashed: every later call is an [`Error::Backend`]. For tests of what a program does then.
    pub fn lose_device(&self) {
        self.gpu.lose();
    }

    /// Runs `encode` on lists made anew, with more room until they fit; what became of it.
    pub(crate) fn with_lists(
        &self,
        workspace: &mut Workspace,
        cloud: &PlanarCloud,
        step: impl Fn(&Workspace) -> Step,
        mut encode: impl FnMut(&mut Workspace, &mut Commands) -> Result<(), Error>,
    ) -> Result<Status, Error> {
        loop {
            workspace.write_step(&self.gpu, &step(workspace));
            let mut commands = Commands::new(&self.gpu);
            workspace.encode_lists(&self.gpu, &mut commands, cloud, true);
            encode(workspace, &mut commands)?;
            commands.submit(&self.gpu);
            let status = workspace.read_status(&self.gpu)?;
            if status.overflow == 0 {
                workspace.edition = Some(cloud.edition);
                return Ok(status);
            }
            workspace.make_room(&self.gpu, &status)?;
        }
    }
}

pub(crate) fn check(view: &Canvas, settings: &RenderSettings) -> Result<(), Error> {
    view.validate()?;
    settings.validate()?;
    let effects = &settings.effects;
    let unsupported = |effect: String| Err(Error::Unsupported { backend: BACKEND, effect });
    if effects.order != Order::Index {
        return unsupported(format!("order {:?} of a planar scene, which has no depth", effects.order));
    }
    if effects.antialias != Antialias::None {
        return unsupported(format!("antialias {:?} of a planar scene", effects.antialias));
    }
    if effects.outputs != Outputs::Color {
        return unsupported(format!("outputs {:?} of a planar scene", effects.outputs));
    }
    if let Statistics::AbsoluteGradient | Statistics::PixelError = effects.statistics {
        let sums = "which its kernels do not sum; a policy by mean gradient, or the CPU, does without";
        return unsupported(format!("statistics {:?}, {sums}", effects.statistics));
    }
    if settings.accuracy.cut != Cut::Hard {
        return unsupported("a smooth cut, which would touch every pixel".to_owned());
    }
    Ok(())
}

fn check_rates(rates: &AdamRates) -> Result<(), Error> {
    if rates.participants != Participants::All {
        let effect = format!("Adam steps of participants {:?}", rates.participants);
        return Err(Error::Unsupported { backend: BACKEND, effect });
    }
    Ok(())
}

impl Rasterizer<PlanarScene> for WgpuRasterizer {
    type Cloud = PlanarCloud;
    type Frame = PlanarFrame;
    type Gradients = PlanarGradients;
    type Target = PlanarTarget;

    fn describe(&self) -> String {
        let AdapterSummary { name, kind, interface, .. } = &self.gpu.adapter;
        format!("wgpu ({name}, {kind}, {interface})")
    }

    fn upload(&self, scene: &PlanarScene, chart: Chart) -> Result<PlanarCloud, Error> {
        PlanarCloud::new(&self.gpu, scene, chart)
    }

    fn download(&self, cloud: &PlanarCloud) -> Result<PlanarScene, Error> {
        cloud.settle(&self.gpu)?;
        cloud.scene(&self.gpu)
    }

    fn len(&self, cloud: &PlanarCloud) -> usize {
        cloud.len
    }

    fn upload_target(&self, image: &Image) -> Result<PlanarTarget, Error> {
        PlanarTarget::new(&self.gpu, image)
    }

    fn save(&self, cloud: &PlanarCloud) -> Result<CloudState, Error> {
        cloud.settle(&self.gpu)?;
        cloud.save(&self.gpu)
    }

    fn restore(&self, state: &CloudState) -> Result<PlanarCloud, Error> {
        PlanarCloud::restore(&self.gpu, state)
    }

    fn forward(&self, cloud: &PlanarCloud, view: &Canvas, settings: &RenderSettings) -> Result<PlanarFrame, Error> {
        check(view, settings)?;
        cloud.settle(&self.gpu)?;
        let mut workspace = self.pool.take(&self.gpu)?;
        workspace.set(&self.gpu, cloud, view, settings)?;
        let status = self.with_lists(
            &mut workspace,
            cloud,
            |w| w.describe(cloud, None, None),
            |w, commands| {
                w.encode_blend(&self.gpu, commands, cloud);
                Ok(())
            },
        )?;
        Ok(PlanarFrame { workspace: Some(workspace), status, pool: Arc::clone(&self.pool) })
    }

    fn image(&self, frame: &PlanarFrame) -> Result<Image, Error> {
        frame.image(&self.gpu)
    }

    fn culled(&self, frame: &PlanarFrame) -> Result<Culled, Error> {
        Ok(frame.culled())
    }

    fn backward(
        &self,
        cloud: &PlanarCloud,
        mut frame: PlanarFrame,
        target: &PlanarTarget,
        loss: &Loss,
    ) -> Result<(f32, PlanarGradients), Error> {
        loss.validate()?;
        let gpu = &self.gpu;
        let workspace = frame.workspace.as_mut().expect("a frame has its workspace until it is dropped");
        target.check_size(workspace.canvas.width, workspace.canvas.height)?;
        if workspace.edition != Some(cloud.edition) {
            return Err(Error::State("the frame is of another cloud, or of this one before an edit".to_owned()));
        }
        cloud.settle(gpu)?;
        workspace.write_step(gpu, &workspace.describe(cloud, Some(*loss), None));
        let mut commands = Commands::new(gpu);
        workspace.encode_loss(gpu, &mut commands, target, Some(*loss))?;
        workspace.encode_blend_bwd(gpu, &mut commands, cloud, Differentiated::Loss);
        workspace.encode_project_bwd(gpu, &mut commands, cloud);
        let source = &workspace.gradients.buffer;
        let buffer = gpu.allocate("gradients", source.size(), crate::gpu::STORAGE)?;
        commands.encoder().copy_buffer_to_buffer(source, 0, &buffer, 0, source.size());
        commands.submit(gpu);
        let value = workspace.read_status(gpu)?.loss;
        let gradients = PlanarGradients {
            buffer,
            len: cloud.len,
            statistics: workspace.settings.effects.statistics,
            opaque: workspace.settings.effects.blend == Blend::Sum || !cloud.has_opacity,
        };
        Ok((value, gradients))
    }

    fn download_gradients(&self, cloud: &PlanarCloud, gradients: &PlanarGradients) -> Result<PlanarScene, Error> {
        gradients.check_len(cloud)?;
        cloud.settle(&self.gpu)?;
        gradients.as_scene(&self.gpu, cloud)
    }

    fn step(&self, cloud: &mut PlanarCloud, gradients: &PlanarGradients, rates: &AdamRates) -> Result<(), Error> {
        gradients.check_len(cloud)?;
        check_rates(rates)?;
        let gpu = &self.gpu;
        cloud.settle(gpu)?;
        let mut workspace = self.pool.take(gpu)?;
        let mut settings = RenderSettings::default();
        settings.effects.statistics = gradients.statistics;
        workspace.set(gpu, cloud, &Canvas::new(1, 1), &settings)?;
        let opaque = u32::from(gradients.opaque);
        let step = Step { opaque, ..workspace.describe(cloud, None, Some(rates)) };
        let uniform = gpu.allocate("step", size_of::<Step>() as u64, UNIFORM)?;
        gpu.write(&uniform, bytemuck::bytes_of(&step));
        let mut commands = Commands::new(gpu);
        let groups = gpu.groups((cloud.len as u64).div_ceil(64)).into();
        encode_adam(gpu, &mut commands, cloud, &uniform, &gradients.buffer, groups);
        commands.submit(gpu);
        self.pool.give(workspace);
        gpu.check()
    }

    fn train_step(
        &self,
        cloud: &mut PlanarCloud,
        view: &Canvas,
        target: &PlanarTarget,
        step: &TrainStep<'_>,
    ) -> Result<(), Error> {
        check(view, step.settings)?;
        step.loss.validate()?;
        check_rates(step.rates)?;
        target.check_size(view.width, view.height)?;
        cloud.in_flight().train(&self.gpu, &self.pool, cloud, Request::new(view, target, step))
    }

    fn losses(&self, cloud: &mut PlanarCloud, wait: Wait, losses: &mut Vec<f32>) -> Result<(), Error> {
        cloud.in_flight().settle(&self.gpu, cloud, wait)?;
        losses.append(self.unread_losses(cloud));
        Ok(())
    }

    fn unread_losses<'c>(&self, cloud: &'c mut PlanarCloud) -> &'c mut Vec<f32> {
        &mut cloud.in_flight.get_mut().unwrap_or_else(PoisonError::into_inner).losses
    }

    fn solve_colors(
        &self,
        cloud: &mut PlanarCloud,
        view: &Canvas,
        target: &PlanarTarget,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        check(view, settings)?;
        target.check_size(view.width, view.height)?;
        if settings.effects.blend != Blend::Sum {
            return Err(Error::Unsupported {
                backend: BACKEND,
                effect: "solving for colours under `over`, where the image is not linear in them".to_owned(),
            });
        }
        let gpu = &self.gpu;
        cloud.settle(gpu)?;
        let mut workspace = self.pool.take(gpu)?;
        workspace.set(gpu, cloud, view, settings)?;
        let describe = |w: &Workspace| w.describe(cloud, None, None);
        self.with_lists(&mut workspace, cloud, describe, |_, _| Ok(()))?;
        let step = describe(&workspace);
        let without_backdrop = gpu.storage("step", &[Step { backdrop: [0.0; 3], ..step }])?;
        workspace.write_step(gpu, &step);
        let mut commands = Commands::new(gpu);
        workspace.encode_solve(gpu, &mut commands, cloud, target, iterations, &without_backdrop)?;
        commands.submit(gpu);
        self.pool.give(workspace);
        gpu.check()
    }

    fn statistics(&self, cloud: &PlanarCloud) -> Result<DensityStatistics, Error> {
        cloud.settle(&self.gpu)?;
        cloud.density_statistics(&self.gpu)
    }

    fn edit(&self, cloud: &mut PlanarCloud, plan: &EditPlan<PlanarGaussian>) -> Result<(), Error> {
        cloud.settle(&self.gpu)?;
        cloud.edit(&self.gpu, plan)
    }
}
