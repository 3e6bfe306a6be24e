//! The studies that come with the program: one for each 2D experiment of the paper, three on the
//! Kodak images, and four on 3D scenes.

use super::definition::Study;
use crate::error::Error;

/// Name and TOML text of each built-in study.
pub const BUILT_IN: [(&str, &str); 12] = [
    ("set-up", include_str!("../../studies/set-up.toml")),
    ("cold-start", include_str!("../../studies/cold-start.toml")),
    ("lazy-convergence", include_str!("../../studies/lazy-convergence.toml")),
    ("instability", include_str!("../../studies/instability.toml")),
    ("edges", include_str!("../../studies/edges.toml")),
    ("absolute-vs-percentile", include_str!("../../studies/absolute-vs-percentile.toml")),
    ("all-policies", include_str!("../../studies/all-policies.toml")),
    ("accuracy-in-training", include_str!("../../studies/accuracy-in-training.toml")),
    ("density-in-3d", include_str!("../../studies/density-in-3d.toml")),
    ("init-by-density", include_str!("../../studies/init-by-density.toml")),
    ("accuracy-in-3d-training", include_str!("../../studies/accuracy-in-3d-training.toml")),
    ("presets", include_str!("../../studies/presets.toml")),
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

    #[test]
    fn every_one_is_possible_and_called_as_its_file() {
        let place = tempfile::tempdir().unwrap();
        let cpu = gs_cpu::CpuRasterizer::new(gs_cpu::CpuSettings::default()).unwrap();
        for scene in ["lego", "room", "banana", "lund_door"] {
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
}
