//! Policies that read evidence over several views, on scenes small enough to work out by hand.

use glam::Vec3;
use gs_core::{
    DensityStatistics, EditPlan, Error, Gaussian3d, Scene, Scene3d,
    edit::{Origin, PruneCause},
    logit,
};
use gs_density::{
    Actions, DensityPolicy, Evidence, FastGs, Grow, ImprovedGs, Observation, PixelSums, Policy, Rng, Signal, Simplify,
    Taming, ViewEvidence,
};

const EXTENT: f32 = 5.0;

fn scene(scales_and_opacities: &[(f32, f32)]) -> Scene3d {
    let mut scene = Scene3d::default();
    for &(scale, opacity) in scales_and_opacities {
        scene.push(Gaussian3d {
            mean: Vec3::new(1.0, -2.0, 3.0),
            log_scale: Vec3::splat(scale.ln()),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: logit(opacity),
            sh: vec![Vec3::ZERO],
        });
    }
    scene
}

/// Evidence of views with these losses, in which each Gaussian covers and contributes as given.
pub(crate) fn evidence(views: &[(f32, &[f32])]) -> Evidence {
    let view = |&(loss, values): &(f32, &[f32])| {
        let sums = PixelSums { pixels: values.to_vec(), error: values.to_vec(), high_error: values.to_vec() };
        let ones = vec![1.0; values.len()];
        ViewEvidence { loss, blended: sums.clone(), covered: sums, depth: ones.clone(), radius_px: ones }
    };
    Evidence { views: views.iter().map(view).collect() }
}

struct Round<'a> {
    scene: &'a Scene3d,
    gradients: &'a [f32],
    evidence: Option<&'a Evidence>,
    step: u32,
    progress: [f32; 2],
    budget: usize,
}

impl Round<'_> {
    fn plan(&self, policy: &dyn DensityPolicy<Scene3d>) -> Result<EditPlan<Gaussian3d>, Error> {
        let statistics = DensityStatistics {
            signal_sum: self.gradients.iter().map(|g| 10.0 * g).collect(),
            visible: vec![10; self.gradients.len()],
        };
        let [progress_before, progress] = self.progress;
        let observation = Observation {
            scene: self.scene,
            statistics: &statistics,
            residual: None,
            evidence: self.evidence,
            extent: EXTENT,
            step: self.step,
            progress,
            progress_before,
            budget: self.budget,
        };
        let plan = policy.plan(&observation, &mut Rng::new(7, 11))?;
        plan.sources(self.scene.len())?;
        Ok(plan)
    }
}

fn parents(plan: &EditPlan<Gaussian3d>) -> Vec<u32> {
    plan.added.iter().filter_map(|birth| birth.parent).collect()
}

fn removed(plan: &EditPlan<Gaussian3d>) -> Vec<(u32, PruneCause)> {
    plan.removed.iter().map(|r| (r.index, r.cause)).collect()
}

/// Only Gaussian 0 has both the gradient (0.0012) and, over two views, 6 pixels of high error on
/// average; it is larger than a thousandth of the extent, so it is split. Of the two transparent
/// ones one is removed. All opacities are lowered to 0.8.
#[test]
fn fastgs_grows_where_gradient_and_views_agree() {
    let scene = scene(&[(0.1, 0.5), (0.1, 0.5), (0.1, 0.5), (0.1, 0.004), (0.1, 0.004)]);
    let evidence = evidence(&[(0.1, &[8.0, 9.0, 20.0, 0.0, 0.0]), (0.3, &[4.0, 2.0, 20.0, 0.0, 0.0])]);
    let gradients = [0.0013, 0.0013, 0.0011, 0.0, 0.0];
    let round = Round {
        scene: &scene,
        gradients: &gradients,
        evidence: Some(&evidence),
        step: 599,
        progress: [0.1, 0.2],
        budget: 100,
    };
    let plan = round.plan(&FastGs::default()).unwrap();
    assert_eq!(parents(&plan), [0]);
    assert_eq!(plan.added[0].origin, Origin::Split);
    assert_eq!(removed(&plan).len(), 1);
    assert!(removed(&plan)[0].0 >= 3 && removed(&plan)[0].1 == PruneCause::Transparent, "{:?}", plan.removed);
    assert_eq!(plan.opacity_ceiling, Some(0.8));
}

