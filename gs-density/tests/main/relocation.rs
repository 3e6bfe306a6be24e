//! Growth without scores and without parents: 3DGS-MCMC's relocation, Image-GS's additions, and the
//! long-axis split.

use glam::{Vec2, Vec3};
use gs_conformance::properties::fresh;
use gs_core::{
    DensityStatistics, EditPlan, Error, Gaussian2d, Image, Scene, Scene2d,
    edit::{Moments, Place, PruneCause},
    logit, sigmoid,
};
use gs_density::{
    DensityPolicy, ErrorAddition, LongAxisSplit, Mcmc, Noise, Observation, Policy, Residual, Rng, SplitPlacement,
};
use proptest::prelude::*;

// Under Miri just so large that all Gaussians lie inside, and both colours of the target show.
const SIZE: (u32, u32) = (40, 30);

fn gaussian(opacity: f32) -> Gaussian2d {
    Gaussian2d {
        mean: Vec2::new(20.0, 14.0),
        log_scale: Vec2::new(0.3, 1.4),
        rotation: 0.4,
        opacity_logit: logit(opacity),
        color: Vec3::new(0.2, 0.5, 0.9),
    }
}

fn plan(
    policy: &impl DensityPolicy,
    scene: &Scene2d,
    residual: Option<&Residual>,
    progress: f32,
    budget: usize,
) -> EditPlan<Gaussian2d> {
    let statistics = DensityStatistics::zeros(scene.len());
    let observation = Observation {
        scene,
        statistics: &statistics,
        residual,
        evidence: None,
        extent: 40.0,
        step: 99,
        progress,
        progress_before: 0.0,
        budget,
    };
    let plan = policy.plan(&observation, &mut Rng::new(7, 11)).unwrap();
    plan.sources(scene.len()).unwrap();
    plan
}

fn after(plan: &EditPlan<Gaussian2d>, scene: &Scene2d) -> Scene2d {
    let before: Vec<_> = scene.iter().collect();
    plan.gather(&plan.sources(scene.len()).unwrap(), &before, |&g| g).into_iter().collect()
}

fn residual() -> Residual {
    let target = Image::from_fn(SIZE.0, SIZE.1, |x, _| if x < 20 { [0.5; 3] } else { [0.9, 0.1, 0.4] }).unwrap();
    Residual::new(target, Image::filled(SIZE.0, SIZE.1, [0.5; 3]).unwrap())
}

#[test]
fn the_dead_move_behind_the_living_and_nothing_else_is_lost() {
    let opacities = [0.9, 0.004, 0.5, 0.001, 0.7];
    let scene: Scene2d = opacities.into_iter().map(gaussian).collect();
    let still = Mcmc::default().with(|s| s.percent = 0.0);
    let plan = plan(&still, &scene, None, 0.5, 100);
    assert_eq!(plan.removed.iter().map(|r| r.index).collect::<Vec<_>>(), [1, 3]);
    assert!(plan.removed.iter().all(|r| r.cause == PruneCause::Transparent));
    assert_eq!(plan.len_after(5), 5);
    assert!(plan.added.iter().all(|b| b.place == Place::BehindParent && b.moments == Moments::Fresh));
    for change in &plan.changed {
        let parts = 1 + plan.added.iter().filter(|b| b.parent == Some(change.index)).count();
        let whole = gaussian(opacities[change.index as usize]);
        let through = (1.0 - sigmoid(change.gaussian.opacity_logit)).powi(parts as i32);
        assert!((1.0 - through - sigmoid(whole.opacity_logit)).abs() < 1e-5);
        assert!(change.gaussian.log_scale.x < whole.log_scale.x);
        for birth in plan.added.iter().filter(|b| b.parent == Some(change.index)) {
            assert_eq!(birth.gaussian, change.gaussian);
        }
    }
}

#[test]
fn copies_go_where_opacity_is() {
    let scene: Scene2d = (0..400).map(|i| gaussian(if i % 2 == 0 { 0.9 } else { 0.1 })).collect();
    let double = Mcmc::default().with(|s| s.percent = 100.0);
    let plan = plan(&double, &scene, None, 0.5, 1000);
    assert_eq!(plan.len_after(400), 800);
    let opaque = plan.added.iter().filter(|b| b.parent.unwrap() % 2 == 0).count() as f32;
    // 400 draws with a chance of 0.9 each: a standard deviation of 6.
    assert!((opaque - 360.0).abs() < 30.0, "{opaque}");
}

