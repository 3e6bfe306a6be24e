//! What this backend needs to know about a kind of scene: its splats, and the stages before `bin` and after `blend_bwd`. All that lies
//! between, and the trait's implementation around it, is written once.

use std::{
    fmt::Debug,
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
};

use fearless_simd::Level;
use gs_core::{
    AdamRates, Binning, DensityStatistics, EditPlan, Error, Parameterization, RenderSettings, Scene, SplatsState,
};

use crate::{
    CpuRasterizer, Target,
    profile::Stage,
    workspace::{Pool, Workspace},
};

mod sealed {
    pub trait Sealed {}

    impl Sealed for gs_core::Scene2d {}
    impl Sealed for gs_core::Scene3d {}
}

/// A kind of scene that [`CpuRasterizer`] is a rasterizer for: a 2D or a 3D scene.
///
/// Implemented for [`Scene2d`](gs_core::Scene2d) and [`Scene3d`](gs_core::Scene3d), and sealed: what it consists of is a matter of this backend.
pub trait SceneKind: sealed::Sealed + Scene + 'static {
    #[doc(hidden)]
    /// The Gaussians where this backend computes.
    type Splats: Debug + Send + Sync;
    #[doc(hidden)]
    /// Buffers of the stages that are this kind's own.
    type Own: Debug + Default + Send + Sync;
    #[doc(hidden)]
    /// Bias corrections of Adam.
    type Bias: Debug + Default + Send;

    #[doc(hidden)]
    /// The stages before `bin`, in their order.
    const BEFORE_BIN: [Stage; 2];

    #[doc(hidden)]
    /// Fails where the view or an effect is not possible.
    fn check(view: &Self::View, settings: &RenderSettings) -> Result<(), Error>;

    #[doc(hidden)]
    /// Fails where Adam's numbers ask for what this kind has not.
    fn check_rates(rates: &AdamRates) -> Result<(), Error>;

    #[doc(hidden)]
    /// Columns and rows.
    fn size(view: &Self::View) -> (u32, u32);

    #[doc(hidden)]
    /// What the rasterizer keeps for this kind.
    fn resources(rasterizer: &CpuRasterizer) -> &Resources<Self>;

    #[doc(hidden)]
    /// splats of this scene.
    fn upload(scene: &Self, parameterization: Parameterization) -> Result<Self::Splats, Error>;

    #[doc(hidden)]
    /// The splats' parameters.
    fn download(splats: &Self::Splats) -> Self;

    #[doc(hidden)]
    /// Its whole state.
    fn save(splats: &Self::Splats) -> SplatsState;

    #[doc(hidden)]
    /// splats in that state.
    fn restore(state: &SplatsState) -> Result<Self::Splats, Error>;

    #[doc(hidden)]
    /// Applies a plan.
    fn edit(splats: &mut Self::Splats, plan: &EditPlan<Self::Gaussian>) -> Result<(), Error>;

    #[doc(hidden)]
    /// Adds to the means.
    fn shift_means(splats: &mut Self::Splats, shifts: &[f32]) -> Result<(), Error>;

    #[doc(hidden)]
    /// What splats of every kind have.
    fn shared(splats: &Self::Splats) -> &Shared<Self>;

    #[doc(hidden)]
    /// The same, to change.
    fn shared_mut(splats: &mut Self::Splats) -> &mut Shared<Self>;

    #[doc(hidden)]
    /// The stages up to `bin`.
    fn prepare(
        workspace: &mut Workspace<Self>,
        splats: &Self::Splats,
        view: &Self::View,
        settings: &RenderSettings,
        binning: Binning,
    ) -> Result<(), Error>;

    #[doc(hidden)]
    /// Stage `project`.
    fn project(workspace: &mut Workspace<Self>, splats: &Self::Splats);

    #[doc(hidden)]
    /// Stage `sort`: the order in which tiles see the projected.
    fn sort(workspace: &mut Workspace<Self>, splats: &Self::Splats);

    #[doc(hidden)]
    /// Stage `project_bwd`: every Gaussian's gradient, times `scale`.
    fn project_bwd(workspace: &mut Workspace<Self>, splats: &Self::Splats, scale: f32);

    #[doc(hidden)]
    /// The gradients that `project_bwd` found, as a scene of derivatives.
    fn derivatives(workspace: &Workspace<Self>, splats: &Self::Splats) -> Self;

    #[doc(hidden)]
    /// Stage `adam`: one step along the gradients that `project_bwd` found, and the statistics.
    fn adam(
        splats: &mut Self::Splats,
        bias: &mut Self::Bias,
        rates: &AdamRates,
        level: Level,
        workspace: &Workspace<Self>,
    );

    #[doc(hidden)]
    /// Solves for the colours, where the image is linear in them.
    fn solve_colors(
        rasterizer: &CpuRasterizer,
        splats: &mut Self::Splats,
        view: &Self::View,
        target: &Target,
        settings: &RenderSettings,
        iterations: u32,
    ) -> Result<(), Error>;
}

/// What splats of every kind have besides their parameters and moments.
#[derive(Debug)]
pub struct Shared<S: SceneKind> {
    pub(crate) statistics: DensityStatistics,
    /// Buffers of training steps, with the lists that [`Binning::Reuse`] may use again.
    pub(crate) workspace: Option<Workspace<S>>,
    /// Of training steps, until they are asked for.
    pub(crate) losses: Vec<f32>,
    /// Another number for every splats and after every edit, by which lists made for another state are recognised.
    pub(crate) edition: u64,
}

impl<S: SceneKind> Shared<S> {
    pub(crate) fn new(statistics: DensityStatistics) -> Self {
        Self { statistics, workspace: None, losses: Vec::new(), edition: next_edition() }
    }

    /// Number of Gaussians.
    pub(crate) fn len(&self) -> usize {
        self.statistics.visible.len()
    }

    /// After an edit whose statistics are these.
    pub(crate) fn edited(&mut self, statistics: DensityStatistics) {
        self.statistics = statistics;
        self.edition = next_edition();
    }
}

fn next_edition() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// What a rasterizer keeps for one kind of scene.
#[derive(Debug)]
pub struct Resources<S: SceneKind> {
    pub(crate) pool: Arc<Pool<S>>,
    pub(crate) bias: Mutex<S::Bias>,
}

impl<S: SceneKind> Default for Resources<S> {
    fn default() -> Self {
        Self { pool: Arc::default(), bias: Mutex::default() }
    }
}
