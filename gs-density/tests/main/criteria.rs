//! Which Gaussians grow and which are removed: counts, budgets, and independence of the order of
//! the Gaussians, for every policy that ranks.

use std::collections::BTreeSet;

use glam::{Vec2, Vec3};
use gs_conformance::properties::fresh;
use gs_core::{DensityStatistics, EditPlan, Error, Gaussian2d, Scene2d, constants::TAU_POSITION, logit};
use gs_density::{
    Actions, DensityPolicy, Grow, Observation, OpacityReset, Policy, Prune, Rng, Signal::MeanGradient, WhenFlat,
};
use proptest::prelude::*;

const EXTENT: f32 = 128.0;

fn observation<'a>(scene: &'a Scene2d, statistics: &'a DensityStatistics, budget: usize) -> Observation<'a> {
    Observation {
        scene,
        statistics,
        residual: None,
        evidence: None,
        extent: EXTENT,
        step: 99,
        progress: 0.5,
        progress_before: 0.25,
        budget,
    }
}

fn gaussian() -> Gaussian2d {
    Gaussian2d {
        mean: Vec2::new(50.0, 40.0),
        log_scale: Vec2::new(1.0, 0.2),
        rotation: 0.4,
        opacity_logit: 0.5,
        color: Vec3::new(0.2, 0.5, 0.9),
    }
}

/// Statistics after 10 visible steps.
fn with_gradients(gradients: &[f32]) -> DensityStatistics {
    DensityStatistics { signal_sum: gradients.iter().map(|g| 10.0 * g).collect(), visible: vec![10; gradients.len()] }
}

fn plan(policy: &impl DensityPolicy, observation: &Observation<'_>) -> EditPlan<Gaussian2d> {
    let plan = policy.plan(observation, &mut Rng::new(7, 11)).unwrap();
    plan.sources(observation.scene.means.len()).unwrap();
    plan
}

fn growing(plan: &EditPlan<Gaussian2d>) -> BTreeSet<u32> {
    plan.added.iter().map(|birth| birth.parent.unwrap()).collect()
}

fn removed(plan: &EditPlan<Gaussian2d>) -> BTreeSet<u32> {
    plan.removed.iter().map(|removal| removal.index).collect()
}

fn ranking_policies() -> Vec<Policy> {
    let ranks = |policy: &Policy| matches!(policy, Policy::Grow(_));
    Policy::NAMES.iter().map(|name| Policy::from_name(name).unwrap()).filter(ranks).collect()
}

#[test]
fn each_criterion_picks_its_own() {
    // 30 Gaussians: 8 above τ, then falling far below it, the last without a gradient.
    let gradients: Vec<f32> = (0..30).map(|i| if i == 29 { 0.0 } else { 1e-3 * 0.8f32.powi(i) }).collect();
    let above = gradients.iter().filter(|&&g| g >= TAU_POSITION).count();
    assert_eq!(above, 8);
    let scene: Scene2d = [gaussian(); 30].into_iter().collect();
    let statistics = with_gradients(&gradients);
    let seen = observation(&scene, &statistics, 1000);
    let first = |n: u32| (0..n).collect::<BTreeSet<u32>>();

    assert_eq!(growing(&plan(&Grow::absolute(MeanGradient), &seen)), first(8));
    assert_eq!(growing(&plan(&Grow::absolute(MeanGradient).with(|s| s.threshold = 0.0), &seen)), first(29));
    assert_eq!(growing(&plan(&Grow::percentile(MeanGradient), &seen)), first(3));
    assert_eq!(growing(&plan(&Grow::percentile(MeanGradient).with(|s| s.percent = 100.0), &seen)), first(29));
    let forced = Grow::percentile(MeanGradient).with(|s| {
        s.percent = 100.0;
        s.when_flat = WhenFlat::Forced;
    });
    assert_eq!(growing(&plan(&forced, &seen)), first(30));

    let both = |percent| {
        Grow::percentile(MeanGradient).with(|s| {
            s.percent = percent;
            s.threshold = TAU_POSITION;
        })
    };
    assert_eq!(growing(&plan(&both(10.0), &seen)), first(3));
    assert_eq!(growing(&plan(&both(50.0), &seen)), first(8));
    let paper = |percent| Grow::paper(MeanGradient).with(|s| s.percent = percent);
    assert_eq!(growing(&plan(&paper(10.0), &seen)), first(8));
    assert_eq!(growing(&plan(&paper(50.0), &seen)), first(15));
    let without_share = Grow::paper(MeanGradient).with(|s| {
        s.threshold = 0.0;
        s.percent = 0.0;
        s.when_flat = WhenFlat::Forced;
    });
    assert_eq!(growing(&plan(&without_share, &seen)), first(29));
}