#[test]
fn copies_of_summed_gaussians_add_up_to_the_original() {
    let opaque = Gaussian2d { opacity_logit: f32::INFINITY, ..gaussian(0.5) };
    let scene: Scene2d = [opaque; 7].into_iter().collect();
    let plan = plan(&Mcmc::default().with(|s| s.percent = 100.0), &scene, None, 0.5, 1000);
    assert_eq!(plan.len_after(7), 14);
    let edited = after(&plan, &scene);
    let sum: Vec3 = edited.colors.iter().sum();
    assert!((sum - 7.0 * opaque.color).abs().max_element() < 1e-5);
    assert!(edited.log_scales.iter().all(|&s| s == opaque.log_scale) && !edited.has_opacity());
}

#[test]
fn dead_gaussians_stay_when_all_are_dead() {
    let broken = Gaussian2d { mean: Vec2::NAN, ..gaussian(0.5) };
    let scene: Scene2d = [gaussian(0.001), broken, gaussian(0.002)].into_iter().collect();
    let plan = plan(&Mcmc::default(), &scene, None, 0.5, 100);
    assert_eq!(plan.removed.iter().map(|r| r.index).collect::<Vec<_>>(), [1]);
    assert!(after(&plan, &scene).means.iter().all(|m| m.is_finite()));
    assert!(plan.len_after(3) >= 2);
}

#[test]
fn only_mcmc_asks_for_noise() {
    for name in Policy::NAMES {
        assert_eq!(Policy::from_name(name).unwrap().needs().noise.is_some(), name == "mcmc", "{name}");
    }
    assert_eq!(Policy::Mcmc(Mcmc::default().with(|s| s.noise = Noise::NONE)).needs().noise, None);
}

#[test]
fn image_gs_starts_with_half_and_adds_four_times() {
    let residual = residual();
    for rounds in [1u32, 3, 4, 6, 15] {
        let mut scene: Scene2d = [gaussian(0.5); 50].into_iter().collect();
        let mut additions = Vec::new();
        for round in 1..=rounds {
            let plan = plan(&ErrorAddition::default(), &scene, Some(&residual), round as f32 / rounds as f32, 100);
            if !plan.added.is_empty() {
                additions.push(plan.added.len());
            }
            for birth in &plan.added {
                assert!(birth.gaussian.mean.x > 20.0, "only the right half is wrong");
                assert_eq!(birth.gaussian.color, Vec3::new(0.9, 0.1, 0.4));
                assert_eq!(birth.gaussian.log_scale, Vec2::splat(5f32.ln()));
            }
            scene = after(&plan, &scene);
        }
        assert_eq!(scene.len(), 100, "{rounds} rounds");
        assert_eq!(additions.len(), rounds.min(4) as usize, "{rounds} rounds: {additions:?}");
    }
    let none = DensityStatistics::zeros(0);
    let empty = Scene2d::default();
    let blind = Observation {
        scene: &empty,
        statistics: &none,
        residual: None,
        evidence: None,
        extent: 40.0,
        step: 0,
        progress: 1.0,
        progress_before: 0.0,
        budget: 5,
    };
    assert!(matches!(ErrorAddition::default().plan(&blind, &mut Rng::new(0, 0)), Err(Error::State(_))));
}

