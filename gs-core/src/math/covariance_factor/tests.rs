//! The parameterization against its definition: axes of factors, steps, bounds, and gradients by
//! central differences.

use super::*;
use crate::{
    Adam,
    effects::{Antialias, Blend},
    math::perspective::{Ellipsoid, Perspective, ProjectionGradient},
    settings::RenderSettings,
    statistics::CullCause,
    view::Camera,
};

const V: ProjectionGradient =
    ProjectionGradient { mean: glam::Vec2::new(0.7, -0.4), covariance: [0.003, -0.002, 0.005], log_opacity: 0.9 };

fn factor(scales: Vec3, axis: Vec3, angle: f32) -> Mat3 {
    Mat3::from_axis_angle(axis.normalize(), angle) * Mat3::from_diagonal(scales)
}

fn factors() -> [Mat3; 4] {
    let turn = Mat3::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), 1.1);
    let mirror = Mat3::from_diagonal(Vec3::new(1.0, -1.0, 1.0));
    [
        factor(Vec3::new(0.3, 0.1, 0.5), Vec3::new(1.0, 2.0, -0.5), 0.7),
        factor(Vec3::new(0.3, 0.1, 0.5), Vec3::new(1.0, 2.0, -0.5), 0.7) * turn,
        factor(Vec3::new(0.2, 0.004, 0.6), Vec3::new(-1.0, 0.3, 0.5), 2.4) * turn * mirror,
        factor(Vec3::splat(0.25), Vec3::X, 0.4) * turn,
    ]
}

fn perspective(antialias: Antialias) -> Perspective {
    let mut settings = RenderSettings::blended(Blend::Over);
    settings.effects.antialias = antialias;
    let rotation = Mat3::from_axis_angle(Vec3::new(0.3, -0.8, 0.5).normalize(), 0.4);
    Perspective::new(&Camera { rotation, ..Camera::looking_forward(64, 48, 1.0) }, &settings)
}

/// What `V` is the gradient of.
fn loss(perspective: &Perspective, g: &Factored) -> f64 {
    let p = perspective.project_factored(g).unwrap();
    let [xx, xy, yy] = p.covariance.map(f64::from);
    let [a, b, c] = V.covariance.map(f64::from);
    let mean = f64::from(V.mean.x) * f64::from(p.mean.x) + f64::from(V.mean.y) * f64::from(p.mean.y);
    mean + a * xx + 2.0 * b * xy + c * yy + f64::from(V.log_opacity) * f64::from(p.opacity).ln()
}

fn factored(factor: Mat3) -> Factored {
    Factored { mean: Vec3::new(0.4, 0.2, 2.5), factor, opacity_logit: 0.4 }
}

#[test]
fn principal_axes_rebuild_the_factor() {
    for factor in factors() {
        let PrincipalAxes { axes, scales, turn } = PrincipalAxes::of(factor);
        let again = (axes * DMat3::from_diagonal(scales) * turn.transpose()).as_mat3();
        assert!(again.abs_diff_eq(factor, 1e-7), "{again} {factor}");
        assert!((axes * axes.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-14) && axes.determinant() > 0.0);
        assert!((turn * turn.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-14));
    }
}

#[test]
fn shapes_come_back_in_their_order_and_thin_ones_keep_their_digits() {
    for log_scale in [Vec3::new(-3.0, -1.0, -2.0), Vec3::new(-14.0, 0.5, -7.0)] {
        let rotation = [0.5, -0.5, 0.1, 0.7];
        let g = Gaussian3d { mean: Vec3::ZERO, log_scale, rotation, opacity_logit: 0.0, sh: vec![Vec3::ZERO] };
        let m = g.factor().unwrap();
        let (found, q) = Gaussian3d::shape_of_factor(m);
        assert!((found - log_scale).abs().max_element() < 1e-5, "{found} {log_scale}");
        let same = Gaussian3d { log_scale: found, rotation: q, ..g }.factor().unwrap();
        assert!(same.x_axis.abs_diff_eq(m.x_axis, 1e-6) && same.y_axis.abs_diff_eq(m.y_axis, 1e-6));
    }
}

