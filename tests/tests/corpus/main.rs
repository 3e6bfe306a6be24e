//! The corpus of hard cases on gs-cpu and gs-wgpu; gradients of hard scenes against difference quotients; and, so that it is known that the
//! corpus can fail, backends with the faults that it is there to find.

mod faulty;

use std::collections::HashSet;

use gs_conformance::{
    Failure,
    corpus::{
        Differences, Hardship, Record, Source, check_backend, check_oracle, hard_planar, hard_spatial, planar_corpus,
        poison_planar, poison_spatial, run, spatial_corpus,
    },
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
        let settings = WgpuSettings {
            fresh_buffers: FreshBuffers::Poison,
            kernels: Some(kernels),
            most_groups: None,
            adapter: None,
        };
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

#[test]
fn the_gpu_stands_all_with_all_kernels() {
    for (kernels, rasterizer) in wgpu() {
        let failures = unexpected(&records(&rasterizer));
        assert!(failures.is_empty(), "{kernels:?}:\n{}", failures.join("\n"));
    }
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
        (DropsLargeGradients, "one Gaussian"),
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
const SEEDS: u64 = 4;

fn all_hard(
    mut planar: impl FnMut(Hardship, Blend, u64) -> Result<Differences, Failure>,
    mut spatial: impl FnMut(Hardship, u64) -> Result<Differences, Failure>,
) -> Vec<(String, Differences)> {
    let mut sets = Vec::new();
    for hardship in Hardship::ALL {
        for blend in [Blend::Sum, Blend::Over] {
            let name = format!("{hardship:?}, {blend:?}");
            let each =
                (0..SEEDS).map(|seed| planar(hardship, blend, seed).unwrap_or_else(|f| panic!("{name} {seed}: {f}")));
            sets.push((name.clone(), each.fold(Differences::default(), Differences::and)));
        }
        let name = format!("{hardship:?}, in space");
        let each = (0..SEEDS).map(|seed| spatial(hardship, seed).unwrap_or_else(|f| panic!("{name} {seed}: {f}")));
        sets.push((name.clone(), each.fold(Differences::default(), Differences::and)));
    }
    sets
}

#[test]
fn the_oracles_gradients_of_hard_scenes_are_difference_quotients() {
    for loss in [Loss::L2, Loss::PAPER] {
        let sets = all_hard(
            |hardship, blend, seed| check_oracle(&hard_planar(hardship, blend, seed), &loss),
            |hardship, seed| check_oracle(&hard_spatial(hardship, seed), &loss),
        );
        for (name, differences) in sets {
            differences.means_something().unwrap_or_else(|failure| panic!("{name}, {loss:?}: {failure}"));
        }
    }
}

fn quotients_of<R: Rasterizer<PlanarScene> + Rasterizer<SpatialScene>>(name: &str, rasterizer: &R) {
    let loss = Loss::L2;
    let sets = all_hard(
        |hardship, blend, seed| check_backend(rasterizer, &hard_planar(hardship, blend, seed), &loss),
        |hardship, seed| check_backend(rasterizer, &hard_spatial(hardship, seed), &loss),
    );
    for (set, differences) in sets {
        differences.means_something().unwrap_or_else(|failure| panic!("{name}, {set}: {failure}"));
    }
}

#[test]
fn backends_gradients_of_hard_scenes_are_difference_quotients() {
    for level in SimdLevel::available() {
        quotients_of(&level.to_string(), &cpu(level));
    }
    for (kernels, rasterizer) in wgpu() {
        quotients_of(&format!("{kernels:?}"), &rasterizer);
    }
}