/// After growth, every 3,000 steps: with losses 0.1 and 0.3 the sums are 2.0, 1.9, 0.4, 0, so the
/// scores are 1, 0.95, 0.2, 0. The first two are above 0.9; the last has an opacity below 0.1.
#[test]
fn fastgs_prunes_after_growth() {
    let scene = scene(&[(0.1, 0.5), (0.1, 0.5), (0.1, 0.5), (0.1, 0.05)]);
    let evidence = evidence(&[(0.1, &[5.0, 4.0, 1.0, 0.0]), (0.3, &[5.0, 5.0, 1.0, 0.0])]);
    let at = |step| Round {
        scene: &scene,
        gradients: &[0.1; 4],
        evidence: Some(&evidence),
        step,
        progress: [0.6, 0.7],
        budget: 100,
    };
    let plan = at(17_999).plan(&FastGs::default()).unwrap();
    let expected = [(0, PruneCause::Unimportant), (1, PruneCause::Unimportant), (3, PruneCause::Transparent)];
    assert_eq!(removed(&plan), expected);
    assert_eq!((plan.added.len(), plan.opacity_ceiling), (0, None));
    assert!(at(17_899).plan(&FastGs::default()).unwrap().is_empty(), "between two prunes");
    let fast = FastGs::default();
    let needed = |step, progress| DensityPolicy::<Scene3d>::evidence(&fast, step, progress).is_some();
    assert!(needed(599, 0.2) && needed(17_999, 0.7) && !needed(17_899, 0.7));
}

/// From 4 Gaussians to 20 in two rounds: 4 + 16 (2p − p²) is 16 at p = ½, but only 4 can grow. From
/// 8 at the same schedule a quarter of the 12 that are missing stays missing.
#[test]
fn taming_follows_its_schedule_of_counts() {
    let taming = Taming::default();
    let added = |count: usize, reaching: usize, progress: [f32; 2]| {
        let scene = scene(&vec![(0.1, 0.5); count]);
        let ones = vec![1.0; count];
        let evidence = evidence(&[(0.1, &ones)]);
        let gradients: Vec<f32> = (0..count).map(|i| if i < reaching { 3e-4 } else { 1e-4 }).collect();
        let round =
            Round { scene: &scene, gradients: &gradients, evidence: Some(&evidence), step: 99, progress, budget: 20 };
        round.plan(&taming).unwrap().added.len()
    };
    assert_eq!(added(4, 4, [0.0, 0.5]), 4);
    assert_eq!(added(12, 12, [0.0, 0.25]), 4, "12 + 8 (1 - 9/16) = 15.5, rounded up");
    assert_eq!(added(12, 12, [0.5, 1.0]), 8);
    assert_eq!(added(12, 3, [0.5, 1.0]), 3);
}

/// Gaussian 1 has a score of 0, as no view shows it; the others have 1 and 999 by the error alone,
/// so that Gaussian 2 is drawn.
#[test]
fn taming_draws_by_score() {
    let mut taming = Taming::default();
    let [mut weights, error] = [taming.weights; 2];
    (weights.gradient, weights.opacity, weights.depth, weights.radius, weights.volume) = (0.0, 0.0, 0.0, 0.0, 0.0);
    (weights.pixels, weights.blending, weights.distance, weights.error) = (0.0, 0.0, 0.0, error.error);
    taming.weights = weights;
    let scene = scene(&[(0.1, 0.5); 3]);
    let evidence = evidence(&[(0.1, &[1.0, 0.0, 999.0])]);
    let round = Round {
        scene: &scene,
        gradients: &[3e-4; 3],
        evidence: Some(&evidence),
        step: 99,
        progress: [0.5, 1.0],
        budget: 4,
    };
    assert_eq!(parents(&round.plan(&taming).unwrap()), [2]);
}

/// With a budget of 16 and a quarter of the rounds done, 16 √¼ = 8 Gaussians are wanted. Of the 5,
/// those 3 grow that reach the gradient and draw edges. They are split whatever their size.
#[test]
fn improved_gs_splits_what_draws_edges() {
    let scene = scene(&[(1e-4, 0.5); 5]);
    let evidence = evidence(&[(0.1, &[1.0, 0.0, 1.0, 2.0, 5.0])]);
    let gradients = [3e-4, 4e-4, 3e-4, 5e-4, 2e-4];
    let round = Round {
        scene: &scene,
        gradients: &gradients,
        evidence: Some(&evidence),
        step: 599,
        progress: [0.2, 0.25],
        budget: 16,
    };
    let plan = round.plan(&ImprovedGs::default()).unwrap();
    assert_eq!(parents(&plan), [0, 2, 3]);
    assert!(plan.added.iter().all(|birth| birth.origin == Origin::Split) && plan.removed.is_empty());
    let few = Round { budget: 12, ..round }.plan(&ImprovedGs::default()).unwrap();
    assert_eq!(few.added.len(), 1, "12 √¼ = 6");
}

