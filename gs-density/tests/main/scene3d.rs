//! Policies in 3D: clone, split, prune, reset and relocate 3D Gaussians.

use crate::evidence::evidence;
use glam::Vec3;
use gs_core::{
    DensityStatistics, EditPlan, Error, Gaussian3d, Scene, Scene3d,
    edit::{Moments, Origin, PruneCause},
    logit, sigmoid,
};
use gs_density::{
    Actions, Densify, DensityPolicy, Grow, LongAxisSplit, Mcmc, Observation, Policy, Prune, Rng, Signal, SizeThreshold,
    SplitPlacement,
};

const EXTENT: f32 = 5.0;

fn gaussian(scale: f32, opacity: f32) -> Gaussian3d {
    Gaussian3d {
        mean: Vec3::new(1.0, -2.0, 3.0),
        log_scale: Vec3::new(0.3 * scale, scale, 0.5 * scale).map(f32::ln),
        rotation: [0.8, 0.5, -0.3, 0.4],
        opacity_logit: logit(opacity),
        sh: vec![Vec3::new(0.2, 0.5, 0.9), Vec3::X, Vec3::Y, Vec3::Z],
    }
}

fn scene(gaussians: &[Gaussian3d]) -> Scene3d {
    let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
    gaussians.iter().for_each(|g| scene.push(g.clone()));
    scene
}

fn statistics(gradients: &[f32]) -> DensityStatistics {
    DensityStatistics { signal_sum: gradients.iter().map(|g| 10.0 * g).collect(), visible: vec![10; gradients.len()] }
}

fn plan_at(policy: &dyn DensityPolicy<Scene3d>, scene: &Scene3d, gradients: &[f32], step: u32) -> EditPlan<Gaussian3d> {
    let statistics = statistics(gradients);
    let observation = Observation {
        scene,
        statistics: &statistics,
        residual: None,
        evidence: None,
        extent: EXTENT,
        step,
        progress: 0.5,
        progress_before: 0.0,
        budget: 100,
    };
    let plan = policy.plan(&observation, &mut Rng::new(7, 11)).unwrap();
    plan.sources(scene.len()).unwrap();
    plan
}

#[test]
fn the_rules_of_3dgs() {
    let rules = Grow::absolute(Signal::MeanGradient).with(|s| {
        s.actions = Actions::default().with(|s| {
            s.prune = Prune::default().with(|s| {
                s.larger_than = Some(SizeThreshold::ExtentFraction(0.1));
                s.larger_after = 3000;
            })
        })
    });
    let (small, large) = (0.01 * EXTENT * 0.9, 0.01 * EXTENT * 1.1);
    let before = scene(&[
        gaussian(small, 0.5),
        gaussian(large, 0.5),
        gaussian(small, 0.004),
        gaussian(0.1 * EXTENT * 1.1, 0.5),
        gaussian(small, 0.5),
    ]);
    let gradients = [3e-4, 3e-4, 3e-4, 0.0, 1e-4];
    let plan = plan_at(&rules, &before, &gradients, 2998);
    assert_eq!(plan.removed.iter().map(|r| (r.index, r.cause)).collect::<Vec<_>>(), [(2, PruneCause::Transparent)]);
    let births: Vec<_> = plan.added.iter().map(|b| (b.parent, b.origin)).collect();
    assert_eq!(births, [(Some(0), Origin::Clone), (Some(1), Origin::Split)]);
    assert_eq!(plan.added[0].gaussian, before.gaussian(0));
    let parent = before.gaussian(1);
    let whiten = parent.factor().unwrap().inverse();
    for half in [&plan.changed[0].gaussian, &plan.added[1].gaussian] {
        assert!((half.log_scale - (parent.log_scale - 1.6f32.ln())).abs().max_element() < 1e-6);
        let drawn = (whiten * (half.mean - parent.mean)).length();
        assert!(drawn > 0.0 && drawn < 6.0, "{drawn} standard deviations");
        assert_eq!((half.rotation, half.opacity_logit, &half.sh), (parent.rotation, parent.opacity_logit, &parent.sh));
    }
    assert_eq!(plan.opacity_ceiling, None);
    let reset = plan_at(&rules, &before, &gradients, 2999);
    assert_eq!((reset.opacity_ceiling, reset.removed.len()), (Some(0.01), 1));
    let after_it = plan_at(&rules, &before, &gradients, 3099);
    let removed: Vec<_> = after_it.removed.iter().map(|r| (r.index, r.cause)).collect();
    assert_eq!(removed, [(2, PruneCause::Transparent), (3, PruneCause::TooLarge)]);
}

#[test]
fn halves_are_drawn_as_their_parent_is_spread() {
    let parent = gaussian(1.0, 0.5);
    let before = scene(&vec![parent.clone(); 50]);
    let policy = Grow::absolute(Signal::MeanGradient);
    let mut sum = 0.0;
    let plan = plan_at(&policy, &before, &[1.0; 50], 99);
    let whiten = parent.factor().unwrap().inverse();
    for birth in &plan.added {
        sum += (whiten * (birth.gaussian.mean - parent.mean)).length_squared();
    }
    // χ² of 150 degrees of freedom: 150 ± 17.
    assert!((sum - 150.0).abs() < 70.0, "{sum}");
}

