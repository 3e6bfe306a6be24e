//! Settings of runs on images: fits of 2D Gaussians.

use gs_core::{Choice as _, Scene2d};
use gs_density::Policy;
use gs_train::{CustomPolicy, FitSettings, InitialCount, Preset};

use super::{Asked, Planned, wrong};
use crate::study::{arm::AnyPolicy, target::StudyTarget};

impl Planned for Scene2d {
    fn start_settings(asked: &Asked<'_>, target: &StudyTarget) -> Result<FitSettings, String> {
        let size = target.image().map_or((1, 1), |image| image.size());
        let preset = Preset::from_name(asked.preset()).ok_or_else(|| {
            let known = Preset::ALL.map(Preset::name).join(", ");
            wrong("preset", format!("there is no preset `{}` for images: those are {known}", asked.preset()))
        })?;
        if asked.arm.start.is_some() {
            return Err(wrong("start", "is for scenes: an image starts from settings.init"));
        }
        if asked.arm.like_gs_train {
            return Err(wrong("like-gs-train", "is for scenes"));
        }
        if asked.arm.pose_error.is_some() {
            return Err(wrong("pose-error", "is for scenes"));
        }
        let mut settings = match (preset, asked.iterations()) {
            (Preset::Paper, iterations) => {
                let paper = Preset::Paper.settings(asked.budget, size);
                let iterations = iterations.unwrap_or(paper.iterations);
                paper.with_iterations(iterations)
            }
            (_, Some(iterations)) => FitSettings::for_image(asked.budget, size, iterations),
            (preset, None) => preset.settings(asked.budget, size),
        };
        if let Some(name) = &asked.arm.policy {
            settings.policy = Policy::from_name(name).map_err(|error| wrong("policy", error))?;
        }
        Ok(match asked.arm.parameterization {
            Some(parameterization) => settings.with_parameterization(parameterization),
            None => settings,
        })
    }

    fn completed(settings: FitSettings, seed: u32) -> FitSettings {
        settings.with(|s| {
            s.seed = seed;
            if let InitialCount::Fixed(count) = &mut s.initial {
                *count = (*count).min(s.gaussians);
            }
        })
    }

    fn own(policy: &AnyPolicy) -> Option<&CustomPolicy> {
        match policy {
            AnyPolicy::In2d(policy) => Some(policy),
            AnyPolicy::In3d(_) | AnyPolicy::Elsewhere => None,
        }
    }
}