#[test]
fn without_gradients_nothing_grows_unless_forced() {
    let scene: Scene2d = [gaussian(); 25].into_iter().collect();
    let never_drawn = DensityStatistics::zeros(25);
    let seen = observation(&scene, &never_drawn, 1000);
    for policy in ranking_policies() {
        assert!(plan(&policy, &seen).is_empty(), "{policy:?}");
    }
    let forced = Grow::percentile(MeanGradient).with(|s| s.when_flat = WhenFlat::Forced);
    assert_eq!(growing(&plan(&forced, &seen)), BTreeSet::from([0, 1, 2]));
    let forced = Grow::paper(MeanGradient).with(|s| s.when_flat = WhenFlat::Forced);
    assert_eq!(growing(&plan(&forced, &seen)), BTreeSet::from([0, 1, 2]));
}

#[test]
fn the_papers_twenty_become_six_hundred() {
    let rounds = |policy: &dyn DensityPolicy, gradient: f32, rounds: usize| {
        let mut scene: Scene2d = [gaussian(); 20].into_iter().collect();
        for round in 0..rounds {
            let statistics = with_gradients(&vec![gradient; scene.means.len()]);
            let plan = policy.plan(&observation(&scene, &statistics, 600), &mut Rng::new(round as u128, 0)).unwrap();
            let sources = plan.sources(scene.means.len()).unwrap();
            let before: Vec<_> = scene.iter().collect();
            scene = plan.gather(&sources, &before, |&g| g).into_iter().collect();
        }
        scene.means.len()
    };
    assert_eq!(rounds(&Grow::percentile(MeanGradient), 1e-3, 24), 234);
    assert_eq!(rounds(&Grow::paper(MeanGradient), 1e-5, 24), 234);
    assert_eq!(rounds(&Grow::paper(MeanGradient), 1e-3, 4), 320);
    assert_eq!(rounds(&Grow::paper(MeanGradient), 1e-3, 6), 600);
    assert_eq!(rounds(&Grow::absolute(MeanGradient), 1e-5, 24), 20);
}

#[test]
fn opacities_are_reset_on_time_and_only_where_there_are_some() {
    let translucent: Scene2d = [gaussian(); 3].into_iter().collect();
    let opaque: Scene2d = [Gaussian2d { opacity_logit: f32::INFINITY, ..gaussian() }; 3].into_iter().collect();
    let statistics = DensityStatistics::zeros(3);
    let ceiling = |policy: &Policy, scene, step, progress| {
        plan(policy, &Observation { step, progress, ..observation(scene, &statistics, 9) }).opacity_ceiling
    };
    for policy in ranking_policies() {
        assert_eq!(ceiling(&policy, &translucent, 2999, 0.3), Some(0.01));
        assert_eq!(ceiling(&policy, &translucent, 5999, 0.6), Some(0.01));
        assert_eq!(ceiling(&policy, &translucent, 2899, 0.3), None);
        assert_eq!(ceiling(&policy, &translucent, 0, 0.01), None);
        assert_eq!(ceiling(&policy, &translucent, 8999, 1.0), None);
        assert_eq!(ceiling(&policy, &opaque, 2999, 0.3), None);
    }
    let reset = OpacityReset::NEVER.with(|s| s.once_after = 500);
    let once = Policy::Grow(Grow::paper(MeanGradient).with_actions(Actions::default().with(|s| s.reset = reset)));
    assert_eq!(ceiling(&once, &translucent, 499, 0.1), Some(0.01));
    assert_eq!(ceiling(&once, &translucent, 999, 0.2), None);
    assert_eq!(ceiling(&once, &translucent, 499, 1.0), None);
    let never = Grow::paper(MeanGradient).with_actions(Actions::default().with(|s| s.reset = OpacityReset::NEVER));
    assert_eq!(ceiling(&Policy::Grow(never), &translucent, 2999, 0.3), None);
    assert_eq!(ceiling(&Policy::None, &translucent, 2999, 0.3), None);
}

