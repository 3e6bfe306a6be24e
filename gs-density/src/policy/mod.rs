//! The policies, a file for each, and all of them as one value, for settings files and command lines.
//!
//! The table in this file is the only list of their names. `rule` says what each must answer.

#[macro_use]
mod declare;
mod error_addition;
mod fast_gs;
mod grow;
mod improved_gs;
mod mcmc;
mod mrnf;
mod partial;
mod residual;
mod rule;
mod steep_gs;
mod taming;

pub use self::{
    error_addition::ErrorAddition,
    fast_gs::FastGs,
    grow::{Combine, FORCED_GROWTH_PERCENT, Grow},
    improved_gs::ImprovedGs,
    mcmc::Mcmc,
    mrnf::Mrnf,
    residual::ResidualGrowth,
    steep_gs::SteepGs,
    taming::{ScoreWeights, Taming},
};

use std::sync::LazyLock;

use gs_core::{EditPlan, Error, Gaussian2d, Gaussian3d, Scene2d, Scene3d, edit::Moments};
use serde::{Deserialize, Serialize};

use self::{
    grow::GrowForm,
    rule::{Listed, Rule},
};
use crate::{
    observation::{DensityPolicy, DensityScene, EvidenceRequest, Needs, Observation, Rng},
    round::{Actions, Prune, SizeThreshold},
};

/// A policy with its default settings, by name.
pub(crate) struct Named {
    /// Name in flags and messages.
    pub(crate) name: &'static str,
    /// What it does, in one line.
    pub(crate) summary: &'static str,
    /// Makes it.
    pub(crate) make: fn() -> Policy,
}

policies! {
    /// Relocate and copy by opacity, with noise between steps.
    Mcmc(Mcmc) = "mcmc":
        "Move transparent Gaussians to opaque ones and add 5 % a round, with noise between steps (3DGS-MCMC)";
    /// Grow and prune where several views agree that pixels are wrong.
    FastGs(FastGs) = "fastgs", by evidence:
        "Grow and prune by the pixels of high error that a Gaussian covers in several views (FastGS)";
    /// Grow by a score of many parts, along a schedule of counts.
    Taming(Taming) = "taming", by evidence:
        "Grow by a score of errors, edges, sizes and contributions over several views, along a schedule that ends at \
         the budget (Taming 3DGS)";
    /// Split what draws edges, along a schedule of counts.
    ImprovedGs(ImprovedGs) = "improved-gs", by evidence:
        "Split Gaussians that draw edges, side by side along the long axis, on a schedule that ends at the budget \
         (Improved-GS)";
    /// Split where two Gaussians can lower the loss and one cannot.
    SteepGs(SteepGs) = "steep-gs", by evidence:
        "Split Gaussians whose splitting matrix over several views has a negative eigenvalue, along its eigenvector \
         (SteepGS)";
    /// Grow by errors that are normalised by visibility, paced to reach the budget.
    Mrnf(Mrnf) = "mrnf", by evidence:
        "Split Gaussians in proportion to their error over several views, normalised by visibility, and replace \
         those that are pruned (after LichtFeld Studio)";
    2D only:
    /// Start with half of the Gaussians and add in proportion to the error.
    ImageGs(ErrorAddition) = "image-gs":
        "Start with half, add the rest in four rounds in proportion to the error (Image-GS)";
    /// Seed where the residual is large.
    Residual(ResidualGrowth) = "residual": "Drop those that contribute least, add where the residual is large";
}

/// All policies by name.
fn named() -> impl Iterator<Item = &'static Named> {
    grow::NAMED.iter().chain(OTHERS)
}

/// [`Policy::NAMES`] for messages.
static LIST: LazyLock<String> = LazyLock::new(|| format!("one of {}", Policy::NAMES.join(", ")));

/// The names of policies for images, for messages.
static LIST_2D: LazyLock<String> = LazyLock::new(|| {
    let fits = |name: &&str| Policy::from_name(name).is_ok_and(|policy| !policy.needs().evidence);
    format!("one of {} for an image", Policy::NAMES.into_iter().filter(fits).collect::<Vec<_>>().join(", "))
});

/// The names of policies for 3D scenes, for messages.
static LIST_3D: LazyLock<String> = LazyLock::new(|| {
    let possible = |named: &&Named| (named.make)().of_3d_scenes().is_some();
    let names: Vec<&str> = named().filter(possible).map(|named| named.name).collect();
    format!("one of {} for a 3D scene", names.join(", "))
});

impl Policy {
    /// The names that [`Self::from_name`] accepts: the `kind`s of a settings file, and kinds with
    /// settings that have a name in the literature or another [`Signal`](crate::Signal).
    pub const NAMES: [&'static str; grow::NAMED.len() + OTHERS.len()] = {
        let mut names = [""; grow::NAMED.len() + OTHERS.len()];
        let mut at = 0;
        while at < names.len() {
            let of_grow = at < grow::NAMED.len();
            names[at] = if of_grow { grow::NAMED[at].name } else { OTHERS[at - grow::NAMED.len()].name };
            at += 1;
        }
        names
    };

