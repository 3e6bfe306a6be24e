//! A part of a study: some of its images or scenes, budgets, seeds and arms.

use std::{fmt::Display, path::Path};

use serde::{Deserialize, Serialize};

use super::{definition::Study, overrides};
use crate::error::Error;

/// The images or scenes, budgets, seeds and arms of a study to run. An empty list selects all.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Selection {
    /// Images by their names in the study, or by their file names with or without extension.
    pub images: Vec<String>,
    /// Scenes, likewise.
    pub scenes: Vec<String>,
    /// Budgets.
    pub budgets: Vec<u32>,
    /// Seeds.
    pub seeds: Vec<u32>,
    /// Arms by their names.
    pub arms: Vec<String>,
}

/// A smaller form of a study. What is left out is as in the study.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Quick {
    /// Some of its images or scenes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) images: Vec<String>,
    /// Some of its arms.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) arms: Vec<String>,
    /// Some of its seeds.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) seeds: Vec<u32>,
    /// Other budgets.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) budgets: Vec<u32>,
    /// Fewer steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) iterations: Option<u32>,
    /// Settings of all arms, laid over those of the study.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub(crate) settings: toml::Table,
}

impl Study {
    /// The study restricted to the selection, in its own order. If the baseline is not selected,
    /// the first selected arm takes its place.
    ///
    /// Runs keep their addresses, which do not depend on the other runs, so the results of several
    /// parts add up in one folder.
    ///
    /// # Errors
    /// [`Error::Study`] where the study does not have a selected name or number; the message lists
    /// those it has.
    pub fn select(mut self, selection: &Selection) -> Result<Self, Error> {
        let Selection { images, scenes, budgets, seeds, arms } = selection;
        let same = |one: &u32, other: &u32| one == other;
        let unknown = |what: String| self.wrong(what, "choose among these");
        let images = kept("image", &self.images, images, is_called).map_err(unknown)?;
        let scenes = kept("scene", &self.scenes, scenes, is_called).map_err(unknown)?;
        let budgets = kept("budget", &self.budgets, budgets, same).map_err(unknown)?;
        let seeds = kept("seed", &self.seeds, seeds, same).map_err(unknown)?;
        let names: Vec<String> = self.arms.iter().map(|arm| arm.name.clone()).collect();
        let names = kept("arm", &names, arms, |one, other| one == other).map_err(unknown)?;
        self.arms.retain(|arm| names.contains(&arm.name));
        self.baseline = self.baseline.filter(|baseline| names.contains(baseline));
        // Without all combinations of the factors, there are no effects.
        if !arms.is_empty() {
            self.factors.clear();
        }
        let mut part = Self { images, scenes, budgets, seeds, ..self };
        part.drop_claims_of_others();
        Ok(part)
    }

    /// The smaller form of the study that its table `quick` describes; the study itself without one.
    ///
    /// # Errors
    /// Those of [`Self::select`].
    pub(crate) fn quick(mut self) -> Result<Self, Error> {
        let Some(Quick { images, arms, seeds, budgets, iterations, settings }) = self.quick.take() else {
            return Ok(self);
        };
        if !budgets.is_empty() {
            self.budgets = budgets;
        }
        self.iterations = iterations.or(self.iterations);
        overrides::lay_upon(&mut self.settings, &settings);
        self.select(&Selection { images, seeds, arms, ..Selection::default() })
    }

    /// Number of runs of the study.
    pub fn runs(&self) -> usize {
        self.arms.len() * self.target_names().len() * self.budgets.len() * self.seeds.len()
    }
}

/// The elements of `all` that are in `wanted`, or all if `wanted` is empty. Fails with a message if
/// an element of `wanted` is unknown.
fn kept<T: Clone + Display>(
    what: &str,
    all: &[T],
    wanted: &[T],
    is: impl Fn(&T, &T) -> bool,
) -> Result<Vec<T>, String> {
    if wanted.is_empty() {
        return Ok(all.to_vec());
    }
    match wanted.iter().find(|wanted| !all.iter().any(|one| is(one, wanted))) {
        Some(unknown) => {
            let known: Vec<String> = all.iter().map(ToString::to_string).collect();
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            Err(format!("there is no {what} `{unknown}`: it has {known}"))
        }
        None => Ok(all.iter().filter(|one| wanted.iter().any(|wanted| is(one, wanted))).cloned().collect()),
    }
}

