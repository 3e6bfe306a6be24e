//! What a study is: arms × images × budgets × seeds, as a short TOML file has them.

use gs_train::{ForeignPolicy, Preset};
use serde::{Deserialize, Serialize};
use std::fmt;

use crate::error::Error;
#[cfg(doc)]
use crate::synthetic::SyntheticTarget;

/// An experiment: every arm fits every image at every budget from every seed.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Study {
    /// A short name, for folders and titles.
    pub name: String,
    /// What the study is to find out, one or two sentences.
    #[serde(default)]
    pub question: String,
    /// Image files, relative to the folder of data or to that of the study's file; and names of [`SyntheticTarget`]s, which need no file,
    /// such as `paper`, the circle and square.
    pub images: Vec<String>,
    /// The most Gaussians there may be.
    pub budgets: Vec<u32>,
    /// Seeds of all random numbers, the same for every arm.
    pub seeds: Vec<u32>,
    /// In which respects arms are compared.
    #[serde(default = "Matching::all", rename = "match")]
    pub matchings: Vec<Matching>,
    /// The arm against which the others are shown; the first, where none is named. The tables compare all with all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline: Option<String>,
    /// What all arms start from. An arm may name another.
    #[serde(default = "standard")]
    pub preset: Preset,
    /// Steps of the optimiser, in place of the preset's; its schedule follows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u32>,
    /// Settings of all arms that differ from the preset's, as in a file of [`gs_train::FitSettings`].
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub settings: toml::Table,
    /// What is compared.
    #[serde(rename = "arm")]
    pub arms: Vec<Arm>,
}

fn standard() -> Preset {
    Preset::Standard
}

/// One of the things that a study compares: a policy, or anything else that a fit can set.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Arm {
    /// A short name, for tables.
    pub name: String,
    /// What it is, in a sentence.
    #[serde(default)]
    pub about: String,
    /// In place of the study's preset.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<Preset>,
    /// In place of the study's iterations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u32>,
    /// A policy by its name, with its source's numbers: one of [`gs_density::Policy::NAMES`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy: Option<String>,
    /// Settings that differ from the study's and the policy's.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub settings: toml::Table,
    /// In place of a policy that settings can name; in the library only.
    #[serde(skip)]
    pub own_policy: Option<OwnPolicy>,
    /// The line of the study's file on which its name stands, counted from 1; nothing of an arm that is from no file.
    #[serde(skip)]
    pub line: Option<usize>,
}

/// Where the arms have their names.
#[derive(Deserialize)]
struct NamedArms {
    arm: Vec<NamedArm>,
}

#[derive(Deserialize)]
struct NamedArm {
    name: toml::Spanned<String>,
}

/// A policy of the caller's own.
#[derive(Clone)]
pub struct OwnPolicy {
    /// All that its plans depend on, in words or numbers: two policies that plan differently must differ here, or a study takes the
    /// results of one for those of the other.
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
    /// An arm that differs from the study's settings in nothing but its policy, one of the caller's own; `fingerprint` as in
    /// [`OwnPolicy::fingerprint`].
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

/// What is equal where two arms are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Matching {
    /// The number of Gaussians: the ends of fits, where both arms have used their budget alike.
    Count,
    /// The steps of the optimiser: the largest number that all arms of the study have done.
    Iterations,
    /// The time spent fitting: that of the study's fastest arm.
    Time,
}

impl Matching {
    /// All of them.
    pub fn all() -> Vec<Self> {
        vec![Self::Count, Self::Iterations, Self::Time]
    }

    /// Its name, as in a study's file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Count => "count",
            Self::Iterations => "iterations",
            Self::Time => "time",
        }
    }
}

impl Study {
    /// Reads a study from its TOML; `origin` names it in errors.
    ///
    /// # Errors
    /// [`Error::Form`] with the line, [`Error::Study`] as [`Study::validate`].
    pub fn from_toml(text: &str, origin: &str) -> Result<Self, Error> {
        let line = |at: usize| 1 + text.bytes().take(at).filter(|&byte| byte == b'\n').count();
        let wrong = |error: toml::de::Error| {
            let line = line(error.span().map_or(0, |span| span.start));
            Error::Form { origin: origin.to_owned(), line, message: error.message().to_owned() }
        };
        let mut study: Self = toml::from_str(text).map_err(wrong)?;
        let named: NamedArms = toml::from_str(text).map_err(wrong)?;
        for (arm, named) in study.arms.iter_mut().zip(named.arm) {
            arm.line = Some(line(named.name.span().start));
        }
        study.validate()?;
        Ok(study)
    }

    /// Fails where the study compares nothing, or says something twice. Settings are looked at when it is laid out for its images.
    ///
    /// # Errors
    /// [`Error::Study`] with what is wrong and how to mend it.
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

    /// The place of the baseline among the arms.
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
