//! What the backend needs to know about planar scenes.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use gs_core::{
    AdamRates, Blend, Canvas, Chart, CloudState, Error, Penalty, PlanarGaussian, PlanarScene, RenderSettings,
    effects::{Antialias, Order, Statistics as Collected},
    profile::Traffic,
    whitened::WhitenedGradient,
};

use super::{solve_colors::solve_colors, state::PlanarState};
use crate::{
    WgpuRasterizer,
    cloud::{Cloud, Edit},
    dispatch::{Commands, Groups, dispatch, dispatch_some},
    frame::{Gradients, Pool},
    gpu::Gpu,
    kind::Kind,
    layout::{Gaussian, Gradient, Moments, SPLAT_BYTES, Statistics, Step},
    profile::Stage,
    rasterizer::{check_settings, unsupported},
    shaders::{Kernels, LANES, Variant},
    target::Target,
    tiles::{BY_GAUSSIAN, Growing, groups_of},
    traffic::{INDEX, size},
    workspace::Workspace,
};

/// The vectors and scalars of `solve_colors`.
#[derive(Debug)]
pub struct PlanarOwn {
    pub(crate) vectors: Growing,
    pub(crate) scalars: Growing,
}

fn in_chart(cloud: &Cloud<PlanarScene>) -> Variant {
    Variant { local_frame: cloud.state.chart == Chart::LocalFrame, ..Variant::default() }
}

impl Kind for PlanarScene {
    type State = PlanarState;
    type Own = PlanarOwn;

    const LISTS_LAST: bool = true;

    fn check(view: &Canvas, settings: &RenderSettings) -> Result<(), Error> {
        view.validate()?;
        check_settings(settings)?;
        let effects = &settings.effects;
        if effects.order != Order::Index {
            return Err(unsupported(format!("order {:?} of a planar scene, which has no depth", effects.order)));
        }
        if effects.antialias != Antialias::None {
            return Err(unsupported(format!("antialias {:?} of a planar scene", effects.antialias)));
        }
        Ok(())
    }

    fn check_rates(rates: &AdamRates) -> Result<(), Error> {
        if rates.penalty != Penalty::NONE {
            return Err(unsupported("a penalty on the opacities and scales of a planar scene"));
        }
        Ok(())
    }

    fn size(view: &Canvas) -> [u32; 2] {
        [view.width, view.height]
    }

    fn pool(rasterizer: &WgpuRasterizer) -> &Arc<Pool<Self>> {
        &rasterizer.planar
    }

    fn upload(gpu: &Gpu, scene: &Self, chart: Chart) -> Result<PlanarState, Error> {
        PlanarState::new(gpu, scene, chart)
    }

    fn prepare(_: &Gpu, _: &mut PlanarState, _: usize) -> Result<(), Error> {
        Ok(())
    }

    fn download(gpu: &Gpu, state: &PlanarState, len: usize) -> Result<Self, Error> {
        state.scene(gpu, len)
    }

    fn save(gpu: &Gpu, state: &PlanarState, len: usize) -> Result<CloudState, Error> {
        state.save(gpu, len)
    }

    fn restore(gpu: &Gpu, state: &CloudState, len: usize) -> Result<PlanarState, Error> {
        PlanarState::restore(gpu, state, len)
    }

    fn has_opacity(state: &PlanarState, fresh: &[&PlanarGaussian]) -> bool {
        state.has_opacity_with(fresh)
    }

    fn coefficients(_: &PlanarState) -> u32 {
        0
    }

    fn edit(
        gpu: &Gpu,
        commands: &mut Commands,
        state: &PlanarState,
        edit: &Edit<'_, PlanarGaussian>,
    ) -> Result<PlanarState, Error> {
        state.edit(gpu, commands, edit)
    }

    fn own(gpu: &Gpu) -> Result<PlanarOwn, Error> {
        Ok(PlanarOwn {
            vectors: Growing::new(gpu, "vectors of conjugate gradients")?,
            scalars: Growing::new(gpu, "scalars of conjugate gradients")?,
        })
    }

    fn ensure(_: &mut Workspace<Self>, _: &Gpu, _: &Cloud<Self>) -> Result<(), Error> {
        Ok(())
    }

    fn gradient_bytes(cloud: &Cloud<Self>) -> Vec<u64> {
        vec![(cloud.len * size_of::<Gradient>()) as u64]
    }

    fn describe(view: &Canvas, settings: &RenderSettings, cloud: &Cloud<Self>, step: &mut Step) {
        step.origin = view.origin.to_array();
        step.pixels_per_unit = view.scale().to_array();
        step.opaque = u32::from(settings.effects.blend == Blend::Sum || !cloud.state.has_opacity);
    }

    fn write_view(_: &Workspace<Self>, _: &Gpu, _: &Canvas) {}

