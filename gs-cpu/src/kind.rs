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
    AdamRates, Binning, DensityStatistics, EditPlan, Error, MeanNoise, Parameterization, RenderSettings, Scene,
    SplatsState,
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
    /// The Gaussians where this backend computes.
    type Splats: Debug + Send + Sync;
    /// Buffers of the stages that are this kind's own.
    #[doc(hidden)]
    type Own: Debug + Default + Send + Sync;
    /// Bias corrections of Adam.
    #[doc(hidden)]
    type Bias: Debug + Default + Send;

    /// The stages before `bin`, in their order.
    #[doc(hidden)]
    const BEFORE_BIN: [Stage; 2];

    /// Fails where the view or an effect is not possible.
    #[doc(hidden)]
    fn check(view: &Self::View, settings: &RenderSettings) -> Result<(), Error>;

    /// Fails where Adam's numbers ask for what this kind has not.
    #[doc(hidden)]
    fn check_rates(rates: &AdamRates) -> Result<(), Error>;

    /// Columns and rows.
    #[doc(hidden)]
    fn size(view: &Self::View) -> (u32, u32);

    /// What the rasterizer keeps for this kind.
    #[doc(hidden)]
    fn resources(rasterizer: &CpuRasterizer) -> &Resources<Self>;

    /// splats of this scene.
    #[doc(hidden)]
    fn upload(scene: &Self, parameterization: Parameterization) -> Result<Self::Splats, Error>;

    /// The splats' parameters.
    #[doc(hidden)]
    fn download(splats: &Self::Splats) -> Self;

    /// Its whole state.
    #[doc(hidden)]
    fn save(splats: &Self::Splats) -> SplatsState;

    /// splats in that state.
    #[doc(hidden)]
    fn restore(state: &SplatsState) -> Result<Self::Splats, Error>;

    /// Applies a plan.
    #[doc(hidden)]
    fn edit(splats: &mut Self::Splats, plan: &EditPlan<Self::Gaussian>) -> Result<(), Error>;

    /// Adds noise to the means.
    #[doc(hidden)]
    fn add_noise(splats: &mut Self::Splats, noise: &MeanNoise);

    /// What splats of every kind have.
    #[doc(hidden)]
    fn shared(splats: &Self::Splats) -> &Shared<Self>;

    /// The same, to change.
    #[doc(hidden)]
    fn shared_mut(splats: &mut Self::Splats) -> &mut Shared<Self>;

    /// The stages up to `bin`.
    #[doc(hidden)]
    fn prepare(
        workspace: &mut Workspace<Self>,
        splats: &Self::Splats,
        view: &Self::View,
        settings: &RenderSettings,
        binning: Binning,
    ) -> Result<(), Error>;

    /// Stage `project`.
    #[doc(hidden)]
    fn project(workspace: &mut Workspace<Self>, splats: &Self::Splats);

    /// Stage `sort`: the order in which tiles see the projected.
    #[doc(hidden)]
    fn sort(workspace: &mut Workspace<Self>, splats: &Self::Splats);

    /// Stage `project_bwd`: every Gaussian's gradient, times `scale`.
    #[doc(hidden)]
    fn project_bwd(workspace: &mut Workspace<Self>, splats: &Self::Splats, scale: f32);

    /// The gradients that `project_bwd` found, as a scene of derivatives.
    #[doc(hidden)]
    fn derivatives(workspace: &Workspace<Self>, splats: &Self::Splats) -> Self;

    /// Stage `adam`: one step along the gradients that `project_bwd` found, and the statistics.
    #[doc(hidden)]
    fn adam(
        splats: &mut Self::Splats,
        bias: &mut Self::Bias,
        rates: &AdamRates,
        level: Level,
        workspace: &Workspace<Self>,
    );

    /// Solves for the colours, where the image is linear in them.
    #[doc(hidden)]
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
