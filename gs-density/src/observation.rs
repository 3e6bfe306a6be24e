//! What a density policy sees, and what it must answer.

use gs_core::{DensityStatistics, EditPlan, Error, Image, PlanarGaussian, PlanarScene, effects::Statistics};

use crate::noise::Noise;

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

impl Observation<'_> {
    /// Fails unless the scene's arrays and the statistics describe the same number of Gaussians. Their values may be anything, NaN too.
    ///
    /// # Errors
    /// [`Error::Length`] naming the first that does not.
    pub fn check_lengths(&self) -> Result<(), Error> {
        let Self { scene, statistics, .. } = self;
        let expected = scene.means.len();
        let opacity_logits = if scene.has_opacity() { scene.opacity_logits.len() } else { expected };
        let lengths = [
            ("log_scales", scene.log_scales.len()),
            ("rotations", scene.rotations.len()),
            ("opacity_logits", opacity_logits),
            ("colors", scene.colors.len()),
            ("gradient_sum", statistics.gradient_sum.len()),
            ("visible", statistics.visible.len()),
        ];
        match lengths.into_iter().find(|&(_, found)| found != expected) {
            Some((what, found)) => Err(Error::Length { what, expected, found }),
            None => Ok(()),
        }
    }
}

/// A rule of density control.
pub trait DensityPolicy {
    /// The edits that the policy wants, never more than `budget` Gaussians after them. The same observation and the same random
    /// numbers give the same plan.
    ///
    /// # Errors
    /// [`Error::Setting`] where a number of the policy is outside its range, [`Error::Length`] where scene and statistics differ in
    /// length, [`Error::State`] where a residual is needed and missing.
    fn plan(&self, observation: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<PlanarGaussian>, Error>;

    /// The statistics that training must collect for this policy.
    fn statistics(&self) -> Statistics;

    /// Whether the policy looks at the residual image, which costs a rendering per round.
    fn needs_residual(&self) -> bool;

    /// The noise that training adds to the means between steps. None, for most.
    fn noise(&self) -> Option<Noise> {
        None
    }
}
