//! All policies as one value, for settings files and command lines.

use gs_core::{EditPlan, Error, Gaussian2d, Gaussian3d, Scene3d, edit::Moments, effects::Statistics};
use serde::{Deserialize, Serialize};

use crate::{
    densify::{Densify, SplitPlacement},
    error_addition::ErrorAddition,
    evidence::EvidenceRequest,
    fast_gs::FastGs,
    gaussian::DensityScene,
    grow::{Combine, Grow, GrowForm},
    improved_gs::ImprovedGs,
    mcmc::Mcmc,
    noise::Noise,
    observation::{DensityPolicy, Observation, Rng},
    prune::Prune,
    residual::ResidualGrowth,
    round::Actions,
    signal::Signal,
    size::SizeThreshold,
    taming::Taming,
};

/// Threshold of `long-axis` on the absolute gradient. *Source:* the code of Deng et al. 2024,
/// without its schedule of factors.
const LONG_AXIS_THRESHOLD: f32 = 3.5e-4;

/// Any of the policies. In a settings file, `kind` names the policy, beside its settings.
///
/// ```
/// use gs_density::{Grow, Policy};
///
/// let policy: Policy = toml::from_str("kind = 'percentile'\npercent = 5.0\nactions.densify.shrink = 2.0").unwrap();
/// assert!(matches!(policy, Policy::Grow(Grow { percent: 5.0, .. })));
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "Form", into = "Form")]
#[non_exhaustive]
pub enum Policy {
    /// Grow by rank and threshold.
    Grow(Grow),
    /// Seed where the residual is large.
    Residual(ResidualGrowth),
    /// Relocate and copy by opacity, with noise between steps.
    Mcmc(Mcmc),
    /// Grow and prune where several views agree that pixels are wrong.
    FastGs(FastGs),
    /// Grow by a score of many parts, along a schedule of counts.
    Taming(Taming),
    /// Split what draws edges, along a schedule of counts.
    ImprovedGs(ImprovedGs),
    /// Start with half of the Gaussians and add in proportion to the error.
    ImageGs(ErrorAddition),
    /// Grow nothing, and prune only Gaussians that are not finite. A control for measuring what
    /// growth is worth.
    None,
}

/// A policy in a settings file. The kinds of [`Grow`] are the names of its constructors.
#[derive(Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum Form {
    Absolute(GrowForm),
    Percentile(GrowForm),
    Hybrid(GrowForm),
    Paper(GrowForm),
    Residual(ResidualGrowth),
    Mcmc(Mcmc),
    #[serde(rename = "fastgs")]
    FastGs(FastGs),
    Taming(Taming),
    ImprovedGs(ImprovedGs),
    ImageGs(ErrorAddition),
    None {},
}

impl From<Form> for Policy {
    fn from(form: Form) -> Self {
        match form {
            Form::Absolute(form) => Self::Grow(form.or(Grow::absolute)),
            Form::Percentile(form) => Self::Grow(form.or(Grow::percentile)),
            Form::Hybrid(form) => Self::Grow(form.or(Grow::hybrid)),
            Form::Paper(form) => Self::Grow(form.or(Grow::paper)),
            Form::Residual(policy) => Self::Residual(policy),
            Form::Mcmc(policy) => Self::Mcmc(policy),
            Form::FastGs(policy) => Self::FastGs(policy),
            Form::Taming(policy) => Self::Taming(policy),
            Form::ImprovedGs(policy) => Self::ImprovedGs(policy),
            Form::ImageGs(policy) => Self::ImageGs(policy),
            Form::None {} => Self::None,
        }
    }
}

impl From<Policy> for Form {
    fn from(policy: Policy) -> Self {
        match policy {
            Policy::Grow(grow) => match kind(&grow) {
                "paper" => Self::Paper(grow.into()),
                "absolute" => Self::Absolute(grow.into()),
                "percentile" => Self::Percentile(grow.into()),
                _ => Self::Hybrid(grow.into()),
            },
            Policy::Residual(policy) => Self::Residual(policy),
            Policy::Mcmc(policy) => Self::Mcmc(policy),
            Policy::FastGs(policy) => Self::FastGs(policy),
            Policy::Taming(policy) => Self::Taming(policy),
            Policy::ImprovedGs(policy) => Self::ImprovedGs(policy),
            Policy::ImageGs(policy) => Self::ImageGs(policy),
            Policy::None => Self::None {},
        }
    }
}

