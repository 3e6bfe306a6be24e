//! Projections against their definition, and their VJPs against central differences.

use super::*;
use crate::scene::Gaussian3d;

fn camera() -> Camera {
    let axis = Vec3::new(0.3, -0.8, 0.5).normalize();
    Camera {
        rotation: Mat3::from_axis_angle(axis, 0.4),
        translation: Vec3::new(0.2, -0.1, 0.5),
        focal: Vec2::new(90.0, 100.0),
        center: Vec2::new(30.0, 27.0),
        ..Camera::looking_forward(64, 48, 1.0)
    }
}

fn ellipsoid(mean: Vec3) -> Ellipsoid {
    Ellipsoid { mean, log_scale: Vec3::new(-1.2, -2.0, -0.7), rotation: [0.9, -0.4, 0.6, 0.3], opacity_logit: 0.4 }
}

fn settings(antialias: Antialias) -> RenderSettings {
    let mut settings = RenderSettings::blended(Blend::Over);
    settings.effects.antialias = antialias;
    settings
}

/// Means in view, and beyond both clamps.
const MEANS: [Vec3; 3] = [Vec3::new(0.4, 0.2, 2.5), Vec3::new(5.0, 0.4, 2.0), Vec3::new(-3.0, -4.0, 2.0)];

#[test]
fn the_projection_is_that_of_the_covariance() {
    let perspective = Perspective::new(&camera(), &settings(Antialias::Dilate));
    let g = ellipsoid(MEANS[0]);
    let found = perspective.project(&g).unwrap();
    let (mean, depth) = camera().project(g.mean).unwrap();
    assert!((found.mean - mean).length() < 1e-4 && (found.depth - depth).abs() < 1e-6);
    let gaussian =
        Gaussian3d { mean: g.mean, log_scale: g.log_scale, rotation: g.rotation, opacity_logit: 0.0, sh: Vec::new() };
    let p = camera().to_camera(g.mean);
    let sigma = camera().rotation * gaussian.covariance().unwrap() * camera().rotation.transpose();
    let gradients = [
        Vec3::new(90.0 / p.z, 0.0, -90.0 * p.x / (p.z * p.z)),
        Vec3::new(0.0, 100.0 / p.z, -100.0 * p.y / (p.z * p.z)),
    ];
    let across = |a: usize, b: usize| gradients[a].dot(sigma * gradients[b]);
    let expected = [across(0, 0) + 0.3, across(0, 1), across(1, 1) + 0.3];
    for (found, expected) in found.covariance.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-3, "{found} {expected}");
    }
    let [xx, xy, yy] = found.covariance;
    assert!((found.determinant / (xx * yy - xy * xy) - 1.0).abs() < 1e-4);
    let by_z = Vec2::new((sigma * gradients[0]).z, (sigma * gradients[1]).z);
    let back = Vec2::new(
        xx * found.depth_slope.x + xy * found.depth_slope.y,
        xy * found.depth_slope.x + yy * found.depth_slope.y,
    );
    assert!((back - by_z).length() < 1e-4, "{back} {by_z}");
}

const UPSTREAM: ProjectionGradient =
    ProjectionGradient { mean: Vec2::new(0.7, -0.4), covariance: [0.3, -0.2, 0.5], log_opacity: 0.9 };

/// A loss with these gradients by the projection.
fn loss(perspective: &Perspective, g: &Ellipsoid, v: &ProjectionGradient) -> f64 {
    let p = perspective.project(g).unwrap();
    let ([xx, xy, yy], [a, b, c]) = (p.covariance.map(f64::from), v.covariance.map(f64::from));
    let of_shape = f64::from(v.mean.dot(p.mean)) + a * xx + 2.0 * b * xy + c * yy;
    of_shape + f64::from(v.log_opacity) * f64::from(p.opacity).ln()
}

