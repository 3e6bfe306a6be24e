//! The definition of a study: arms × images or scenes × budgets × seeds, read from a short TOML file.

use gs_train::parse_settings;
use serde::{Deserialize, Serialize};
use std::{fmt, path::Path};

use super::{
    arm::{Arm, Factor},
    claim::{Choice, StatedClaim},
    clock::Clock,
    column::Measure,
    selection::Quick,
    target::DatasetReading,
};
use crate::error::Error;
#[cfg(doc)]
use crate::synthetic::SyntheticTarget;

/// An experiment: every arm fits every image, or is trained on every scene, at every budget from
/// every seed.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Study {
    /// A short name, for folders and titles.
    pub name: String,
    /// The question that the study answers, one or two sentences.
    #[serde(default)]
    pub question: String,
    /// Image files, relative to the data folder or to the study file; and names of
    /// [`SyntheticTarget`]s, which need no file, such as `paper`. A study has either images or scenes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) images: Vec<String>,
    /// Data sets of posed images, as `gs train` reads them, relative to the data folder or to the
    /// study file.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) scenes: Vec<String>,
    /// The largest numbers of Gaussians allowed.
    pub(crate) budgets: Vec<u32>,
    /// Seeds of all random numbers, the same for every arm.
    pub(crate) seeds: Vec<u32>,
    /// What is held equal when arms are compared.
    #[serde(default = "all_matchings", rename = "match")]
    pub(crate) matchings: Vec<Matching>,
    /// What is measured as the time of a run.
    #[serde(default, skip_serializing_if = "Clock::is_wall")]
    pub(crate) clock: Clock,
    /// What is measured of every run besides the usual; images only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) measure: Vec<Measure>,
    /// Whether held-out views are measured where errors of their poses do not count: the camera of each
    /// is aligned to the left half of its image, and the right half is measured
    /// ([`PoseMatched`](gs_train::train::PoseMatched)). Scenes only, at equal count only: curves over steps
    /// and time are of whole views at the given poses.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) align_poses: bool,
    /// The arm that the report compares the others with; by default the first. The tables compare
    /// all pairs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) baseline: Option<String>,
    /// The preset that arms start from, unless they name another: a [`Preset`](gs_train::Preset), or
    /// for scenes a [`TrainPreset`](gs_train::TrainPreset).
    #[serde(default = "standard")]
    pub(crate) preset: String,
    /// Steps of the optimizer instead of the preset's. The schedule is stretched accordingly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) iterations: Option<u32>,
    /// How the data sets are read.
    #[serde(default, skip_serializing_if = "DatasetReading::is_default")]
    pub(crate) dataset: DatasetReading,
    /// Settings of all arms that differ from the preset's, with the keys of
    /// [`gs_train::FitSettings`], or for scenes of [`gs_train::TrainSettings`].
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub(crate) settings: toml::Table,
    /// The arms that are compared; those of a study with factors are all combinations of these.
    #[serde(default, rename = "arm", skip_serializing_if = "Vec::is_empty")]
    pub arms: Vec<Arm>,
    /// The factors of a factorial design.
    #[serde(default, rename = "factor", skip_serializing_if = "Vec::is_empty")]
    pub(crate) factors: Vec<Factor>,
    /// A smaller form of the study, for a first look.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) quick: Option<Quick>,
    /// Arms that claims choose case by case.
    #[serde(default, rename = "choice", skip_serializing_if = "Vec::is_empty")]
    pub(crate) choices: Vec<Choice>,
    /// What the study's runs confirm or refute.
    #[serde(default, rename = "claim", skip_serializing_if = "Vec::is_empty")]
    pub(crate) claims: Vec<StatedClaim>,
}

gs_core::impl_with!(Study);

fn standard() -> String {
    "standard".to_owned()
}

gs_core::choices! {
    /// What is held equal when two arms are compared.
    pub(crate) enum Matching {
        /// The number of Gaussians: the ends of runs whose counts are equal.
        Count = "count",
        /// The number of steps: the largest that all arms of the study have reached.
        Iterations = "iterations",
        /// The time spent on training: that of the study's fastest arm.
        Time = "time",
    }
}

fn all_matchings() -> Vec<Matching> {
    Matching::ALL.to_vec()
}

impl Study {
    /// Reads a study from TOML text. `origin` is the file's name for errors.
    ///
    /// # Errors
    /// [`Error::Form`] with the line, and those of [`Study::validate`].
    pub fn from_toml(text: &str, origin: &str) -> Result<Self, Error> {
        Self::from_toml_and(text, origin, Vec::new())
    }

    /// Reads a study as [`Self::from_toml`] does, with further arms of the caller's own, without
    /// which it may have none.
    ///
    /// # Errors
    /// Those of [`Self::from_toml`].
    pub fn from_toml_and(text: &str, origin: &str, arms: Vec<Arm>) -> Result<Self, Error> {
        let wrong = |error| match error {
            gs_train::Error::Settings { line, problem, .. } => {
                Error::Form { origin: origin.to_owned(), line, message: problem }
            }
            error => Error::Fit(error),
        };
        let mut study: Self = parse_settings(text, Path::new(origin)).map_err(wrong)?;
        study.expand()?;
        study.arms.extend(arms);
        study.validate()?;
        Ok(study)
    }

    /// The study as the text of a TOML file, for [`Self::from_toml`]. Arms that combine factors are
    /// left out, as the factors stand for them.
    ///
    /// # Errors
    /// [`Error::Study`] where TOML has no form for it.
    pub(crate) fn to_toml(&self) -> Result<String, Error> {
        let arms = if self.factors.is_empty() { self.arms.clone() } else { Vec::new() };
        let stored = Self { arms, ..self.clone() };
        toml::to_string(&stored).map_err(|error| self.wrong(error.to_string(), "leave it out"))
    }

