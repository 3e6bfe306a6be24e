//! What this backend needs to know about a kind of scene: its parameters on the device, and the stages before `scan` and after `blend_bwd`.
//! All that lies between, and the trait's implementation around it, is written once.

use std::{fmt::Debug, sync::Arc};

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
    #[doc(hidden)]
    /// Parameters and Adam moments on the device.
    type State: Debug + Send + Sync;
    #[doc(hidden)]
    /// Buffers of the stages that are this kind's own.
    type Own: Debug + Send + Sync;

    #[doc(hidden)]
    /// Whether lists may serve more than one step: not where each looks through another camera.
    const LISTS_LAST: bool;

    #[doc(hidden)]
    /// Fails where the view or an effect is not possible.
    fn check(view: &Self::View, settings: &RenderSettings) -> Result<(), Error>;

    #[doc(hidden)]
    /// Fails where an optimiser's setting is not possible.
    fn check_rates(rates: &AdamRates) -> Result<(), Error>;

    #[doc(hidden)]
    /// Columns and rows.
    fn size(view: &Self::View) -> [u32; 2];

    #[doc(hidden)]
    /// Where the rasterizer keeps this kind's workspaces.
    fn pool(rasterizer: &WgpuRasterizer) -> &Arc<Pool<Self>>;

    #[doc(hidden)]
    /// The state of splats of this valid scene.
    fn upload(gpu: &Gpu, scene: &Self, parameterization: Parameterization) -> Result<Self::State, Error>;

    #[doc(hidden)]
    /// Makes what it takes to move or edit the state's `len` Gaussians, but not to look at them; to be called before either.
    fn prepare(gpu: &Gpu, state: &mut Self::State, len: usize) -> Result<(), Error>;

    #[doc(hidden)]
    /// The parameters of `len` Gaussians.
    fn download(gpu: &Gpu, state: &Self::State, len: usize) -> Result<Self, Error>;

    #[doc(hidden)]
    /// All of the state but the statistics.
    fn save(gpu: &Gpu, state: &Self::State, len: usize) -> Result<SplatsState, Error>;

    #[doc(hidden)]
    /// That state again, of as many Gaussians as are said.
    fn restore(gpu: &Gpu, state: &SplatsState, len: usize) -> Result<Self::State, Error>;

    #[doc(hidden)]
    /// Whether opacities are stored once `fresh` Gaussians have come.
    fn has_opacity(state: &Self::State, fresh: &[&Self::Gaussian]) -> bool;

    #[doc(hidden)]
    /// SH coefficients of a Gaussian.
    fn coefficients(state: &Self::State) -> u32;

    #[doc(hidden)]
    /// The edited state, as the commands will make it; those also edit the statistics.
    fn edit(
        gpu: &Gpu,
        commands: &mut Commands,
        state: &Self::State,
        edit: &Edit<'_, Self::Gaussian>,
    ) -> Result<Self::State, Error>;

    #[doc(hidden)]
    /// Empty buffers of this kind's own stages.
    fn own(gpu: &Gpu) -> Result<Self::Own, Error>;

    #[doc(hidden)]
    /// Makes room in them for the splats.
    fn ensure(workspace: &mut Workspace<Self>, gpu: &Gpu, splats: &Splats<Self>) -> Result<(), Error>;

    #[doc(hidden)]
    /// Bytes of each buffer of gradients.
    fn gradient_bytes(splats: &Splats<Self>) -> Vec<u64>;

    #[doc(hidden)]
    /// Adds to what a pass tells the device.
    fn describe(view: &Self::View, settings: &RenderSettings, splats: &Splats<Self>, step: &mut Step);

    #[doc(hidden)]
    /// Tells the device of the view what does not stand in [`Step`].
    fn write_view(workspace: &Workspace<Self>, gpu: &Gpu, view: &Self::View);

    #[doc(hidden)]
    /// Stage `project`, and all until projected and their numbers of tiles stand in the order of blending.
    fn encode_project(
        workspace: &Workspace<Self>,
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        lists: bool,
    );

    #[doc(hidden)]
    /// Stage `project_bwd`.
    fn encode_project_bwd(workspace: &Workspace<Self>, gpu: &Gpu, commands: &mut Commands, splats: &Splats<Self>);

    #[doc(hidden)]
    /// Stage `adam`; the sizes of its dispatches stand in `indirect`, if the device is to say whether anything is done.
    fn encode_adam(
        gpu: &Gpu,
        commands: &mut Commands,
        splats: &Splats<Self>,
        step: &wgpu::Buffer,
        gradients: &[&wgpu::Buffer],
        indirect: Option<&wgpu::Buffer>,
    );

    #[doc(hidden)]
    /// The gradients as a scene of derivatives.
    fn derivatives(gpu: &Gpu, splats: &Splats<Self>, gradients: &Gradients<Self>) -> Result<Self, Error>;

    #[doc(hidden)]
    /// Solves for the colours, where the image is linear in them.
    fn solve_colors(
        rasterizer: &WgpuRasterizer,
        splats: &mut Splats<Self>,
        view: &Self::View,
        target: &Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error>;
}