#[test]
fn a_long_axis_split_puts_two_side_by_side() {
    let split = LongAxisSplit::default();
    let densify = Densify::default().with(|s| s.split_placement = SplitPlacement::LongAxisSplit(split));
    let actions = Actions::default().with(|s| s.densify = densify);
    let policy = Grow::absolute(Signal::MeanGradient).with_actions(actions);
    let parent = gaussian(1.0, 0.5);
    let plan = plan_at(&policy, &scene(std::slice::from_ref(&parent)), &[1.0], 99);
    // The second axis is the longest.
    let along = parent.factor().unwrap().y_axis * split.offset;
    for (half, side) in [(&plan.changed[0].gaussian, -1.0), (&plan.added[0].gaussian, 1.0)] {
        assert!((half.mean - parent.mean - side * along).length() < 1e-5);
        let factors = (half.log_scale - parent.log_scale).map(f32::exp);
        assert!((factors - Vec3::new(split.width, split.length, split.width)).abs().max_element() < 1e-5);
        assert!((sigmoid(half.opacity_logit) - split.opacity * 0.5).abs() < 1e-6);
    }
}

#[test]
fn mcmc_moves_the_dead_to_the_living_and_keeps_the_picture() {
    let before = scene(&[gaussian(0.2, 0.9), gaussian(0.2, 0.003), gaussian(0.2, 0.001)]);
    let policy = Mcmc::default().with(|s| s.percent = 0.0);
    let plan = plan_at(&policy, &before, &[0.0; 3], 99);
    assert_eq!(plan.removed.iter().map(|r| r.index).collect::<Vec<_>>(), [1, 2]);
    assert_eq!((plan.len_after(3), plan.changed.len(), plan.added.len()), (3, 1, 2));
    for part in plan.added.iter().map(|b| &b.gaussian).chain([&plan.changed[0].gaussian]) {
        let through = (1.0 - sigmoid(part.opacity_logit)).powi(3);
        assert!((1.0 - through - 0.9).abs() < 1e-5);
        assert!(part.log_scale.cmplt(before.log_scales[0]).all());
        assert_eq!(part.sh, before.gaussian(0).sh);
    }
}

#[test]
fn every_policy_except_the_2d_ones_plans_in_3d() {
    let before = scene(&[gaussian(0.04, 0.5), gaussian(0.2, 0.5)]);
    let statistics = statistics(&[1.0, 1.0]);
    let evidence = evidence(&[(0.5, &[10.0, 10.0])]);
    let observation = Observation {
        scene: &before,
        statistics: &statistics,
        residual: None,
        evidence: Some(&evidence),
        extent: EXTENT,
        step: 99,
        progress: 0.5,
        progress_before: 0.0,
        budget: 3,
    };
    for name in Policy::NAMES {
        let flat = Policy::from_name(name).unwrap();
        assert_eq!(flat.validate_3d().is_err(), ["residual", "image-gs", "long-axis"].contains(&name), "{name}");
        let policy = flat.for_3d();
        // With a budget of 3, its schedule grows at the end.
        let progress = if name == "improved-gs" { 1.0 } else { 0.5 };
        let observation = Observation { progress, ..observation };
        let plan: Result<EditPlan<Gaussian3d>, Error> = policy.plan(&observation, &mut Rng::new(1, 2));
        if ["residual", "image-gs"].contains(&name) {
            let message = plan.unwrap_err().to_string();
            assert_eq!(message, policy.validate_3d().unwrap_err().to_string());
            assert!(message.contains(name) && message.contains("mcmc"), "{message}");
        } else {
            policy.validate_3d().unwrap();
            let plan = plan.unwrap();
            assert_eq!(plan.len_after(2), if name == "none" { 2 } else { 3 }, "{name}");
            assert!(plan.added.iter().all(|birth| birth.moments == Moments::Zeroed), "{name}");
        }
    }
}

#[test]
fn arrays_of_other_lengths_are_refused() {
    let mut odd = scene(&[gaussian(0.1, 0.5), gaussian(0.1, 0.5)]);
    odd.sh.pop();
    let statistics = statistics(&[1.0, 1.0]);
    let observation = Observation {
        scene: &odd,
        statistics: &statistics,
        residual: None,
        evidence: None,
        extent: EXTENT,
        step: 0,
        progress: 0.5,
        progress_before: 0.0,
        budget: 9,
    };
    let refused: Result<EditPlan<Gaussian3d>, Error> = Policy::None.plan(&observation, &mut Rng::new(1, 2));
    assert_eq!(refused, Err(Error::Length { what: "sh", expected: 8, found: 7 }));
}
