//! The interface of density policies: the observation and the policy trait.

mod evidence;
mod gaussian;
mod signal;

pub use self::{
    evidence::{Evidence, EvidenceRequest, PixelSums, ViewEvidence},
    gaussian::{DensityGaussian, DensityScene},
    signal::Signal,
};

use glam::Vec2;
use gs_core::{DensityStatistics, EditPlan, Error, Image, Scene2d, check_len, effects::Statistics};

use crate::noise::Noise;

/// Random number generator of a policy. The training loop makes a new one for every round, from the
/// run's seed and the step, so that a resumed run draws the same numbers as an uninterrupted one.
pub type Rng = rand_pcg::Pcg64;

/// The target and the rendering; both unclamped and of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// Target image.
    pub target: Image,
    /// Current rendering of the scene.
    pub rendered: Image,
    /// How much each pixel counts, `[height · width]`, row-major, not negative; `None` where all
    /// count 1. Policies weigh the squares of residuals by it.
    pub weights: Option<Vec<f32>>,
}

impl Residual {
    /// The residual of two images of which every pixel counts the same.
    pub fn new(target: Image, rendered: Image) -> Self {
        Self { target, rendered, weights: None }
    }

    /// The weights of row `y`; `None` where all are 1.
    pub(crate) fn row_of_weights(&self, y: usize) -> Option<&[f32]> {
        let width = self.target.width() as usize;
        self.weights.as_ref().map(|weights| &weights[y * width..][..width])
    }

    /// The weight of the pixel that holds a point, or of the nearest one.
    pub(crate) fn weight_at(&self, point: Vec2) -> f32 {
        let Some(weights) = &self.weights else { return 1.0 };
        let (width, height) = self.target.size();
        // Casts take NaN and what is below 0 as 0.
        let [x, y] = [(point.x, width), (point.y, height)].map(|(at, size)| (at as usize).min(size as usize - 1));
        weights[y * width as usize + x]
    }

    /// Checks that the images have one size and that there is a weight for each pixel.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] or [`Error::Length`] where not.
    pub(crate) fn check(&self) -> Result<(), Error> {
        self.target.same_size(&self.rendered)?;
        let pixels = self.target.pixels().len();
        check_len("weights", pixels, self.weights.as_ref().map_or(pixels, Vec::len))
    }
}

/// Input of a policy.
#[derive(Debug)]
pub struct Observation<'a, S = Scene2d> {
    /// The N Gaussians. Plane coordinates are pixels of the target (an identity canvas).
    pub scene: &'a S,
    /// Statistics since the last edit, `[N]`.
    pub statistics: &'a DensityStatistics,
    /// Target and rendering, where [`Needs::residual`].
    pub residual: Option<&'a Residual>,
    /// Evidence over several training views, where [`DensityPolicy::evidence`] requests it.
    pub evidence: Option<&'a Evidence>,
    /// Extent of the scene, in its unit: in 2D the image's longer side, px; in 3D the radius of the
    /// camera positions as in 3DGS, world units.
    pub extent: f32,
    /// Training step, from 0, after which the policy is called.
    pub step: u32,
    /// Progress of density control: from just above 0 at its first round to 1 at its last.
    pub progress: f32,
    /// [`Self::progress`] of the round before; 0 at the first.
    pub progress_before: f32,
    /// Largest number of Gaussians after the plan.
    pub budget: usize,
}

impl<S> Clone for Observation<'_, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S> Copy for Observation<'_, S> {}

impl<S: DensityScene> Observation<'_, S> {
    /// Checks that the scene's arrays and the statistics describe the same number of Gaussians.
    /// Their values may be anything.
    ///
    /// # Errors
    /// Those of [`Scene::check_lengths`](gs_core::Scene::check_lengths); [`Error::Length`] for the
    /// statistics.
    pub(crate) fn check_lengths(&self) -> Result<(), Error> {
        let Self { scene, statistics, .. } = self;
        scene.check_lengths()?;
        check_len("signal_sum", scene.len(), statistics.signal_sum.len())?;
        check_len("visible", scene.len(), statistics.visible.len())
    }
}

/// What training must do for a policy. By default nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Needs {
    /// Statistic that training must collect.
    pub statistics: Statistics,
    /// Depth from which gradients count fully in [`Statistics::PixelGradient`], in extents of the
    /// scene; at 0 all count fully.
    pub full_depth: f32,
    /// Whether the policy needs the residual, which costs a rendering per round.
    pub residual: bool,
    /// Whether some round needs evidence over several training views. Only training in 3D has it;
    /// elsewhere such a policy is refused before the first step.
    pub evidence: bool,
    /// Noise that training adds to the means between steps.
    pub noise: Option<Noise>,
}

/// A policy of density control for scenes of kind `S`.
pub trait DensityPolicy<S: DensityScene = Scene2d> {
    /// The edits of one round, after which there are at most `budget` Gaussians.
    ///
    /// The same observation and the same random numbers give the same plan.
    ///
    /// # Errors
    /// [`Error::Setting`] where a setting of the policy is outside its range, [`Error::Length`]
    /// where scene and statistics differ in length, [`Error::State`] where a residual is needed and
    /// missing.
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error>;

    /// What training must do for this policy. By default nothing, as for a policy that reads the scene
    /// alone.
    fn needs(&self) -> Needs {
        Needs::default()
    }

    /// The evidence that the round after `step` (from 0) at this progress needs; both as in
    /// [`Observation`]. Default none. Each view costs about two training steps.
    fn evidence(&self, _step: u32, _progress: f32) -> Option<EvidenceRequest> {
        None
    }
}
