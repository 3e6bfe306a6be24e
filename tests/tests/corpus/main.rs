//! The corpus of hard cases on gs-cpu and gs-wgpu; gradients of hard scenes against difference quotients; and, so that it is known that the
//! corpus can fail, backends with the faults that it is there to find.

mod faulty;

use std::collections::HashSet;

use gs_conformance::{
    Failure,
    corpus::{
        Differences, Hardship, Quotients, Record, Source, hard_planar, hard_spatial, planar_corpus, poison_planar,
        poison_planar_slots, poison_spatial, poison_spatial_slots, run, spatial_corpus,
    },
    subject::Subject,
};
use gs_core::{Loss, PlanarScene, Rasterizer, SpatialScene, effects::Blend};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use gs_wgpu::{FreshBuffers, Kernels, WgpuRasterizer, WgpuSettings};

use self::faulty::{Fault, Faulty};

/// As one thread: what threads would do in images of this size is wait for each other.
fn cpu(level: SimdLevel) -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings { threads: Some(1), level: Some(level) }).unwrap()
}

/// A device with this kind of kernels, if the adapter can run them, with fresh buffers full of NaN.
fn wgpu_with(kernels: Kernels) -> Option<WgpuRasterizer> {
    let settings =
        WgpuSettings { fresh_buffers: FreshBuffers::Poison, kernels: Some(kernels), ..WgpuSettings::default() };
    WgpuRasterizer::new(settings).ok()
}

/// A device for each kind of kernels that the adapter can run.
fn wgpu() -> Vec<(Kernels, WgpuRasterizer)> {
    let of = |kernels| Some((kernels, wgpu_with(kernels)?));
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
    let Some(rasterizer) = wgpu_with(kernels) else { return };
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

/// What of the corpus finds a fault: cases, or records of poison, whose names have this in them.
#[derive(Debug, Clone, Copy)]
enum By {
    Planar(&'static str),
    Spatial(&'static str),
}

/// Faults, and what of the corpus each must be found by.
const FOUND_BY: &[(Fault, By)] = {
    use By::*;
    use Fault::*;
    &[
        (DropsExtremes, Planar("needles")),
        (DropsExtremes, Spatial("scale → 0 in one axis, dilated")),
        (CountsNothing, Planar("scale → 0")),
        (CountsNothing, Spatial("on the camera, behind it")),
        (SpreadsToAPixel, Planar("poison, over: mean 0")),
        (SpreadsToAPixel, Spatial("poison, by mean depth: mean 0")),
        (SpreadsByAnUlp, Planar("poison, sum: log_scale 0")),
        (SpreadsByAnUlp, Spatial("poison, by pixel depth: frame 4, in local frames")),
        (ShowsNan, Planar("poison, over: color 0")),
        (ShowsNan, Spatial("poison, by mean depth: sh 0")),
        (Sanitises, Planar("poison, over: rotation 0")),
        (Sanitises, Planar("poison, sum: frame 1, in local frames")),
        (Sanitises, Spatial("poison, by mean depth: frame 0, in local frames")),
        (TakesAnyTarget, Planar("target red")),
        (TakesAnyTarget, Spatial("poison, by mean depth: target red")),
        (TakesAnyRates, Planar("learning rate of means")),
        (TakesAnyRates, Spatial("poison, by mean depth: beta1 of higher SH")),
        (TakesAnyLoss, Planar("poison, over: lambda")),
        (RefusesTheUnusual, Planar("poison, over: alpha_max")),
        (RefusesTheUnusual, Spatial("poison, by pixel depth: alpha_max")),
        (IgnoresTheExtent, Planar("poison, over: extent")),
        (IgnoresTheExtent, Spatial("poison, by mean depth: extent")),
        (ClampsElsewhere, Planar("logits")),
        (ClampsElsewhere, Spatial("logits")),
        (CutsTwoUlpsLower, Planar("α two ulps below the cut")),
        (CutsWhatIsAtTheCut, Planar("α = cut")),
        (DropsLargeGradients, Planar("axis-aligned")),
        (DropsLargeGradients, Spatial("coincident")),
        (LosesItsLosses, Planar("one Gaussian")),
        (LosesItsLoss, Planar("one Gaussian")),
        (LosesItsLoss, Spatial("one Gaussian")),
        (Creeps, Planar("loss exactly 0")),
        (NeverSteps, Planar("one Gaussian")),
        (NeverSteps, Planar("10⁶ px away")),
        (NeverSteps, Planar("loss exactly 0")),
        (NeverSteps, Spatial("one Gaussian")),
        (NeverSteps, Spatial("10⁶ px away")),
        (MixesGradients, Planar("axis-aligned")),
        (MixesGradients, Spatial("at the edge of the field of view")),
        (IgnoresTheNearPlane, Spatial("on the near plane, an ulp either side")),
        (OrdersByIndex, Spatial("sort keys at their limits, by depth of the mean")),
        (OrdersByIndex, Spatial("sort keys at their limits, by depth at each pixel")),
        (OrdersByMean, Spatial("two that interpenetrate, by depth at each pixel")),
        (FollowsTheJacobian, Spatial("at the edge of the field of view")),
        (CentresThePrincipalPoint, Spatial("with an off-centre principal point")),
        (SquaresPixels, Spatial("pixels that are not square")),
        (DropsHarmonics, Spatial("SH that drive the colour below 0")),
        (Dilates, Spatial("scale → 0 in all axes, not antialiased")),
        (ForgetsCompensation, Spatial("scale → 0 in all axes, mip")),
    ]
};

impl By {
    /// How many records there are, and those that are not as expected.
    fn outcome<R: Rasterizer<PlanarScene> + Rasterizer<SpatialScene>>(self, rasterizer: &R) -> (usize, Vec<String>) {
        let records = match self {
            Self::Planar(word) => {
                let cases = planar_corpus().into_iter().filter(|case| case.name.contains(word));
                let mut records: Vec<Record> = cases.map(|case| run(rasterizer, &case)).collect();
                records.extend(poison_planar_slots(rasterizer, |name| name.contains(word)));
                records
            }
            Self::Spatial(word) => {
                let cases = spatial_corpus().into_iter().filter(|case| case.name.contains(word));
                let mut records: Vec<Record> = cases.map(|case| run(rasterizer, &case)).collect();
                records.extend(poison_spatial_slots(rasterizer, |name| name.contains(word)));
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
        let (run, failures) = by.outcome(&Faulty { inner: &inner, fault: Fault::Faultless });
        if run == 0 || !failures.is_empty() {
            wrong.push(format!("{run} of {by:?}, without a fault: {}", failures.join("\n")));
        }
        match by.outcome(&Faulty { inner: &inner, fault }).1.first() {
            None => wrong.push(format!("{fault:?} is not found by {by:?}")),
            Some(found) => eprintln!("{fault:?}: {found}"),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
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
