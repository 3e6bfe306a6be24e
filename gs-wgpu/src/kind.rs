//! What this backend needs to know about a kind of scene: its parameters on the device, and the stages before `scan` and after `blend_bwd`.
//! All that lies between, and the trait's implementation around it, is written once.

use std::{fmt::Debug, future::Future, sync::Arc};

use gs_core::{AdamRates, Error, Parameterization, RenderSettings, Scene, SplatsState};

use crate::{
    WgpuRasterizer,
    dispatch::Commands,
    forward_pass::{Gradients, Pool},
    gpu::Gpu,
    layout::Step,
    splats::{Edit, Splats},
    target::Target,
    workspace::Workspace,
};

mod sealed {
    pub trait Sealed {}

    impl Sealed for gs_core::Scene2d {}
    impl Sealed for gs_core::Scene3d {}
}

/// A kind of scene that [`WgpuRasterizer`] is a rasterizer for: a 2D or a 3D scene.
///
/// Implemented for [`Scene2d`](gs_core::Scene2d) and [`Scene3d`](gs_core::Scene3d), and sealed: what it consists of is a matter of this backend.
pub trait SceneKind: sealed::Sealed + Scene<View: PartialEq> + 'static {
    /// Parameters and Adam moments on the device.
    #[doc(hidden)]
    type State: Debug + wgpu::WasmNotSendSync;
    /// Buffers of the stages that are this kind's own.
    #[doc(hidden)]
    type Own: Debug + wgpu::WasmNotSendSync;

    /// Whether lists may serve more than one step: not where each looks through another camera.
    #[doc(hidden)]
    const LISTS_LAST: bool;

    /// Fails where the view or an effect is not possible.
    #[doc(hidden)]
    fn check(view: &Self::View, settings: &RenderSettings) -> Result<(), Error>;

    /// Fails where an optimiser's setting is not possible.
    #[doc(hidden)]
    fn check_rates(rates: &AdamRates) -> Result<(), Error>;

    /// Columns and rows.
    #[doc(hidden)]
    fn size(view: &Self::View) -> [u32; 2];

    /// Where the rasterizer keeps this kind's workspaces.
    #[doc(hidden)]
    fn pool(rasterizer: &WgpuRasterizer) -> &Arc<Pool<Self>>;

    /// The state of splats of this valid scene.
    #[doc(hidden)]
    fn upload(gpu: &Gpu, scene: &Self, parameterization: Parameterization) -> Result<Self::State, Error>;

    /// Makes what it takes to move or edit the state's `len` Gaussians, but not to look at them; to be called before either.
    #[doc(hidden)]
    fn prepare(gpu: &Gpu, state: &mut Self::State, len: usize) -> Result<(), Error>;

    /// The parameters of `len` Gaussians.
    #[doc(hidden)]
    fn download(gpu: &Gpu, state: &Self::State, len: usize) -> impl Future<Output = Result<Self, Error>>;

    /// All of the state but the statistics.
    #[doc(hidden)]
    fn save(gpu: &Gpu, state: &Self::State, len: usize) -> impl Future<Output = Result<SplatsState, Error>>;

    /// That state again, of as many Gaussians as are said.
    #[doc(hidden)]
    fn restore(gpu: &Gpu, state: &SplatsState, len: usize) -> Result<Self::State, Error>;

    /// Whether opacities are stored once `fresh` Gaussians have come.
    #[doc(hidden)]
    fn has_opacity(state: &Self::State, fresh: &[&Self::Gaussian]) -> bool;

    /// SH coefficients of a Gaussian.
    #[doc(hidden)]
    fn coefficients(state: &Self::State) -> u32;

    /// The edited state, as the commands will make it; those also edit the statistics.
    #[doc(hidden)]
    fn edit(
        gpu: &Gpu,
        commands: &mut Commands,
        state: &Self::State,
        edit: &Edit<'_, Self::Gaussian>,
    ) -> Result<Self::State, Error>;

    /// Empty buffers of this kind's own stages.
    #[doc(hidden)]
    fn own(gpu: &Gpu) -> Result<Self::Own, Error>;

    /// Makes room in them for the splats.
    #[doc(hidden)]
    fn ensure(workspace: &mut Workspace<Self>, gpu: &Gpu, splats: &Splats<Self>) -> Result<(), Error>;

    /// Bytes of each buffer of gradients.
    #[doc(hidden)]
    fn gradient_bytes(splats: &Splats<Self>) -> Vec<u64>;

    /// Adds to what a pass tells the device.
    #[doc(hidden)]
    fn describe(view: &Self::View, settings: &RenderSettings, splats: &Splats<Self>, step: &mut Step);

    /// Tells the device of the view what does not stand in [`Step`].
    #[doc(hidden)]
    fn write_view(workspace: &Workspace<Self>, gpu: &Gpu, view: &Self::View);

    /// Stage `project`, and all until projected and their numbers of tiles stand in the order of blending.
    #[doc(hidden)]
    fn encode_project(
        workspace: &Workspace<Self>,
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        lists: bool,
    );

    /// Stage `project_bwd`.
    #[doc(hidden)]
    fn encode_project_bwd(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Self>);

    /// Stage `adam`; the sizes of its dispatches stand in `indirect`, if the device is to say whether anything is done.
    #[doc(hidden)]
    fn encode_adam(
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        step: &wgpu::Buffer,
        gradients: &[&wgpu::Buffer],
        indirect: Option<&wgpu::Buffer>,
    );

    /// The gradients as a scene of derivatives.
    #[doc(hidden)]
    fn derivatives(
        gpu: &Gpu,
        splats: &Splats<Self>,
        gradients: &Gradients<Self>,
    ) -> impl Future<Output = Result<Self, Error>>;

    /// The entry point that adds noise to means, and the buffer that has them.
    #[doc(hidden)]
    fn noise(splats: &Splats<Self>) -> (&'static str, &wgpu::Buffer);

    /// Whether the parameterization is `CovarianceFactor`.
    #[doc(hidden)]
    fn has_factors(state: &Self::State) -> bool;

    /// Solves for the colours, where the image is linear in them.
    #[doc(hidden)]
    fn solve_colors(
        rasterizer: &WgpuRasterizer,
        splats: &mut Splats<Self>,
        view: &Self::View,
        target: &Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> impl Future<Output = Result<(), Error>>;
}
