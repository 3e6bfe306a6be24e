//! The two Gaussians that replace a growing one: their positions, sizes, moments and image.

use glam::{Mat2, Vec2, Vec3};
use gs_core::{
    DensityStatistics, Gaussian2d, Scene2d,
    edit::{Birth, Change, Moments, Origin, Place},
    sigmoid,
};
use gs_density::{Densify, Observation, OpacityCorrection, Rng, SizeThreshold, SplitPlacement};

fn parent() -> Gaussian2d {
    Gaussian2d {
        mean: Vec2::new(60.0, 30.0),
        log_scale: Vec2::new(0.7, 2.0),
        rotation: 0.6,
        opacity_logit: 0.8,
        color: Vec3::new(0.2, -0.4, 0.9),
    }
}

/// Grows Gaussian 1 of two equal ones.
fn grow(densify: &Densify, parent: Gaussian2d, rng: &mut Rng) -> (Option<Change<Gaussian2d>>, Birth<Gaussian2d>) {
    let scene: Scene2d = [parent; 2].into_iter().collect();
    grow_in(&scene, 1, densify, rng)
}

/// Grows one Gaussian of two.
fn grow_in(
    scene: &Scene2d,
    index: u32,
    densify: &Densify,
    rng: &mut Rng,
) -> (Option<Change<Gaussian2d>>, Birth<Gaussian2d>) {
    let statistics = DensityStatistics::zeros(2);
    let observation = Observation {
        scene,
        statistics: &statistics,
        residual: None,
        evidence: None,
        extent: 200.0,
        step: 0,
        progress: 0.5,
        progress_before: 0.0,
        budget: 9,
    };
    densify.grow(index, &observation, rng)
}

fn small() -> Densify {
    Densify::default().with(|s| s.split_above = SizeThreshold::Pixels(1000.0))
}

#[test]
fn a_small_one_is_cloned_and_left_alone() {
    let (change, birth) = grow(&small(), parent(), &mut Rng::new(1, 2));
    assert_eq!(change, None);
    assert_eq!(
        birth,
        Birth {
            gaussian: parent(),
            parent: Some(1),
            moments: Moments::Fresh,
            origin: Origin::Clone,
            place: Place::BehindParent
        }
    );
}

#[test]
fn a_large_one_is_split_into_smaller_ones() {
    let (change, birth) = grow(&Densify::default(), parent(), &mut Rng::new(1, 2));
    let change = change.unwrap();
    assert_eq!((change.index, birth.parent, birth.origin), (1, Some(1), Origin::Split));
    for half in [change.gaussian, birth.gaussian] {
        let ratio = (parent().log_scale - half.log_scale).map(f32::exp);
        assert!((ratio - 1.6).abs().max_element() < 1e-5, "{ratio}");
        assert_ne!(half.mean, parent().mean);
        assert_eq!(Gaussian2d { mean: parent().mean, log_scale: parent().log_scale, ..half }, parent());
    }
    assert_ne!(change.gaussian.mean, birth.gaussian.mean);
}

#[test]
fn both_halves_of_a_split_have_the_moments_of_newcomers() {
    for newcomers in [Moments::Fresh, Moments::Zeroed] {
        let split = Densify::default().with(|s| s.newcomers = newcomers);
        let (change, birth) = grow(&split, parent(), &mut Rng::new(1, 2));
        assert_eq!((change.unwrap().moments, birth.moments), (newcomers, newcomers));
    }
}

#[test]
fn halves_are_drawn_from_the_parent() {
    let mut rng = Rng::new(2024, 5);
    let draws = 20_000;
    let offsets: Vec<Vec2> = (0..draws / 2)
        .flat_map(|_| {
            let (change, birth) = grow(&Densify::default(), parent(), &mut rng);
            [change.unwrap().gaussian.mean - parent().mean, birth.gaussian.mean - parent().mean]
        })
        .collect();
    let n = draws as f32;
    let mean = offsets.iter().sum::<Vec2>() / n;
    let covariance =
        offsets.iter().map(|&d| Mat2::from_cols(d * d.x, d * d.y)).fold(Mat2::ZERO, |a, b| a + b) * (1.0 / n);
    // In the parent's whitened coordinates the offsets are standard normal: standard errors are
    // 1/√n of the mean, √(2/n) of a variance.
    let whiten = parent().factor().inverse();
    let (mean, covariance) = (whiten * mean, whiten * covariance * whiten.transpose());
    assert!(mean.abs().max_element() < 4.0 / n.sqrt(), "{mean}");
    let tolerance = 4.0 * (2.0 / n).sqrt();
    assert!(covariance.abs_diff_eq(Mat2::IDENTITY, tolerance), "{covariance} against {tolerance}");
    // The two halves of one parent are independent.
    let correlation = offsets.chunks(2).map(|pair| (whiten * pair[0]).dot(whiten * pair[1])).sum::<f32>() / (n / 2.0);
    assert!(correlation.abs() < 4.0 * (2.0 / (n / 2.0)).sqrt(), "{correlation}");
}

#[test]
fn the_long_axis_split_is_symmetric_and_needs_no_luck() {
    let densify = Densify::default().with(|s| s.split_placement = SplitPlacement::LongAxis);
    let (change, birth) = grow(&densify, parent(), &mut Rng::new(1, 2));
    assert_eq!(grow(&densify, parent(), &mut Rng::new(3, 4)), (change.clone(), birth.clone()));
    let (a, b) = (change.unwrap().gaussian.mean, birth.gaussian.mean);
    // The second axis is the longer: σ = e² px along (−sin θ, cos θ).
    let half = 0.5 * 2f32.exp() * Vec2::new(-0.6f32.sin(), 0.6f32.cos());
    assert!((a - (parent().mean - half)).length() < 1e-4);
    assert!((b - (parent().mean + half)).length() < 1e-4);
}

#[test]
fn conserved_opacity_composites_to_the_parents() {
    let conserve = small().with(|s| s.opacity_correction = OpacityCorrection::Conserve);
    for opacity_logit in [-6.0, -2.0, 0.0, 0.8, 3.0, 8.0, f32::INFINITY] {
        let parent = Gaussian2d { opacity_logit, ..parent() };
        // A second, translucent Gaussian makes this a scene with opacities even where this one is
        // opaque.
        let scene: Scene2d = [parent, self::parent()].into_iter().collect();
        let (change, birth) = grow_in(&scene, 0, &conserve, &mut Rng::new(1, 2));
        let original = change.map_or(parent, |c| c.gaussian);
        assert_eq!(original, birth.gaussian);
        assert_eq!(Gaussian2d { opacity_logit, ..original }, parent);
        let through = (1.0 - sigmoid(original.opacity_logit)) * (1.0 - sigmoid(birth.gaussian.opacity_logit));
        assert!((1.0 - through - sigmoid(opacity_logit)).abs() < 1e-6, "{opacity_logit}");
    }
}

#[test]
fn conserved_colour_adds_up_to_the_parents_where_gaussians_are_summed() {
    let conserve = small().with(|s| s.opacity_correction = OpacityCorrection::Conserve);
    let opaque = Gaussian2d { opacity_logit: f32::INFINITY, ..parent() };
    let (change, birth) = grow(&conserve, opaque, &mut Rng::new(1, 2));
    let original = change.unwrap().gaussian;
    assert_eq!(original.color + birth.gaussian.color, opaque.color);
    assert_eq!(Gaussian2d { color: opaque.color, ..original }, opaque);
    assert_eq!(original, birth.gaussian);
}