/// Whether a name stands for an image of a study.
fn is_called(image: &String, name: &String) -> bool {
    let path = Path::new(image);
    let is = |part: Option<&std::ffi::OsStr>| part.is_some_and(|part| *part == **name);
    image == name || is(path.file_name()) || is(path.file_stem())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::{plan::Plan, target::Places};

    const STUDY: &str = "name = 'x'\nimages = ['paper', 'thin-lines']\nbudgets = [10, 20]\nseeds = [0, 1]\npreset = 'paper'\n\
                         iterations = 9\nbaseline = 'b'\n[[arm]]\nname = 'a'\n[[arm]]\nname = 'b'\npolicy = 'none'\n";

    fn study() -> Study {
        Study::from_toml(STUDY, "x.toml").unwrap()
    }

    fn addresses(study: Study) -> Vec<String> {
        Plan::new(study, &Places::default(), "test").unwrap().runs.into_iter().map(|run| run.address).collect()
    }

    #[test]
    fn the_runs_of_parts_are_those_of_the_whole() {
        let part = |seed| study().select(&Selection { seeds: vec![seed], ..Selection::default() }).unwrap();
        let [first, second] = [0, 1].map(|seed| addresses(part(seed)));
        assert_eq!([first, second].concat(), addresses(study()), "seeds come first in the order of runs");
        assert_eq!(addresses(study().select(&Selection::default()).unwrap()), addresses(study()));
        let small = Selection {
            images: vec!["thin-lines".to_owned()],
            budgets: vec![20],
            seeds: vec![1],
            arms: vec!["a".to_owned()],
            ..Selection::default()
        };
        let small = study().select(&small).unwrap();
        assert_eq!((small.runs(), small.baseline_arm(), study().runs()), (1, 0, 16));
        assert!(addresses(study()).contains(&addresses(small)[0]));
    }

    #[test]
    fn images_are_known_by_their_file_names_too() {
        for name in ["kodak/a.png", "a.png", "a"] {
            assert!(is_called(&"kodak/a.png".to_owned(), &name.to_owned()), "{name}");
        }
        assert!(!is_called(&"kodak/a.png".to_owned(), &"kodak".to_owned()));
    }

    #[test]
    fn unknown_names_are_refused_with_the_available_ones() {
        let message = |selection: Selection| study().select(&selection).unwrap_err().to_string();
        let names = |name: &str| vec!["a".to_owned(), name.to_owned()];
        assert_eq!(
            message(Selection { arms: names("c"), ..Selection::default() }),
            "study `x`: there is no arm `c`: it has a, b: choose among these"
        );
        assert!(message(Selection { images: names("y"), ..Selection::default() }).contains("it has paper, thin-lines"));
        assert!(message(Selection { seeds: vec![0, 7], ..Selection::default() }).contains("seed `7`: it has 0, 1"));
        assert!(message(Selection { budgets: vec![5], ..Selection::default() }).contains("budget `5`: it has 10, 20"));
    }

    #[test]
    fn a_part_keeps_the_claims_about_it_and_a_folder_stores_them() {
        let claim = |name: &str, rest: &str| {
            format!(
                "[[claim]]\nname = '{name}'\nstatement = 's'\ncircumstances = [{{ arm = 'a', of = 'psnr', above = 0, {rest} }}]\n"
            )
        };
        let claims = [
            claim("of-a", "images = ['paper', 'thin-lines']"),
            claim("against-b", "less = { arms = ['b'] }"),
            claim("of-lines", "images = ['thin-lines']"),
        ];
        let part = Selection { arms: vec!["a".to_owned()], images: vec!["paper".to_owned()], ..Selection::default() };
        let part = Study::from_toml(&format!("{STUDY}{}", claims.concat()), "x.toml").unwrap().select(&part).unwrap();
        assert_eq!(part.claims.iter().map(|claim| claim.name.as_str()).collect::<Vec<_>>(), ["of-a"]);
        assert_eq!(part.claims[0].circumstances[0].images, ["paper"]);
        assert_eq!(Study::from_toml(&part.to_toml().unwrap(), "x.toml").unwrap().claims, part.claims);
    }
}