#[test]
fn a_long_axis_split_puts_two_side_by_side() {
    let Policy::Grow(policy) = Policy::from_name("long-axis").unwrap() else { panic!("another kind") };
    let LongAxisSplit { offset, length, width, opacity, .. } = LongAxisSplit::default();
    assert_eq!(policy.actions.densify.split_placement, SplitPlacement::LongAxisSplit(LongAxisSplit::default()));
    for opaque in [false, true] {
        let mut parent = gaussian(0.5);
        if opaque {
            parent.opacity_logit = f32::INFINITY;
        }
        let scene: Scene2d = [parent].into_iter().collect();
        let statistics = DensityStatistics { signal_sum: vec![1.0], visible: vec![1] };
        let observation = Observation {
            scene: &scene,
            statistics: &statistics,
            residual: None,
            evidence: None,
            extent: 40.0,
            step: 9,
            progress: 0.5,
            progress_before: 0.0,
            budget: 2,
        };
        let edited = after(&policy.plan(&observation, &mut Rng::new(1, 2)).unwrap(), &scene);
        assert_eq!(edited.len(), 2);
        // The second axis is the longer: (−sin θ, cos θ), σ = e^1.4 px.
        let along = Vec2::new(-0.4f32.sin(), 0.4f32.cos()) * 1.4f32.exp() * offset;
        for (half, side) in edited.iter().zip([-1.0, 1.0]) {
            assert!((half.mean - parent.mean - side * along).length() < 1e-4);
            let shrunk = (half.log_scale - parent.log_scale).map(f32::exp);
            assert!((shrunk - Vec2::new(width, length)).abs().max_element() < 1e-5);
            if opaque {
                assert!((half.color - opacity * parent.color).abs().max_element() < 1e-6);
                assert_eq!(half.opacity_logit, f32::INFINITY);
            } else {
                assert!((sigmoid(half.opacity_logit) - opacity * 0.5).abs() < 1e-6);
                assert_eq!(half.color, parent.color);
            }
        }
    }
}

proptest! {
    #![proptest_config(fresh(256))]

    #[test]
    fn budgets_are_met_exactly_and_what_is_broken_goes(
        opacities in proptest::collection::vec(proptest::option::weighted(0.9, 0.0001f32..0.999), 1..60),
        budget in 1usize..120, percent in 0u8..=100, additions in 1u32..6, progress in 0.01f32..=1.0,
    ) {
        let broken = Gaussian2d { mean: Vec2::NAN, ..gaussian(0.5) };
        let scene: Scene2d = opacities.iter().map(|o| o.map_or(broken, gaussian)).collect();
        let finite = opacities.iter().flatten().count();
        let living = opacities.iter().flatten().filter(|&&o| o > 0.005).count();

        let relocated = after(&plan(&Mcmc::default().with(|s| s.percent = percent.into()), &scene, None, progress, budget), &scene);
        prop_assert!(relocated.means.iter().all(|m| m.is_finite()));
        let growth = (opacities.len() * usize::from(percent)).div_ceil(100);
        let target = (opacities.len() + growth).min(budget);
        if living > 0 {
            prop_assert_eq!(relocated.len(), target.max(living));
            prop_assert!(relocated.opacity_logits.iter().all(|l| l.is_finite()));
        } else {
            prop_assert!(relocated.len() >= finite);
        }

        let residual = residual();
        let policy = ErrorAddition::default().with(|s| s.additions = additions);
        let added = after(&plan(&policy, &scene, Some(&residual), 1.0, budget), &scene);
        prop_assert_eq!(added.len(), budget.max(finite));
        prop_assert!(added.means.iter().all(|m| m.is_finite()));
        let early = after(&plan(&policy, &scene, Some(&residual), progress, budget), &scene);
        prop_assert!(early.len() <= budget.max(finite));
    }

    #[test]
    fn the_same_random_numbers_give_the_same_plan(seed in any::<u64>(), count in 1usize..40) {
        let scene: Scene2d = (0..count).map(|i| gaussian(0.02 + 0.9 * i as f32 / count as f32)).collect();
        let statistics = DensityStatistics::zeros(count);
        let residual = residual();
        let observation = Observation {
            scene: &scene,
            statistics: &statistics,
            residual: Some(&residual),
            evidence: None,
            extent: 40.0,
            step: 99,
            progress: 1.0,
            progress_before: 0.0,
            budget: 2 * count,
        };
        for name in ["mcmc", "image-gs"] {
            let policy = Policy::from_name(name).unwrap();
            let of = |seed: u64| policy.plan(&observation, &mut Rng::new(u128::from(seed), 1)).unwrap();
            prop_assert_eq!(of(seed), of(seed));
            prop_assert!(!of(seed).is_empty());
        }
    }
}
