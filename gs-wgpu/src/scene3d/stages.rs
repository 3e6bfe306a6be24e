//! Commands of the stages that only 3D scenes have, and their buffers.

use gs_core::{Camera, Error, RenderSettings, Scene3d, effects::Order, math::perspective::Perspective};

use crate::{
    dispatch::{Commands, Groups, dispatch},
    gpu::{Gpu, UNIFORM},
    kind::State as _,
    layout,
    layout::{BY_COEFFICIENT, BY_GAUSSIAN},
    lists::{Sorting, Which},
    shaders::{SORT_BITS, SORT_BLOCK, Variant},
    splats::Splats,
    tiles::{Growing, groups_of},
    workspace::Workspace,
};

/// Number of passes of the sort by 32-bit depths: even, so that the result is in the first buffers.
const DEPTH_PASSES: u32 = u32::BITS / SORT_BITS;

/// The buffers that only 3D scenes need.
#[derive(Debug)]
pub struct Buffers3d {
    camera: wgpu::Buffer,
    /// Splats by index.
    pub(crate) projected: Growing,
    /// Number of tiles that each splat touches, by index.
    pub(crate) counts: Growing,
    /// Depths with slopes and indices, for the sort at each pixel.
    pub(crate) pixel_depths: Growing,
    pub(crate) depths: [Growing; 2],
    /// Place → index.
    pub(crate) order: [Growing; 2],
}

impl Buffers3d {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, Error> {
        let growing = |label| Growing::new(gpu, label);
        Ok(Self {
            camera: gpu.allocate("camera", size_of::<layout::Camera>() as u64, UNIFORM)?,
            projected: growing("projected by index")?,
            counts: growing("tile counts")?,
            pixel_depths: growing("depths by pixel")?,
            depths: [growing("depths")?, growing("depths")?],
            order: [growing("order of depth")?, growing("order of depth")?],
        })
    }

    /// Writes the uniform of the camera.
    pub(crate) fn write_camera(&self, gpu: &Gpu, camera: &Camera, settings: &RenderSettings) {
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
        gpu.write(&self.camera, bytemuck::bytes_of(&camera));
    }
}

impl Workspace<Scene3d> {
    /// Records stage `project` by index, the sort by depth if needed, and stage `place`.
    pub(crate) fn encode_splats(&self, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Scene3d>) {
        let Self { tiles, buffers, .. } = self;
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
        let passes = self.depth_passes();
        if passes > 0 {
            let blocks = n.div_ceil(SORT_BLOCK.into());
            let groups = [gpu.groups(blocks).into(), groups_of(gpu, blocks << SORT_BITS, 1024)];
            let (keys, order) = (buffers.depths.each_ref(), buffers.order.each_ref());
            let sorting = Sorting { which: Which::Gaussians, keys, order, passes, groups };
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

    /// Number of passes of the sort by depth; 0 for the order of the scene.
    pub(crate) fn depth_passes(&self) -> u32 {
        let by_depth = self.tiles.variant().over && self.tiles.settings.effects.order != Order::Index;
        if by_depth { DEPTH_PASSES } else { 0 }
    }

    /// Records stage `project_bwd`, with the gradient by the camera into the status if it is asked
    /// for.
    pub(crate) fn encode_splats_bwd(&self, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Scene3d>) {
        let Self { tiles, buffers, gradients, .. } = self;
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

    /// Records the addition of a further loss's gradients.
    pub(crate) fn encode_add(&self, gpu: &Gpu, commands: &mut Commands, added: &[wgpu::Buffer]) {
        let mut bindings = vec![&self.tiles.step];
        bindings.extend(self.gradient_buffers());
        bindings.extend(added);
        let groups = groups_of(gpu, u64::from(self.tiles.gaussians), 64);
        dispatch(gpu, commands, "add_gradients_3d", Variant::default(), &bindings, groups);
    }
}

/// Records stage `adam`.
pub(crate) fn encode_adam(
    gpu: &Gpu,
    commands: &mut Commands,
    splats: &Splats<Scene3d>,
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
