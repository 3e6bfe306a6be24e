//! What a density policy sees, and what it must answer.

use gs_core::{DensityStatistics, EditPlan, Error, Image, Scene2d, effects::Statistics};

use crate::{
    gaussian::{DensityScene, check_lengths},
    noise::Noise,
};

/// The random numbers of a policy. The training loop makes one anew for every round, from the run's seed and the step, so that a
/// resumed run draws what an uninterrupted one would have.
pub type Rng = rand_pcg::Pcg64;

/// What the scene looks like beside what it should look like; both unclamped and of one size.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// The image to reach.
    pub target: Image,
    /// The scene as rendered now.
    pub rendered: Image,
}

/// All that a policy may look at.
#[derive(Debug)]
pub struct Observation<'a, S = Scene2d> {
    /// The Gaussians as they are, N of them. Plane coordinates are pixels of the target (an identity canvas).
    pub scene: &'a S,
    /// Statistics since the last edit, `[N]`.
    pub statistics: &'a DensityStatistics,
    /// The residual image, where [`DensityPolicy::needs_residual`] asked for it.
    pub residual: Option<&'a Residual>,
    /// How large the scene is, in its unit: the image's longer side, px; in 3D the radius of the cameras' positions as 3DGS has it,
    /// world units.
    pub extent: f32,
    /// The training step, from 0, after which the policy is asked.
    pub step: u32,
    /// How far the window in which density is controlled has passed: from just above 0 at its first round to 1 at its last.
    pub progress: f32,
    /// The most Gaussians there may be after the plan.
    pub budget: usize,
}

impl<S> Clone for Observation<'_, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S> Copy for Observation<'_, S> {}

impl<S: DensityScene> Observation<'_, S> {
    /// Fails unless the scene's arrays and the statistics describe the same number of Gaussians. Their values may be anything, NaN too.
    ///
    /// # Errors
    /// [`Error::Length`] naming the first that does not.
    pub fn check_lengths(&self) -> Result<(), Error> {
        let Self { scene, statistics, .. } = self;
        scene.check_lengths()?;
        let lengths = [("gradient_sum", statistics.gradient_sum.len()), ("visible", statistics.visible.len())];
        check_lengths(scene.len(), lengths)
    }
}

/// A rule of density control for scenes of kind `S`.
pub trait DensityPolicy<S: DensityScene = Scene2d> {
    /// The edits that the policy wants, never more than `budget` Gaussians after them. The same observation and the same random
    /// numbers give the same plan.
    ///
    /// # Errors
    /// [`Error::Setting`] where a number of the policy is outside its range, [`Error::Length`] where scene and statistics differ in
    /// length, [`Error::State`] where a residual is needed and missing.
    fn plan(&self, observation: &Observation<'_, S>, rng: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error>;

    /// The statistics that training must collect for this policy.
    fn statistics(&self) -> Statistics;

    /// Whether the policy looks at the residual image, which costs a rendering per round.
    fn needs_residual(&self) -> bool;

    /// The noise that training adds to the means between steps. None, for most.
    fn noise(&self) -> Option<Noise> {
        None
    }
}
