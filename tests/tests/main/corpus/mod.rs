//! The corpus of hard cases on gs-cpu and gs-wgpu, and gradients of hard scenes compared with
//! difference quotients. As negative controls, backends with the faults that the corpus must find.

mod faulty;

use std::collections::HashSet;

use gs_conformance::{
    Failure,
    corpus::{
        Differences, Hardship, Quotients, Record, Source, corpus_2d, corpus_3d, hard_2d, hard_3d, poison_2d, poison_3d,
        poison_slots_2d, poison_slots_3d, run,
    },
    subject::Subject,
};
use gs_core::{Loss, Optimizer, Scene2d, Scene3d, effects::Blend};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use gs_wgpu::{Kernels, WgpuRasterizer};

use self::faulty::{Fault, Faulty};
use crate::gpus;

/// A rasterizer with one thread: with images of this size, threads would wait for each other.
fn cpu(level: SimdLevel) -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(1);
        s.level = Some(level);
    }))
    .unwrap()
}

/// The records of every `step`-th case, from the case `first` on.
fn every<R: Optimizer<Scene2d> + Optimizer<Scene3d>>(step: usize, first: usize, rasterizer: &R) -> Vec<Record> {
    let scenes_2d = corpus_2d();
    let scenes_3d = corpus_3d();
    let mut records: Vec<Record> =
        scenes_2d.iter().skip(first).step_by(step).map(|case| run(rasterizer, case)).collect();
    records.extend(scenes_3d.iter().skip(first).step_by(step).map(|case| run(rasterizer, case)));
    records
}

/// The records of all cases and hostile values.
fn records<R: Optimizer<Scene2d> + Optimizer<Scene3d>>(rasterizer: &R) -> Vec<Record> {
    let mut records = every(1, 0, rasterizer);
    records.extend(poison_2d(rasterizer));
    records.extend(poison_3d(rasterizer));
    records
}

fn unexpected(records: &[Record]) -> Vec<String> {
    records.iter().filter(|record| !record.is_as_expected()).map(ToString::to_string).collect()
}

