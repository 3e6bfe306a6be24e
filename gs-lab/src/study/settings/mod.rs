//! What differs between the settings of runs on images and those of runs on 3D scenes.

mod image;
mod scene;

use std::fmt::Display;

use gs_core::{RenderSettings, effects::Statistics};
use gs_train::{CustomPolicy, Error as TrainError, FitSettings, SettingsFile as _, TrainSettings, Trainable};

use super::{
    arm::{AnyPolicy, Arm},
    definition::Study,
    target::StudyTarget,
};

/// What an arm asks for besides its settings.
pub(crate) struct Asked<'a> {
    pub(crate) study: &'a Study,
    pub(crate) arm: &'a Arm,
    pub(crate) budget: u32,
}

impl Asked<'_> {
    pub(crate) fn preset(&self) -> &str {
        self.arm.preset.as_ref().unwrap_or(&self.study.preset)
    }

    pub(crate) fn iterations(&self) -> Option<u32> {
        self.arm.iterations.or(self.study.iterations)
    }
}

/// The message that the value of a key of an arm is not possible, and why.
fn wrong(key: &str, why: impl Display) -> String {
    format!("{key}: {why}")
}

/// The kind of scene of a run, as far as a plan needs it.
pub(crate) trait Planned: Trainable {
    /// The settings of an arm before its table of settings, without the seed. The error names the
    /// wrong key and the reason.
    fn start_settings(asked: &Asked<'_>, target: &StudyTarget) -> Result<Self::Settings, String>;

    /// The settings with the seed, and with numbers that depend on others.
    fn completed(settings: Self::Settings, seed: u32) -> Self::Settings;

    /// The policy, where it is one for this kind of scene.
    fn own(policy: &AnyPolicy) -> Option<&CustomPolicy<Self>>;
}

/// The settings of a run.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ArmSettings {
    /// Those of the fit of an image.
    Image(Box<FitSettings>),
    /// Those of the training of a scene.
    Scene(Box<TrainSettings>),
}

/// Runs an expression on the settings of either kind.
macro_rules! of_either {
    ($settings:expr, $of:ident => $expression:expr) => {
        match $settings {
            ArmSettings::Image($of) => $expression,
            ArmSettings::Scene($of) => $expression,
        }
    };
}

impl ArmSettings {
    /// The settings as the text of a TOML file, which `gs fit --settings` or `gs train --settings`
    /// reads.
    ///
    /// # Errors
    /// [`gs_train::Error::UnwritableSettings`] where TOML has no form for them.
    pub(crate) fn to_toml(&self) -> Result<String, TrainError> {
        of_either!(self, settings => settings.to_toml())
    }

    /// Largest number of Gaussians.
    pub(crate) fn gaussians(&self) -> u32 {
        of_either!(self, settings => settings.gaussians)
    }

    /// Number of steps.
    pub(crate) fn iterations(&self) -> u32 {
        of_either!(self, settings => settings.iterations)
    }

    /// Settings of renderings.
    pub(crate) fn render(&self) -> &RenderSettings {
        of_either!(self, settings => &settings.render)
    }

    /// The densification statistics that the policy needs.
    pub(crate) fn statistics(&self) -> Statistics {
        match self {
            Self::Image(settings) => settings.policy.needs().statistics,
            Self::Scene(settings) => settings.policy.needs().statistics,
        }
    }
}

impl From<FitSettings> for ArmSettings {
    fn from(settings: FitSettings) -> Self {
        Self::Image(settings.into())
    }
}

impl From<TrainSettings> for ArmSettings {
    fn from(settings: TrainSettings) -> Self {
        Self::Scene(settings.into())
    }
}

#[cfg(test)]
impl ArmSettings {
    /// The settings of a fit.
    pub(crate) fn of_image(&self) -> &FitSettings {
        let Self::Image(settings) = self else { panic!("a training") };
        settings
    }

    /// The settings of a training.
    pub(crate) fn of_scene(&self) -> &TrainSettings {
        let Self::Scene(settings) = self else { panic!("a fit") };
        settings
    }
}
