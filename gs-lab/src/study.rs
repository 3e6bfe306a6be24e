//! The definition of a study: arms × images × budgets × seeds, read from a short TOML file.

use gs_train::{ForeignPolicy, Preset, parse_settings};
use serde::{Deserialize, Serialize};
use std::{fmt, path::Path};

pub use crate::{
    built_in::BUILT_IN,
    claims::ClaimNote,
    comparison::{Difference, Verdict},
    conduct::{Conducted, Watcher, refuse_unsupported},
    digest::of_scene as scene_digest,
    export::write_tables,
    folder::{RunningRun, Safety},
    machine::Machine,
    plan::{Run, VERSION},
    record::{Finished, Record, RunOutcome},
    remark::{Pairing, ResultRemark},
    replay::{Replayed, recorded_run, replay},
    selection::Selection,
    statistics::Interval,
    synthetic::SyntheticTarget,
    tables::{Metric, RunQuality, Spread},
    target::StudyImage,
    work::{AtEnd, Shard, WorkSettings},
};

use crate::error::Error;

/// An experiment: every arm fits every image at every budget from every seed.
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
    /// [`SyntheticTarget`]s, which need no file, such as `paper`.
    pub images: Vec<String>,
    /// The largest numbers of Gaussians allowed.
    pub budgets: Vec<u32>,
    /// Seeds of all random numbers, the same for every arm.
    pub seeds: Vec<u32>,
    /// What is held equal when arms are compared.
    #[serde(default = "Matching::all", rename = "match")]
    pub matchings: Vec<Matching>,
    /// The arm that the report compares the others with; by default the first. The tables compare
    /// all pairs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline: Option<String>,
    /// The preset that arms start from, unless they name another.
    #[serde(default = "standard")]
    pub preset: Preset,
    /// Steps of the optimizer instead of the preset's. The schedule is stretched accordingly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u32>,
    /// Settings of all arms that differ from the preset's, with the keys of
    /// [`gs_train::FitSettings`].
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub settings: toml::Table,
    /// The arms that are compared.
    #[serde(rename = "arm")]
    pub arms: Vec<Arm>,
}

gs_core::impl_with!(Study, Arm);

fn standard() -> Preset {
    Preset::Standard
}

/// An arm of a study: a policy, or any other settings of a fit.
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
    pub preset: Option<Preset>,
    /// Replaces the study's iterations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u32>,
    /// A policy by its name, with its source's parameters: one of [`gs_density::Policy::NAMES`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy: Option<String>,
    /// Settings that differ from the study's and the policy's.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub settings: toml::Table,
    /// A policy that settings cannot name; available in the library only.
    #[serde(skip)]
    pub own_policy: Option<OwnPolicy>,
    /// Line of the study file with the arm's name, counted from 1; `None` for an arm that is not
    /// from a file.
    #[serde(skip)]
    pub line: Option<usize>,
}

/// Used to find the lines of the arms' names.
#[derive(Deserialize)]
struct NamedArms {
    arm: Vec<NamedArm>,
}

#[derive(Deserialize)]
struct NamedArm {
    name: toml::Spanned<String>,
}

/// A policy that settings cannot name.
#[derive(Clone)]
pub struct OwnPolicy {
    /// Describes everything that the policy's plans depend on. Two policies that plan differently
    /// must have different fingerprints, or a study reuses the results of one for the other.
    pub fingerprint: String,
    /// The policy.
    pub policy: ForeignPolicy,
}

impl fmt::Debug for OwnPolicy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OwnPolicy").field(&self.fingerprint).finish()
    }
}

impl Arm {
    /// An arm that differs from the study's settings only in its policy. `fingerprint` is explained
    /// at [`OwnPolicy::fingerprint`].
    pub fn with_policy(name: impl Into<String>, fingerprint: impl Into<String>, policy: ForeignPolicy) -> Self {
        Self {
            name: name.into(),
            about: String::new(),
            preset: None,
            iterations: None,
            policy: None,
            settings: toml::Table::new(),
            own_policy: Some(OwnPolicy { fingerprint: fingerprint.into(), policy }),
            line: None,
        }
    }
}

