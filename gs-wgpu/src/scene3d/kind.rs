//! [`Kind`] for 3D scenes.

use std::sync::Arc;

use glam::Vec3;
use gs_core::{
    AdamRates, Camera, Error, Output, RenderSettings, Scene3d, effects::Order, math::perspective::Perspective,
};

use super::state::{COLOR_BYTES, State3d};
use crate::{
    dispatch::{Commands, Groups, dispatch},
    fault::BACKEND,
    gpu::{Gpu, UNIFORM},
    kind::{Kind, State as _},
    layout::{self, BY_COEFFICIENT, BY_GAUSSIAN, EllipsoidGradient, SPLAT_BYTES, Step},
    lists::{Sorting, Which},
    shaders::{SORT_BITS, SORT_BLOCK, Variant},
    splats::Splats,
    tiles::{DEPTH_BYTES, Growing, groups_of},
    workspace::{Pool, Pools, Workspace},
};

/// Number of passes of the sort by 32-bit depths: even, so that the result is in the first buffers.
const DEPTH_PASSES: u32 = u32::BITS / SORT_BITS;

/// The buffers that only 3D scenes need.
#[derive(Debug)]
pub struct Buffers3d {
    camera: wgpu::Buffer,
    /// Splats by index.
    projected: Growing,
    /// Number of tiles that each splat touches, by index.
    counts: Growing,
    /// Depths with slopes and indices, for the sort at each pixel.
    pixel_depths: Growing,
    depths: [Growing; 2],
    /// Place → index.
    order: [Growing; 2],
}

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
        let growing = |label| Growing::new(gpu, label);
        Ok(Buffers3d {
            camera: gpu.allocate("camera", size_of::<layout::Camera>() as u64, UNIFORM)?,
            projected: growing("projected by index")?,
            counts: growing("tile counts")?,
            pixel_depths: growing("depths by pixel")?,
            depths: [growing("depths")?, growing("depths")?],
            order: [growing("order of depth")?, growing("order of depth")?],
        })
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
        let settings = &workspace.tiles.settings;
        let [least_slope, most_slope] = Perspective::new(camera, settings).slopes();
        let antialias = settings.effects.antialias;
        let row = |i: usize| camera.rotation.row(i).extend(camera.translation[i]).to_array();
        let camera = layout::Camera {
            world_to_camera: [row(0), row(1), row(2)],
            position: camera.position().to_array(),
            near: camera.near,
            focal: camera.focal.to_array(),
            center: camera.center.to_array(),
            least_slope: least_slope.to_array(),
            most_slope: most_slope.to_array(),
            dilation: antialias.dilation(),
            compensates: u32::from(antialias.compensates()),
            full_depth: settings.full_depth,
            unused: 0,
        };
        gpu.write(&workspace.buffers.camera, bytemuck::bytes_of(&camera));
    }

    fn encode_project(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Self>, _: bool) {
        let Workspace { tiles, buffers, .. } = workspace;
        let n = u64::from(tiles.gaussians);
        let by_pixel = tiles.orders_by_pixel();
        let variant = Variant { by_pixel, ..Variant::default() };
        let mut bindings = vec![
            &tiles.step,
            &buffers.camera,
            &splats.state.ellipsoids,
            &splats.state.sh,
            &buffers.projected.buffer,
            &buffers.counts.buffer,
            &buffers.depths[0].buffer,
            &buffers.order[0].buffer,
            &tiles.status,
        ];
        if by_pixel {
            bindings.push(&buffers.pixel_depths.buffer);
        }
        dispatch(gpu, commands, "project_3d", variant, &bindings, groups_of(gpu, n, 64));
        // The order of the scene needs no sort by depth.
        let by_depth = tiles.variant().over && tiles.settings.effects.order != Order::Index;
        if by_depth {
            let blocks = n.div_ceil(SORT_BLOCK.into());
            let groups = [gpu.groups(blocks).into(), groups_of(gpu, blocks << SORT_BITS, 1024)];
            let (keys, order) = (buffers.depths.each_ref(), buffers.order.each_ref());
            let sorting = Sorting { which: Which::Gaussians, keys, order, passes: DEPTH_PASSES, groups };
            tiles.encode_sorting(gpu, commands, &sorting);
        }
        let mut bindings = vec![
            &tiles.step,
            &buffers.order[0].buffer,
            &buffers.projected.buffer,
            &buffers.counts.buffer,
            &tiles.projected.buffer,
            &tiles.offsets.buffer,
        ];
        if by_pixel {
            bindings.extend([&buffers.pixel_depths.buffer, &tiles.depths.buffer]);
        }
        dispatch(gpu, commands, "place", variant, &bindings, groups_of(gpu, n + 1, 64));
    }

    fn encode_project_bwd(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Self>) {
        let Workspace { tiles, buffers, gradients, .. } = workspace;
        let bindings = [
            &tiles.step,
            &buffers.camera,
            &tiles.projected.buffer,
            &tiles.offsets.buffer,
            &tiles.slots.buffer,
            &gradients[0].buffer,
            &splats.state.ellipsoids,
            &splats.state.sh,
            &gradients[1].buffer,
            &buffers.order[0].buffer,
        ];
        let groups = groups_of(gpu, u64::from(tiles.gaussians), 64);
        let camera = tiles.settings.camera_gradient;
        dispatch(gpu, commands, "project_bwd_3d", Variant { camera, ..tiles.variant() }, &bindings, groups);
        if camera {
            let bindings = [&tiles.step, &gradients[0].buffer, &tiles.status];
            dispatch(gpu, commands, "camera_gradient_3d", Variant::default(), &bindings, Groups::Direct(1, 1));
        }
    }

    fn encode_adam(
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        step: &wgpu::Buffer,
        gradients: &[&wgpu::Buffer],
        indirect: Option<&wgpu::Buffer>,
    ) {
        let (n, state) = (splats.len as u64, &splats.state);
        let groups = |offset: u64, count: u64| match indirect {
            Some(sizes) => Groups::Indirect(sizes, offset),
            None => groups_of(gpu, count, 64),
        };
        let moments = state.moments();
        let bindings = [step, gradients[0], &state.ellipsoids, &moments.geometry, &splats.statistics];
        dispatch(gpu, commands, "adam_3d", Variant::default(), &bindings, groups(BY_GAUSSIAN, n));
        let [first, second] = &moments.sh;
        let bindings = [step, gradients[0], &state.ellipsoids, gradients[1], &state.sh, first, second];
        let by_coefficient = groups(BY_COEFFICIENT, n * state.coefficients() as u64);
        dispatch(gpu, commands, "adam_color_3d", moments.variant(), &bindings, by_coefficient);
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