/// Gaussian 0 covers 98 px with a gradient of 3e-4 in one view and 2 px with none in another: its
/// mean gradient of 1.5e-4 is below the threshold, its pixel-aware gradient of 2.94e-4 above.
/// Gaussian 1 covers 2 px with 9e-4 and 98 px with none: 4.5e-4 and 1.8e-5.
#[test]
fn pixel_gs_counts_pixels_where_3dgs_counts_views() {
    let views = [[(98.0, 3e-4), (2.0, 0.0)], [(2.0, 9e-4), (98.0, 0.0)]];
    let by_views = DensityStatistics {
        signal_sum: views.map(|seen| seen.map(|(_, gradient)| gradient).iter().sum()).to_vec(),
        visible: vec![2; 2],
    };
    let by_pixels = DensityStatistics {
        signal_sum: views.map(|seen| seen.map(|(pixels, gradient)| pixels * gradient).iter().sum()).to_vec(),
        visible: views.map(|seen| seen.map(|(pixels, _)| pixels as u32).iter().sum()).to_vec(),
    };
    let scene: Scene2d = [gaussian(); 2].into_iter().collect();
    for (name, statistics, expected) in [("absolute", by_views, 1), ("pixel-gs", by_pixels, 0)] {
        let policy = Policy::from_name(name).unwrap();
        assert_eq!(growing(&plan(&policy, &observation(&scene, &statistics, 9))), BTreeSet::from([expected]), "{name}");
    }
}

#[test]
fn arrays_that_do_not_fit_are_refused() {
    let scene: Scene2d = [gaussian(); 3].into_iter().collect();
    let short = DensityStatistics { signal_sum: vec![1.0; 3], visible: vec![1; 2] };
    let mut torn = scene.clone();
    torn.colors.pop();
    let whole = DensityStatistics::zeros(3);
    let others = [Policy::None, Policy::from_name("mcmc").unwrap(), Policy::from_name("image-gs").unwrap()];
    for policy in ranking_policies().into_iter().chain(others) {
        let result = policy.plan(&observation(&scene, &short, 9), &mut Rng::new(0, 0));
        assert_eq!(result, Err(Error::Length { what: "visible", expected: 3, found: 2 }));
        let result = policy.plan(&observation(&torn, &whole, 9), &mut Rng::new(0, 0));
        assert_eq!(result, Err(Error::Length { what: "colors", expected: 3, found: 2 }));
    }
}

/// A scene of 0 to 60 Gaussians, a tenth of them broken, and its mean gradients: distinct, from far
/// below τ to far above it.
fn any_scene() -> impl Strategy<Value = (Vec<Gaussian2d>, Vec<f32>)> {
    let any_gaussian = (
        (0f32..128.0, 0f32..96.0),
        (-1f32..3.0, -1f32..3.0),
        -1.5f32..1.5,
        0.001f32..0.999,
        (0u32..40).prop_map(|n| if n < 4 { Some(n) } else { None }),
    )
        .prop_map(|((x, y), (sx, sy), rotation, opacity, broken)| {
            let mut g = Gaussian2d {
                mean: Vec2::new(x, y),
                log_scale: Vec2::new(sx, sy),
                rotation,
                opacity_logit: logit(opacity),
                color: Vec3::new(x / 128.0, y / 96.0, 0.5),
            };
            match broken {
                Some(0) => g.mean.x = f32::NAN,
                Some(1) => g.log_scale.y = f32::INFINITY,
                Some(2) => g.color.z = f32::NAN,
                Some(_) => g.opacity_logit = f32::NAN,
                None => {}
            }
            g
        });
    proptest::collection::vec(any_gaussian, 0..60).prop_flat_map(|gaussians| {
        let gradients: Vec<f32> = (0..gaussians.len()).map(|i| 1e-6 * 1.2f32.powi(i as i32)).collect();
        (Just(gaussians), Just(gradients).prop_shuffle())
    })
}

fn any_policy() -> impl Strategy<Value = Policy> {
    let actions = || {
        let prune = (0f32..0.3).prop_map(|opacity| Prune::default().with(|s| s.opacity = opacity));
        prune.prop_map(|prune| Actions::default().with(|s| s.prune = prune))
    };
    let threshold = || (-15f32..0.0).prop_map(f32::exp);
    prop_oneof![
        (threshold(), actions()).prop_map(|(threshold, actions)| Policy::Grow(Grow::absolute(MeanGradient).with(
            |s| {
                s.threshold = threshold;
                s.actions = actions;
            }
        ))),
        (0f32..=100.0, actions()).prop_map(|(percent, actions)| {
            Policy::Grow(Grow::percentile(MeanGradient).with(|s| {
                s.percent = percent;
                s.actions = actions;
            }))
        }),
        (0f32..=100.0, threshold(), actions()).prop_map(|(percent, threshold, actions)| Policy::Grow(
            Grow::percentile(MeanGradient).with(|s| {
                s.percent = percent;
                s.threshold = threshold;
                s.actions = actions;
            })
        )),
        (0f32..=100.0, threshold(), actions()).prop_map(|(percent, threshold, actions)| {
            Policy::Grow(Grow::paper(MeanGradient).with(|s| {
                s.percent = percent;
                s.threshold = threshold;
                s.actions = actions;
            }))
        }),
        Just(Policy::None),
    ]
}

