//! All policies as one value, for settings files and command lines.

use gs_core::{EditPlan, Error, PlanarGaussian, effects::Statistics};
use serde::{Deserialize, Serialize};

use crate::{
    absolute::AbsoluteThreshold,
    hybrid::Hybrid,
    observation::{DensityPolicy, Observation, Rng},
    paper::Paper,
    percentile::RelativePercentile,
    prune::Prune,
    residual::ResidualGrowth,
};

/// Any of the policies. In a settings file, `kind` names it and stands beside its settings.
///
/// ```
/// use gs_density::{Policy, RelativePercentile};
///
/// let policy: Policy = toml::from_str("kind = 'percentile'\npercent = 5.0\nactions.densify.shrink = 2.0").unwrap();
/// assert!(matches!(policy, Policy::Percentile(RelativePercentile { percent: 5.0, .. })));
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Policy {
    /// Grow above a threshold.
    Absolute(AbsoluteThreshold),
    /// Grow the first few by rank.
    Percentile(RelativePercentile),
    /// Grow the first few by rank that are above a floor.
    Hybrid(Hybrid),
    /// Grow the first few by rank and what is above a threshold.
    Paper(Paper),
    /// Seed where the residual is large.
    Residual(ResidualGrowth),
    /// Grow nothing, and prune only what is not finite.
    None,
}

impl Policy {
    /// The names that [`Self::from_name`] knows; the `kind`s of a settings file.
    pub const NAMES: [&'static str; 6] = ["absolute", "percentile", "hybrid", "paper", "residual", "none"];

    /// The policy of that name, with its default settings.
    ///
    /// # Errors
    /// [`Error::Setting`], listing the names.
    pub fn from_name(name: &str) -> Result<Self, Error> {
        Ok(match name {
            "absolute" => Self::Absolute(AbsoluteThreshold::default()),
            "percentile" => Self::Percentile(RelativePercentile::default()),
            "hybrid" => Self::Hybrid(Hybrid::default()),
            "paper" => Self::Paper(Paper::default()),
            "residual" => Self::Residual(ResidualGrowth::default()),
            "none" => Self::None,
            _ => {
                let allowed = "one of absolute, percentile, hybrid, paper, residual, none";
                return Err(Error::setting("policy", format!("`{name}`"), allowed));
            }
        })
    }

    /// The policy's name, as in [`Self::NAMES`].
    pub fn name(&self) -> &'static str {
        match self {
            Self::Absolute(_) => "absolute",
            Self::Percentile(_) => "percentile",
            Self::Hybrid(_) => "hybrid",
            Self::Paper(_) => "paper",
            Self::Residual(_) => "residual",
            Self::None => "none",
        }
    }

    /// Fails where a number is outside its range, before training starts rather than at its first round.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        match self {
            Self::Absolute(policy) => policy.validate(),
            Self::Percentile(policy) => policy.validate(),
            Self::Hybrid(policy) => policy.validate(),
            Self::Paper(policy) => policy.validate(),
            Self::Residual(policy) => policy.validate(),
            Self::None => Ok(()),
        }
    }

    fn inner(&self) -> &dyn DensityPolicy {
        match self {
            Self::Absolute(policy) => policy,
            Self::Percentile(policy) => policy,
            Self::Hybrid(policy) => policy,
            Self::Paper(policy) => policy,
            Self::Residual(policy) => policy,
            Self::None => &NoGrowth,
        }
    }
}

impl DensityPolicy for Policy {
    fn plan(&self, observation: &Observation<'_>, rng: &mut Rng) -> Result<EditPlan<PlanarGaussian>, Error> {
        self.inner().plan(observation, rng)
    }

    fn statistics(&self) -> Statistics {
        self.inner().statistics()
    }

    fn needs_residual(&self) -> bool {
        self.inner().needs_residual()
    }
}

/// [`Policy::None`].
struct NoGrowth;

impl DensityPolicy for NoGrowth {
    fn plan(&self, observation: &Observation<'_>, _: &mut Rng) -> Result<EditPlan<PlanarGaussian>, Error> {
        observation.check_lengths()?;
        let removed = Prune::NOT_FINITE_ONLY.removals(observation.scene, observation.size);
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
    fn names_are_the_kinds_and_the_error_lists_them() {
        let message = Policy::from_name("absolut").unwrap_err().to_string();
        assert!(message.contains("`absolut`"), "{message}");
        for name in Policy::NAMES {
            let policy = Policy::from_name(name).unwrap();
            assert_eq!(policy.name(), name);
            assert_eq!(toml::from_str::<Policy>(&format!("kind = '{name}'")).unwrap(), policy);
            assert_eq!(toml::from_str::<Policy>(&toml::to_string(&policy).unwrap()).unwrap(), policy);
            policy.validate().unwrap();
            assert!(message.contains(name), "{message}");
        }
    }

    #[test]
    fn settings_files_are_held_to_their_fields_and_ranges() {
        let read = |text: &str| toml::from_str::<Policy>(text);
        assert!(read("kind = 'percentile'\npercentage = 5").is_err());
        assert!(read("kind = 'paper'\nactions.densify.split-above = { pixels = 3.0 }").is_ok());
        assert!(read("kind = 'paper'\nactions.densify.split-above = { furlongs = 3.0 }").is_err());
        assert!(read("kind = 'everything'").is_err());
        for out_of_range in [
            "kind = 'absolute'\nthreshold = -1.0",
            "kind = 'percentile'\npercent = 101.0",
            "kind = 'hybrid'\nfloor = nan",
            "kind = 'paper'\nactions.densify.shrink = 0.5",
            "kind = 'paper'\nactions.densify.split-above = { pixels = 0.0 }",
            "kind = 'paper'\nactions.prune.opacity = 1.5",
            "kind = 'paper'\nactions.prune.larger-than = { extent-fraction = -0.5 }",
            "kind = 'paper'\nactions.reset.to = 0.0",
        ] {
            let policy = read(out_of_range).unwrap();
            assert!(matches!(policy.validate(), Err(Error::Setting { .. })), "{out_of_range}");
        }
    }
}