    /// Returns the policy with this name and its default settings. What each does is in
    /// [`Self::summary`] and in `docs/policies.md`.
    ///
    /// # Errors
    /// [`Error::Setting`], listing the names.
    pub fn from_name(name: &str) -> Result<Self, Error> {
        match named().find(|named| named.name == name) {
            Some(named) => Ok((named.make)()),
            None => Err(Error::setting("policy", format!("`{name}`"), &LIST)),
        }
    }

    /// What the policy with this name does, in one line; `None` for a name that is not in
    /// [`Self::NAMES`].
    pub fn summary(name: &str) -> Option<&'static str> {
        named().find(|named| named.name == name).map(|named| named.summary)
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub(crate) fn validate(&self) -> Result<(), Error> {
        self.rule().validate()
    }

    /// Whether the policy tries to reach the budget. Under a threshold the budget is only a bound.
    pub fn aims_at_budget(&self) -> bool {
        self.rule().aims_at_budget()
    }

    /// The actions of a policy that clones and splits; other policies have none.
    pub fn actions(&self) -> Option<&Actions> {
        self.rule().actions()
    }

    /// [`Self::actions`], mutable.
    pub fn actions_mut(&mut self) -> Option<&mut Actions> {
        self.rule_mut()?.actions_mut()
    }

    /// Returns this policy for 3D scenes, which have no sizes in px.
    ///
    /// A split above a size in px becomes a split of any size, and a pruning bound in px is
    /// removed. Moments of new Gaussians are zeroed, as in the optimizer of 3DGS and its
    /// successors.
    #[must_use]
    pub fn for_3d(mut self) -> Self {
        if let Some(rule) = self.rule_mut() {
            rule.adapt_to_3d();
        }
        if let Some(Actions { densify, prune, .. }) = self.actions_mut() {
            densify.newcomers = Moments::Zeroed;
            if let SizeThreshold::Pixels(_) = densify.split_above {
                densify.split_above = SizeThreshold::WorldUnits(f32::MIN_POSITIVE);
            }
            prune.larger_than = prune.larger_than.filter(|bound| !matches!(bound, SizeThreshold::Pixels(_)));
        }
        self
    }

    /// Checks the policy for fits of images, which have no views to gather evidence from.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the policy, or the first value outside its range.
    pub fn validate_2d(&self) -> Result<(), Error> {
        if self.needs().evidence {
            let found = format!("`{}`, which needs several views of a 3D scene", self.name());
            return Err(Error::setting("policy", found, &LIST_2D));
        }
        self.validate()
    }

    /// Checks the policy for 3D scenes, where growth by residual and sizes in px are not possible.
    ///
    /// # Errors
    /// [`Error::Setting`] naming what is possible, or the first value outside its range.
    pub fn validate_3d(&self) -> Result<(), Error> {
        if let Some(Actions { densify, prune, .. }) = self.actions() {
            for bound in [Some(densify.split_above), prune.larger_than].into_iter().flatten() {
                if let SizeThreshold::Pixels(pixels) = bound {
                    let allowed = "an extent-fraction or in world-units: a 3D scene has no pixels";
                    return Err(Error::setting("a size", format!("{pixels} px"), allowed));
                }
            }
        }
        match self.of_3d_scenes() {
            Some(_) => self.validate(),
            None => {
                let found = format!("`{}`, which needs the residual of an image", self.name());
                Err(Error::setting("policy", found, &LIST_3D))
            }
        }
    }

    /// What training must do for this policy, for scenes of either kind.
    pub fn needs(&self) -> Needs {
        self.of_2d_scenes().needs()
    }
}

impl DensityPolicy for Policy {
    fn plan(&self, observation: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<Gaussian2d>, Error> {
        self.of_2d_scenes().plan(observation, rng)
    }

    fn needs(&self) -> Needs {
        self.needs()
    }
}

impl DensityPolicy<Scene3d> for Policy {
    fn plan(&self, observation: &Observation<'_, Scene3d>, rng: &mut Rng) -> Result<EditPlan<Gaussian3d>, Error> {
        self.validate_3d()?;
        self.of_3d_scenes().unwrap_or(&NoGrowth).plan(observation, rng)
    }

    fn needs(&self) -> Needs {
        self.needs()
    }

    fn evidence(&self, step: u32, progress: f32) -> Option<EvidenceRequest> {
        self.of_2d_scenes().evidence(step, progress)
    }
}

/// [`Policy::None`].
struct NoGrowth;

impl Rule for NoGrowth {
    fn validate(&self) -> Result<(), Error> {
        Ok(())
    }

    fn aims_at_budget(&self) -> bool {
        false
    }
}

impl<S: DensityScene> DensityPolicy<S> for NoGrowth {
    fn plan(&self, observation: &Observation<'_, S>, _: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        observation.check_lengths()?;
        let removed = Prune::NOT_FINITE_ONLY.removals(observation);
        Ok(EditPlan { removed, ..EditPlan::default() })
    }
}

#[cfg(test)]
mod tests;
