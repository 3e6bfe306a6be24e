//! The difference between 2D and 3D scenes: their splats, and the stages before `bin` and after
//! `blend_bwd`. The stages in between and the implementation of the traits are shared.

use std::{
    fmt::Debug,
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
};

use gs_core::{
    AdamRates, Binning, CameraGradient, DensityStatistics, EditPlan, Error, MeanNoise, Parameterization,
    RenderSettings, SavedState, Scene, Scene2d, Scene3d, SplatsState, edit::Source,
};

use crate::{
    level::Level,
    stage::Stage,
    target::Target,
    unsupported::unsupported,
    workspace::{Pool, Workspace},
};

/// Gaussians of one kind on the CPU, with all that training changes.
pub trait Splats<S: Kind>: Debug + Send + Sync + Sized {
    /// Splats of a scene.
    fn new(scene: &S, parameterization: Parameterization) -> Result<Self, Error>;

    /// The parameters as a scene.
    fn scene(&self) -> S;

    /// The whole state.
    fn saved(&self) -> SavedState<'_>;

    /// Splats with a saved state.
    fn restore(state: &SplatsState) -> Result<Self, Error>;

    /// Applies an edit plan.
    fn edit(&mut self, plan: &EditPlan<S::Gaussian>) -> Result<(), Error>;

    /// Adds noise to the means.
    fn add_noise(&mut self, noise: &MeanNoise);

    /// The part that both kinds share.
    fn shared(&self) -> &Shared<S>;

    /// The part that both kinds share, mutable.
    fn shared_mut(&mut self) -> &mut Shared<S>;
}

/// A kind of scene that [`CpuRasterizer`](crate::CpuRasterizer) draws and trains: [`Scene2d`] or
/// [`Scene3d`].
pub trait Kind: Scene + 'static {
    /// Splats of this kind.
    type Splats: Splats<Self>;
    /// Buffers of the stages that only this kind has.
    type Buffers: Debug + Default + Send + Sync;
    /// Adam's bias corrections.
    type Bias: Debug + Default + Send;

    /// The stages before `bin`, in order.
    const BEFORE_BIN: [Stage; 2];

    /// Whether a step can use the lists of the step before, so that splats keep their buffers.
    const REUSES_LISTS: bool;

    /// The stages after `blend_bwd`, in order.
    const AFTER_BLEND: &'static [Stage];

    /// Fails for an invalid view or an unsupported effect.
    fn check(view: &Self::View, settings: &RenderSettings) -> Result<(), Error>;

    /// Fails for Adam settings that this kind does not support.
    fn check_rates(_rates: &AdamRates) -> Result<(), Error> {
        Ok(())
    }

    /// Columns and rows of a view's image.
    fn size(view: &Self::View) -> (u32, u32);

    /// The pools of this kind.
    fn resources(all: &AllResources) -> &Resources<Self>;

    /// Runs the stages up to `bin`.
    fn prepare(
        workspace: &mut Workspace<Self::Buffers>,
        splats: &Self::Splats,
        view: &Self::View,
        settings: &RenderSettings,
        binning: Binning,
        level: Level,
    ) -> Result<(), Error>;

    /// Runs stage `project`.
    fn project(workspace: &mut Workspace<Self::Buffers>, splats: &Self::Splats, level: Level);

    /// Runs stage `sort`: finds the order in which tiles see the splats.
    fn sort(workspace: &mut Workspace<Self::Buffers>, splats: &Self::Splats);

    /// Runs stage `bin`: lists the splats of each tile in that order.
    fn bin(workspace: &mut Workspace<Self::Buffers>, level: Level) -> Result<(), Error>;

    /// Runs stage `project_bwd`: every Gaussian's gradient, times `scale`.
    fn project_bwd(workspace: &mut Workspace<Self::Buffers>, splats: &Self::Splats, level: Level, scale: f32);

    /// The gradients of `project_bwd` as a scene of derivatives.
    fn derivatives(workspace: &Workspace<Self::Buffers>, splats: &Self::Splats) -> Self;

    /// The gradient by the camera of `project_bwd` or `update`, where the settings ask for it.
    fn camera_gradient(_workspace: &Workspace<Self::Buffers>) -> Option<CameraGradient> {
        None
    }

    /// Runs stage `adam`: one step along the gradients of `project_bwd`, and the statistics.
    fn adam(
        splats: &mut Self::Splats,
        bias: &mut Self::Bias,
        rates: &AdamRates,
        level: Level,
        workspace: &Workspace<Self::Buffers>,
    );

    /// Runs stages `project_bwd`, with gradients times `scale`, and `adam`: stage `update`, where a
    /// kind has a faster way that leaves no gradients behind.
    fn update(
        splats: &mut Self::Splats,
        bias: &mut Self::Bias,
        rates: &AdamRates,
        level: Level,
        workspace: &mut Workspace<Self::Buffers>,
        scale: f32,
    ) {
        Self::project_bwd(workspace, splats, level, scale);
        Self::adam(splats, bias, rates, level, workspace);
    }

    /// Fails where the image is not linear in the colours, or no solver exists for this kind.
    fn check_solve_colors(_settings: &RenderSettings) -> Result<(), Error> {
        Err(unsupported("solving for the colours of 3D scenes"))
    }

    /// Solves for the colours; `workspace` has been prepared.
    fn solve_colors(
        _workspace: &mut Workspace<Self::Buffers>,
        _splats: &mut Self::Splats,
        _target: &Target,
        _level: Level,
        _iterations: u32,
    ) -> Result<(), Error> {
        Self::check_solve_colors(&RenderSettings::default())
    }
}

/// The part of the splats that both kinds share.
#[derive(Debug)]
pub struct Shared<S: Kind> {
    pub(crate) statistics: DensityStatistics,
    /// Buffers of training steps with the lists for [`Binning::Reuse`], of kinds that reuse them.
    pub(crate) workspace: Option<Workspace<S::Buffers>>,
    /// Losses of training steps that the caller has not taken yet.
    pub(crate) losses: Vec<f32>,
    /// Gradients by the camera of training steps that the caller has not taken yet.
    pub(crate) camera_gradients: Vec<CameraGradient>,
    /// A number that is unique to these splats since their last edit. It identifies invalid lists.
    pub(crate) version: u64,
}

impl<S: Kind> Shared<S> {
    pub(crate) fn new(statistics: DensityStatistics) -> Self {
        Self { statistics, workspace: None, losses: Vec::new(), camera_gradients: Vec::new(), version: next_version() }
    }

    /// Number of Gaussians.
    pub(crate) fn len(&self) -> usize {
        self.statistics.visible.len()
    }

    /// Edits the statistics.
    pub(crate) fn edit(&mut self, plan: &EditPlan<S::Gaussian>, sources: &[Source]) {
        let DensityStatistics { signal_sum, visible } = &mut self.statistics;
        *signal_sum = plan.gather_statistics(sources, signal_sum);
        *visible = plan.gather_statistics(sources, visible);
        self.version = next_version();
    }
}

fn next_version() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// What a rasterizer keeps for one kind of scene.
#[derive(Debug)]
pub struct Resources<S: Kind> {
    pub(crate) pool: Arc<Pool<S::Buffers>>,
    pub(crate) bias: Mutex<S::Bias>,
}

impl<S: Kind> Default for Resources<S> {
    fn default() -> Self {
        Self { pool: Arc::default(), bias: Mutex::default() }
    }
}

/// What a rasterizer keeps for both kinds of scenes.
#[derive(Debug, Default)]
pub struct AllResources {
    pub(crate) for_2d: Resources<Scene2d>,
    pub(crate) for_3d: Resources<Scene3d>,
}