    /// Fails where the study lists nothing to compare, or lists something twice. Settings are
    /// checked by [`Plan::new`](crate::Plan::new).
    ///
    /// # Errors
    /// [`Error::Study`] with the problem and how to fix it.
    pub fn validate(&self) -> Result<(), Error> {
        let names: Vec<&str> = self.arms.iter().map(|arm| arm.name.as_str()).collect();
        let fine = |name: &str| name.chars().all(|c| c.is_alphanumeric() || "-_.".contains(c)) && !name.is_empty();
        let of_factors = |name: &str| name.split('+').all(fine);
        if !fine(&self.name) || self.name.starts_with('.') {
            return Err(self.wrong("its name is not a word", "use letters, digits, `-`, `_` and `.`"));
        }
        let factors: Vec<&str> = self.factors.iter().map(|factor| factor.name.as_str()).collect();
        let arms = names.iter().filter(|name| !of_factors(name)).map(|name| ("arm", name));
        if let Some((what, name)) = arms.chain(factors.iter().filter(|n| !fine(n)).map(|name| ("factor", name))).next()
        {
            return Err(
                self.wrong(format!("{what} `{name}`: its name is not a word"), "use letters, digits, `-`, `_` and `.`")
            );
        }
        match (self.images.is_empty(), self.scenes.is_empty()) {
            (false, false) => {
                return Err(self.wrong("it has both images and scenes", "make two studies of it"));
            }
            (_, true) => {
                self.listed("images", &self.images, "name at least one, such as images = [\"paper\"], or scenes")?
            }
            (true, false) => self.listed("scenes", &self.scenes, "name at least one")?,
        }
        if !self.images.is_empty() && !self.dataset.is_default() {
            return Err(self.wrong("[dataset] is for scenes", "leave it out"));
        }
        if self.align_poses && (self.scenes.is_empty() || self.matchings != [Matching::Count]) {
            let what = "align-poses is for scenes that are compared at their ends";
            return Err(self.wrong(what, "leave it out, or set match = [\"count\"]"));
        }
        self.unrepeated("factor", &factors)?;
        self.listed("budgets", &self.budgets, "name at least one, such as budgets = [1000]")?;
        self.listed("seeds", &self.seeds, "name at least one, such as seeds = [0, 1, 2, 3, 4]")?;
        self.listed("arm", &names, "name at least one: [[arm]] with a name")?;
        self.listed("match", &self.matchings, "name at least one of \"count\", \"iterations\", \"time\"")?;
        for (key, names) in [("images", &self.images), ("scenes", &self.scenes)] {
            if let Some(name) = names.iter().find(|name| name.contains(char::is_control)) {
                return Err(self.wrong(format!("{key}: {name:?} has a control character"), "rename the file"));
            }
        }
        if self.budgets.contains(&0) {
            return Err(self.wrong("budgets: 0 Gaussians draw nothing", "leave 0 out"));
        }
        if let Some(baseline) = self.baseline.as_ref().filter(|&baseline| !names.contains(&baseline.as_str())) {
            return Err(self.wrong(format!("baseline: there is no arm `{baseline}`"), "name one of the arms"));
        }
        let tables = std::iter::once(("settings".to_owned(), &self.settings))
            .chain(self.arms.iter().map(|arm| (format!("arm `{}`: settings", arm.name), &arm.settings)));
        for (place, table) in tables {
            for (key, hint) in [
                ("gaussians", "list it under budgets"),
                ("gaussians-per-point", "the budget is the number of Gaussians"),
                ("seed", "list it under seeds"),
            ] {
                if table.contains_key(key) {
                    return Err(self.wrong(format!("{place}: `{key}` is not for settings"), hint));
                }
            }
        }
        self.validate_claims()
    }

    /// Index of the baseline among the arms.
    pub(crate) fn baseline_arm(&self) -> usize {
        self.baseline.as_ref().and_then(|name| self.arms.iter().position(|arm| arm.name == *name)).unwrap_or(0)
    }

    /// Whether the study trains scenes.
    pub fn is_of_scenes(&self) -> bool {
        !self.scenes.is_empty()
    }

    /// Images or scenes by their names.
    pub(crate) fn target_names(&self) -> &[String] {
        if self.is_of_scenes() { &self.scenes } else { &self.images }
    }

    /// "image" or "scene".
    pub(crate) fn target_word(&self) -> &'static str {
        if self.is_of_scenes() { "scene" } else { "image" }
    }

    fn listed<T: PartialEq + fmt::Debug>(&self, key: &str, values: &[T], hint: &'static str) -> Result<(), Error> {
        if values.is_empty() {
            return Err(self.wrong(format!("{key}: there are none"), hint));
        }
        self.unrepeated(key, values)
    }

    pub(super) fn unrepeated<T: PartialEq + fmt::Debug>(&self, key: &str, values: &[T]) -> Result<(), Error> {
        let twice = values.iter().enumerate().find(|(i, value)| values[..*i].contains(value));
        match twice {
            Some((_, value)) => Err(self.wrong(format!("{key}: {value:?} is listed twice"), "remove one")),
            None => Ok(()),
        }
    }

    pub(crate) fn wrong(&self, what: impl Into<String>, hint: &'static str) -> Error {
        Error::Study { study: self.name.clone(), what: what.into(), hint }
    }
}
