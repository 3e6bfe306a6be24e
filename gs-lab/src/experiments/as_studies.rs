//! The built-in studies that repeat experiments must have the experiments' settings, and the study
//! of all policies must contain every policy.

use super::{
    Experiment, ExperimentSize,
    cold_start::Start,
    instability::{FLOORS_PX, floor_settings},
    lazy_convergence::Criterion,
    set_up::{SMALL_SCALE_PX, fixed_settings, forced_growth_settings, paper_settings},
};
use crate::{
    study::{Places, Plan, Run, Study, built_in},
    synthetic::SyntheticTarget,
};
use gs_density::Policy;
use gs_train::FitSettings;

fn laid_out(name: &str) -> Plan {
    Plan::new(built_in(name).unwrap(), &Places::default(), "test").unwrap()
}

type MadeBy<'a> = (&'a str, &'a dyn Fn(u32) -> FitSettings);

/// Compares the settings of the study's arms with those that the experiment uses for the same seed.
/// The study has these arms and `others`.
fn check(name: &str, arms: &[MadeBy<'_>], others: &[&str]) {
    let plan = laid_out(name);
    let listed: Vec<&str> = plan.study.arms.iter().map(|arm| arm.name.as_str()).collect();
    let known: Vec<&str> = arms.iter().map(|(arm, _)| *arm).chain(others.iter().copied()).collect();
    assert_eq!(listed, known, "{name}");
    for (arm, settings) in arms {
        let runs: Vec<&Run> = plan.runs.iter().filter(|run| plan.arm(run).name == *arm).collect();
        assert!(runs.len() >= 5, "{name}: {arm}");
        for run in runs {
            assert_eq!(run.settings, settings(run.seed).into(), "{name}: {arm}");
        }
    }
}

const FULL: ExperimentSize = ExperimentSize::Full;

#[test]
fn every_experiment_that_fits_is_a_study() {
    for experiment in Experiment::ALL.into_iter().filter(|&experiment| experiment != Experiment::Popping) {
        let study = built_in(experiment.name()).unwrap();
        assert!(study.images.iter().all(|image| SyntheticTarget::from_name(image).is_ok()), "{experiment}");
    }
}

#[test]
fn the_set_up_is_that_of_the_experiment() {
    let arms: [MadeBy<'_>; 5] = [
        ("growth", &|seed| paper_settings(FULL, seed)),
        ("forced-growth", &|seed| forced_growth_settings(FULL, seed)),
        ("twenty", &|seed| fixed_settings(FULL, seed, 20, 15.0)),
        ("many-small", &|seed| fixed_settings(FULL, seed, 600, SMALL_SCALE_PX)),
        ("many-large", &|seed| fixed_settings(FULL, seed, 600, 15.0)),
    ];
    check("set-up", &arms, &["percentile", "absolute"]);
}

#[test]
fn cold_starts_are_those_of_the_experiment() {
    let names = Start::ALL.map(|start| match start {
        Start::Good => "good",
        Start::ColdWhite => "cold-white",
        Start::ColdRandom => "cold-random",
        Start::ColdForced => "cold-forced",
        Start::ColdResidual => "cold-residual",
        Start::LargeVariance => "large-variance",
    });
    let starts = Start::ALL.map(|start| move |seed| start.settings(paper_settings(FULL, seed)));
    let arms: Vec<MadeBy<'_>> = names.into_iter().zip(&starts).map(|(name, made)| (name, made as _)).collect();
    check("cold-start", &arms, &[]);
}

#[test]
fn criteria_are_those_of_the_experiment() {
    let names = Criterion::ALL.map(|criterion| match criterion {
        Criterion::AbsoluteDevice => "absolute-device",
        Criterion::AbsolutePixel => "absolute-pixel",
        Criterion::Forced => "forced-growth",
    });
    let criteria = Criterion::ALL.map(|criterion| move |seed| criterion.settings(FULL, seed));
    let arms: Vec<MadeBy<'_>> = names.into_iter().zip(&criteria).map(|(name, made)| (name, made as _)).collect();
    check("lazy-convergence", &arms, &["hybrid"]);
    // All targets of the experiment with the size that these settings are for.
    let of_size = SyntheticTarget::ALL.into_iter().filter_map(|target| {
        let varied = target.disc_and_square()?;
        (varied.side_px == gs_train::PAPER_SIDE_PX).then(|| target.name().to_owned())
    });
    assert_eq!(built_in("lazy-convergence").unwrap().images, of_size.collect::<Vec<_>>());
}

#[test]
fn floors_are_those_of_the_experiment() {
    let [paper, project] = FLOORS_PX;
    let arms: [MadeBy<'_>; 2] = [
        ("floor-0.25px", &|seed| floor_settings(FULL, seed, project)),
        ("floor-1px", &|seed| floor_settings(FULL, seed, paper)),
    ];
    check("instability", &arms, &[]);
}

#[test]
fn edges_are_fitted_as_in_the_experiment() {
    let arms: [MadeBy<'_>; 2] = [
        ("growth", &|seed| paper_settings(FULL, seed)),
        ("many-small", &|seed| fixed_settings(FULL, seed, 600, SMALL_SCALE_PX)),
    ];
    check("edges", &arms, &[]);
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
        assert_eq!(run.settings.of_image().unwrap().policy, source, "{name}");
    }
}
