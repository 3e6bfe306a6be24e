//! What a density policy sees, and what it must answer.

use gs_core::{DensityStatistics, EditPlan, Error, Image, PlanarGaussian, PlanarScene, effects::Statistics};

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
#[derive(Debug, Clone, Copy)]
pub struct Observation<'a> {
    /// The Gaussians as they are, N of them. Plane coordinates are pixels of the target (an identity canvas).
    pub scene: &'a PlanarScene,
    /// Statistics since the last edit, `[N]`.
    pub statistics: &'a DensityStatistics,
    /// The residual image, where [`DensityPolicy::needs_residual`] asked for it.
    pub residual: Option<&'a Residual>,
    /// Size of the image, px: (columns, rows).
    pub size: (u32, u32),
    /// The training step, from 0, after which the policy is asked.
    pub step: u32,
    /// How far the window in which density is controlled has passed: from just above 0 at its first round to 1 at its last.
    pub progress: f32,
    /// The most Gaussians there may be after the plan.
    pub budget: usize,
}

/// A rule of density control.
pub trait DensityPolicy {
    /// The edits that the policy wants, never more than `budget` Gaussians after them. The same observation and the same random
    /// numbers give the same plan.
    ///
    /// # Errors
    /// [`Error::Length`] where scene and statistics differ in length, [`Error::State`] where a residual is needed and missing.
    fn plan(&self, observation: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<PlanarGaussian>, Error>;

    /// The statistics that training must collect for this policy.
    fn statistics(&self) -> Statistics;

    /// Whether the policy looks at the residual image, which costs a rendering per round.
    fn needs_residual(&self) -> bool;
}