/// The constructor of [`Grow`] that makes a rule like this one: `paper`, `absolute`, `percentile`
/// or `hybrid`.
fn kind(grow: &Grow) -> &'static str {
    match grow.combine {
        Combine::Either => "paper",
        Combine::Both if grow.percent >= 100.0 => "absolute",
        Combine::Both if grow.threshold == 0.0 => "percentile",
        Combine::Both => "hybrid",
    }
}

impl Policy {
    /// The names that [`Self::from_name`] accepts: the `kind`s of a settings file, and kinds with
    /// settings that have a name in the literature or another [`Signal`].
    pub const NAMES: [&'static str; 18] = [
        "absolute",
        "abs-gs",
        "absolute-error",
        "percentile",
        "percentile-abs-gs",
        "percentile-error",
        "hybrid",
        "hybrid-abs-gs",
        "hybrid-error",
        "long-axis",
        "paper",
        "mcmc",
        "fastgs",
        "taming",
        "improved-gs",
        "image-gs",
        "residual",
        "none",
    ];

    /// Returns the policy with this name and its default settings:
    ///
    /// - `absolute`, `abs-gs`, `absolute-error`: [`Grow::absolute`] by mean gradient (3DGS),
    ///   absolute gradient (AbsGS, which splits what is larger than a thousandth of the image, not
    ///   a hundredth) or pixel error (Rota Bulò et al. 2024);
    /// - `percentile`, `percentile-abs-gs`, `percentile-error`: [`Grow::percentile`] by the same;
    /// - `hybrid`, `hybrid-abs-gs`, `hybrid-error`: [`Grow::hybrid`] by the same;
    /// - `long-axis`: [`Grow::absolute`] by the absolute gradient, at its source's threshold of
    ///   0.00035, with a [`LongAxisSplit`](crate::LongAxisSplit) for both clone and split;
    /// - `paper`: [`Grow::paper`]; `mcmc`: [`Mcmc`]; `fastgs`: [`FastGs`]; `taming`: [`Taming`];
    ///   `improved-gs`: [`ImprovedGs`]; `image-gs`: [`ErrorAddition`]; `residual`:
    ///   [`ResidualGrowth`]; `none`: [`Policy::None`].
    ///
    /// # Errors
    /// [`Error::Setting`], listing the names.
    pub fn from_name(name: &str) -> Result<Self, Error> {
        use Signal::{AbsoluteGradient, MeanGradient, PixelError};
        Ok(match name {
            "absolute" => Self::Grow(Grow::absolute(MeanGradient)),
            "abs-gs" => Self::Grow(Grow::abs_gs()),
            "absolute-error" => Self::Grow(Grow::absolute(PixelError)),
            "percentile" => Self::Grow(Grow::percentile(MeanGradient)),
            "percentile-abs-gs" => Self::Grow(Grow::percentile(AbsoluteGradient)),
            "percentile-error" => Self::Grow(Grow::percentile(PixelError)),
            "hybrid" => Self::Grow(Grow::hybrid(MeanGradient)),
            "hybrid-abs-gs" => Self::Grow(Grow::hybrid(AbsoluteGradient)),
            "hybrid-error" => Self::Grow(Grow::hybrid(PixelError)),
            "long-axis" => Self::Grow(Grow {
                threshold: LONG_AXIS_THRESHOLD,
                actions: splitting(Densify::along_long_axes()),
                ..Grow::absolute(AbsoluteGradient)
            }),
            "paper" => Self::Grow(Grow::paper(MeanGradient)),
            "mcmc" => Self::Mcmc(Mcmc::default()),
            "fastgs" => Self::FastGs(FastGs::default()),
            "taming" => Self::Taming(Taming::default()),
            "improved-gs" => Self::ImprovedGs(ImprovedGs::default()),
            "image-gs" => Self::ImageGs(ErrorAddition::default()),
            "residual" => Self::Residual(ResidualGrowth::default()),
            "none" => Self::None,
            _ => {
                let allowed = "one of absolute, abs-gs, absolute-error, percentile, percentile-abs-gs, percentile-error, hybrid, \
                               hybrid-abs-gs, hybrid-error, long-axis, paper, mcmc, fastgs, taming, improved-gs, image-gs, residual, none";
                return Err(Error::setting("policy", format!("`{name}`"), allowed));
            }
        })
    }