#[test]
fn an_aligned_factor_keeps_the_covariance_and_is_the_parents_if_possible() {
    for (parent, turn) in factors().into_iter().zip(factors()) {
        let other = parent * PrincipalAxes::of(turn).axes.as_mat3();
        assert!(aligned(other, parent).abs_diff_eq(parent, 1e-6));
        let wider = Mat3::from_diagonal(Vec3::new(1.5, 0.9, 1.1)) * other;
        let found = aligned(wider, parent);
        let [before, after] = [wider, found].map(|m| m * m.transpose());
        assert!(after.abs_diff_eq(before, 1e-6));
        assert!(frobenius(&(found - parent)) < frobenius(&(wider - parent)));
    }
    let [factor, ..] = factors();
    assert_eq!(aligned(factor, Mat3::NAN), factor);
}

/// A Gaussian whose quaternion has no direction is not drawn, does not change in training, and is
/// downloaded unchanged; a Gaussian of a tiny size is another case.
#[test]
fn a_quaternion_without_direction_has_no_factor() {
    let rates = Adam::default().at(0.0);
    assert_eq!(factor_of(Vec3::ZERO, [0.0; 4]), None);
    for antialias in Antialias::ALL {
        let found = perspective(antialias).project_factored(&factored(Mat3::ZERO));
        assert_eq!(found, Err(CullCause::Degenerate), "{antialias:?}");
    }
    assert_eq!(stretched(Mat3::ZERO, [0.1; 6], &rates), Mat3::ZERO);
    let (log_scale, rotation) = Gaussian3d::shape_of_factor(Mat3::ZERO);
    assert!(log_scale.is_finite() && rotation == [0.0; 4]);
    assert_eq!(by_scale_rotation(Mat3::ZERO, [0.0; 6]), (Vec3::ZERO, [0.0; 4]));

    let tiny = factor_of(Vec3::splat(-200.0), [1.0, 0.0, 0.0, 0.0]).unwrap();
    assert!(perspective(Antialias::Dilate).project_factored(&factored(tiny)).is_ok());
    assert!(Gaussian3d::shape_of_factor(tiny).0.is_finite());
}

#[test]
fn factors_without_extent_have_axes() {
    let flat = Mat3::from_cols(Vec3::new(0.0, 2.0, 0.0), Vec3::new(0.0, 2.0, 0.0), Vec3::ZERO);
    for m in [Mat3::ZERO, flat, Mat3::from_diagonal(Vec3::new(0.0, 1.0, 3.0))] {
        let PrincipalAxes { axes, scales, .. } = PrincipalAxes::of(m);
        assert!((axes * axes.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-12), "{axes}");
        assert!(axes.determinant() > 0.0 && scales.min_element() == 0.0);
    }
    assert!(Gaussian3d::shape_of_factor(Mat3::NAN).0.is_nan());
}

#[test]
fn a_factor_is_seen_as_its_scales_and_rotation_are() {
    for antialias in Antialias::ALL {
        let perspective = perspective(antialias);
        for factor in factors() {
            let g = factored(factor);
            let (log_scale, rotation) = Gaussian3d::shape_of_factor(factor);
            let same = Ellipsoid { mean: g.mean, log_scale, rotation, opacity_logit: g.opacity_logit };
            let (a, b) = (perspective.project_factored(&g).unwrap(), perspective.project(&same).unwrap());
            assert!((a.mean - b.mean).length() < 1e-4 && (a.opacity / b.opacity - 1.0).abs() < 1e-3);
            let [a, b] = [a, b].map(|p| p.covariance);
            assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-4 * a[0].max(a[2])), "{a:?} {b:?}");

            // Gradients agree, too.
            let (found, expected) = (perspective.project_factored_vjp(&g, &V), perspective.project_vjp(&same, &V));
            assert!((found.mean - expected.mean).length() < 1e-4 * expected.mean.length());
            assert!((found.opacity_logit - expected.opacity_logit).abs() < 1e-6);
            let (by_log_scale, by_rotation) = by_scale_rotation(factor, found.stretch);
            let largest = expected.log_scale.length();
            assert!((by_log_scale - expected.log_scale).length() < 1e-3 * largest, "{by_log_scale} {expected:?}");
            for (found, expected) in by_rotation.iter().zip(expected.rotation) {
                assert!((found - expected).abs() < 2e-3 * largest, "{by_rotation:?} {expected:?}");
            }
        }
    }
}