    fn encode_project(
        workspace: &Workspace<Self>,
        gpu: &Gpu,
        commands: &mut Commands,
        cloud: &Cloud<Self>,
        lists: bool,
    ) {
        let tiles = &workspace.tiles;
        let (step, status, splats) = (&tiles.step, &tiles.status, &tiles.splats.buffer);
        let variant = Variant { lists, ..in_chart(cloud) };
        let groups = groups_of(gpu, u64::from(tiles.gaussians) + 1, 64);
        let gaussians = &cloud.state.gaussians;
        if lists {
            let bindings = [step, gaussians, splats, &tiles.offsets.buffer, status];
            dispatch(gpu, commands, "project", variant, &bindings, groups);
        } else {
            let bindings = [step, gaussians, splats, status];
            dispatch_some(gpu, commands, "project", variant, (&[0, 1, 2, 4], &bindings), groups);
        }
    }

    fn encode_project_bwd(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, cloud: &Cloud<Self>) {
        let tiles = &workspace.tiles;
        let bindings = [
            &tiles.step,
            &cloud.state.gaussians,
            &tiles.splats.buffer,
            &tiles.offsets.buffer,
            &tiles.slots.buffer,
            &workspace.gradients[0].buffer,
        ];
        let invocations = if gpu.kernels == Kernels::Vectors { LANES } else { 64 };
        let groups = groups_of(gpu, u64::from(tiles.gaussians), invocations.into());
        let variant = Variant { local_frame: in_chart(cloud).local_frame, ..tiles.variant() };
        dispatch(gpu, commands, "project_bwd", variant, &bindings, groups);
    }

    fn encode_adam(
        gpu: &Gpu,
        commands: &mut Commands,
        cloud: &Cloud<Self>,
        step: &wgpu::Buffer,
        gradients: &[&wgpu::Buffer],
        indirect: Option<&wgpu::Buffer>,
    ) {
        let PlanarState { gaussians, moments, .. } = &cloud.state;
        let groups = match indirect {
            Some(sizes) => Groups::Indirect(sizes, BY_GAUSSIAN),
            None => groups_of(gpu, cloud.len as u64, 64),
        };
        let bindings = [step, gradients[0], gaussians, moments, &cloud.statistics];
        dispatch(gpu, commands, "adam", in_chart(cloud), &bindings, groups);
    }

    fn derivatives(gpu: &Gpu, cloud: &Cloud<Self>, gradients: &Gradients<Self>) -> Result<Self, Error> {
        let found: Vec<Gradient> = gpu.read(&gradients.buffers[0], gradients.len)?;
        let mut scene = Self::default();
        for (gradient, gaussian) in found.iter().zip(cloud.state.download_gaussians(gpu, cloud.len)?) {
            let (mean, [x, y, angle]) = match gradient.visible {
                0 => (Vec2::ZERO, [0.0; 3]),
                _ => by_scale_rotation(&cloud.state, &gaussian, gradient),
            };
            scene.means.push(mean);
            scene.log_scales.push(Vec2::new(x, y));
            scene.rotations.push(angle);
            scene.colors.push(Vec3::from_array(gradient.color));
            if cloud.state.has_opacity {
                scene.opacity_logits.push(gradient.opacity_logit);
            }
        }
        Ok(scene)
    }

    fn solve_colors(
        rasterizer: &WgpuRasterizer,
        cloud: &mut Cloud<Self>,
        view: &Canvas,
        target: &Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        solve_colors(rasterizer, cloud, view, target, settings, iterations)
    }

    fn traffic(stage: Stage, workspace: &Workspace<Self>, cloud: &Cloud<Self>) -> Traffic {
        let n = cloud.len as u64;
        let (read, written) = match stage {
            Stage::Project => (n * size::<Gaussian>(), n * (SPLAT_BYTES + INDEX)),
            Stage::ProjectBwd => (n * (size::<Gaussian>() + SPLAT_BYTES + INDEX), n * size::<Gradient>()),
            Stage::Adam => {
                let collected = workspace.tiles.settings.effects.statistics != Collected::None;
                let statistics = if collected { size::<Statistics>() } else { 0 };
                let state = size::<Gaussian>() + size::<Moments>() + statistics;
                (n * (size::<Gradient>() + state), n * state)
            }
            _ => (0, 0),
        };
        Traffic { read, written }
    }
}

fn by_scale_rotation(state: &PlanarState, gaussian: &Gaussian, gradient: &Gradient) -> (Vec2, [f32; 3]) {
    let whitened = WhitenedGradient { xi: Vec2::from_array(gradient.xi), eta: gradient.eta };
    let l = state.frame(gaussian);
    let (l, log_ratio, whitened) = match state.chart {
        Chart::ScaleRotation => (l, gaussian.shape[0] - gaussian.shape[1], whitened),
        Chart::LocalFrame => whitened.in_axes(l),
    };
    whitened.by_scale_rotation(l, log_ratio)
}
