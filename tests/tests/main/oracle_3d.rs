//! The oracle for 3D scenes, compared with finite differences, hand calculations, and the pinhole
//! model.

use glam::{Mat3, Vec2, Vec3};
use gs_conformance::{
    oracle::{MovedCamera, OPACITY_3D, Oracle, Projection, QUATERNION, SH_3D, Splat},
    scenes::{Draw, Kind3d},
    subject::Subject,
};
use gs_core::{
    Camera, Error, Gaussian3d, Loss, Output, RenderSettings, Scene, Scene3d,
    effects::{Antialias, Blend, Order},
};

use super::oracle::smooth;

const LOSSES: [Loss; 3] = [Loss::L2, Loss::L1, Loss::PAPER];

/// Compares analytic gradients with central finite differences, within 0.1 %. Returns the number of
/// gradients that are not negligible, by parameter.
fn differentiate(draw: &Draw<Scene3d>, loss: &Loss) -> Vec<usize> {
    let oracle = Oracle::new(draw.view, smooth(draw.settings)).unwrap();
    let target = draw.target().unwrap();
    let scene = draw.scene.rows();
    let analytic = oracle.gradients(&scene, &target, loss).unwrap();
    let mut counted = vec![0; scene.gaussians[0].len()];
    for g in 0..scene.gaussians.len() {
        let size = analytic.values[g].iter().fold(0.0f64, |m, v| m.max(v.abs()));
        for i in (0..counted.len()).filter(|&i| scene.gaussians[g][i].is_finite()) {
            let at = |step: f64| {
                let mut nudged = scene.clone();
                nudged.gaussians[g][i] += step;
                oracle.loss(&nudged, &target, loss).unwrap()
            };
            let step = 1e-6;
            let numeric = (at(step) - at(-step)) / (2.0 * step);
            let value = analytic.values[g][i];
            // The differences are accurate to 1e-9. Much smaller gradients are compared relative to
            // the Gaussian's largest.
            let relative = ((value - numeric).abs() - 1e-9) / value.abs().max(1e-4 * size).max(1e-12);
            let name = Scene3d::parameter_name(i);
            let effects = draw.settings.effects;
            assert!(
                relative <= 1e-3,
                "{:?} {loss:?} {effects:?}: Gaussian {g}, {name}: {value:e} against {numeric:e}",
                draw.kind
            );
            counted[i] += usize::from(value.abs() > 1e-6);
        }
    }
    differentiate_by_the_camera(draw, loss);
    counted
}

/// Does the same for the gradient by the camera.
fn differentiate_by_the_camera(draw: &Draw<Scene3d>, loss: &Loss) {
    let (settings, scene, target) = (smooth(draw.settings), draw.scene.rows(), draw.target().unwrap());
    let analytic = Oracle::new(draw.view, settings).unwrap().gradients(&scene, &target, loss).unwrap().view;
    assert_eq!(analytic.values.len(), 10);
    for (k, &value) in analytic.values.iter().enumerate() {
        let at = |step: f64| {
            let mut moved = MovedCamera { camera: draw.view, by: [0.0; 10] };
            moved.by[k] = step;
            Oracle::new(moved, settings).unwrap().loss(&scene, &target, loss).unwrap()
        };
        let step = if k < 6 { 1e-6 } else { 1e-5 };
        let numeric = (at(step) - at(-step)) / (2.0 * step);
        let relative = ((value - numeric).abs() - 1e-9) / value.abs().max(1e-12);
        let effects = draw.settings.effects;
        assert!(
            relative <= 1e-3,
            "{:?} {loss:?} {effects:?}: number {k} of the camera: {value:e} against {numeric:e}",
            draw.kind
        );
    }
}

/// The gradient by the camera counts the depth where it is shown.
#[test]
fn gradients_by_the_camera_hold_for_every_output() {
    for output in [Output::InverseDepth, Output::Alpha] {
        for (seed, kind) in (80..).zip([Kind3d::Typical, Kind3d::Near, Kind3d::Edge]) {
            let mut draw = Draw::for_3d(kind, Blend::Over, 5, (12, 9), seed);
            draw.settings.output = output;
            differentiate(&draw, &Loss::L2);
        }
    }
}

