//! [`Kind`] for 3D scenes.

use std::sync::Arc;

use glam::Vec3;
use gs_core::{AdamRates, Camera, Error, Output, RenderSettings, Scene3d};

use super::{
    stages::{self, Buffers3d},
    state::{COLOR_BYTES, State3d},
};
use crate::{
    dispatch::Commands,
    fault::BACKEND,
    gpu::Gpu,
    kind::{Kind, State as _},
    layout::{EllipsoidGradient, SPLAT_BYTES, Step},
    splats::Splats,
    tiles::DEPTH_BYTES,
    workspace::{Pool, Pools, Workspace},
};

impl Kind for Scene3d {
    type State = State3d;
    type Buffers = Buffers3d;

    const LISTS_LAST: bool = false;

    fn check(camera: &Camera, settings: &RenderSettings) -> Result<(), Error> {
        camera.validate()?;
        settings.check_for(BACKEND)
    }

    fn size(camera: &Camera) -> [u32; 2] {
        [camera.width, camera.height]
    }

    fn pool(pools: &Pools) -> &Arc<Pool<Self>> {
        &pools.pool_3d
    }

    async fn prepare(gpu: &Gpu, splats: &mut Splats<Self>, rates: Option<&AdamRates>) -> Result<(), Error> {
        let found = splats.state.moment_format();
        let format = rates.map_or(found.unwrap_or_default(), |rates| rates.color_rest_moments);
        if found.is_some_and(|found| found != format) {
            // A pending step that is repeated needs the moments in its own format.
            splats.settle(gpu).await?;
        }
        splats.state.make_moments(gpu, splats.len, format).await
    }

    fn buffers(gpu: &Gpu) -> Result<Buffers3d, Error> {
        Buffers3d::new(gpu)
    }

    fn ensure(workspace: &mut Workspace<Self>, gpu: &Gpu, splats: &Splats<Self>) -> Result<(), Error> {
        let Workspace { tiles, buffers, .. } = workspace;
        let n = splats.len as u64;
        tiles.ensure_sorting(gpu, n)?;
        buffers.projected.ensure(gpu, n * SPLAT_BYTES)?;
        buffers.counts.ensure(gpu, n * 4)?;
        if tiles.orders_by_pixel() {
            buffers.pixel_depths.ensure(gpu, n * DEPTH_BYTES)?;
        }
        buffers.depths.iter_mut().chain(&mut buffers.order).try_for_each(|growing| growing.ensure(gpu, n * 4))
    }

    /// Bytes of the gradients by the ellipsoids, with those by the camera of each work group if they
    /// are asked for, and by the SH coefficients.
    fn gradient_bytes(splats: &Splats<Self>, settings: &RenderSettings) -> Vec<u64> {
        let n = splats.len as u64;
        let sums = if settings.camera_gradient { n.div_ceil(64) } else { 0 };
        vec![(n + sums) * size_of::<EllipsoidGradient>() as u64, n * splats.state.coefficients() as u64 * COLOR_BYTES]
    }

    fn describe(_: &Camera, settings: &RenderSettings, splats: &Splats<Self>, step: &mut Step) {
        step.coefficients = splats.state.coefficients() as u32;
        step.sh_degree = settings.effects.sh_degree.min(splats.state.sh_degree).into();
        step.output = match settings.output {
            Output::Color => 0,
            Output::InverseDepth => 1,
            Output::Alpha => 2,
        };
        step.dropout_threshold = settings.dropout.threshold();
        step.dropout_seed = settings.dropout.seed;
    }

    fn write_view(workspace: &Workspace<Self>, gpu: &Gpu, camera: &Camera) {
        workspace.buffers.write_camera(gpu, camera, &workspace.tiles.settings);
    }

    fn encode_project(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Self>, _: bool) {
        workspace.encode_splats(gpu, commands, splats);
    }

    fn encode_project_bwd(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Self>) {
        workspace.encode_splats_bwd(gpu, commands, splats);
    }

    fn encode_add(
        workspace: &Workspace<Self>,
        gpu: &Gpu,
        commands: &mut Commands,
        added: &[wgpu::Buffer],
    ) -> Result<(), Error> {
        workspace.encode_add(gpu, commands, added);
        Ok(())
    }

    fn encode_adam(
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        step: &wgpu::Buffer,
        gradients: &[&wgpu::Buffer],
        indirect: Option<&wgpu::Buffer>,
    ) {
        stages::encode_adam(gpu, commands, splats, step, gradients, indirect);
    }

    async fn derivatives(
        gpu: &Gpu,
        splats: &Splats<Self>,
        gradients: &[wgpu::Buffer],
        len: usize,
    ) -> Result<Self, Error> {
        let k = splats.state.coefficients();
        let found: Vec<EllipsoidGradient> = gpu.read(&gradients[0], len).await?;
        let sh: Vec<[f32; 3]> = gpu.read(&gradients[1], len * k).await?;
        let mut scene = Self { sh_degree: splats.state.sh_degree, ..Self::default() };
        for (g, sh) in found.iter().zip(sh.chunks_exact(k)) {
            scene.means.push(Vec3::from_array(g.mean));
            scene.log_scales.push(Vec3::from_array(g.log_scale));
            scene.rotations.push(g.rotation);
            scene.opacity_logits.push(g.opacity_logit);
            scene.sh.extend(sh.iter().map(|&c| if g.visible == 0 { Vec3::ZERO } else { Vec3::from_array(c) }));
        }
        Ok(scene)
    }

    fn noise(splats: &Splats<Self>) -> (&'static str, &wgpu::Buffer) {
        ("add_noise_3d", &splats.state.ellipsoids)
    }
}