/// What is held equal when two arms are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Matching {
    /// The number of Gaussians: the ends of fits whose counts are equal.
    Count,
    /// The number of steps: the largest that all arms of the study have reached.
    Iterations,
    /// The time spent fitting: that of the study's fastest arm.
    Time,
}

impl Matching {
    /// All ways to match arms.
    pub fn all() -> Vec<Self> {
        vec![Self::Count, Self::Iterations, Self::Time]
    }

    /// The name in study files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Count => "count",
            Self::Iterations => "iterations",
            Self::Time => "time",
        }
    }
}

impl Study {
    /// Reads a study from TOML text. `origin` is the file's name for errors.
    ///
    /// # Errors
    /// [`Error::Form`] with the line, and those of [`Study::validate`].
    pub fn from_toml(text: &str, origin: &str) -> Result<Self, Error> {
        let wrong = |error| match error {
            gs_train::Error::Settings { line, problem, .. } => {
                Error::Form { origin: origin.to_owned(), line, message: problem }
            }
            error => Error::Fit(error),
        };
        let mut study: Self = parse_settings(text, Path::new(origin)).map_err(wrong)?;
        let named: NamedArms = parse_settings(text, Path::new(origin)).map_err(wrong)?;
        for (arm, named) in study.arms.iter_mut().zip(named.arm) {
            arm.line = Some(1 + text[..named.name.span().start].matches('\n').count());
        }
        study.validate()?;
        Ok(study)
    }

    /// Fails where the study lists nothing to compare, or lists something twice. Settings are
    /// checked by [`Plan::new`](crate::Plan::new).
    ///
    /// # Errors
    /// [`Error::Study`] with the problem and how to fix it.
    pub fn validate(&self) -> Result<(), Error> {
        let names: Vec<&str> = self.arms.iter().map(|arm| arm.name.as_str()).collect();
        let fine = |name: &str| name.chars().all(|c| c.is_alphanumeric() || "-_.".contains(c)) && !name.is_empty();
        if !fine(&self.name) || self.name.starts_with('.') {
            return Err(self.wrong("its name is not a word", "use letters, digits, `-`, `_` and `.`"));
        }
        if let Some(name) = names.iter().find(|name| !fine(name)) {
            return Err(
                self.wrong(format!("arm `{name}`: its name is not a word"), "use letters, digits, `-`, `_` and `.`")
            );
        }
        self.listed("images", &self.images, "name at least one, such as images = [\"paper\"]")?;
        self.listed("budgets", &self.budgets, "name at least one, such as budgets = [1000]")?;
        self.listed("seeds", &self.seeds, "name at least one, such as seeds = [0, 1, 2, 3, 4]")?;
        self.listed("arm", &names, "name at least one: [[arm]] with a name")?;
        self.listed("match", &self.matchings, "name at least one of \"count\", \"iterations\", \"time\"")?;
        if let Some(image) = self.images.iter().find(|image| image.contains(char::is_control)) {
            return Err(self.wrong(format!("images: {image:?} has a control character"), "rename the file"));
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
            for (key, mend) in [("gaussians", "list it under budgets"), ("seed", "list it under seeds")] {
                if table.contains_key(key) {
                    return Err(self.wrong(format!("{place}: `{key}` is not for settings"), mend));
                }
            }
        }
        Ok(())
    }

    /// Index of the baseline among the arms.
    pub fn baseline_arm(&self) -> usize {
        self.baseline.as_ref().and_then(|name| self.arms.iter().position(|arm| arm.name == *name)).unwrap_or(0)
    }

    fn listed<T: PartialEq + fmt::Debug>(&self, key: &str, values: &[T], mend: &'static str) -> Result<(), Error> {
        if values.is_empty() {
            return Err(self.wrong(format!("{key}: there are none"), mend));
        }
        let twice = values.iter().enumerate().find(|(i, value)| values[..*i].contains(value));
        match twice {
            Some((_, value)) => Err(self.wrong(format!("{key}: {value:?} stands there twice"), "leave one out")),
            None => Ok(()),
        }
    }

    pub(crate) fn wrong(&self, what: impl Into<String>, mend: &'static str) -> Error {
        Error::Study { study: self.name.clone(), what: what.into(), mend }
    }
}