/// The oracle moves a camera as gs-core does.
#[test]
fn a_moved_camera_is_the_one_of_gs_core() {
    let draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 8, (20, 16), 7);
    let by = [0.1, -0.05, 0.07, 0.06, 0.03, -0.04, 1.5, -0.7, 0.4, 0.9];
    let moved = MovedCamera { camera: draw.view, by };
    let [vx, vy, vz, wx, wy, wz, fx, fy, cx, cy] = by.map(|v| v as f32);
    let camera = draw.view.moved(Vec3::new(vx, vy, vz), Vec3::new(wx, wy, wz));
    let camera =
        Camera { focal: camera.focal + Vec2::new(fx, fy), center: camera.center + Vec2::new(cx, cy), ..camera };
    let scene = draw.scene.rows();
    let before = Oracle::new(draw.view, draw.settings).unwrap().render(&scene).pixels;
    let after = Oracle::new(moved, draw.settings).unwrap().render(&scene).pixels;
    let expected = Oracle::new(camera, draw.settings).unwrap().render(&scene).pixels;
    let off = |a: &[[f64; 3]], b: &[[f64; 3]]| {
        a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let (moved, wrong) = (off(&before, &expected), off(&after, &expected));
    assert!(moved > 0.05 && wrong < 1e-4, "moved by {moved}, off by {wrong}");
}

/// Checks every kind, blend and loss, with SH of every degree.
#[test]
fn gradients_are_the_derivatives_of_the_loss() {
    for blend in [Blend::Sum, Blend::Over] {
        for loss in LOSSES {
            let mut counted = 0;
            for (seed, kind) in (40..).zip(Kind3d::ALL) {
                let draw = Draw::for_3d(kind, blend, 4, (12, 9), seed).on([0.3, 0.9, 0.1]);
                // A finite difference would change the order of equal depths.
                let equal = kind == Kind3d::EqualDepths;
                let draw = if equal { draw.in_order(Order::Index) } else { draw };
                counted += differentiate(&draw, &loss).iter().sum::<usize>();
            }
            assert!(counted > 300, "{blend:?} {loss:?}: only {counted} gradients were compared");
        }
    }
}

/// The compensation's derivative is a great part of it where Gaussians are narrower than a pixel.
#[test]
fn gradients_hold_through_antialiasing_and_in_every_order() {
    for (antialias, order) in [
        (Antialias::Dilate, Order::Global),
        (Antialias::Mip, Order::Global),
        (Antialias::Mip, Order::PerPixel),
        (Antialias::Compensated, Order::Global),
        (Antialias::None, Order::PerPixel),
        (Antialias::None, Order::Index),
    ] {
        for (seed, kind) in (60..).zip([Kind3d::Typical, Kind3d::Tiny, Kind3d::Needles]) {
            let draw = Draw::for_3d(kind, Blend::Over, 5, (12, 9), seed).antialiased(antialias).in_order(order);
            let counted = differentiate(&draw, &Loss::L2);
            let tiny = kind == Kind3d::Tiny && antialias == Antialias::None;
            assert!(tiny || counted[..11].iter().all(|&n| n > 0), "{kind:?} {antialias:?} {order:?}: {counted:?}");
        }
    }
}

