//! [`Kind`] for 2D scenes.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use gs_core::{
    AdamRates, Blend, Canvas, Error, Parameterization, Penalty, RenderSettings, Scene2d,
    math::whitened::WhitenedGradient,
};

use super::{solve_colors::solve_colors, state::State2d};
use crate::{
    dispatch::{Commands, Groups, dispatch, dispatch_some},
    fault::{BACKEND, unsupported},
    gpu::Gpu,
    kind::{Kind, State as _},
    layout::{BY_GAUSSIAN, Gaussian, Gradient, Step},
    shaders::Variant,
    splats::Splats,
    target::Target,
    tiles::{Growing, groups_of},
    workspace::{Pool, Pools, Workspace},
};

/// The vectors and scalars of `solve_colors`.
#[derive(Debug)]
pub struct Buffers2d {
    pub(crate) vectors: Growing,
    pub(crate) scalars: Growing,
}

fn in_parameterization(splats: &Splats<Scene2d>) -> Variant {
    Variant { covariance_factor: splats.state.has_factors(), ..Variant::default() }
}

impl Kind for Scene2d {
    type State = State2d;
    type Buffers = Buffers2d;

    const LISTS_LAST: bool = true;

    fn check(view: &Canvas, settings: &RenderSettings) -> Result<(), Error> {
        view.validate()?;
        settings.check_for_2d(BACKEND)
    }

    fn check_rates(rates: &AdamRates) -> Result<(), Error> {
        if rates.penalty != Penalty::NONE {
            return Err(unsupported("a penalty on the opacities and scales of a 2D scene"));
        }
        Ok(())
    }

    fn size(view: &Canvas) -> [u32; 2] {
        [view.width, view.height]
    }

    fn pool(pools: &Pools) -> &Arc<Pool<Self>> {
        &pools.pool_2d
    }

    fn buffers(gpu: &Gpu) -> Result<Buffers2d, Error> {
        Ok(Buffers2d {
            vectors: Growing::new(gpu, "vectors of conjugate gradients")?,
            scalars: Growing::new(gpu, "scalars of conjugate gradients")?,
        })
    }

    fn gradient_bytes(splats: &Splats<Self>, _: &RenderSettings) -> Vec<u64> {
        vec![(splats.len * size_of::<Gradient>()) as u64]
    }

    fn describe(view: &Canvas, settings: &RenderSettings, splats: &Splats<Self>, step: &mut Step) {
        step.origin = view.origin.to_array();
        step.pixels_per_unit = view.scale().to_array();
        let effects = &settings.effects;
        step.opaque = u32::from(effects.blend == Blend::Sum || !splats.state.has_opacity);
        step.dilation = effects.antialias.dilation();
        step.compensates = u32::from(effects.blend == Blend::Over && effects.antialias.compensates());
    }

    fn encode_project(
        workspace: &Workspace<Self>,
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        lists: bool,
    ) {
        let tiles = &workspace.tiles;
        let (step, status, projected) = (&tiles.step, &tiles.status, &tiles.projected.buffer);
        let variant = Variant { lists, ..in_parameterization(splats) };
        let groups = groups_of(gpu, u64::from(tiles.gaussians) + 1, 64);
        let gaussians = &splats.state.gaussians;
        if lists {
            let bindings = [step, gaussians, projected, &tiles.offsets.buffer, status];
            dispatch(gpu, commands, "project", variant, &bindings, groups);
        } else {
            let bindings = [step, gaussians, projected, status];
            dispatch_some(gpu, commands, "project", variant, (&[0, 1, 2, 4], &bindings), groups);
        }
    }

    fn encode_project_bwd(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Self>) {
        let tiles = &workspace.tiles;
        let bindings = [
            &tiles.step,
            &splats.state.gaussians,
            &tiles.projected.buffer,
            &tiles.offsets.buffer,
            &tiles.slots.buffer,
            &workspace.gradients[0].buffer,
        ];
        let groups = groups_of(gpu, u64::from(tiles.gaussians), 64);
        let variant = Variant { covariance_factor: in_parameterization(splats).covariance_factor, ..tiles.variant() };
        dispatch(gpu, commands, "project_bwd", variant, &bindings, groups);
    }

    fn encode_adam(
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        step: &wgpu::Buffer,
        gradients: &[&wgpu::Buffer],
        indirect: Option<&wgpu::Buffer>,
    ) {
        let State2d { gaussians, moments, .. } = &splats.state;
        let groups = match indirect {
            Some(sizes) => Groups::Indirect(sizes, BY_GAUSSIAN),
            None => groups_of(gpu, splats.len as u64, 64),
        };
        let bindings = [step, gradients[0], gaussians, moments, &splats.statistics];
        dispatch(gpu, commands, "adam", in_parameterization(splats), &bindings, groups);
    }

    async fn derivatives(
        gpu: &Gpu,
        splats: &Splats<Self>,
        gradients: &[wgpu::Buffer],
        len: usize,
    ) -> Result<Self, Error> {
        let found: Vec<Gradient> = gpu.read(&gradients[0], len).await?;
        let mut scene = Self::default();
        for (gradient, gaussian) in found.iter().zip(splats.state.download_gaussians(gpu, splats.len).await?) {
            let (mean, [x, y, angle]) = match gradient.visible {
                0 => (Vec2::ZERO, [0.0; 3]),
                _ => by_scale_rotation(&splats.state, &gaussian, gradient),
            };
            scene.means.push(mean);
            scene.log_scales.push(Vec2::new(x, y));
            scene.rotations.push(angle);
            scene.colors.push(Vec3::from_array(gradient.color));
            if splats.state.has_opacity {
                scene.opacity_logits.push(gradient.opacity_logit);
            }
        }
        Ok(scene)
    }

    fn noise(splats: &Splats<Self>) -> (&'static str, &wgpu::Buffer) {
        ("add_noise", &splats.state.gaussians)
    }

    async fn solve_colors(
        gpu: &Gpu,
        pools: &Pools,
        splats: &mut Splats<Self>,
        view: &Canvas,
        target: &Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error> {
        solve_colors(gpu, pools, splats, view, target, settings, iterations).await
    }
}

fn by_scale_rotation(state: &State2d, gaussian: &Gaussian, gradient: &Gradient) -> (Vec2, [f32; 3]) {
    let whitened = WhitenedGradient { xi: Vec2::from_array(gradient.xi), eta: gradient.eta };
    let l = state.factor(gaussian);
    let (l, log_ratio, whitened) = match state.parameterization {
        Parameterization::ScaleRotation => (l, gaussian.shape[0] - gaussian.shape[1], whitened),
        Parameterization::CovarianceFactor => whitened.in_axes(l),
    };
    whitened.by_scale_rotation(l, log_ratio)
}
