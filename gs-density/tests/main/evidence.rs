//! Policies that read evidence over several views, on scenes small enough to work out by hand.

use glam::Vec3;
use gs_core::{
    DensityStatistics, EditPlan, Error, Gaussian3d, Scene, Scene3d,
    edit::{Origin, PruneCause},
    logit, sigmoid,
};
use gs_density::{
    DensityPolicy, Evidence, FastGs, ImprovedGs, Mrnf, Observation, PixelSums, Policy, Rng, SteepGs, Taming,
    ViewEvidence,
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

/// Evidence of views with these losses, in which each Gaussian covers these pixels of high error,
/// draws these edges and contributes as much. The other sums are different ones. All splits lower the
/// loss.
pub(crate) fn evidence(views: &[(f32, &[f32])]) -> Evidence {
    let view = |&(loss, values): &(f32, &[f32])| {
        let others: Vec<f32> = values.iter().rev().map(|value| value + 0.5).collect();
        let ones = vec![1.0; values.len()];
        ViewEvidence {
            loss,
            blended: PixelSums { pixels: others.clone(), error: values.to_vec(), high_error: others.clone() },
            covered: PixelSums { pixels: others.clone(), error: others, high_error: values.to_vec() },
            depth: ones.clone(),
            radius_px: ones,
        }
    };
    let len = views.first().map_or(0, |(_, values)| values.len());
    let splitting = vec![[-1.0, 0.0, 0.0, -1.0, 0.0, -1.0]; len];
    Evidence { views: views.iter().map(view).collect(), splitting }
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
        self.plan_with(policy, 7)
    }

    /// [`Self::plan`] with another seed.
    fn plan_with(&self, policy: &dyn DensityPolicy<Scene3d>, seed: u64) -> Result<EditPlan<Gaussian3d>, Error> {
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
        let plan = policy.plan(&observation, &mut Rng::new(seed.into(), 11))?;
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
/// ones one is removed: that with the pruning score 1, whose weight is a million times that of the
/// score 0. All opacities are lowered to 0.8.
#[test]
fn fastgs_grows_where_gradient_and_views_agree() {
    let scene = scene(&[(0.1, 0.5), (0.1, 0.5), (0.1, 0.5), (0.1, 0.004), (0.1, 0.004)]);
    let evidence = evidence(&[(0.1, &[8.0, 9.0, 20.0, 0.0, 25.0]), (0.3, &[4.0, 2.0, 20.0, 0.0, 25.0])]);
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
    assert_eq!(removed(&plan), [(4, PruneCause::Transparent)]);
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

/// One of two Gaussians grows. By the parts in the order of the weights, each divided by its smaller
/// value, the first view gives Gaussian 0 the score 25 · 1 + 100 · 2 + 5 · 1 + 10 · 1 + 25 · 1 + 10 ·
/// 1 + 0.1 · 1 + 50 · 4 + 50 · 1 = 525.1, and Gaussian 1 the score 25 · 2 + 100 · 1 + 5 · 2 + 10 · 4 +
/// 25 · 8 + 10 · 5 + 0.1 · 4 + 50 · 1 + 50 · 8 = 900.4. The second view shows only Gaussian 0, with
/// 375.1. With the losses 0.2 and 0.6 these are 330.08 and 180.08.
#[test]
fn taming_draws_by_score() {
    let scene = scene(&[(0.1, 0.5), (0.2, 0.25)]);
    let view = |loss, [pixels, error, blending, depth, radius]: [[f32; 2]; 5]| ViewEvidence {
        loss,
        blended: PixelSums { pixels: blending.to_vec(), error: vec![7.0, 70.0], high_error: vec![9.0, 900.0] },
        covered: PixelSums { pixels: pixels.to_vec(), error: error.to_vec(), high_error: vec![8.0, 80.0] },
        depth: depth.to_vec(),
        radius_px: radius.to_vec(),
    };
    let views = vec![
        view(0.2, [[4.0, 16.0], [1.0, 5.0], [8.0, 2.0], [2.0, 4.0], [3.0, 12.0]]),
        view(0.6, [[4.0, 0.0], [1.0, 0.0], [8.0, 0.0], [2.0, 0.0], [3.0, 0.0]]),
    ];
    let evidence = Evidence { views, ..Evidence::default() };
    let round = Round {
        scene: &scene,
        gradients: &[3e-4, 6e-4],
        evidence: Some(&evidence),
        step: 99,
        progress: [0.5, 1.0],
        budget: 3,
    };
    let first = (0..4_000).filter(|&seed| parents(&round.plan_with(&Taming::default(), seed).unwrap()) == [0]).count();
    let expected = 4_000.0 * 330.08 / (330.08 + 180.08);
    assert!((first as f64 - expected).abs() < 100.0, "{first} times instead of {expected}");
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

#[test]
fn missing_evidence_is_an_error_that_names_the_policy() {
    let scene = scene(&[(0.1, 0.5); 2]);
    let short = evidence(&[(0.1, &[1.0])]);
    for name in ["fastgs", "taming", "improved-gs", "steep-gs", "mrnf"] {
        let policy = Policy::from_name(name).unwrap();
        assert!(policy.needs().evidence);
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
        assert!(
            refused.contains(name)
                && refused.contains(", which needs several views of a 3D scene, but must be one of absolute"),
            "{refused}"
        );
        policy.validate_3d().unwrap();
    }
    Policy::from_name("absolute").unwrap().validate_2d().unwrap();
}

/// Gaussians of scale 0.1, whose splitting matrices in units of their scales are the given
/// diagonals. In world units they are a hundred times as large.
fn splitting(diagonals: &[[f32; 3]]) -> Evidence {
    let matrix = |&[xx, yy, zz]: &[f32; 3]| [xx, 0.0, 0.0, yy, 0.0, zz];
    Evidence { splitting: diagonals.iter().map(matrix).collect(), ..Evidence::default() }
}

/// Of the Gaussians that reach the gradient, only those with an eigenvalue below -1e-6 grow: -2e-8
/// in units of a scale of 0.1 is -2e-6 in world units, -5e-9 is -5e-7. The halves of Gaussian 0
/// stand along y, those of Gaussian 4 along x, on opposite sides, with half of the opacity.
#[test]
fn steep_gs_splits_along_the_most_negative_eigenvector() {
    let scene = scene(&[(0.1, 0.5), (0.1, 0.5), (0.1, 0.5), (0.1, 0.5), (0.01, 0.5)]);
    let evidence =
        splitting(&[[1.0, -2e-8, 0.0], [1.0, -5e-9, 0.0], [1.0, 1.0, 1.0], [-1.0, -1.0, -1.0], [-2.0, -1.0, 0.0]]);
    let gradients = [3e-4, 3e-4, 3e-4, 1e-4, 2.5e-4];
    let round = Round {
        scene: &scene,
        gradients: &gradients,
        evidence: Some(&evidence),
        step: 599,
        progress: [0.1, 0.2],
        budget: 100,
    };
    let plan = round.plan(&SteepGs::default()).unwrap();
    assert_eq!(parents(&plan), [0, 4]);
    let mean = Vec3::new(1.0, -2.0, 3.0);
    // A Gaussian larger than 0.01 of the extent is split, the other one cloned.
    for (number, (axis, origin, scale)) in
        [(Vec3::Y, Origin::Split, 0.1 / 1.6), (Vec3::X, Origin::Clone, 0.01)].into_iter().enumerate()
    {
        let halves = [&plan.changed[number].gaussian, &plan.added[number].gaussian];
        let along = halves.map(|half| (half.mean - mean).dot(axis));
        assert!(along[0] * along[1] < 0.0, "{along:?}");
        for half in halves {
            assert!(((half.mean - mean).dot(axis).abs() - (half.mean - mean).length()).abs() < 1e-6);
            assert!((sigmoid(half.opacity_logit) - 0.25).abs() < 1e-6);
            assert!((half.log_scale.x.exp() - scale).abs() < 1e-6);
        }
        assert_eq!(plan.added[number].origin, origin);
        if origin == Origin::Clone {
            assert!((along[0].abs() - 1.6e-4 * EXTENT).abs() < 1e-6, "{along:?}");
        }
    }
    let one = Round { budget: 6, ..round }.plan(&SteepGs::default()).unwrap();
    assert_eq!(parents(&one), [0], "the larger gradient comes first");
}

/// Errors and visibilities of one view.
fn blended(views: &[(&[f32], &[f32])]) -> Evidence {
    let view = |&(error, pixels): &(&[f32], &[f32])| {
        let blended = PixelSums { pixels: pixels.to_vec(), error: error.to_vec(), high_error: vec![0.0; error.len()] };
        ViewEvidence { loss: 0.1, blended, ..ViewEvidence::default() }
    };
    Evidence { views: views.iter().map(view).collect(), ..Evidence::default() }
}

/// Gaussians 0 and 1 are transparent and replaced, also after growth. 7 % of 40 candidates are 2.8,
/// so 3 are split, the two in place of removed ones included, if the pace allows 3: growth ends at
/// 0.526, so rounds of 0.1 after 0.2 are three, and 14 missing Gaussians are 5 for each. With 6
/// missing it is 2, all of them in place of removed ones.
#[test]
fn mrnf_paces_its_growth_and_replaces_what_it_prunes() {
    let mut opacities = vec![(0.1, 0.5); 44];
    opacities[0].1 = 0.003;
    opacities[1].1 = 0.003;
    let scene = scene(&opacities);
    let mut errors = vec![1.0; 44];
    (errors[2], errors[3]) = (0.002, 0.002);
    let ones = vec![1.0; 44];
    let evidence = blended(&[(&errors, &ones)]);
    let plan = |budget: usize, progress: [f32; 2]| {
        let round =
            Round { scene: &scene, gradients: &[0.0; 44], evidence: Some(&evidence), step: 599, progress, budget };
        let plan = round.plan(&Mrnf::default()).unwrap();
        assert_eq!(removed(&plan), [(0, PruneCause::Transparent), (1, PruneCause::Transparent)]);
        assert!(plan.added.iter().all(|birth| birth.origin == Origin::Split));
        plan.added.len()
    };
    assert_eq!([plan(56, [0.1, 0.2]), plan(48, [0.1, 0.2])], [3, 2]);
    assert_eq!([plan(43, [0.1, 0.2]), plan(56, [0.5, 0.6])], [1, 2]);
    // Nothing is removed: 7 % of 42 is 3, of which the pace allows 2 with 5 missing.
    opacities.iter_mut().for_each(|(_, opacity)| *opacity = 0.5);
    let scene = self::scene(&opacities);
    let grown = |budget: usize| {
        let progress = [0.1, 0.2];
        let round =
            Round { scene: &scene, gradients: &[0.0; 44], evidence: Some(&evidence), step: 599, progress, budget };
        round.plan(&Mrnf::default()).unwrap().added.len()
    };
    assert_eq!([grown(100), grown(49)], [3, 2]);
}

/// Both views count by themselves: the ratio of Gaussian 1 is 8 / 16^¾ = 1 in the first and 0.1 in
/// the second, that of Gaussian 0 is 0.5 / 1 in both, that of Gaussian 2 is 999.
#[test]
fn mrnf_normalises_errors_by_visibility() {
    let scene = scene(&[(0.1, 0.5); 3]);
    let evidence = blended(&[(&[0.5, 8.0, 0.0], &[1.0, 16.0, 0.0]), (&[0.5, 0.1, 999.0], &[1.0, 1.0, 1.0])]);
    let mut times = [0i32; 3];
    for step in 0..40 {
        let round = Round {
            scene: &scene,
            gradients: &[0.0; 3],
            evidence: Some(&evidence),
            step,
            progress: [0.4, 0.5],
            budget: 4,
        };
        let mut policy = Mrnf::default();
        policy.percent = 34.0;
        for index in parents(&round.plan_with(&policy, u64::from(step)).unwrap()) {
            times[index as usize] += 1;
        }
    }
    assert!(times[2] >= 38 && times.iter().sum::<i32>() == 40, "{times:?}");
    let mut evidence = evidence;
    evidence.views[1].blended.error[2] = 0.0;
    let mut times = [0i32; 3];
    for step in 0..400 {
        let round = Round {
            scene: &scene,
            gradients: &[0.0; 3],
            evidence: Some(&evidence),
            step,
            progress: [0.4, 0.5],
            budget: 4,
        };
        let mut policy = Mrnf::default();
        policy.percent = 50.0;
        for index in parents(&round.plan_with(&policy, u64::from(step)).unwrap()) {
            times[index as usize] += 1;
        }
    }
    // In proportion 0.5 to 1.
    assert!((times[1] - 267).abs() < 40 && times[2] == 0 && times.iter().sum::<i32>() == 400, "{times:?}");
}
