//! Tests of growth by residual: exact counts, the right ones pruned, seeds where the residual is.

use glam::Vec2;
use gs_core::{
    DensityStatistics, Image,
    edit::{Moments, Origin},
};
use rand::SeedableRng;

use super::*;

fn gaussian(i: usize) -> Gaussian2d {
    Gaussian2d {
        mean: Vec2::new(1.0 + i as f32, 20.0),
        log_scale: Vec2::new(0.5, 0.1),
        rotation: 0.2,
        opacity_logit: f32::INFINITY,
        color: Vec3::splat(0.1 + 0.01 * ((i * 7) % 60) as f32),
    }
}

fn scene(len: usize) -> Scene2d {
    (0..len).map(gaussian).collect()
}

/// A residual that is wrong only within a square of 12 px side.
fn residual() -> Residual {
    let target = Image::from_fn(60, 40, |x, y| {
        if (30..42).contains(&x) && (10..22).contains(&y) { [0.9, 0.4, 0.2] } else { [0.25; 3] }
    });
    Residual::new(target.unwrap(), Image::filled(60, 40, [0.25; 3]).unwrap())
}

fn plan_at(policy: &ResidualGrowth, scene: &Scene2d, residual: &Residual, progress: f32) -> EditPlan<Gaussian2d> {
    let observation = Observation {
        scene,
        statistics: &DensityStatistics::zeros(scene.len()),
        residual: Some(residual),
        evidence: None,
        extent: 60.0,
        step: 30,
        progress,
        progress_before: 0.0,
        budget: 200,
    };
    let plan = policy.plan(&observation, &mut Rng::seed_from_u64(11)).unwrap();
    plan.sources(scene.len()).unwrap();
    plan
}

fn removed(plan: &EditPlan<Gaussian2d>) -> Vec<u32> {
    plan.removed.iter().map(|r| r.index).collect()
}

#[test]
fn the_count_follows_the_line_and_ends_at_the_budget() {
    let policy = ResidualGrowth { growth_fraction: 0.4, ..ResidualGrowth::default() };
    let mut len = 16;
    for (round, expected) in [(1, 62), (2, 108), (3, 154), (4, 200), (5, 200), (10, 200)] {
        let plan = plan_at(&policy, &scene(len), &residual(), round as f32 / 10.0);
        let share = if expected > len { 0.2 } else { 0.1 };
        assert_eq!(plan.removed.len(), (share * len as f64).round() as usize, "round {round}");
        len = plan.len_after(len);
        assert_eq!(len, expected, "round {round}");
    }
}

#[test]
fn the_budget_is_met_from_above_and_from_nothing() {
    let policy = ResidualGrowth { growth_fraction: 0.0, ..ResidualGrowth::default() };
    for len in [0, 1, 199, 200, 260] {
        assert_eq!(plan_at(&policy, &scene(len), &residual(), 0.1).len_after(len), 200, "from {len}");
    }
}

#[test]
fn seeds_go_where_the_residual_is() {
    let plan = plan_at(&ResidualGrowth::default(), &scene(16), &residual(), 0.1);
    let near = |b: &&Birth<Gaussian2d>| {
        let m = b.gaussian.mean;
        m.x > 27.0 && m.x < 45.0 && m.y > 7.0 && m.y < 25.0
    };
    // At most 0.3 on each of the 144 wrong pixels, so 43 of 49 at the square, smoothing included.
    let there = plan.added.iter().filter(near).count();
    assert!(there >= plan.added.len() * 85 / 100, "{there} of {}", plan.added.len());
    let inside = plan.added.iter().map(|b| b.gaussian).find(|g| g.mean.distance(Vec2::new(36.0, 16.0)) < 4.0).unwrap();
    assert!((inside.color - Vec3::new(0.325, 0.075, -0.025)).abs().max_element() < 1e-3, "{}", inside.color);
    assert!(plan.added.iter().all(|b| b.moments == Moments::Fresh && b.origin == Origin::Seed && b.parent.is_none()));
}