/// A Gaussian beyond each edge of the field of view, where a slope is clamped, large enough to be
/// seen; before an off-centre principal point, so that the four clamps differ.
#[test]
fn gradients_hold_where_the_jacobian_is_clamped() {
    let mut draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 0, (14, 11), 3);
    let camera = Camera { focal: Vec2::new(16.0, 15.0), center: Vec2::new(4.0, 7.5), ..draw.view };
    draw.view = camera;
    let beyond = [Vec2::new(-9.0, 5.0), Vec2::new(25.0, 5.0), Vec2::new(7.0, -8.0), Vec2::new(7.0, 20.0)];
    for (pixel, depth) in beyond.into_iter().zip([3.0, 2.5, 3.5, 2.8]) {
        let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
        draw.scene.push(Gaussian3d {
            mean: camera.rotation.transpose() * (ray * depth - camera.translation),
            log_scale: Vec3::new(0.4, 0.6, 0.1),
            rotation: [0.5, -0.2, 0.8, 0.3],
            opacity_logit: 1.0,
            sh: (0..16).map(|k| Vec3::splat(0.4 / (1 + k) as f32)).collect(),
        });
    }
    // Beyond 0.3 half images from the edge.
    let (width, height) = (14.0f32, 11.0f32);
    for &mean in &draw.scene.means {
        let (pixel, _) = camera.project(mean).unwrap();
        let outside = [(-pixel.x).max(pixel.x - width) / width, (-pixel.y).max(pixel.y - height) / height];
        assert!(outside.into_iter().any(|share| share > 0.2), "{pixel} is not clamped");
    }
    for loss in LOSSES {
        let counted = differentiate(&draw, &loss);
        assert!(counted[..11].iter().all(|&n| n >= 3), "{counted:?}");
    }
}

/// Σ′⁻¹ from σ at one px from the centre along x, y and both.
fn precision(splat: &dyn Splat) -> [f64; 3] {
    let center = center(splat);
    let sigma = |dx: f64, dy: f64| splat.exponent([center[0] + dx, center[1] + dy]).sigma;
    let (xx, yy) = (2.0 * sigma(1.0, 0.0), 2.0 * sigma(0.0, 1.0));
    [xx, sigma(1.0, 1.0) - 0.5 * (xx + yy), yy]
}

/// The centre, where the gradient of σ is 0: one Newton step is exact.
fn center(splat: &dyn Splat) -> [f64; 2] {
    let at = |p: [f64; 2]| splat.exponent(p).derivatives;
    let [o, x, y] = [at([0.0, 0.0]), at([1.0, 0.0]), at([0.0, 1.0])];
    let [a, b, c, d] = [x[0] - o[0], y[0] - o[0], x[1] - o[1], y[1] - o[1]];
    let determinant = a * d - b * c;
    [-(d * o[0] - b * o[1]) / determinant, -(a * o[1] - c * o[0]) / determinant]
}

fn one(g: Gaussian3d) -> Scene3d {
    let mut scene = Scene3d { sh_degree: g.sh.len().isqrt() as u8 - 1, ..Scene3d::default() };
    scene.push(g);
    scene
}

fn projected(scene: &Scene3d, view: Camera, settings: RenderSettings) -> Box<dyn Splat> {
    match Oracle::new(view, settings).unwrap().project(&scene.rows()).remove(0) {
        Projection::Drawable(splat) => splat,
        Projection::Left(cause) => panic!("{cause:?}"),
    }
}