#[test]
fn gradients_are_central_differences() {
    let v = UPSTREAM;
    for (antialias, mean) in Antialias::ALL.into_iter().flat_map(|a| MEANS.map(|m| (a, m))) {
        let perspective = Perspective::new(&camera(), &settings(antialias));
        let g = ellipsoid(mean);
        let scale = perspective.project(&g).unwrap().covariance[0].max(1.0);
        let scaled = ProjectionGradient { covariance: v.covariance.map(|c| c / scale), ..v };
        let loss = |g: &Ellipsoid| loss(&perspective, g, &scaled);
        let found = perspective.project_vjp(&g, &scaled);
        let dot: f32 = found.rotation.iter().zip(g.rotation).map(|(a, b)| a * b).sum();
        assert!(dot.abs() < 1e-4, "not orthogonal to q: {dot}");
        let flat = |g: &Ellipsoid| -> [f32; 11] {
            let [w, x, y, z] = g.rotation;
            let (m, s) = (g.mean, g.log_scale);
            [m.x, m.y, m.z, s.x, s.y, s.z, w, x, y, z, g.opacity_logit]
        };
        let built = |[a, b, c, d, e, f, w, x, y, z, o]: [f32; 11]| Ellipsoid {
            mean: Vec3::new(a, b, c),
            log_scale: Vec3::new(d, e, f),
            rotation: [w, x, y, z],
            opacity_logit: o,
        };
        let largest = flat(&found).iter().fold(0.0f32, |m, v| m.max(v.abs()));
        for k in 0..11 {
            let (mut up, mut down) = (flat(&g), flat(&g));
            up[k] += 4e-3;
            down[k] -= 4e-3;
            let numeric = (loss(&built(up)) - loss(&built(down))) / f64::from(up[k] - down[k]);
            let error = (f64::from(flat(&found)[k]) - numeric).abs();
            assert!(error < 2e-3 * f64::from(largest), "{antialias:?} {mean} {k}: {} {numeric}", flat(&found)[k]);
        }
    }
}

#[test]
fn gradients_by_the_camera_are_central_differences() {
    for (antialias, mean) in Antialias::ALL.into_iter().flat_map(|a| MEANS.map(|m| (a, m))) {
        let (g, settings, camera) = (ellipsoid(mean), settings(antialias), camera());
        let perspective = Perspective::new(&camera, &settings);
        let scale = perspective.project(&g).unwrap().covariance[0].max(1.0);
        let v = ProjectionGradient { covariance: UPSTREAM.covariance.map(|c| c / scale), ..UPSTREAM };
        let moved = |k: usize, by: f32| {
            let mut moved = camera;
            match k {
                0..3 => moved = camera.moved(Vec3::AXES[k] * by, Vec3::ZERO),
                3..6 => moved = camera.moved(Vec3::ZERO, Vec3::AXES[k - 3] * by),
                6..8 => moved.focal[k - 6] += 100.0 * by,
                _ => moved.center[k - 8] += 100.0 * by,
            }
            loss(&Perspective::new(&moved, &settings), &g, &v)
        };
        let found = perspective.camera_vjp(&g, &v).to_array();
        for (k, &found_k) in found.iter().enumerate() {
            let step = if k < 6 { 8e-3 } else { 0.8 };
            let numeric = (moved(k, 4e-3) - moved(k, -4e-3)) / step;
            let of_kind = if k < 6 { &found[k / 3 * 3..][..3] } else { &found[k / 2 * 2..][..2] };
            let largest = of_kind.iter().fold(0.0f32, |m, v| m.max(v.abs()));
            let error = (f64::from(found_k) - numeric).abs();
            assert!(error < 3e-3 * f64::from(largest), "{antialias:?} {mean} {k}: {found_k} {numeric}");
        }
    }
}

#[test]
fn gradients_by_the_camera_through_colours_are_central_differences() {
    let (camera, settings, mean) = (camera(), settings(Antialias::None), MEANS[0]);
    let perspective = Perspective::new(&camera, &settings);
    let (v_direction, v_inverse) = (Vec3::new(0.3, -0.5, 0.8), 0.7);
    let by_direction = perspective.direction_camera_vjp(perspective.direction_vjp(mean, v_direction)).to_array();
    let by_depth =
        perspective.inverse_depth_camera_vjp(mean, perspective.inverse_depth_vjp(mean, v_inverse)).to_array();
    for k in 0..6 {
        let at = |by: f32| {
            let twist =
                [0, 3].map(|first| if (first..first + 3).contains(&k) { Vec3::AXES[k % 3] * by } else { Vec3::ZERO });
            let moved = Perspective::new(&camera.moved(twist[0], twist[1]), &settings);
            (moved.direction(mean).dot(v_direction), v_inverse / moved.depth(mean))
        };
        let ((up, near), (down, far)) = (at(1e-2), at(-1e-2));
        assert!((by_direction[k] - (up - down) / 2e-2).abs() < 1e-4, "{k}: {} {}", by_direction[k], (up - down) / 2e-2);
        assert!((by_depth[k] - (near - far) / 2e-2).abs() < 1e-4, "{k}: {} {}", by_depth[k], (near - far) / 2e-2);
    }
}

