//! The studies that come with the program: six with the 2D experiments of the paper, three on the
//! Kodak images, and five on 3D scenes.

use super::definition::Study;
use crate::error::Error;

/// Name and TOML text of each built-in study.
pub const BUILT_IN: [(&str, &str); 14] = [
    ("set-up", include_str!("../../studies/set-up.toml")),
    ("cold-start", include_str!("../../studies/cold-start.toml")),
    ("lazy-convergence", include_str!("../../studies/lazy-convergence.toml")),
    ("thresholds", include_str!("../../studies/thresholds.toml")),
    ("instability", include_str!("../../studies/instability.toml")),
    ("edges", include_str!("../../studies/edges.toml")),
    ("absolute-vs-percentile", include_str!("../../studies/absolute-vs-percentile.toml")),
    ("all-policies", include_str!("../../studies/all-policies.toml")),
    ("accuracy-in-training", include_str!("../../studies/accuracy-in-training.toml")),
    ("density-in-3d", include_str!("../../studies/density-in-3d.toml")),
    ("init-by-density", include_str!("../../studies/init-by-density.toml")),
    ("accuracy-in-3d-training", include_str!("../../studies/accuracy-in-3d-training.toml")),
    ("start-without-sfm", include_str!("../../studies/start-without-sfm.toml")),
    ("defaults", include_str!("../../studies/defaults.toml")),
];

/// Other names of built-in studies. `paper` is the paper's main experiment, the set-up.
const ALIASES: [(&str, &str); 1] = [("paper", "set-up")];

/// The built-in study of that name. `paper` is another name of `set-up`.
///
/// # Errors
/// [`Error::Unknown`], listing the names.
pub fn built_in(name: &str) -> Result<Study, Error> {
    let asked = ALIASES.iter().find(|(alias, _)| *alias == name).map_or(name, |(_, meant)| meant);
    match BUILT_IN.iter().find(|(known, _)| *known == asked) {
        Some((name, text)) => Study::from_toml(text, name),
        None => Err(Error::Unknown { name: name.to_owned(), known: BUILT_IN.map(|(known, _)| known).join(", ") }),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::study::{
        plan::{Plan, Run},
        target::Places,
    };
    use gs_conformance::posed::{small_scene, write_dataset};
    use gs_density::Policy;

    #[test]
    fn every_one_is_possible_and_called_as_its_file() {
        let place = tempfile::tempdir().unwrap();
        let cpu = gs_cpu::CpuRasterizer::new(gs_cpu::CpuSettings::default()).unwrap();
        for scene in ["lego", "room", "banana", "lund_door", "fox", "desk", "mouse", "few"] {
            write_dataset(&place.path().join(scene), &small_scene(0), &cpu, true).unwrap();
        }
        let places = Places { data: Some(place.path().to_owned()), ..Places::default() };
        for (name, _) in BUILT_IN {
            let study = built_in(name).unwrap();
            assert_eq!(study.name, name);
            assert!(study.seeds.len() >= if study.is_of_scenes() { 3 } else { 5 } && !study.question.is_empty());
            assert!(
                study.arms.iter().all(|arm| arm.about.ends_with('.')),
                "{name}: an arm that says nothing of itself"
            );
            // Neither the Kodak images nor data sets are part of the repository, so synthetic
            // targets take their place.
            let on_files = study.images.first().is_some_and(|image| image.ends_with(".png"));
            let images = if on_files { vec!["paper".to_owned()] } else { study.images.clone() };
            let plan = Plan::new(Study { images, ..study }, &places, "test").unwrap();
            assert!(plan.runs.len() >= 10);
            let of_run = |run: &Run| (run.target, run.address.clone());
            let different: HashSet<(usize, String)> = plan.runs.iter().map(of_run).collect();
            assert_eq!(different.len(), plan.runs.len(), "{name}: two arms are the same");
        }
        assert_eq!(built_in("paper").unwrap().name, "set-up");
        let message = built_in("all-policy").unwrap_err().to_string();
        assert!(message.contains("all-policy: is neither a file") && message.contains("all-policies"), "{message}");
    }

    #[test]
    fn no_policy_is_forgotten_and_each_has_its_sources_numbers() {
        let plan = {
            let study = Study { images: vec!["paper".to_owned()], ..built_in("all-policies").unwrap() };
            Plan::new(study, &Places::default(), "test").unwrap()
        };
        for name in Policy::NAMES.into_iter().filter(|name| Policy::from_name(name).unwrap().validate_2d().is_ok()) {
            let arms = plan.study.arms.iter().enumerate();
            let of_policy = arms.filter(|(_, arm)| arm.policy.as_deref() == Some(name)).collect::<Vec<_>>();
            assert!(!of_policy.is_empty(), "{name} takes no part");
            // The first of them is the policy itself, except that opacities are conserved where this
            // can be chosen.
            let (index, arm) = of_policy[0];
            let run = plan.runs.iter().find(|run| run.arm == index).unwrap();
            let mut source = Policy::from_name(name).unwrap();
            if let Some(conserved) = arm.settings.get("policy") {
                let expected = "actions.densify.opacity-correction = 'conserve'".parse::<toml::Table>().unwrap();
                assert_eq!(conserved, &toml::Value::Table(expected), "{name}");
                let mut settings = toml::Table::try_from(&source).unwrap();
                let densify = settings["actions"]["densify"].as_table_mut().unwrap();
                densify.insert("opacity-correction".to_owned(), "conserve".into());
                source = settings.try_into().unwrap();
            }
            assert_eq!(run.settings.of_image().policy, source, "{name}");
        }
    }
}