#[test]
fn an_axis_without_extent_leaves_the_turn_between_the_others() {
    let between_y_and_z = [0.0, 0.0, 0.0, 0.0, 0.3, 0.0];
    let turn_of = |x: f32| by_scale_rotation(Mat3::from_diagonal(Vec3::new(x, 1.0, 3.0)), between_y_and_z).1;
    assert_eq!(turn_of(0.0), turn_of(0.5));
    assert!(turn_of(0.0)[1].abs() > 0.1, "{:?}", turn_of(0.0));
    let with_x = by_scale_rotation(Mat3::from_diagonal(Vec3::new(0.0, 1.0, 3.0)), [0.0, 0.5, 0.5, 0.0, 0.3, 0.0]).1;
    assert_eq!(with_x, turn_of(0.0), "turns of what has no extent are none");
}

#[test]
fn gradients_are_central_differences() {
    let rates = Adam { min_scale: 1e-6, max_scale: 1e6, ..Adam::default() }.at(0.0);
    let h = 4e-3f32;
    for antialias in Antialias::ALL {
        let perspective = perspective(antialias);
        for factor in factors() {
            let g = factored(factor);
            let found = perspective.project_factored_vjp(&g, &V);
            let xi = factor.transpose() * found.mean;
            let slope = |at: &dyn Fn(f32) -> Factored| {
                (loss(&perspective, &at(h)) - loss(&perspective, &at(-h))) / f64::from(2.0 * h)
            };
            for axis in 0..3 {
                let numeric = slope(&|h| Factored { mean: g.mean + factor * (Vec3::AXES[axis] * h), ..g });
                assert!((f64::from(xi[axis]) - numeric).abs() < 2e-3 * f64::from(xi.length()), "{xi} {numeric}");
            }
            let largest = found.stretch.iter().fold(0.0f32, |m, v| m.max(v.abs()));
            for k in 0..6 {
                let numeric = slope(&|h| {
                    let eta = std::array::from_fn(|i| if i == k { h } else { 0.0 });
                    Factored { factor: stretched(factor, eta, &rates), ..g }
                });
                // Both entries beside the diagonal move.
                let expected = found.stretch[k] * if [1, 2, 4].contains(&k) { 2.0 } else { 1.0 };
                let error = (f64::from(expected) - numeric).abs();
                assert!(error < 4e-3 * f64::from(largest), "{antialias:?} {k}: {expected} {numeric}");
            }
        }
    }
}

#[test]
fn the_sum_of_scales_has_its_gradient() {
    let rates = Adam { min_scale: 1e-6, max_scale: 1e6, ..Adam::default() }.at(0.0);
    for factor in factors() {
        let found = sum_of_scales_vjp(factor);
        for k in 0..6 {
            let sum = |h: f32| {
                let eta = std::array::from_fn(|i| if i == k { h } else { 0.0 });
                PrincipalAxes::of(stretched(factor, eta, &rates)).scales.element_sum()
            };
            let numeric = (sum(1e-2) - sum(-1e-2)) / 2e-2 / if [1, 2, 4].contains(&k) { 2.0 } else { 1.0 };
            assert!((f64::from(found[k]) - numeric).abs() < 1e-4, "{k}: {} {numeric}", found[k]);
        }
    }
}

#[test]
fn scales_stay_within_their_bounds() {
    let rates = Adam { min_scale: 0.01, max_scale: 2.0, ..Adam::default() }.at(0.0);
    let turn = Mat3::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), 1.1);
    let needle = factor(Vec3::new(0.011, 1.9, 0.012), Vec3::new(1.0, 2.0, -0.5), 0.7) * turn;
    for eta in [[0.4, -0.3, 0.45, 0.2, 0.1, 0.3], [-0.4, 0.3, -0.45, -0.2, 0.1, -0.9], [0.5; 6], [-0.5; 6]] {
        let scales = PrincipalAxes::of(stretched(needle, eta, &rates)).scales;
        assert!(scales.min_element() > 0.009_999 && scales.max_element() < 2.000_1, "{scales}");
    }
    // A factor within the bounds stays, and a flat one becomes as thick as it must.
    let inner = factor(Vec3::new(0.1, 0.2, 0.3), Vec3::Y, 0.3);
    assert_eq!(stretched(inner, [0.0; 6], &rates), inner);
    let flat = stretched(Mat3::from_diagonal(Vec3::new(0.0, 0.5, 0.0)), [0.0; 6], &rates);
    assert!((PrincipalAxes::of(flat).scales - DVec3::new(0.01, 0.5, 0.01)).length() < 1e-6);
    assert!(stretched(Mat3::NAN, [0.0; 6], &rates).is_nan());
}
