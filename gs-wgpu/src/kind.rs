//! The difference between 2D and 3D scenes: their parameters on the device, and the stages before
//! `scan` and after `blend_bwd`. The stages in between and the implementation of the traits are
//! shared.

use std::{fmt::Debug, future::Future, sync::Arc};

use gs_core::{AdamRates, Error, Parameterization, RenderSettings, Scene, SplatsState};

use crate::{
    dispatch::Commands,
    fault::unsupported,
    gpu::Gpu,
    layout::Step,
    splats::{Edit, Splats},
    target::Target,
    workspace::{Pool, Pools, Workspace},
};

/// Parameters and Adam moments of one kind on the device.
pub trait State<S: Scene>: Debug + wgpu::WasmNotSendSync + Sized {
    /// The state of a scene's splats.
    fn new(gpu: &Gpu, scene: &S, parameterization: Parameterization) -> Result<Self, Error>;

    /// The parameters of `len` Gaussians.
    fn scene(&self, gpu: &Gpu, len: usize) -> impl Future<Output = Result<S, Error>>;

    /// The state without the statistics, to save.
    fn save(&self, gpu: &Gpu, len: usize) -> impl Future<Output = Result<SplatsState, Error>>;

    /// A saved state of `len` Gaussians.
    fn restore(gpu: &Gpu, state: &SplatsState, len: usize) -> Result<Self, Error>;

    /// Records the commands of an edit, including that of the statistics; returns the edited state.
    fn edit(&self, gpu: &Gpu, commands: &mut Commands, edit: &Edit<'_, S::Gaussian>) -> Result<Self, Error>;

    /// Whether opacities are stored after `fresh` Gaussians were added.
    fn has_opacity_with(&self, _fresh: &[&S::Gaussian]) -> bool {
        true
    }

    /// K, the number of SH coefficients per Gaussian; 0 in 2D.
    fn coefficients(&self) -> usize {
        0
    }

    /// Whether the parameterization is `CovarianceFactor`.
    fn has_factors(&self) -> bool {
        false
    }
}

/// A kind of scene that [`WgpuRasterizer`](crate::WgpuRasterizer) draws and trains:
/// [`Scene2d`](gs_core::Scene2d) or [`Scene3d`](gs_core::Scene3d).
pub trait Kind: Scene<View: PartialEq> + 'static {
    /// Parameters and Adam moments on the device.
    type State: State<Self>;
    /// Buffers of the stages that only this kind has.
    type Buffers: Debug + wgpu::WasmNotSendSync;

    /// Whether several steps may share lists. False for 3D scenes, where each step has another
    /// camera.
    const LISTS_LAST: bool;

    /// Fails for an invalid view or an unsupported effect.
    fn check(view: &Self::View, settings: &RenderSettings) -> Result<(), Error>;

    /// Fails for Adam settings that this kind does not support.
    fn check_rates(_rates: &AdamRates) -> Result<(), Error> {
        Ok(())
    }

    /// Columns and rows of a view's image.
    fn size(view: &Self::View) -> [u32; 2];

    /// The pool of this kind's workspaces.
    fn pool(pools: &Pools) -> &Arc<Pool<Self>>;

    /// Allocates the buffers that moving and editing Gaussians needs, and drawing does not; those
    /// for steps with `rates` in their format.
    fn prepare(
        _gpu: &Gpu,
        _splats: &mut Splats<Self>,
        _rates: Option<&AdamRates>,
    ) -> impl Future<Output = Result<(), Error>> {
        async { Ok(()) }
    }

    /// Empty buffers of the stages that only this kind has.
    fn buffers(gpu: &Gpu) -> Result<Self::Buffers, Error>;

    /// Enlarges these buffers for the splats.
    fn ensure(_workspace: &mut Workspace<Self>, _gpu: &Gpu, _splats: &Splats<Self>) -> Result<(), Error> {
        Ok(())
    }

    /// Bytes of each buffer of gradients.
    fn gradient_bytes(splats: &Splats<Self>, settings: &RenderSettings) -> Vec<u64>;

    /// Adds this kind's numbers to the uniform of a pass.
    fn describe(view: &Self::View, settings: &RenderSettings, splats: &Splats<Self>, step: &mut Step);

    /// Writes the parameters of the view that are not in [`Step`].
    fn write_view(_workspace: &Workspace<Self>, _gpu: &Gpu, _view: &Self::View) {}

    /// Records stage `project` and those after it that bring the splats into the order of blending.
    fn encode_project(
        workspace: &Workspace<Self>,
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        lists: bool,
    );

    /// Records stage `project_bwd`.
    fn encode_project_bwd(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Self>);

    /// Records stage `adam`. With `indirect`, the device sets the sizes of its dispatches, 0 to
    /// skip it.
    fn encode_adam(
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        step: &wgpu::Buffer,
        gradients: &[&wgpu::Buffer],
        indirect: Option<&wgpu::Buffer>,
    );

    /// The gradients of `len` Gaussians as a scene of derivatives.
    fn derivatives(
        gpu: &Gpu,
        splats: &Splats<Self>,
        gradients: &[wgpu::Buffer],
        len: usize,
    ) -> impl Future<Output = Result<Self, Error>>;

    /// The entry point that adds noise to means, and the buffer that has them.
    fn noise(splats: &Splats<Self>) -> (&'static str, &wgpu::Buffer);

    /// Solves for the colours where the image is linear in them.
    fn solve_colors(
        _gpu: &Gpu,
        _pools: &Pools,
        _splats: &mut Splats<Self>,
        _view: &Self::View,
        _target: &Target,
        _settings: &RenderSettings,
        _iterations: u32,
    ) -> impl Future<Output = Result<(), Error>> {
        async { Err(unsupported("solving for the colours of 3D scenes")) }
    }
}