#[test]
fn without_residual_seeds_are_finite_and_spread_evenly() {
    let mut flat = residual();
    flat.target = flat.rendered.clone();
    let plan = plan_at(&ResidualGrowth::default(), &scene(16), &flat, 1.0);
    let seeds: Scene2d = plan.added.iter().map(|b| b.gaussian).collect();
    seeds.validate().unwrap();
    let left = seeds.means.iter().filter(|m| m.x < 30.0).count();
    assert!(left.abs_diff(seeds.len() / 2) <= 4);
}

#[test]
fn a_residual_that_is_not_finite_does_no_harm() {
    let mut broken = residual();
    broken.rendered.pixels_mut()[700] = [f32::NAN, f32::INFINITY, 0.0];
    let plan = plan_at(&ResidualGrowth::default(), &scene(16), &broken, 1.0);
    plan.added.iter().map(|b| b.gaussian).collect::<Scene2d>().validate().unwrap();
}

#[test]
fn the_least_important_go_after_those_that_are_not_finite() {
    let mut scene = scene(100);
    scene.means[40].x = f32::NAN;
    scene.colors[90] = Vec3::ZERO;
    scene.log_scales[70] = Vec2::splat(-4.0);
    scene.colors[5] = Vec3::ZERO;
    let policy = ResidualGrowth { prune_growing: 0.04, ..ResidualGrowth::default() };
    let plan = plan_at(&policy, &scene, &residual(), 0.4);
    assert_eq!(removed(&plan), [5, 40, 70, 90]);
    assert_eq!(plan.counts().pruned_not_finite, 1);
    assert_eq!(plan.counts().pruned_unimportant, 3);
    // All that are not finite go, even where the share is smaller.
    let none = ResidualGrowth { prune_growing: 0.0, ..policy };
    assert_eq!(removed(&plan_at(&none, &scene, &residual(), 0.4)), [40]);
}

#[test]
fn weights_draw_seeds_and_protect_gaussians() {
    let mut weighted = residual();
    // Wrong everywhere by the same amount; the left half counts 16 times as much.
    weighted.target = Image::filled(60, 40, [0.5; 3]).unwrap();
    weighted.weights = Some((0..60 * 40).map(|i| if i % 60 < 30 { 1.6 } else { 0.1 }).collect());
    let policy = ResidualGrowth { max_per_pixel: 1.0, ..ResidualGrowth::default() };
    let mut equal = scene(58);
    equal.colors.fill(Vec3::splat(0.5));
    let plan = plan_at(&policy, &equal, &weighted, 0.3);
    // (√16)³ = 64 times as many seeds on the left, but for those that smoothing moves.
    let right = plan.added.iter().filter(|birth| birth.gaussian.mean.x > 31.0).count();
    assert!(!plan.added.is_empty() && right <= plan.added.len() / 40 + 1, "{right} of {}", plan.added.len());
    // Means are at x = 1 + index.
    assert!(!plan.removed.is_empty() && plan.removed.iter().all(|removal| removal.index >= 29), "{:?}", plan.removed);

    weighted.weights = Some(vec![1.0; 7]);
    let observation = Observation {
        scene: &equal,
        statistics: &DensityStatistics::zeros(58),
        residual: Some(&weighted),
        evidence: None,
        extent: 60.0,
        step: 30,
        progress: 0.1,
        progress_before: 0.0,
        budget: 200,
    };
    let refused = policy.plan(&observation, &mut Rng::seed_from_u64(1)).unwrap_err();
    assert!(matches!(refused, Error::Length { what: "weights", expected: 2400, found: 7 }), "{refused}");
}

#[test]
fn with_opacities_the_transparent_go_first_and_seeds_have_one() {
    let mut scene = scene(100);
    scene.opacity_logits = vec![1.0; 100];
    scene.opacity_logits[33] = -9.0;
    scene.opacity_logits[34] = f32::NEG_INFINITY;
    scene.colors[50] = Vec3::ZERO; // black hides what is behind
    let policy = ResidualGrowth { prune_growing: 0.02, ..ResidualGrowth::default() };
    let plan = plan_at(&policy, &scene, &residual(), 0.4);
    assert_eq!(removed(&plan), [33, 34]);
    assert!(plan.added.iter().all(|b| (sigmoid(b.gaussian.opacity_logit) - 0.7).abs() < 1e-5));
}