#[test]
fn the_cpu_passes_at_its_best_level() {
    let failures = unexpected(&records(&cpu(SimdLevel::best())));
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// The other levels are the same source, compiled again: each takes its share of half of the cases.
#[test]
fn the_cpu_passes_a_share_of_the_cases_at_each_other_level() {
    let others: Vec<SimdLevel> =
        SimdLevel::available().into_iter().filter(|level| *level != SimdLevel::best()).collect();
    for (first, level) in others.iter().enumerate() {
        let failures = unexpected(&every(2 * others.len(), first, &cpu(*level)));
        assert!(failures.is_empty(), "{level}:\n{}", failures.join("\n"));
    }
}

/// Fails for records that are not as expected with one kind of kernels, if the adapter supports it.
fn check(kernels: Kernels, records: impl Fn(&WgpuRasterizer) -> Vec<Record>) {
    let Some(rasterizer) = gpus::with_kernels(kernels, None) else { return };
    // A software driver refuses lists that are longer than its loops with this error.
    let records = records(&rasterizer);
    let (refused, failures): (Vec<_>, Vec<_>) =
        unexpected(&records).into_iter().partition(|failure| failure.contains("ends loops after"));
    refused.iter().for_each(|record| eprintln!("skipped: {record}"));
    assert!(4 * refused.len() <= records.len(), "{kernels:?} refuse too much:\n{}", refused.join("\n"));
    assert!(failures.is_empty(), "{kernels:?}:\n{}", failures.join("\n"));
}

#[test]
fn wgpu_passes_a_sixteenth_of_the_cases_with_portable_kernels() {
    check(Kernels::Portable, |rasterizer| every(16, 0, rasterizer));
}

#[test]
fn wgpu_passes_another_sixteenth_of_the_cases_with_subgroups() {
    check(Kernels::Subgroups, |rasterizer| every(16, 8, rasterizer));
}

#[test]
#[ignore = "minutes on a software driver; `cargo xtask test --slow` runs it"]
fn wgpu_passes_all_cases_and_hostile_values_with_portable_kernels() {
    check(Kernels::Portable, records);
}

#[test]
#[ignore = "minutes on a software driver; `cargo xtask test --slow` runs it"]
fn wgpu_passes_all_cases_and_hostile_values_with_subgroups() {
    check(Kernels::Subgroups, records);
}

#[test]
fn cases_have_unique_names_and_sources() {
    let cases = corpus_2d().into_iter().map(|c| (format!("2D: {}", c.name), c.why, c.source));
    let cases = cases.chain(corpus_3d().into_iter().map(|c| (format!("3D: {}", c.name), c.why, c.source)));
    let mut names = HashSet::new();
    for (name, why, source) in cases {
        assert!(!why.is_empty(), "{name}");
        let (Source::Paper(place) | Source::Report(place) | Source::Definition(place)) = source;
        let right = match source {
            Source::Paper(_) => place.starts_with('§'),
            Source::Report(_) => place.starts_with("https://"),
            Source::Definition(_) => place.contains("::"),
        };
        assert!(right, "{name}: {source:?}");
        assert!(names.insert(name.clone()), "two cases are called {name}");
    }
    assert!(names.len() > 90, "{}", names.len());
}

/// The part of the corpus that finds a fault: cases or records of hostile values with this in their
/// names.
#[derive(Debug, Clone, Copy)]
enum By {
    TwoD(&'static str),
    ThreeD(&'static str),
}

/// Faults, and the part of the corpus that must find each.
const FOUND_BY: &[(Fault, By)] = {
    use By::*;
    use Fault::*;
    &[
        (DropsExtremes, TwoD("needles")),
        (DropsExtremes, ThreeD("scale → 0 in one axis, dilated")),
        (CountsNothing, TwoD("scale → 0")),
        (CountsNothing, ThreeD("on the camera, behind it")),
        (SpreadsToAPixel, TwoD("poison, over: mean 0")),
        (SpreadsToAPixel, ThreeD("poison, by mean depth: mean 0")),
        (SpreadsByAnUlp, TwoD("poison, sum: log_scale 0")),
        (SpreadsByAnUlp, ThreeD("poison, by pixel depth: log_scale 1")),
        (ShowsNan, TwoD("poison, over: color 0")),
        (ShowsNan, ThreeD("poison, by mean depth: sh 0")),
        (Sanitises, TwoD("poison, over: rotation 0")),
        (Sanitises, TwoD("poison, sum: factor 1, in covariance factors")),
        (Sanitises, ThreeD("poison, by mean depth: rotation 0")),
        (TakesAnyTarget, TwoD("target red")),
        (TakesAnyTarget, ThreeD("poison, by mean depth: target red")),
        (TakesAnyRates, TwoD("learning rate of means")),
        (TakesAnyRates, ThreeD("poison, by mean depth: beta1 of higher SH")),
        (TakesAnyLoss, TwoD("poison, over: lambda")),
        (RefusesTheUnusual, TwoD("poison, over: alpha_max")),
        (RefusesTheUnusual, ThreeD("poison, by pixel depth: alpha_max")),
        (ClampsElsewhere, TwoD("logits")),
        (ClampsElsewhere, ThreeD("logits")),
        (CutsTwoUlpsLower, TwoD("α two ulps below the cut")),
        (CutsWhatIsAtTheCut, TwoD("α = cut")),
        (DropsLargeGradients, TwoD("axis-aligned")),
        (DropsLargeGradients, ThreeD("coincident")),
        (LosesItsLosses, TwoD("one Gaussian")),
        (LosesItsLoss, TwoD("one Gaussian")),
        (LosesItsLoss, ThreeD("one Gaussian")),
        (Creeps, TwoD("loss exactly 0")),
        (NeverSteps, TwoD("one Gaussian")),
        (NeverSteps, TwoD("10⁶ px away")),
        (NeverSteps, TwoD("loss exactly 0")),
        (NeverSteps, ThreeD("one Gaussian")),
        (NeverSteps, ThreeD("10⁶ px away")),
        (MixesGradients, TwoD("axis-aligned")),
        (MixesGradients, ThreeD("at the edge of the field of view")),
        (IgnoresTheNearPlane, ThreeD("on the near plane, an ulp either side")),
        (OrdersByIndex, ThreeD("sort keys at their limits, by depth of the mean")),
        (OrdersByIndex, ThreeD("sort keys at their limits, by depth at each pixel")),
        (OrdersByMean, ThreeD("two that interpenetrate, by depth at each pixel")),
        (FollowsTheJacobian, ThreeD("at the edge of the field of view")),
        (CentresThePrincipalPoint, ThreeD("with an off-centre principal point")),
        (SquaresPixels, ThreeD("pixels that are not square")),
        (DropsSh, ThreeD("SH that drive the colour below 0")),
        (Dilates, ThreeD("scale → 0 in all axes, not antialiased")),
        (ForgetsCompensation, ThreeD("scale → 0 in all axes, mip")),
    ]
};

impl By {
    /// The number of records, and those that are not as expected.
    fn outcome<R: Optimizer<Scene2d> + Optimizer<Scene3d>>(self, rasterizer: &R) -> (usize, Vec<String>) {
        let records = match self {
            Self::TwoD(word) => {
                let cases = corpus_2d().into_iter().filter(|case| case.name.contains(word));
                let mut records: Vec<Record> = cases.map(|case| run(rasterizer, &case)).collect();
                records.extend(poison_slots_2d(rasterizer, |name| name.contains(word)));
                records
            }
            Self::ThreeD(word) => {
                let cases = corpus_3d().into_iter().filter(|case| case.name.contains(word));
                let mut records: Vec<Record> = cases.map(|case| run(rasterizer, &case)).collect();
                records.extend(poison_slots_3d(rasterizer, |name| name.contains(word)));
                records
            }
        };
        (records.len(), unexpected(&records))
    }
}

#[test]
fn faults_are_found() {
    let inner = cpu(SimdLevel::best());
    let mut wrong = Vec::new();
    for &(fault, by) in FOUND_BY {
        let (run, failures) = by.outcome(&Faulty::new(&inner, Fault::Faultless));
        if run == 0 || !failures.is_empty() {
            wrong.push(format!("{run} of {by:?}, without a fault: {}", failures.join("\n")));
        }
        match by.outcome(&Faulty::new(&inner, fault)).1.first() {
            None => wrong.push(format!("{fault:?} is not found by {by:?}")),
            Some(found) => eprintln!("{fault:?}: {found}"),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Seeds of each hardship.
const SEEDS: u64 = 3;

/// Difference quotients of hard scenes, by hardship.
struct Sets {
    scene_2d: Vec<(String, Vec<Quotients<Scene2d>>)>,
    scene_3d: Vec<(String, Vec<Quotients<Scene3d>>)>,
}

impl Sets {
    fn new(loss: Loss, seeds: u64) -> Self {
        let (mut scene_2d, mut scene_3d) = (Vec::new(), Vec::new());
        for hardship in Hardship::ALL {
            for blend in [Blend::Sum, Blend::Over] {
                let of = |seed| Quotients::new(hard_2d(hardship, blend, seed), loss).unwrap();
                scene_2d.push((format!("{hardship:?}, {blend:?}, {loss:?}"), (0..seeds).map(of).collect()));
            }
            let of = |seed| Quotients::new(hard_3d(hardship, seed), loss).unwrap();
            scene_3d.push((format!("{hardship:?}, in 3D, {loss:?}"), (0..seeds).map(of).collect()));
        }
        Self { scene_2d, scene_3d }
    }

    /// The failures of a backend.
    fn wrong_on<R: Optimizer<Scene2d> + Optimizer<Scene3d>>(&self, rasterizer: &R) -> Vec<String> {
        let mut failures = wrong(&self.scene_2d, |quotients| quotients.check_backend(rasterizer));
        failures.extend(wrong(&self.scene_3d, |quotients| quotients.check_backend(rasterizer)));
        failures
    }
}

/// Failures of one kind of scene, and sets with too many ill-conditioned gradients.
fn wrong<S: Subject>(
    sets: &[(String, Vec<Quotients<S>>)],
    check: impl Fn(&Quotients<S>) -> Result<Differences, Failure>,
) -> Vec<String> {
    let mut wrong = Vec::new();
    for (name, set) in sets {
        let mut all = Differences::default();
        for (seed, quotients) in set.iter().enumerate() {
            match check(quotients) {
                Ok(differences) => all = all.and(differences),
                Err(failure) => wrong.push(format!("{name}, seed {seed}: {failure}")),
            }
        }
        wrong.extend(all.means_something().err().map(|failure| format!("{name}: {failure}")));
    }
    wrong
}

/// The quotients take most of the time, so one test compares all backends with them.
#[test]
fn gradients_of_hard_scenes_match_difference_quotients() {
    let on_gpu = gpus::of_each_kind(None);
    for loss in [Loss::L2, Loss::PAPER] {
        let sets = Sets::new(loss, SEEDS);
        let mut failures = wrong(&sets.scene_2d, Quotients::check_oracle);
        failures.extend(wrong(&sets.scene_3d, Quotients::check_oracle));
        for level in SimdLevel::available() {
            failures.extend(sets.wrong_on(&cpu(level)));
        }
        for (_, rasterizer) in &on_gpu {
            failures.extend(sets.wrong_on(rasterizer));
        }
        assert!(failures.is_empty(), "{}", failures.join("\n"));
    }
}

/// A negative control: gradients of another scene are rejected.
#[test]
fn the_comparison_rejects_gradients_of_other_scenes() {
    let inner = cpu(SimdLevel::best());
    let faulty = Faulty::new(&inner, Fault::MixesGradients);
    for hardship in [Hardship::Needles, Hardship::Bright] {
        let quotients = Quotients::new(hard_2d(hardship, Blend::Over, 1), Loss::L2).unwrap();
        quotients.check_backend(&inner).unwrap();
        assert!(matches!(quotients.check_backend(&faulty), Err(Failure::Differs { .. })), "{hardship:?}");
    }
}