    /// Name of the policy, as in [`Self::NAMES`], by its rule, signal and kind of split.
    pub fn name(&self) -> &'static str {
        use Signal::{AbsoluteGradient, MeanGradient, PixelError};
        match self {
            Self::Grow(grow) => match (kind(grow), grow.actions.densify.split_placement, grow.signal) {
                ("paper", ..) => "paper",
                ("absolute", SplitPlacement::LongAxisSplit(_), AbsoluteGradient) => "long-axis",
                ("absolute", _, MeanGradient) => "absolute",
                ("absolute", _, AbsoluteGradient) => "abs-gs",
                ("absolute", _, PixelError) => "absolute-error",
                ("percentile", _, MeanGradient) => "percentile",
                ("percentile", _, AbsoluteGradient) => "percentile-abs-gs",
                ("percentile", _, PixelError) => "percentile-error",
                (_, _, MeanGradient) => "hybrid",
                (_, _, AbsoluteGradient) => "hybrid-abs-gs",
                (_, _, PixelError) => "hybrid-error",
            },
            Self::Mcmc(_) => "mcmc",
            Self::FastGs(_) => "fastgs",
            Self::Taming(_) => "taming",
            Self::ImprovedGs(_) => "improved-gs",
            Self::ImageGs(_) => "image-gs",
            Self::Residual(_) => "residual",
            Self::None => "none",
        }
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub fn validate(&self) -> Result<(), Error> {
        match self {
            Self::Grow(policy) => policy.validate(),
            Self::Residual(policy) => policy.validate(),
            Self::Mcmc(policy) => policy.validate(),
            Self::FastGs(policy) => policy.validate(),
            Self::Taming(policy) => policy.validate(),
            Self::ImprovedGs(policy) => policy.validate(),
            Self::ImageGs(policy) => policy.validate(),
            Self::None => Ok(()),
        }
    }

    /// Whether the policy tries to reach the budget. Under a threshold the budget is only a bound.
    pub fn aims_at_budget(&self) -> bool {
        match self {
            Self::Grow(grow) => kind(grow) == "hybrid",
            Self::Residual(_) | Self::Mcmc(_) | Self::Taming(_) | Self::ImprovedGs(_) | Self::ImageGs(_) => true,
            Self::FastGs(_) | Self::None => false,
        }
    }

    /// The actions of a policy that clones and splits; other policies have none.
    pub fn actions(&self) -> Option<&Actions> {
        match self {
            Self::Grow(policy) => Some(&policy.actions),
            Self::FastGs(policy) => Some(&policy.actions),
            Self::Taming(policy) => Some(&policy.actions),
            Self::ImprovedGs(policy) => Some(&policy.actions),
            Self::Residual(_) | Self::Mcmc(_) | Self::ImageGs(_) | Self::None => None,
        }
    }

    /// [`Self::actions`], mutable.
    pub fn actions_mut(&mut self) -> Option<&mut Actions> {
        match self {
            Self::Grow(policy) => Some(&mut policy.actions),
            Self::FastGs(policy) => Some(&mut policy.actions),
            Self::Taming(policy) => Some(&mut policy.actions),
            Self::ImprovedGs(policy) => Some(&mut policy.actions),
            Self::Residual(_) | Self::Mcmc(_) | Self::ImageGs(_) | Self::None => None,
        }
    }

