//! The settings of a fit by names, as the page's form has them.

use gs_core::{Blend, Image};
use gs_density::Policy;
use gs_train::{FitSettings, Preset, mean_color};
use serde::{Deserialize, Serialize};
use wasm_bindgen::prelude::*;

use crate::failure;

/// The choices of the form. What is absent is as in `gs fit`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Choices {
    preset: Option<Preset>,
    gaussians: Option<u32>,
    iterations: Option<u32>,
    policy: Option<String>,
    blend: Option<Blend>,
    seed: Option<u32>,
}

impl Choices {
    /// The settings for a target.
    pub(crate) fn settings(&self, target: &Image) -> Result<FitSettings, JsError> {
        let preset = self.preset.unwrap_or(Preset::Standard);
        let mut settings = FitSettings::from_preset(preset, target.size(), self.gaussians, self.iterations);
        if let Some(blend) = self.blend {
            settings = settings.with_blend(blend, mean_color(target));
        }
        if let Some(policy) = &self.policy {
            settings = settings.with_policy(Policy::from_name(policy).map_err(failure)?);
        }
        settings.seed = self.seed.unwrap_or(settings.seed);
        let settings = settings.before_flat_color(target);
        settings.validate().map_err(failure)?;
        Ok(settings)
    }
}

/// A policy of the form.
#[derive(Serialize)]
struct Offered {
    name: &'static str,
    summary: &'static str,
}

/// The policies for images, as JSON: `[{"name", "summary"}]`.
#[wasm_bindgen]
pub fn policies() -> String {
    let possible = |name: &&str| Policy::from_name(name).is_ok_and(|policy| policy.validate_2d().is_ok());
    let offered = |name| Offered { name, summary: Policy::summary(name).unwrap_or_default() };
    let all: Vec<Offered> = Policy::NAMES.into_iter().filter(possible).map(offered).collect();
    serde_json::to_string(&all).unwrap_or_default()
}