#[test]
fn directions_and_their_gradients() {
    let perspective = Perspective::new(&camera(), &settings(Antialias::None));
    let (mean, v) = (MEANS[0], Vec3::new(0.3, -0.5, 0.8));
    let found = perspective.direction_vjp(mean, v);
    for axis in 0..3 {
        let h = Vec3::AXES[axis] * 1e-2;
        let numeric = (perspective.direction(mean + h) - perspective.direction(mean - h)).dot(v) / 2e-2;
        assert!((found[axis] - numeric).abs() < 1e-4);
    }
    let at_camera = camera().position();
    assert_eq!(perspective.direction(at_camera), Vec3::Z);
    assert_eq!(perspective.direction_vjp(at_camera, v), Vec3::ZERO);
}

#[test]
fn each_culled_gaussian_has_a_cause() {
    let perspective = Perspective::new(&camera(), &settings(Antialias::None));
    let good = ellipsoid(MEANS[0]);
    let cause = |g: Ellipsoid| perspective.project(&g).unwrap_err();
    assert_eq!(cause(Ellipsoid { mean: Vec3::new(f32::NAN, 0.0, -9.0), ..good }), CullCause::NotFinite);
    assert_eq!(cause(Ellipsoid { mean: Vec3::new(0.0, 0.0, -9.0), ..good }), CullCause::Near);
    assert_eq!(cause(Ellipsoid { mean: camera().position(), ..good }), CullCause::Near);
    assert_eq!(cause(Ellipsoid { rotation: [0.0; 4], ..good }), CullCause::Degenerate);
    assert_eq!(cause(Ellipsoid { rotation: [f32::INFINITY; 4], ..good }), CullCause::NotFinite);
    assert_eq!(cause(Ellipsoid { log_scale: Vec3::splat(80.0), ..good }), CullCause::NotFinite);
    assert_eq!(cause(Ellipsoid { log_scale: Vec3::splat(-80.0), ..good }), CullCause::Degenerate);
    assert_eq!(cause(Ellipsoid { opacity_logit: f32::NEG_INFINITY, ..good }), CullCause::Transparent);
    assert_eq!(cause(Ellipsoid { opacity_logit: f32::NAN, ..good }), CullCause::NotFinite);
    assert_eq!(perspective.project(&Ellipsoid { opacity_logit: f32::INFINITY, ..good }).unwrap().opacity, 1.0);
    let mip = Perspective::new(&camera(), &settings(Antialias::Mip));
    let flat = Ellipsoid { log_scale: Vec3::new(-1.0, -200.0, -200.0), ..good };
    assert_eq!(mip.project(&flat).unwrap_err(), CullCause::Transparent);
    assert!(mip.project_vjp(&flat, &ProjectionGradient { log_opacity: 1.0, ..Default::default() }).mean.is_finite());
}

#[test]
fn quaternions_of_every_length_turn_alike() {
    let perspective = Perspective::new(&camera(), &settings(Antialias::None));
    let good = ellipsoid(MEANS[0]);
    let expected = perspective.project(&good).unwrap();
    let v = ProjectionGradient { mean: Vec2::ONE, covariance: [0.3, -0.2, 0.1], log_opacity: 0.5 };
    let length = good.rotation.iter().map(|c| c * c).sum::<f32>().sqrt();
    let gradient = perspective.project_vjp(&good, &v);
    for longer in [1e10, 1e18, 1e20, 1e30, 1e38] {
        let factor = longer / length;
        let long = Ellipsoid { rotation: good.rotation.map(|c| c * factor), ..good };
        let found = perspective.project(&long).unwrap();
        for (a, b) in found.covariance.into_iter().zip(expected.covariance) {
            assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "{longer:e}: {found:?} {expected:?}");
        }
        let found = perspective.project_vjp(&long, &v);
        for (a, b) in found.rotation.into_iter().zip(gradient.rotation) {
            let b = f64::from(b) / f64::from(factor);
            assert!((f64::from(a) - b).abs() <= 1e-4 * b.abs() + 1e-37, "{longer:e}: {a:e} {b:e}");
        }
    }
}

#[test]
fn directions_have_length_one_from_any_distance() {
    let perspective = Perspective::new(&Camera::looking_forward(4, 4, 1.0), &settings(Antialias::None));
    let expected = Vec3::new(0.48, -0.6, 0.64);
    for distance in [1e-37, 1e-25, 1e-16, 1.0, 1e16, 1e25, 1e37] {
        let (mean, v) = (expected * distance, Vec3::new(0.3, -0.5, 0.8));
        let found = perspective.direction(mean);
        assert!((found - expected).length() < 1e-6, "{distance:e}: {found}");
        let tangential = v - expected * expected.dot(v);
        let v_mean = perspective.direction_vjp(mean, v) * distance;
        assert!((v_mean - tangential).length() < 1e-5, "{distance:e}: {v_mean}");
    }
}