#[test]
fn permuting_the_gaussians_permutes_the_plan() {
    let mut ordered = scene(60); // 60 different colours, so no ties
    ordered.colors.iter_mut().enumerate().for_each(|(i, c)| c.y += 1e-3 * i as f32);
    let permutation: Vec<usize> = (0..60).map(|i| (i * 37 + 5) % 60).collect();
    let permuted: Scene2d = permutation.iter().map(|&i| ordered.gaussian(i)).collect();
    let policy = ResidualGrowth::default();
    let (a, b) = (plan_at(&policy, &ordered, &residual(), 0.6), plan_at(&policy, &permuted, &residual(), 0.6));
    let mut mapped: Vec<u32> = removed(&b).into_iter().map(|i| permutation[i as usize] as u32).collect();
    mapped.sort_unstable();
    assert_eq!(mapped, removed(&a));
    assert_eq!(a.added, b.added);
}

#[test]
fn equal_random_numbers_give_equal_plans() {
    let policy = ResidualGrowth::default();
    assert_eq!(plan_at(&policy, &scene(50), &residual(), 0.3), plan_at(&policy, &scene(50), &residual(), 0.3));
}

#[test]
fn plans_are_equal_on_any_number_of_threads() {
    // Large enough for several tasks: rows, and more than one group of seeds.
    let target = Image::from_fn(200, 150, |x, y| [(0.3 * x as f32).sin(), (0.2 * y as f32).cos(), 0.5]).unwrap();
    let residual = Residual::new(target, Image::filled(200, 150, [0.1; 3]).unwrap());
    let statistics = DensityStatistics::zeros(0);
    let scene = Scene2d::default();
    let observation = Observation {
        scene: &scene,
        statistics: &statistics,
        residual: Some(&residual),
        evidence: None,
        extent: 200.0,
        step: 0,
        progress: 1.0,
        progress_before: 0.0,
        budget: 3000,
    };
    let plan = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| ResidualGrowth::default().plan(&observation, &mut Rng::seed_from_u64(3))).unwrap()
    };
    let one = plan(1);
    assert_eq!(one.added.len(), 3000);
    assert_eq!(one, plan(2));
    assert_eq!(one, plan(7));
}

#[test]
fn powers_agree_with_powf() {
    for exponent in [0.5, 1.0, 1.7, 2.0, 2.5, 3.5, 4.0, 8.0] {
        let mut values = [0.0, 1e-4, 0.3, 1.0, 2.5];
        let expected = values.map(|v: f32| v.powf(0.5 * exponent));
        Power::of_square_root(exponent).apply(&mut values);
        for (v, e) in values.iter().zip(expected) {
            assert!((v - e).abs() <= 1e-5 * e, "{exponent}: {v} {e}");
        }
    }
}

#[test]
fn missing_inputs_and_invalid_settings_are_refused() {
    let scene = scene(3);
    let residual = residual();
    let complete = Observation {
        scene: &scene,
        statistics: &DensityStatistics::zeros(3),
        residual: Some(&residual),
        evidence: None,
        extent: 60.0,
        step: 0,
        progress: 0.5,
        progress_before: 0.0,
        budget: 9,
    };
    let plan = |policy: ResidualGrowth, o: &Observation<'_>| policy.plan(o, &mut Rng::seed_from_u64(0));
    let policy = ResidualGrowth::default();
    assert!(plan(policy, &complete).is_ok());
    assert!(matches!(plan(policy, &Observation { residual: None, ..complete }), Err(Error::State(_))));
    let short = DensityStatistics::zeros(2);
    assert!(matches!(plan(policy, &Observation { statistics: &short, ..complete }), Err(Error::Length { .. })));
    for bad in [
        ResidualGrowth { exponent: f32::NAN, ..policy },
        ResidualGrowth { prune_growing: 1.5, ..policy },
        ResidualGrowth { max_per_pixel: 0.0, ..policy },
        ResidualGrowth { max_sigma_px: 0.1, ..policy },
        ResidualGrowth { opacity: 1.0, ..policy },
    ] {
        assert!(matches!(plan(bad, &complete), Err(Error::Setting { .. })), "{bad:?}");
    }
}
