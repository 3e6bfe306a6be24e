//! The corpus of hard cases on gs-cpu and gs-wgpu; gradients of hard scenes against difference quotients; and, so that it is known that the
//! corpus can fail, backends with the faults that it is there to find.

mod faulty;

use std::collections::HashSet;

use gs_conformance::{
    Failure,
    corpus::{
        Differences, Hardship, Quotients, Record, Source, hard_planar, hard_spatial, planar_corpus, poison_planar,
        poison_spatial, run, spatial_corpus,
    },
    subject::Subject,
};
use gs_core::{Loss, PlanarScene, Rasterizer, SpatialScene, effects::Blend};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use gs_wgpu::{FreshBuffers, Kernels, WgpuRasterizer, WgpuSettings};

use self::faulty::{Fault, Faulty};

fn cpu(level: SimdLevel) -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings { threads: Some(2), level: Some(level) }).unwrap()
}

/// A device for each kind of kernels that the adapter can run, with fresh buffers full of NaN.
fn wgpu() -> Vec<(Kernels, WgpuRasterizer)> {
    let of = |kernels| {
        let settings =
            WgpuSettings { fresh_buffers: FreshBuffers::Poison, kernels: Some(kernels), ..WgpuSettings::default() };
        Some((kernels, WgpuRasterizer::new(settings).ok()?))
    };
    let found: Vec<_> = [Kernels::Portable, Kernels::Subgroups, Kernels::Vectors].into_iter().filter_map(of).collect();
    assert!(!found.is_empty(), "`cargo xtask test` installs a software driver where there is no adapter");
    found
}

/// All records of a backend, those of poison included.
fn records<R: Rasterizer<PlanarScene> + Rasterizer<SpatialScene>>(rasterizer: &R) -> Vec<Record> {
    let mut records: Vec<Record> = planar_corpus().iter().map(|case| run(rasterizer, case)).collect();
    records.extend(spatial_corpus().iter().map(|case| run(rasterizer, case)));
    records.extend(poison_planar(rasterizer));
    records.extend(poison_spatial(rasterizer));
    records
}

fn unexpected(records: &[Record]) -> Vec<String> {
    records.iter().filter(|record| !record.is_as_expected()).map(ToString::to_string).collect()
}

#[test]
fn the_cpu_stands_all_at_every_level() {
    for level in SimdLevel::available() {
        let failures = unexpected(&records(&cpu(level)));
        assert!(failures.is_empty(), "{level}:\n{}", failures.join("\n"));
    }
}

/// All cases with one kind of kernels, if the adapter has it.
fn stands_all(kernels: Kernels) {
    let Some((_, rasterizer)) = wgpu().into_iter().find(|(kind, _)| *kind == kernels) else { return };
    let failures = unexpected(&records(&rasterizer));
    assert!(failures.is_empty(), "{kernels:?}:\n{}", failures.join("\n"));
}

#[test]
#[ignore = "minutes on a software driver; `cargo xtask test --slow` runs it"]
fn the_gpu_stands_all_with_portable_kernels() {
    stands_all(Kernels::Portable);
}

#[test]
#[ignore = "minutes on a software driver; `cargo xtask test --slow` runs it"]
fn the_gpu_stands_all_with_subgroups() {
    stands_all(Kernels::Subgroups);
}

#[test]
fn the_gpu_stands_all_with_vectors() {
    stands_all(Kernels::Vectors);
}

