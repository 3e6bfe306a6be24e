//! An arm of a study.

mod factor;
mod pose_error;

use std::fmt;

use gs_core::{Parameterization, Scene3d, effects::Statistics};
use gs_io::dataset::Dataset;
use gs_train::{CustomPolicy, TrainSettings, train::StartName};
use serde::{Deserialize, Serialize};

pub(crate) use self::factor::Factor;
pub use self::pose_error::PoseError;

gs_core::impl_with!(Arm);

/// An arm of a study: a policy, or any other settings of a run. The levels of a
/// factor have the same keys.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Arm {
    /// A short name, for tables.
    pub name: String,
    /// A description, one sentence.
    #[serde(default)]
    pub about: String,
    /// Replaces the study's preset.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Replaces the study's iterations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u32>,
    /// What a training starts from, as `gs train --start`; studies of scenes only. By default what
    /// suits the data set: [`StartName::usual`]. Without `like-gs-train`, the images are not
    /// searched for more points, so that arms with other settings start alike.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<StartName>,
    /// Whether the arm has the number of Gaussians and the start that `gs train` chooses for its
    /// preset. The budget is the largest number allowed; initial points raise a number of at most half
    /// of it only. Studies of scenes only.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub like_gs_train: bool,
    /// Wrong camera poses; studies of scenes only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_error: Option<PoseError>,
    /// A policy by its name, with its source's parameters: one of [`gs_density::Policy::NAMES`]. In
    /// studies of scenes it prunes and resets opacities as the preset does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy: Option<String>,
    /// Coordinates in which the optimizer moves, with the learning rates that go with them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameterization: Option<Parameterization>,
    /// A policy that settings cannot name. A study's file keeps its fingerprint, so that every program
    /// finds the runs and reports them; only a program with the policy can do them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) own_policy: Option<OwnPolicy>,
    /// Settings that differ from the study's and from those that the keys above choose.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub settings: toml::Table,
    /// The level of each of the study's factors, where the arm is a combination of them.
    #[serde(skip)]
    pub(crate) levels: Vec<usize>,
}

impl Arm {
    /// An arm without settings of its own.
    pub fn named(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            about: String::new(),
            preset: None,
            iterations: None,
            start: None,
            like_gs_train: false,
            pose_error: None,
            policy: None,
            parameterization: None,
            own_policy: None,
            settings: toml::Table::new(),
            levels: Vec::new(),
        }
    }

    /// An arm that differs from the settings of a study of images only in its policy. `fingerprint`
    /// describes everything that the policy's plans depend on: two policies that plan differently must have
    /// different ones, or a study reuses the results of one for the other.
    pub fn with_policy(name: impl Into<String>, fingerprint: impl Into<String>, policy: CustomPolicy) -> Self {
        Self::with_any_policy(name, fingerprint, AnyPolicy::In2d(policy))
    }

    /// [`Self::with_policy`] for a study of scenes.
    pub fn with_policy_3d(
        name: impl Into<String>,
        fingerprint: impl Into<String>,
        policy: CustomPolicy<Scene3d>,
    ) -> Self {
        Self::with_any_policy(name, fingerprint, AnyPolicy::In3d(policy))
    }

    fn with_any_policy(name: impl Into<String>, fingerprint: impl Into<String>, policy: AnyPolicy) -> Self {
        let own_policy = Some(OwnPolicy { fingerprint: fingerprint.into(), policy });
        Self { own_policy, ..Self::named(name) }
    }

    /// What a training of this arm with these settings starts from.
    pub(crate) fn start(&self, dataset: &Dataset, settings: &TrainSettings) -> StartName {
        match (self.start, self.like_gs_train) {
            (Some(start), _) => start,
            (None, true) => StartName::usual_for(dataset, settings),
            (None, false) => StartName::usual(dataset),
        }
    }
}

/// A policy that settings cannot name.
#[derive(Clone, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub(crate) struct OwnPolicy {
    /// Describes everything that the policy's plans depend on. Two policies that plan differently
    /// must have different fingerprints, or a study reuses the results of one for the other.
    pub(crate) fingerprint: String,
    /// The policy.
    pub(crate) policy: AnyPolicy,
}

impl From<String> for OwnPolicy {
    /// The policy of a study's file.
    fn from(fingerprint: String) -> Self {
        Self { fingerprint, policy: AnyPolicy::Elsewhere }
    }
}

impl From<OwnPolicy> for String {
    fn from(policy: OwnPolicy) -> Self {
        policy.fingerprint
    }
}

/// A policy for either kind of scene.
#[derive(Clone)]
#[non_exhaustive]
pub(crate) enum AnyPolicy {
    /// For fits of images.
    In2d(CustomPolicy),
    /// For the training of 3D scenes.
    In3d(CustomPolicy<Scene3d>),
    /// A policy that only another program has.
    Elsewhere,
}

impl AnyPolicy {
    /// The densification statistics that the policy needs, where this program has it.
    pub(crate) fn statistics(&self) -> Option<Statistics> {
        match self {
            Self::In2d(policy) => Some(policy.needs().statistics),
            Self::In3d(policy) => Some(policy.needs().statistics),
            Self::Elsewhere => None,
        }
    }
}

impl fmt::Debug for AnyPolicy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::In2d(_) => "In2d",
            Self::In3d(_) => "In3d",
            Self::Elsewhere => "Elsewhere",
        })
    }
}

impl fmt::Debug for OwnPolicy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OwnPolicy").field(&self.fingerprint).finish()
    }
}