/// Points of a small Gaussian, put through the pinhole one by one, have the projected mean and
/// covariance, and their depths given the pixel are those of `Order::PerPixel`.
#[test]
fn a_small_gaussian_falls_where_its_points_fall() {
    let draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 6, (40, 30), 5);
    for g in 0..6 {
        // A thousandth as large, through a lens a thousand times as long: the affine approximation
        // is then nearly exact.
        let mut gaussian = draw.scene.gaussian(g);
        gaussian.log_scale -= 1000f32.ln();
        let (pixel, _) = draw.view.project(gaussian.mean).unwrap();
        let mut view = Camera { focal: draw.view.focal * 1000.0, ..draw.view };
        view.center += pixel - view.project(gaussian.mean).unwrap().0;
        let splat = projected(&one(gaussian.clone()), view, draw.settings);
        let factor = gaussian.factor().unwrap().as_dmat3();
        let (rotation, translation) = (view.rotation.as_dmat3(), view.translation.as_dvec3());
        let (focal, principal) = (view.focal.as_dvec2(), view.center.as_dvec2());
        // Third-order cubature: ±√3 along each axis has the mean and covariance of the Gaussian
        // exactly.
        let mut points = Vec::new();
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut offset = glam::DVec3::ZERO;
                offset[axis] = sign * 3f64.sqrt();
                let p = rotation * (gaussian.mean.as_dvec3() + factor * offset) + translation;
                points.push((focal * p.truncate() / p.z + principal, p.z));
            }
        }
        let mean = points.iter().map(|p| p.0).sum::<glam::DVec2>() / 6.0;
        let depth = points.iter().map(|p| p.1).sum::<f64>() / 6.0;
        let moment = |f: &dyn Fn(glam::DVec2, f64) -> f64| {
            points.iter().map(|&(p, z)| f(p - mean, z - depth)).sum::<f64>() / 6.0
        };
        let (xx, xy, yy) = (moment(&|d, _| d.x * d.x), moment(&|d, _| d.x * d.y), moment(&|d, _| d.y * d.y));
        let determinant = xx * yy - xy * xy;
        let expected = [yy / determinant, -xy / determinant, xx / determinant];
        let found = precision(splat.as_ref());
        let size = expected[0] + expected[2];
        for i in 0..3 {
            assert!((found[i] - expected[i]).abs() < 1e-2 * size, "{g}: Σ′⁻¹ {found:?}, not {expected:?}");
        }
        let at = center(splat.as_ref());
        assert!((mean.x - at[0]).abs() < 1e-3 && (mean.y - at[1]).abs() < 1e-3, "{g}: {at:?}, not {mean}");

        // Regression of depth on the pixel.
        let (kx, ky) = (moment(&|d, z| z * d.x), moment(&|d, z| z * d.y));
        let slope = [expected[0] * kx + expected[1] * ky, expected[1] * kx + expected[2] * ky];
        let moved = splat.depth([at[0] + 0.01, at[1] + 0.02], Order::PerPixel).value;
        let center_depth = splat.depth(at, Order::PerPixel).value;
        let predicted = 0.01 * slope[0] + 0.02 * slope[1];
        assert!((center_depth - depth).abs() < 1e-4);
        let scale = 0.02 * (slope[0].abs() + slope[1].abs());
        assert!((moved - center_depth - predicted).abs() < 2e-2 * scale, "{g}: {moved} {center_depth} {predicted}");
        assert_eq!(splat.depth([0.5, 0.5], Order::Global).value, splat.depth(at, Order::Global).value);
    }
}

/// A sphere on the optical axis, by hand: Σ′ = (f s/z)² I, and an SH of degree 0 and 1 at d = +z.
#[test]
fn hand_calculation_of_a_sphere_on_the_axis() {
    let view = Camera { center: Vec2::new(4.5, 4.5), focal: Vec2::splat(8.0), ..Camera::looking_forward(9, 9, 1.0) };
    let mut sphere = Gaussian3d {
        mean: Vec3::new(0.0, 0.0, 4.0),
        log_scale: Vec3::ZERO,
        rotation: [0.3, 0.2, -0.5, 0.7],
        opacity_logit: 0.0,
        sh: vec![Vec3::ZERO; 16],
    };
    sphere.sh[0] = Vec3::new(1.0, -2.0, 0.0);
    sphere.sh[2] = Vec3::new(0.5, 0.0, 0.0);
    let mut settings = RenderSettings::blended(Blend::Over).on([0.25; 3]);
    settings.effects.sh_degree = 3;
    let image = Oracle::new(view, settings).unwrap().render(&one(sphere.clone()).rows());
    // Two px wide; its centre on pixel (4, 4), where α = ½.
    let red = 0.5 + 0.282_094_791_773_878_14 + 0.488_602_511_902_919_9 * 0.5;
    let expected = [0.5 * red + 0.125, 0.125, 0.25 + 0.125]; // Green is clamped: ½ − 2 Y₀ < 0.
    for k in 0..3 {
        assert!((image.pixels[4 * 9 + 4][k] - expected[k]).abs() < 1e-9, "{:?}", image.pixels[4 * 9 + 4]);
    }
    let w = (-0.5f64 * (4.0 + 1.0) / 4.0).exp(); // (2, 1) px away.
    let found = image.pixels[5 * 9 + 6][0];
    assert!((found - (0.5 * w * red + (1.0 - 0.5 * w) * 0.25)).abs() < 1e-9, "{found}");

    // With Mip, Σ′ is 4.1 I and the opacity is scaled by 4/4.1.
    settings.effects.antialias = Antialias::Mip;
    let image = Oracle::new(view, settings).unwrap().render(&one(sphere.clone()).rows());
    let dilation = f64::from(0.1f32);
    let alpha = 0.5 * 4.0 / (4.0 + dilation) * (-0.5 * 5.0 / (4.0 + dilation)).exp();
    assert!((image.pixels[5 * 9 + 6][0] - (alpha * red + (1.0 - alpha) * 0.25)).abs() < 1e-9);
    // With Dilate it is 4.3 I and the opacity stays; with Compensated the opacity is scaled by
    // 4/4.3.
    let dilation = f64::from(0.3f32);
    for (antialias, opacity) in [(Antialias::Dilate, 0.5), (Antialias::Compensated, 0.5 * 4.0 / (4.0 + dilation))] {
        settings.effects.antialias = antialias;
        let image = Oracle::new(view, settings).unwrap().render(&one(sphere.clone()).rows());
        let alpha = opacity * (-0.5 * 5.0 / (4.0 + dilation)).exp();
        assert!((image.pixels[5 * 9 + 6][0] - (alpha * red + (1.0 - alpha) * 0.25)).abs() < 1e-9, "{antialias:?}");
    }
}

