//! The difference between 2D and 3D scenes: their parameters on the device, and the stages before
//! `scan` and after `blend_bwd`. The stages in between and the implementation of the traits are
//! shared.

use std::{fmt::Debug, future::Future, sync::Arc};

use gs_core::{AdamRates, Error, Parameterization, RenderSettings, Scene, SplatsState};

use crate::{
    dispatch::Commands,
    gpu::Gpu,
    layout::Step,
    splats::{Edit, Splats},
    target::Target,
    unsupported::unsupported,
    workspace::{Pool, Pools, Workspace},
};

mod sealed {
    pub trait Sealed {}

    impl Sealed for gs_core::Scene2d {}
    impl Sealed for gs_core::Scene3d {}
}

/// A kind of scene that [`WgpuRasterizer`](crate::WgpuRasterizer) draws and trains.
///
/// Implemented for [`Scene2d`](gs_core::Scene2d) and [`Scene3d`](gs_core::Scene3d), and sealed.
pub trait SceneKind: sealed::Sealed + Scene<View: PartialEq> + 'static {
    /// Parameters and Adam moments on the device.
    #[doc(hidden)]
    type State: Debug + wgpu::WasmNotSendSync;
    /// Buffers of the stages that only this kind has.
    #[doc(hidden)]
    type Own: Debug + wgpu::WasmNotSendSync;

    /// Whether several steps may share lists. False for 3D scenes, where each step has another
    /// camera.
    #[doc(hidden)]
    const LISTS_LAST: bool;

    /// Fails for an invalid view or an unsupported effect.
    #[doc(hidden)]
    fn check(view: &Self::View, settings: &RenderSettings) -> Result<(), Error>;

    /// Fails for Adam settings that this kind does not support.
    #[doc(hidden)]
    fn check_rates(_rates: &AdamRates) -> Result<(), Error> {
        Ok(())
    }

    /// Columns and rows of a view's image.
    #[doc(hidden)]
    fn size(view: &Self::View) -> [u32; 2];

    /// The pool of this kind's workspaces.
    #[doc(hidden)]
    fn pool(pools: &Pools) -> &Arc<Pool<Self>>;

    /// The state of a scene's splats.
    #[doc(hidden)]
    fn upload(gpu: &Gpu, scene: &Self, parameterization: Parameterization) -> Result<Self::State, Error>;

    /// Allocates the buffers that moving and editing Gaussians needs, and drawing does not; those
    /// for steps with `rates` in their format.
    #[doc(hidden)]
    fn prepare(
        _gpu: &Gpu,
        _splats: &mut Splats<Self>,
        _rates: Option<&AdamRates>,
    ) -> impl Future<Output = Result<(), Error>> {
        async { Ok(()) }
    }

    /// The parameters of `len` Gaussians.
    #[doc(hidden)]
    fn download(gpu: &Gpu, state: &Self::State, len: usize) -> impl Future<Output = Result<Self, Error>>;

    /// The state without the statistics, to save.
    #[doc(hidden)]
    fn save(gpu: &Gpu, state: &Self::State, len: usize) -> impl Future<Output = Result<SplatsState, Error>>;

    /// A saved state of `len` Gaussians.
    #[doc(hidden)]
    fn restore(gpu: &Gpu, state: &SplatsState, len: usize) -> Result<Self::State, Error>;

    /// Whether opacities are stored after `fresh` Gaussians were added.
    #[doc(hidden)]
    fn has_opacity(_state: &Self::State, _fresh: &[&Self::Gaussian]) -> bool {
        true
    }

    /// Number of SH coefficients per Gaussian.
    #[doc(hidden)]
    fn coefficients(_state: &Self::State) -> u32 {
        0
    }

    /// Records the commands of an edit, including that of the statistics; returns the edited state.
    #[doc(hidden)]
    fn edit(
        gpu: &Gpu,
        commands: &mut Commands,
        state: &Self::State,
        edit: &Edit<'_, Self::Gaussian>,
    ) -> Result<Self::State, Error>;

    /// Empty buffers of the stages that only this kind has.
    #[doc(hidden)]
    fn own(gpu: &Gpu) -> Result<Self::Own, Error>;

    /// Enlarges these buffers for the splats.
    #[doc(hidden)]
    fn ensure(_workspace: &mut Workspace<Self>, _gpu: &Gpu, _splats: &Splats<Self>) -> Result<(), Error> {
        Ok(())
    }

    /// Bytes of each buffer of gradients.
    #[doc(hidden)]
    fn gradient_bytes(splats: &Splats<Self>) -> Vec<u64>;

    /// Adds this kind's numbers to the uniform of a pass.
    #[doc(hidden)]
    fn describe(view: &Self::View, settings: &RenderSettings, splats: &Splats<Self>, step: &mut Step);

    /// Writes the parameters of the view that are not in [`Step`].
    #[doc(hidden)]
    fn write_view(_workspace: &Workspace<Self>, _gpu: &Gpu, _view: &Self::View) {}

    /// Records stage `project` and those after it that bring the splats into the order of blending.
    #[doc(hidden)]
    fn encode_project(
        workspace: &Workspace<Self>,
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        lists: bool,
    );

    /// Records stage `project_bwd`.
    #[doc(hidden)]
    fn encode_project_bwd(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Self>);

    /// Records the addition of a further loss's gradients, times the weight in the uniform, to those
    /// of `project_bwd`.
    #[doc(hidden)]
    fn encode_add(
        _workspace: &Workspace<Self>,
        _gpu: &Gpu,
        _commands: &mut Commands,
        _added: &[wgpu::Buffer],
    ) -> Result<(), Error> {
        Err(unsupported("added gradients of 2D scenes"))
    }

    /// Records stage `adam`. With `indirect`, the device sets the sizes of its dispatches, 0 to
    /// skip it.
    #[doc(hidden)]
    fn encode_adam(
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        step: &wgpu::Buffer,
        gradients: &[&wgpu::Buffer],
        indirect: Option<&wgpu::Buffer>,
    );

    /// The gradients of `len` Gaussians as a scene of derivatives.
    #[doc(hidden)]
    fn derivatives(
        gpu: &Gpu,
        splats: &Splats<Self>,
        gradients: &[wgpu::Buffer],
        len: usize,
    ) -> impl Future<Output = Result<Self, Error>>;

    /// The entry point that adds noise to means, and the buffer that has them.
    #[doc(hidden)]
    fn noise(splats: &Splats<Self>) -> (&'static str, &wgpu::Buffer);

    /// Whether the parameterization is `CovarianceFactor`.
    #[doc(hidden)]
    fn has_factors(_state: &Self::State) -> bool {
        false
    }

    /// Solves for the colours where the image is linear in them.
    #[doc(hidden)]
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
