//! Settings of runs on scenes: trainings of 3D Gaussians from views.

use gs_core::{Choice as _, Scene3d};
use gs_density::Policy;
use gs_io::dataset::Split;
use gs_train::{CustomPolicy, TrainPreset, TrainSettings};

use super::{Asked, Planned, wrong};
use crate::study::{arm::AnyPolicy, overrides, target::StudyTarget};

impl Planned for Scene3d {
    fn start_settings(asked: &Asked<'_>, target: &StudyTarget) -> Result<TrainSettings, String> {
        let preset = TrainPreset::from_name(asked.preset()).ok_or_else(|| {
            let known = TrainPreset::ALL.map(TrainPreset::name).join(", ");
            wrong("preset", format!("there is no preset `{}` for scenes: those are {known}", asked.preset()))
        })?;
        let Some(dataset) = target.dataset() else {
            return Err(wrong("preset", "is for scenes"));
        };
        if let Some(start) = asked.arm.start {
            start.of(dataset).map_err(|error| wrong("start", format!("{error} ({})", target.label())))?;
        }
        if let Some(error) = &asked.arm.pose_error {
            error.validate().map_err(|error| wrong("pose-error", error))?;
        }
        let cameras = dataset.views_of(Split::Train).map(|view| &view.camera);
        let mut settings = preset.settings_for(asked.iterations(), dataset.kind, cameras);
        settings = match asked.arm.like_gs_train {
            // The points of the start may double the preset's number.
            true if settings.gaussians <= asked.budget / 2 => settings,
            true => {
                let gaussians = settings.gaussians.min(asked.budget);
                settings.with_gaussians(gaussians)
            }
            false => settings.with_gaussians(asked.budget),
        };
        // What is wrong with the rounds is reported later, with its place.
        for over in [&asked.study.settings, &asked.arm.settings] {
            settings = overrides::with_rounds(settings, over);
        }
        if let Some(name) = &asked.arm.policy {
            let policy = Policy::from_name(name).map_err(|error| wrong("policy", error))?;
            settings = settings.with_policy(policy);
            settings.policy.validate_3d().map_err(|error| wrong("policy", error))?;
        }
        let parameterization = asked.arm.parameterization.unwrap_or_default();
        parameterization.check_3d().map_err(|error| wrong("parameterization", error))?;
        Ok(settings)
    }

    fn completed(settings: TrainSettings, seed: u32) -> TrainSettings {
        settings.with(|s| s.seed = seed)
    }

    fn own(policy: &AnyPolicy) -> Option<&CustomPolicy<Self>> {
        match policy {
            AnyPolicy::In2d(_) | AnyPolicy::Elsewhere => None,
            AnyPolicy::In3d(policy) => Some(policy),
        }
    }
}