/// A red and a blue ball, the blue one further away but listed first.
#[test]
fn orders_are_by_index_by_mean_and_by_pixel() {
    let ball = |z: f32, color: Vec3| Gaussian3d {
        mean: Vec3::new(0.0, 0.0, z),
        log_scale: Vec3::splat(-1.0),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: 3.0,
        sh: vec![(color - 0.5) / 0.282_094_8],
    };
    let mut scene = one(ball(4.0, Vec3::Z));
    scene.push(ball(3.0, Vec3::X));
    let view = Camera { center: Vec2::splat(4.5), ..Camera::looking_forward(9, 9, 1.0) };
    let middle = |scene: &Scene3d, order, pixel: usize| {
        let mut settings = RenderSettings::blended(Blend::Over);
        settings.effects.order = order;
        Oracle::new(view, settings).unwrap().render(&scene.rows()).pixels[pixel]
    };
    let red_in_front = |[r, _, b]: [f64; 3]| r > b;
    assert!(!red_in_front(middle(&scene, Order::Index, 40)));
    assert!(red_in_front(middle(&scene, Order::Global, 40)));
    assert!(red_in_front(middle(&scene, Order::PerPixel, 40)));

    // Two discs that cross like an X seen from above: each is in front on one side, by the pixel's
    // depth alone.
    let disc = |angle: f32, color: Vec3| Gaussian3d {
        log_scale: Vec3::new(0.0, 0.0, -4.0),
        rotation: [(0.5 * angle).cos(), 0.0, (0.5 * angle).sin(), 0.0],
        ..ball(3.0, color)
    };
    let mut crossed = one(disc(0.7, Vec3::X));
    crossed.push(disc(-0.7, Vec3::Z));
    // A turn about +y (down) by 0.7 takes the disc's +x edge towards the camera.
    let sides = |order| [4 * 9 + 2, 4 * 9 + 6].map(|pixel| red_in_front(middle(&crossed, order, pixel)));
    assert_eq!(sides(Order::PerPixel), [false, true]);
    assert_eq!(sides(Order::Global), [true, true], "equal depths: by index");
    crossed = crossed.picked([1, 0]);
    assert_eq!([4 * 9 + 2, 4 * 9 + 6].map(|p| red_in_front(middle(&crossed, Order::PerPixel, p))), [false, true]);
}

