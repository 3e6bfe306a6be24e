//! gs-cpu: the conformance suite at every SIMD level, determinism for every number of threads, and drawn
//! scenes compared with the oracle.

use gs_conformance::{
    bits::bits,
    conformance::{check_gradients, check_image, conformance},
    properties::{judge, losses, repeatable},
    scenes::{Draw, Kind2d, draws},
};
use gs_core::Backend as _;
use gs_core::Optimizer as _;
use gs_core::{
    Adam, Binning, EditPlan, Loss, Parameterization, Rasterizer, Scene, SplatsState, TrainStep,
    edit::{Birth, Moments, Origin, Place, PruneCause, Removal},
    effects::{Blend, Statistics},
};
use gs_cpu::{CpuRasterizer, CpuSettings, SimdLevel};
use pollster::FutureExt as _;
use proptest::prelude::*;

const THREADS: [usize; 3] = [1, 2, 7];

pub(crate) fn rasterizer(level: SimdLevel, threads: usize) -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(threads);
        s.level = Some(level);
    }))
    .unwrap()
}

fn assert_conforms(level: SimdLevel, threads: usize) {
    let rasterizer = rasterizer(level, threads);
    let rasterizer = rasterizer.for_2d();
    assert!(rasterizer.describe().contains(&level.to_string()), "{} is not {level}", rasterizer.describe());
    match conformance(rasterizer) {
        Ok(skipped) => assert_eq!(skipped, []),
        Err(failure) => panic!("{}: {failure}", rasterizer.describe()),
    }
}

/// Tests of the best level with seven threads, and of every other level with one: other tests compare the bits for
/// different numbers of threads. They are given what checks a level and a number of threads.
macro_rules! conforms_at_every_level {
    ($check:path) => {
        #[test]
        fn conforms_at_the_best_level() {
            $check(SimdLevel::best(), 7);
        }

        #[test]
        fn conforms_at_the_other_levels() {
            let others = SimdLevel::available().into_iter().filter(|level| *level != SimdLevel::best());
            others.for_each(|level| $check(level, 1));
        }
    };
}

pub(crate) use conforms_at_every_level;

conforms_at_every_level!(assert_conforms);

/// More Gaussians than fit into one task, and more tiles than threads.
fn many(blend: Blend) -> Draw {
    let mut draw = Draw::new(Kind2d::Typical, blend, 2500, (173, 141), 42).on([0.1, 0.5, 0.3]);
    draw.settings.effects.statistics = Statistics::MeanGradient;
    draw
}

#[test]
fn images_and_gradients_have_the_same_bits_for_every_number_of_threads() {
    for level in SimdLevel::available() {
        for blend in [Blend::Sum, Blend::Over] {
            let draw = many(blend);
            let image = draw.target().unwrap();
            for loss in [Loss::L2, Loss::L1, Loss::PAPER] {
                let [one, two, seven] = THREADS.map(|threads| {
                    let r = rasterizer(level, threads);
                    let r = r.for_2d();
                    let splats = r.upload(&draw.scene, Parameterization::ScaleRotation).unwrap();
                    let target = r.upload_target(&image).unwrap();
                    let pass = r.forward(&splats, &draw.view, &draw.settings).block_on().unwrap();
                    let rendered = r.image(&pass).block_on().unwrap();
                    let (loss, gradients) = r.backward(&splats, pass, &target, &loss).block_on().unwrap();
                    let gradients = r.gradients(&splats, &gradients).block_on().unwrap();
                    assert!(gradients.means.iter().any(|g| g.length() > 0.0));
                    let pixels: Vec<u32> = rendered.pixels().as_flattened().iter().map(|v| v.to_bits()).collect();
                    (loss.to_bits(), pixels, gradients)
                });
                assert!(one == two && two == seven, "{level}, {blend:?}, {loss:?}");
            }
        }
    }
}

/// The state after 50 steps with an edit half way, in which every other step reuses lists.
fn trained(
    level: SimdLevel,
    threads: usize,
    blend: Blend,
    parameterization: Parameterization,
    loss: Loss,
) -> SplatsState {
    let r = rasterizer(level, threads);
    let r = r.for_2d();
    let draw = many(blend);
    let target = r.upload_target(&draw.target().unwrap()).unwrap();
    let mut splats = r.upload(&draw.scene, parameterization).unwrap();
    for step in 0..50 {
        let rates = Adam::default().at(step as f32 / 50.0);
        let binning = if step % 2 == 1 { Binning::Reuse } else { Binning::Fresh };
        let step_ = TrainStep { settings: &draw.settings, loss, rates: &rates, binning };
        r.train_step(&mut splats, &draw.view, &target, &step_).block_on().unwrap();
        if step == 25 {
            let birth = |i: u32| Birth {
                gaussian: draw.scene.gaussian(i as usize),
                parent: Some(i),
                moments: Moments::Inherit,
                origin: Origin::Clone,
                place: Place::default(),
            };
            let removed = (0..200).map(|i| Removal { index: i * 7, cause: PruneCause::Unimportant }).collect();
            let added = (0..300).map(|i| birth(i * 5)).collect();
            r.edit(&mut splats, &EditPlan { removed, added, ..EditPlan::default() }).block_on().unwrap();
            if blend == Blend::Sum {
                r.solve_colors(&mut splats, &draw.view, &target, &draw.settings, 3).block_on().unwrap();
            }
        }
    }
    r.save(&splats).block_on().unwrap()
}

#[test]
fn training_runs_have_the_same_bits_for_every_number_of_threads() {
    let best = SimdLevel::best();
    for blend in [Blend::Sum, Blend::Over] {
        for (parameterization, loss) in [
            (Parameterization::ScaleRotation, Loss::PAPER),
            (Parameterization::CovarianceFactor, Loss::L2),
            (Parameterization::ScaleRotation, Loss::L2),
            (Parameterization::CovarianceFactor, Loss::L1),
        ] {
            let [one, two, seven] = THREADS.map(|threads| trained(best, threads, blend, parameterization, loss));
            assert_eq!(one.rows::<2>("mean").unwrap().len(), 2600);
            assert!(one.rows::<2>("mean").unwrap().as_flattened().iter().all(|v| v.is_finite()));
            assert!(
                bits(&one) == bits(&two) && bits(&two) == bits(&seven),
                "{blend:?}, {parameterization:?}, {loss:?}"
            );
        }
    }
}

pub(crate) fn levels() -> impl Strategy<Value = SimdLevel> {
    proptest::sample::select(SimdLevel::available())
}

proptest! {
    #![proptest_config(repeatable(300, 2026))]

    #[test]
    fn drawn_images_match(draw in draws(), level in levels()) {
        judge(check_image(&rasterizer(level, 2), &draw))?;
    }

    #[test]
    fn drawn_gradients_match(draw in draws(), level in levels(), loss in losses(), local in any::<bool>()) {
        let parameterization = if local { Parameterization::CovarianceFactor } else { Parameterization::ScaleRotation };
        judge(check_gradients(&rasterizer(level, 2), &draw, &loss, parameterization))?;
    }
}