#[test]
fn cases_have_names_of_their_own_and_say_who_met_them() {
    let cases = planar_corpus().into_iter().map(|c| (format!("planar: {}", c.name), c.why, c.source));
    let cases = cases.chain(spatial_corpus().into_iter().map(|c| (format!("spatial: {}", c.name), c.why, c.source)));
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

/// Faults, and what of the corpus each must be found by.
#[test]
fn faults_are_found() {
    use Fault::*;
    let caught_by = [
        (DropsExtremes, "needles"),
        (CountsNothing, "scale → 0"),
        (SpreadsToAPixel, "poison"),
        (SpreadsByAnUlp, "poison"),
        (ShowsNan, "poison"),
        (Sanitises, "poison"),
        (TakesAnyTarget, "target red"),
        (TakesAnyRates, "learning rate"),
        (ClampsElsewhere, "logits"),
        (CutsAnUlpHigher, "α one ulp below the cut"),
        (DropsLargeGradients, "axis-aligned"),
        (LosesItsLosses, "one Gaussian"),
        (LosesItsLoss, "one Gaussian"),
        (Creeps, "loss exactly 0"),
        (MixesGradients, "axis-aligned"),
    ];
    let inner = cpu(SimdLevel::best());
    let outcome = |fault, word: &str| -> (usize, Vec<String>) {
        let faulty = Faulty { inner: &inner, fault };
        let mut records: Vec<Record> =
            planar_corpus().iter().filter(|case| case.name.contains(word)).map(|case| run(&faulty, case)).collect();
        if records.is_empty() {
            records.extend(poison_planar(&faulty).into_iter().filter(|record| record.case.contains(word)));
        }
        (records.len(), unexpected(&records))
    };
    for (fault, word) in caught_by {
        let (run, failures) = outcome(Faultless, word);
        assert!(run > 0 && failures.is_empty(), "without a fault, {word}:\n{}", failures.join("\n"));
        assert!(!outcome(fault, word).1.is_empty(), "{fault:?} is not found by {word}");
    }
}

/// Seeds of each hardship.
const SEEDS: u64 = 3;

/// Gradients of hard scenes by difference quotients, by what is hard about them.
struct Sets {
    planar: Vec<(String, Vec<Quotients<PlanarScene>>)>,
    spatial: Vec<(String, Vec<Quotients<SpatialScene>>)>,
}

impl Sets {
    fn new(loss: Loss) -> Self {
        let (mut planar, mut spatial) = (Vec::new(), Vec::new());
        for hardship in Hardship::ALL {
            for blend in [Blend::Sum, Blend::Over] {
                let of = |seed| Quotients::new(hard_planar(hardship, blend, seed), loss).unwrap();
                planar.push((format!("{hardship:?}, {blend:?}, {loss:?}"), (0..SEEDS).map(of).collect()));
            }
            let of = |seed| Quotients::new(hard_spatial(hardship, seed), loss).unwrap();
            spatial.push((format!("{hardship:?}, in space, {loss:?}"), (0..SEEDS).map(of).collect()));
        }
        Self { planar, spatial }
    }
}

/// All of one kind that are not what they should be, and sets that say too little.
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

#[test]
fn gradients_of_hard_scenes_are_difference_quotients() {
    for loss in [Loss::L2, Loss::PAPER] {
        let sets = Sets::new(loss);
        let mut failures = wrong(&sets.planar, Quotients::check_oracle);
        failures.extend(wrong(&sets.spatial, Quotients::check_oracle));
        for level in SimdLevel::available() {
            let rasterizer = cpu(level);
            failures.extend(wrong(&sets.planar, |quotients| quotients.check_backend(&rasterizer)));
            failures.extend(wrong(&sets.spatial, |quotients| quotients.check_backend(&rasterizer)));
        }
        for (_, rasterizer) in wgpu() {
            failures.extend(wrong(&sets.planar, |quotients| quotients.check_backend(&rasterizer)));
            failures.extend(wrong(&sets.spatial, |quotients| quotients.check_backend(&rasterizer)));
        }
        assert!(failures.is_empty(), "{}", failures.join("\n"));
    }
}

/// The comparison with difference quotients can fail: gradients of one scene are not those of another.
#[test]
fn gradients_of_other_scenes_are_not_these_difference_quotients() {
    let inner = cpu(SimdLevel::best());
    let faulty = Faulty { inner: &inner, fault: Fault::MixesGradients };
    for hardship in [Hardship::Needles, Hardship::Bright] {
        let quotients = Quotients::new(hard_planar(hardship, Blend::Over, 1), Loss::L2).unwrap();
        quotients.check_backend(&inner).unwrap();
        assert!(matches!(quotients.check_backend(&faulty), Err(Failure::Differs { .. })), "{hardship:?}");
    }
}