/// Two Gaussians whose depths differ by less than rounding may have either order. The oracle
/// reports the affected pixels.
#[test]
fn only_orders_within_rounding_are_reported() {
    let mut draw = Draw::for_3d(Kind3d::Overlapping, Blend::Over, 2, (20, 16), 12);
    let render = |draw: &Draw<Scene3d>| Oracle::new(draw.view, draw.settings).unwrap().render(&draw.scene.rows());
    let apart = render(&draw);
    let away = |image: &gs_conformance::oracle::Rendering| {
        (0..320).filter(|&p| image.flip[p].iter().any(|&v| v > 0.0)).count()
    };
    assert!(away(&apart) < 5);
    // The same depth, but for the last bits.
    let forward = draw.view.rotation.transpose() * Vec3::Z;
    let gap = draw.view.to_camera(draw.scene.means[1]).z - draw.view.to_camera(draw.scene.means[0]).z;
    draw.scene.means[1] -= forward * gap;
    let tied = render(&draw);
    assert!(away(&tied) > 30, "{} of 320 pixels", away(&tied));
    let swapped = Draw { scene: draw.scene.picked([1, 0]), ..draw.clone() }.in_order(Order::Index);
    let index = Draw { ..draw.clone() }.in_order(Order::Index);
    let (a, b) = (render(&swapped), render(&index));
    for p in 0..320 {
        for k in 0..3 {
            assert!((a.pixels[p][k] - b.pixels[p][k]).abs() <= tied.flip[p][k] + 1e-12, "the order changes more");
        }
    }
    // In the same place, ties are by index, and there is nothing to notice.
    draw.scene.means[1] = draw.scene.means[0];
    assert!(away(&render(&draw)) < 5);
}

/// Properties that finite differences do not show: the gradient is orthogonal to the quaternion,
/// and 0 above the effective degree and at infinite logits.
#[test]
fn gradients_have_the_expected_structure() {
    let mut draw = Draw::for_3d(Kind3d::Opaque, Blend::Over, 9, (20, 16), 3);
    draw.settings.effects.sh_degree = 1;
    let scene = draw.scene.rows();
    let target = draw.target().unwrap();
    let gradients = Oracle::new(draw.view, draw.settings).unwrap().gradients(&scene, &target, &Loss::L2).unwrap();
    let mut nonzero = 0;
    for (row, g) in gradients.values.iter().zip(&scene.gaussians) {
        let q = QUATERNION..OPACITY_3D;
        let along: f64 = row[q.clone()].iter().zip(&g[q.clone()]).map(|(a, b)| a * b).sum();
        let size = row[q].iter().fold(0.0f64, |m, v| m.max(v.abs()));
        nonzero += usize::from(size > 0.0);
        assert!(along.abs() <= 1e-12 * (1.0 + size));
        assert!(row[SH_3D + 12..].iter().all(|&v| v == 0.0));
        assert!(g[OPACITY_3D].is_finite() || row[OPACITY_3D] == 0.0);
        assert!(row.iter().all(|v| v.is_finite()));
    }
    assert!(nonzero > 4);
}

/// [`Statistics`](gs_core::effects::Statistics): the mean gradient is that of the projected mean,
/// which a shift of the principal point moves for all Gaussians alike.
#[test]
fn the_mean_gradient_is_that_of_the_pixel_position() {
    let draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 1, (20, 16), 4);
    let (scene, target) = (draw.scene.rows(), draw.target().unwrap());
    let settings = smooth(draw.settings);
    let found = Oracle::new(draw.view, settings).unwrap().statistics(&scene, &target, &Loss::L2).unwrap();
    // J is taken at p, the colour at μ: only u, v depend on cx, cy while no slope is clamped.
    let at = |shift: Vec2| {
        let view = Camera { center: draw.view.center + shift, ..draw.view };
        Oracle::new(view, settings).unwrap().loss(&scene, &target, &Loss::L2).unwrap()
    };
    let step = 2f32.powi(-9);
    let [du, dv] = [Vec2::X, Vec2::Y].map(|axis| (at(axis * step) - at(-axis * step)) / (2.0 * f64::from(step)));
    let expected = (du * 10.0).hypot(dv * 8.0);
    assert!((found.mean_gradient[0] - expected).abs() < 1e-3 * expected, "{} {expected}", found.mean_gradient[0]);
    assert!(found.absolute_gradient[0] >= found.mean_gradient[0] && found.pixel_error[0] > 0.0);
}

#[test]
fn unsupported_settings_are_errors() {
    let view = Camera::looking_forward(4, 4, 1.0);
    let stretched = Camera { rotation: Mat3::IDENTITY * 2.0, ..view };
    assert!(matches!(Oracle::new(stretched, RenderSettings::default()), Err(Error::Setting { .. })));
}