proptest! {
    #![proptest_config(fresh(256))]

    #[test]
    fn permuting_the_gaussians_permutes_the_plan(
        ((gaussians, gradients), order) in any_scene().prop_flat_map(|pair| {
            let order: Vec<usize> = (0..pair.0.len()).collect();
            (Just(pair), Just(order).prop_shuffle())
        }),
        policy in any_policy(),
        budget in 0usize..120,
    ) {
        let scene: Scene2d = gaussians.iter().copied().collect();
        let statistics = with_gradients(&gradients);
        let original = plan(&policy, &observation(&scene, &statistics, budget));

        // order[slot] is the old index of the Gaussian that now stands in that slot.
        let scene: Scene2d = order.iter().map(|&old| gaussians[old]).collect();
        let statistics = with_gradients(&order.iter().map(|&old| gradients[old]).collect::<Vec<_>>());
        let permuted = plan(&policy, &observation(&scene, &statistics, budget));

        let back = |indices: BTreeSet<u32>| indices.into_iter().map(|i| order[i as usize] as u32).collect::<BTreeSet<_>>();
        prop_assert_eq!(growing(&original), back(growing(&permuted)));
        prop_assert_eq!(removed(&original), back(removed(&permuted)));
        prop_assert_eq!(original.counts(), permuted.counts());
    }

    #[test]
    fn the_budget_is_kept_and_met_where_enough_qualify(
        (gaussians, gradients) in any_scene(), policy in any_policy(), budget in 0usize..120,
    ) {
        let scene: Scene2d = gaussians.iter().copied().collect();
        let statistics = with_gradients(&gradients);
        let unlimited = plan(&policy, &observation(&scene, &statistics, usize::MAX));
        let limited = plan(&policy, &observation(&scene, &statistics, budget));

        prop_assert_eq!(&limited.removed, &unlimited.removed);
        let survivors = gaussians.len() - limited.removed.len();
        let wanted = unlimited.len_after(gaussians.len());
        prop_assert_eq!(limited.len_after(gaussians.len()), wanted.min(budget.max(survivors)));
        prop_assert_eq!(limited.counts().added() as usize, limited.added.len());
        prop_assert_eq!(growing(&limited).len(), limited.added.len());

        // Gaussians beyond the limit have smaller gradients than those that grow.
        let least = growing(&limited).into_iter().map(|i| gradients[i as usize]).fold(f32::INFINITY, f32::min);
        for i in growing(&unlimited).difference(&growing(&limited)) {
            prop_assert!(gradients[*i as usize] < least);
        }
    }

    #[test]
    fn nonfinite_gaussians_are_removed_and_do_not_spread(
        (gaussians, mut gradients) in any_scene(), policy in any_policy(), spoilt in proptest::collection::vec(0usize..60, 0..5),
    ) {
        for index in &spoilt {
            if let Some(gradient) = gradients.get_mut(*index) {
                *gradient = f32::NAN;
            }
        }
        let scene: Scene2d = gaussians.iter().copied().collect();
        let statistics = with_gradients(&gradients);
        let plan = plan(&policy, &observation(&scene, &statistics, 1000));
        prop_assert!(growing(&plan).iter().all(|&i| gradients[i as usize].is_finite()));

        let sources = plan.sources(gaussians.len()).unwrap();
        let after: Vec<_> = plan.gather(&sources, &gaussians, |&g| g);
        for g in &after {
            prop_assert!(g.mean.is_finite() && g.log_scale.is_finite() && g.color.is_finite(), "{:?}", g);
            prop_assert!(!g.opacity_logit.is_nan());
        }
        let broken = gaussians.iter().filter(|g| {
            !(g.mean.is_finite() && g.log_scale.is_finite() && g.color.is_finite()) || g.opacity_logit.is_nan()
        });
        prop_assert_eq!(broken.count(), plan.counts().pruned_not_finite as usize);
    }
}
