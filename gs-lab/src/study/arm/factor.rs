//! Factors of a study, whose combinations are its arms.

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::Arm;
use crate::{
    error::Error,
    study::{definition::Study, overrides},
};

/// A factor of a factorial design, such as the policy or the initialization. The arms of a study
/// with factors are all combinations of their levels.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Factor {
    /// A short name, for tables.
    pub(crate) name: String,
    /// A description, one sentence.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub(crate) about: String,
    /// The levels, at least two; effects are differences from the first. The arm of a combination
    /// has the names of its levels, joined by `+`.
    #[serde(rename = "level")]
    pub(crate) levels: Vec<Arm>,
}

/// Joins the names of levels to that of an arm.
const JOINT: &str = "+";

impl Study {
    /// Makes the arms of the factors: all combinations, with the first factor varying slowest. Does
    /// nothing without factors.
    ///
    /// # Errors
    /// [`Error::Study`] where there are arms already, a factor has fewer than two levels, or two
    /// factors set the same key.
    pub(crate) fn expand(&mut self) -> Result<(), Error> {
        if self.factors.is_empty() {
            return Ok(());
        }
        if !self.arms.is_empty() {
            return Err(self.wrong("there are both arms and factors", "write each arm as a level of a factor"));
        }
        let mut arms = vec![Arm::named("")];
        for factor in &self.factors {
            if factor.levels.len() < 2 {
                return Err(self.wrong(format!("factor `{}` has fewer than two levels", factor.name), "add a level"));
            }
            let mut longer = Vec::with_capacity(arms.len() * factor.levels.len());
            for arm in &arms {
                for (index, level) in factor.levels.iter().enumerate() {
                    let both = combined(arm, level, index).map_err(|key| {
                        let what = format!("factor `{}`: another factor sets `{key}`, too", factor.name);
                        self.wrong(what, "set each key in one factor only")
                    })?;
                    longer.push(both);
                }
            }
            arms = longer;
        }
        self.arms = arms;
        Ok(())
    }
}

/// The arm with the keys of `arm` and of a level; an error is a key that both have.
fn combined(arm: &Arm, level: &Arm, index: usize) -> Result<Arm, String> {
    let words = |of: fn(&Arm) -> &String, joint: &str| {
        [of(arm), of(level)].into_iter().filter(|part| !part.is_empty()).cloned().collect::<Vec<_>>().join(joint)
    };
    if let Some(key) = shared(&arm.settings, &level.settings, "settings") {
        return Err(key);
    }
    let mut settings = arm.settings.clone();
    overrides::lay_upon(&mut settings, &level.settings);
    Ok(Arm {
        name: words(|arm| &arm.name, JOINT),
        about: words(|arm| &arm.about, " "),
        preset: either("preset", &arm.preset, &level.preset)?,
        iterations: either("iterations", &arm.iterations, &level.iterations)?,
        start: either("start", &arm.start, &level.start)?,
        like_gs_train: arm.like_gs_train || level.like_gs_train,
        pose_error: either("pose-error", &arm.pose_error, &level.pose_error)?,
        policy: either("policy", &arm.policy, &level.policy)?,
        parameterization: either("parameterization", &arm.parameterization, &level.parameterization)?,
        own_policy: level.own_policy.as_ref().or(arm.own_policy.as_ref()).cloned(),
        settings,
        levels: arm.levels.iter().copied().chain([index]).collect(),
    })
}

fn either<T: Clone>(key: &str, one: &Option<T>, other: &Option<T>) -> Result<Option<T>, String> {
    match (one, other) {
        (Some(_), Some(_)) => Err(key.to_owned()),
        _ => Ok(one.as_ref().or(other.as_ref()).cloned()),
    }
}

/// The path of a value that both tables have.
fn shared(one: &Table, other: &Table, path: &str) -> Option<String> {
    one.iter().find_map(|(key, value)| {
        let path = format!("{path}.{key}");
        match (value, other.get(key)?) {
            (Value::Table(one), Value::Table(other)) => shared(one, other, &path),
            _ => Some(path),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUDY: &str = "name = 'x'\nimages = ['paper']\nbudgets = [9]\nseeds = [0]\n\
        [[factor]]\nname = 'policy'\n\
        level = [{ name = 'none', policy = 'none' }, { name = 'top', policy = 'percentile', about = 'Grows.' }]\n\
        [[factor]]\nname = 'lists'\n\
        level = [{ name = 'old', settings.rebin-every = 4 }, { name = 'new', settings.rebin-every = 1, about = 'Exact.' }]\n";

    #[test]
    fn factors_expand_into_all_their_combinations() {
        let study = Study::from_toml(STUDY, "x.toml").unwrap();
        let arms: Vec<_> = study.arms.iter().map(|arm| (arm.name.as_str(), &arm.levels[..])).collect();
        let expected = [("none+old", [0, 0]), ("none+new", [0, 1]), ("top+old", [1, 0]), ("top+new", [1, 1])];
        assert_eq!(arms, expected.each_ref().map(|(name, levels)| (*name, &levels[..])));
        let last = &study.arms[3];
        assert_eq!((last.policy.as_deref(), last.about.as_str()), (Some("percentile"), "Grows. Exact."));
        assert_eq!(last.settings["rebin-every"].as_integer(), Some(1));
        // As it is stored, it expands in the same way.
        let again = Study::from_toml(&study.to_toml().unwrap(), "y.toml").unwrap();
        assert_eq!(format!("{:?}", again.arms[2].settings), format!("{:?}", study.arms[2].settings));
        assert_eq!((again.arms.len(), again.factors.len()), (4, 2));
    }

    #[test]
    fn factors_that_contradict_each_other_or_do_not_vary_are_refused() {
        for (from, to, expected) in [
            ("settings.rebin-every = 1", "policy = 'paper'", "factor `lists`: another factor sets `policy`, too"),
            ("policy = 'none'", "settings.rebin-every = 3", "sets `settings.rebin-every`, too: set each key in one"),
            ("{ name = 'none', policy = 'none' }, ", "", "factor `policy` has fewer than two levels"),
            ("[[factor]]\nname = 'lists'", "[[arm]]\nname = 'a'\n[[factor]]\nname = 'lists'", "both arms and factors"),
            ("name = 'new'", "name = 'old'", "\"none+old\" is listed twice"),
            ("rebin-every = 1", "rebin-evry = 1", ""),
            ("name = 'lists'", "name = 'policy'", "factor: \"policy\" is listed twice"),
            ("name = 'lists'", "name = 'li/sts'", "factor `li/sts`: its name is not a word"),
        ] {
            let found = Study::from_toml(&STUDY.replacen(from, to, 1), "x.toml").map(|study| study.arms.len());
            match expected {
                "" => assert_eq!(found.unwrap(), 4, "settings are checked by the plan"),
                _ => assert!(found.as_ref().unwrap_err().to_string().contains(expected), "{found:?}"),
            }
        }
    }
}
