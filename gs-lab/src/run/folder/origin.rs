//! What the results in a study's folder come from, so that no process adds others.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::study::{Machine, Plan, VERSION};

/// What the results in a folder come from, in `machine.json`.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Origin {
    #[serde(flatten)]
    pub(crate) machine: Machine,
    /// The version of the program; `None` where the file does not say it.
    #[serde(default)]
    version: Option<String>,
    /// Digests of the images or scenes by their names in the study.
    #[serde(default)]
    images: BTreeMap<String, String>,
}

impl Origin {
    /// The origin of a plan's results.
    pub(crate) fn of(plan: &Plan) -> Self {
        let images = plan.targets.iter().map(|target| (target.name.clone(), target.digest.clone())).collect();
        Self { machine: plan.machine.clone(), version: Some(VERSION.to_owned()), images }
    }

    /// Fails where a plan's results come from something else, with the difference and what to do.
    pub(crate) fn check(&self, plan: &Plan) -> Result<(), (String, &'static str)> {
        if self.version.as_deref() != Some(VERSION) {
            let theirs = self.version.as_deref().unwrap_or("(not stored)");
            let hint = "use that version, or begin again with this one in another folder";
            return Err((format!("is a study by version {theirs} of gs, but this is {VERSION}"), hint));
        }
        if self.machine.name != plan.machine.name {
            let what = format!("is a study on {}, but this is {}", self.machine.name, plan.machine.name);
            let hint = "a study has one backend and SIMD level for all machines: leave out flags that choose others";
            return Err((what, hint));
        }
        for target in &plan.targets {
            if self.images.get(&target.name).is_some_and(|digest| *digest != target.digest) {
                let place = target.path.as_ref().map_or_else(String::new, |file| format!(" ({})", file.display()));
                let what = format!(
                    "{} {}{place} is not the one that the study began with",
                    plan.study.target_word(),
                    target.name
                );
                return Err((what, "name the folder of the right one with --data or GS_DATA"));
            }
        }
        Ok(())
    }
}