/// 300 steps after the resets at 3,000 and 6,000, a fifth of five goes: the least opaque.
#[test]
fn improved_gs_prunes_what_recovers_slowly() {
    let scene = scene(&[(0.1, 0.5), (0.1, 0.3), (0.1, 0.2), (0.1, 0.4), (0.1, 0.6)]);
    let evidence = evidence(&[(0.1, &[0.0; 5])]);
    let at = |step| {
        let gradients = [0.0; 5];
        let round = Round {
            scene: &scene,
            gradients: &gradients,
            evidence: Some(&evidence),
            step,
            progress: [0.2, 0.25],
            budget: 16,
        };
        removed(&round.plan(&ImprovedGs::default()).unwrap())
    };
    assert_eq!([at(3_299), at(6_299)], [[(2, PruneCause::Unimportant)], [(2, PruneCause::Unimportant)]]);
    assert_eq!([at(2_999), at(3_399), at(9_299), at(299)], [const { Vec::new() }; 4]);
}

/// Contributions of 1, 2, 3, … to 10 (together 55) in two views. Soft pruning removes 8 of 10, hard
/// pruning 3; to hold 1 % of all is not possible for the least, 20 % (of both views: 22 of 110) is
/// held by 1 + 2 + 3 + 4 = 10 per view.
#[test]
fn the_least_contributing_are_removed_beside_any_growth() {
    let scene = scene(&[(0.1, 0.5); 10]);
    let contributions: Vec<f32> = (1..=10).map(|i| i as f32).collect();
    let evidence = evidence(&[(0.1, &contributions), (0.9, &contributions)]);
    let count = |simplify: Simplify, step: u32, progress: f32| {
        let actions = Actions::default().with(|s| {
            s.simplify = Some(simplify);
            s.growth_fraction = 0.5;
        });
        let policy = Policy::Grow(Grow::absolute(Signal::MeanGradient).with_actions(actions));
        let round = Round {
            scene: &scene,
            gradients: &[0.1; 10],
            evidence: Some(&evidence),
            step,
            progress: [0.0, progress],
            budget: 100,
        };
        let plan = round.plan(&policy).unwrap();
        let gone = removed(&plan);
        assert!(gone.iter().enumerate().all(|(i, r)| *r == (i as u32, PruneCause::Unimportant)), "{gone:?}");
        assert_eq!(plan.added.len(), if progress <= 0.5 { 10 - gone.len() } else { 0 });
        gone.len()
    };
    let speedy = Simplify::speedy_splat();
    assert_eq!(count(speedy, 5_999, 0.4), 8);
    assert_eq!(count(speedy, 8_999, 0.6), 3);
    assert_eq!([count(speedy, 2_999, 0.4), count(speedy, 6_099, 0.4)], [0, 0], "not due");
    assert_eq!(count(Simplify::mini_splatting(), 19_999, 0.6), 0);
    assert_eq!(count(Simplify::mini_splatting().with(|s| s.mass = 0.2), 19_999, 0.6), 4);
}

#[test]
fn missing_evidence_is_an_error_that_names_the_policy() {
    let scene = scene(&[(0.1, 0.5); 2]);
    let short = evidence(&[(0.1, &[1.0])]);
    for name in ["fastgs", "taming", "improved-gs"] {
        let policy = Policy::from_name(name).unwrap();
        assert!(DensityPolicy::<Scene3d>::needs_evidence(&policy));
        let round = |evidence| Round {
            scene: &scene,
            gradients: &[0.1; 2],
            evidence,
            step: 99,
            progress: [0.0, 0.1],
            budget: 9,
        };
        let error = round(None).plan(&policy).unwrap_err();
        assert!(matches!(&error, Error::State(message) if message.contains(name)), "{error}");
        assert!(matches!(round(Some(&short)).plan(&policy), Err(Error::Length { .. })));
        let refused = policy.validate_2d().unwrap_err().to_string();
        assert!(refused.contains(name) && refused.contains("only training in 3D"), "{refused}");
        policy.validate_3d().unwrap();
    }
    let actions = Actions::default().with(|s| s.simplify = Some(Simplify::speedy_splat()));
    let simplified = Policy::Grow(Grow::absolute(Signal::MeanGradient).with_actions(actions));
    assert!(simplified.validate_2d().unwrap_err().to_string().contains("simplify"));
    Policy::from_name("absolute").unwrap().validate_2d().unwrap();
}