    /// Returns this policy for 3D scenes, which have no sizes in px.
    ///
    /// A split above a size in px becomes a split of any size, and a pruning bound in px is
    /// removed. Moments of new Gaussians are zeroed, as in the optimizer of 3DGS and its
    /// successors.
    #[must_use]
    pub fn for_3d(mut self) -> Self {
        if let Self::Mcmc(mcmc) = &mut self {
            mcmc.newcomers = Moments::Zeroed;
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
    /// [`Error::Setting`] naming the policy; those of [`Self::validate`].
    pub fn validate_2d(&self) -> Result<(), Error> {
        if self.of_2d_scenes().needs_evidence() {
            let allowed = "for images one without evidence over several views, which only training in 3D has";
            return Err(Error::setting("policy", format!("`{}`", self.evidence_name()), allowed));
        }
        self.validate()
    }

    /// What needs the evidence: the policy, or its actions.
    fn evidence_name(&self) -> String {
        match self {
            Self::FastGs(_) | Self::Taming(_) | Self::ImprovedGs(_) => self.name().to_owned(),
            _ => format!("{} with actions.simplify", self.name()),
        }
    }

    /// Checks the policy for 3D scenes, where growth by residual and sizes in px are not possible.
    ///
    /// # Errors
    /// [`Error::Setting`] naming what is possible; those of [`Self::validate`].
    pub fn validate_3d(&self) -> Result<(), Error> {
        if let Some(Actions { densify, prune, .. }) = self.actions() {
            for bound in [Some(densify.split_above), prune.larger_than].into_iter().flatten() {
                if let SizeThreshold::Pixels(pixels) = bound {
                    let allowed = "an extent-fraction or in world-units: a 3D scene has no pixels";
                    return Err(Error::setting("a size", format!("{pixels} px"), allowed));
                }
            }
        }
        let (Self::Residual(_) | Self::ImageGs(_)) = self else { return self.validate() };
        let allowed = "for 3D scenes one of absolute, abs-gs, absolute-error, percentile, percentile-abs-gs, percentile-error, \
                       hybrid, hybrid-abs-gs, hybrid-error, long-axis, paper, mcmc, fastgs, taming, improved-gs, none: the residual of an image \
                       is in 2D";
        Err(Error::setting("policy", format!("`{}`", self.name()), allowed))
    }

    /// Statistic that training must collect for this policy, for scenes of either kind.
    pub fn statistics(&self) -> Statistics {
        self.of_2d_scenes().statistics()
    }

    /// Noise that training adds to the means between steps, for scenes of either kind.
    pub fn noise(&self) -> Option<Noise> {
        self.of_2d_scenes().noise()
    }

    /// The policy for scenes of any kind; `None` where it is for 2D scenes only.
    fn of_any_scene<S: DensityScene>(&self) -> Option<&dyn DensityPolicy<S>> {
        Some(match self {
            Self::Grow(policy) => policy,
            Self::Mcmc(policy) => policy,
            Self::FastGs(policy) => policy,
            Self::Taming(policy) => policy,
            Self::ImprovedGs(policy) => policy,
            Self::None => &NoGrowth,
            Self::Residual(_) | Self::ImageGs(_) => return None,
        })
    }

    fn of_2d_scenes(&self) -> &dyn DensityPolicy {
        match self {
            Self::Residual(policy) => policy,
            Self::ImageGs(policy) => policy,
            _ => self.of_any_scene().unwrap_or(&NoGrowth),
        }
    }
}

impl DensityPolicy for Policy {
    fn plan(&self, observation: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<Gaussian2d>, Error> {
        self.of_2d_scenes().plan(observation, rng)
    }

    fn statistics(&self) -> Statistics {
        self.of_2d_scenes().statistics()
    }

    fn needs_residual(&self) -> bool {
        self.of_2d_scenes().needs_residual()
    }

    fn needs_evidence(&self) -> bool {
        self.of_2d_scenes().needs_evidence()
    }

    fn evidence(&self, step: u32, progress: f32) -> Option<EvidenceRequest> {
        self.of_2d_scenes().evidence(step, progress)
    }

    fn noise(&self) -> Option<Noise> {
        self.of_2d_scenes().noise()
    }
}

impl DensityPolicy<Scene3d> for Policy {
    fn plan(&self, observation: &Observation<'_, Scene3d>, rng: &mut Rng) -> Result<EditPlan<Gaussian3d>, Error> {
        self.validate_3d()?;
        self.of_any_scene().unwrap_or(&NoGrowth).plan(observation, rng)
    }

    fn statistics(&self) -> Statistics {
        Self::statistics(self)
    }

    fn needs_residual(&self) -> bool {
        false
    }

    fn needs_evidence(&self) -> bool {
        self.of_2d_scenes().needs_evidence()
    }

    fn evidence(&self, step: u32, progress: f32) -> Option<EvidenceRequest> {
        self.of_2d_scenes().evidence(step, progress)
    }

    fn noise(&self) -> Option<Noise> {
        Self::noise(self)
    }
}

/// The default actions with other cloning and splitting.
fn splitting(densify: Densify) -> Actions {
    Actions { densify, ..Actions::default() }
}

/// [`Policy::None`].
struct NoGrowth;

impl<S: DensityScene> DensityPolicy<S> for NoGrowth {
    fn plan(&self, observation: &Observation<'_, S>, _: &mut Rng) -> Result<EditPlan<S::Gaussian>, Error> {
        observation.check_lengths()?;
        let removed = Prune::NOT_FINITE_ONLY.removals(observation);
        Ok(EditPlan { removed, ..EditPlan::default() })
    }

    fn statistics(&self) -> Statistics {
        Statistics::None
    }

    fn needs_residual(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back_from_settings_files_and_the_error_lists_them() {
        let message = Policy::from_name("absolut").unwrap_err().to_string();
        assert!(message.contains("`absolut`"), "{message}");
        for name in Policy::NAMES {
            let policy = Policy::from_name(name).unwrap();
            assert_eq!(policy.name(), name);
            assert_eq!(toml::from_str::<Policy>(&toml::to_string(&policy).unwrap()).unwrap(), policy);
            policy.validate().unwrap();
            assert!(message.contains(name), "{message}");
        }
        for kind in
            ["absolute", "percentile", "hybrid", "paper", "mcmc", "fastgs", "taming", "image-gs", "residual", "none"]
        {
            let read = toml::from_str::<Policy>(&format!("kind = '{kind}'")).unwrap();
            assert_eq!(read, Policy::from_name(kind).unwrap());
        }
    }

    #[test]
    fn a_threshold_that_is_not_given_is_that_of_the_signal() {
        for (signal, suffix, threshold) in
            [("mean-gradient", "", 2e-4), ("absolute-gradient", "abs-gs", 4e-4), ("pixel-error", "error", 0.1)]
        {
            let read = |kind| toml::from_str::<Policy>(&format!("kind = '{kind}'\nsignal = '{signal}'")).unwrap();
            let Policy::Grow(absolute) = read("absolute") else { panic!("another kind") };
            assert_eq!(absolute.threshold, threshold);
            let Policy::Grow(hybrid) = read("hybrid") else { panic!("another kind") };
            assert_eq!(hybrid.threshold, 0.01 * threshold);
            assert!(read("percentile").name().ends_with(if suffix.is_empty() { "percentile" } else { suffix }));
        }
        let given = "kind = 'absolute'\nsignal = 'pixel-error'\nthreshold = 0.3";
        assert!(matches!(toml::from_str(given).unwrap(), Policy::Grow(Grow { threshold: 0.3, .. })));
    }

    #[test]
    fn abs_gs_splits_what_3dgs_would_clone() {
        let split_above = |name| match Policy::from_name(name).unwrap() {
            Policy::Grow(policy) => policy.actions.densify.split_above.bound(768.0),
            other => panic!("{other:?}"),
        };
        assert!((split_above("absolute") - 7.68).abs() < 1e-4 && (split_above("abs-gs") - 0.768).abs() < 1e-5);
    }

    #[test]
    fn settings_files_are_held_to_their_fields_and_ranges() {
        let read = |text: &str| toml::from_str::<Policy>(text);
        assert!(read("kind = 'percentile'\npercentage = 5").is_err());
        assert!(read("kind = 'paper'\nactions.densify.split-above = { pixels = 3.0 }").is_ok());
        assert!(read("kind = 'paper'\nactions.densify.split-above = { furlongs = 3.0 }").is_err());
        assert!(read("kind = 'everything'").is_err());
        assert!(read("kind = 'absolute'\nsignal = 'smoke'").is_err());
        assert!(read("kind = 'absolute'\nthresh = 1.0").is_err());
        assert!(read("kind = 'hybrid'\nfloors = 1.0").is_err());
        assert!(read("kind = 'none'\npercent = 1.0").is_err());
        for out_of_range in [
            "kind = 'absolute'\nthreshold = -1.0",
            "kind = 'percentile'\npercent = 101.0",
            "kind = 'hybrid'\nfloor = nan",
            "kind = 'paper'\nactions.densify.shrink = 0.5",
            "kind = 'paper'\nactions.densify.split-above = { pixels = 0.0 }",
            "kind = 'paper'\nactions.prune.opacity = 1.5",
            "kind = 'paper'\nactions.prune.larger-than = { extent-fraction = -0.5 }",
            "kind = 'paper'\nactions.reset.to = 0.0",
            "kind = 'hybrid'\nactions.densify.split-placement = { long-axis-split = { width = 0.0 } }",
            "kind = 'mcmc'\npercent = -1.0",
            "kind = 'mcmc'\ndead-opacity = 1.0",
            "kind = 'mcmc'\nnoise.every = 0",
            "kind = 'fastgs'\nhigh-error = nan",
            "kind = 'fastgs'\nfinal-every = 0",
            "kind = 'fastgs'\nopacity-ceiling = 0.0",
            "kind = 'taming'\nweights.depth = -1.0",
            "kind = 'improved-gs'\nrecovery-percent = 101.0",
            "kind = 'absolute'\nactions.growth-fraction = 1.5",
            "kind = 'absolute'\nactions.simplify.mass = nan",
            "kind = 'absolute'\nactions.simplify.every = 0",
            "kind = 'image-gs'\nadditions = 0",
            "kind = 'image-gs'\nstart-fraction = 1.5",
            "kind = 'image-gs'\nopacity = 1.0",
            "kind = 'image-gs'\nexponent = 0.0",
        ] {
            let policy = read(out_of_range).unwrap();
            assert!(matches!(policy.validate(), Err(Error::Setting { .. })), "{out_of_range}");
        }
    }
}
