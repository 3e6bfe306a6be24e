//! The oracle compared with central finite differences, a textbook value and hand calculations.

use glam::{Vec2, Vec3};
use gs_conformance::{
    adam_reference::AdamReference,
    oracle::{Oracle, OracleScene, PARAMETER_NAMES, best_colors},
    scenes::{self, Draw, Kind2d},
};
use gs_core::{
    Adam, Canvas, Cut, Error, Gaussian2d, Image, Loss, RenderSettings, Scene2d,
    adam::Group,
    effects::{Antialias, Blend, Order},
};

const LOSSES: [Loss; 3] = [Loss::L2, Loss::L1, Loss::PAPER];

/// Differentiable settings: no cut, never full.
pub(crate) fn smooth(mut settings: RenderSettings) -> RenderSettings {
    settings.accuracy.cut = Cut::Smooth;
    settings.accuracy.transmittance_min = 0.0;
    settings
}

/// Worst relative difference between analytic gradients and central finite differences of one
/// drawing. `counted` is the number of gradients that are not negligible.
fn worst_difference(draw: &Draw, loss: &Loss, counted: &mut usize) -> f64 {
    let oracle = Oracle::new(draw.view, smooth(draw.settings)).unwrap();
    let target = draw.target().unwrap();
    let scene = OracleScene::from(&draw.scene);
    let analytic = oracle.gradients(&scene, &target, loss).unwrap();
    let mut worst: f64 = 0.0;
    for g in 0..scene.gaussians.len() {
        let size = analytic.values[g].iter().fold(0.0f64, |m, v| m.max(v.abs()));
        for i in (0..9).filter(|&i| scene.gaussians[g][i].is_finite()) {
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
            let off = (value - numeric).abs() - 1e-9;
            let relative = off / value.abs().max(1e-4 * size).max(1e-12);
            assert!(
                relative <= 1e-3,
                "{:?} {loss:?}: Gaussian {g}, {}: {value:e} against {numeric:e}",
                draw.kind,
                PARAMETER_NAMES[i]
            );
            worst = worst.max(relative);
            *counted += usize::from(value.abs() > 1e-6);
        }
    }
    worst
}

#[test]
fn gradients_are_the_derivatives_of_the_loss() {
    for blend in [Blend::Sum, Blend::Over] {
        for loss in LOSSES {
            let mut counted = 0;
            for (seed, kind) in Kind2d::ALL.into_iter().enumerate() {
                let draw = Draw::new(kind, blend, 5, (14, 11), 40 + seed as u64).on([0.3, 0.9, 0.1]);
                worst_difference(&draw, &loss, &mut counted);
            }
            assert!(counted > 100, "{blend:?} {loss:?}: only {counted} gradients were compared");
        }
    }
}

#[test]
fn gradients_hold_through_antialiasing() {
    for antialias in [Antialias::Dilate, Antialias::Mip, Antialias::Compensated] {
        for blend in [Blend::Sum, Blend::Over] {
            let view = Canvas::new(14, 11).resized(9, 13);
            let mut counted = 0;
            for (seed, kind) in (70..).zip(Kind2d::ALL) {
                let draw = Draw::new(kind, blend, 5, (14, 11), seed).antialiased(antialias).through(view);
                worst_difference(&draw, &Loss::L2, &mut counted);
            }
            assert!(counted > 20, "{antialias:?} {blend:?}: only {counted} gradients were compared");
        }
    }
}

#[test]
fn gradients_hold_through_a_zoomed_canvas() {
    let view = Canvas::new(13, 10).showing(Vec2::new(3.0, -2.0), Vec2::new(6.5, 20.0));
    for blend in [Blend::Sum, Blend::Over] {
        let mut counted = 0;
        worst_difference(&Draw::new(Kind2d::Typical, blend, 8, (14, 14), 5).through(view), &Loss::L2, &mut counted);
        assert!(counted > 20, "only {counted} gradients were compared");
    }
}

fn disc(mean: Vec2, opacity_logit: f32, color: Vec3) -> Gaussian2d {
    Gaussian2d { mean, log_scale: Vec2::splat(2f32.ln()), rotation: 0.0, opacity_logit, color }
}

#[test]
fn hand_calculation_of_two_discs() {
    // Two discs of σ = 2 px centred on pixel (1, 1); the pixel to the right is 1 px away: w =
    // exp(−1/8).
    let center = Vec2::new(1.5, 1.5);
    let scene = [disc(center, 0.0, Vec3::new(1.0, 0.0, 0.5)), disc(center, f32::INFINITY, Vec3::new(0.0, 1.0, 0.5))];
    let scene = OracleScene::from(&scene.into_iter().collect::<Scene2d>());
    let sigma = f64::from(2f32.ln()).exp();
    let w = (-0.5 / (sigma * sigma)).exp();
    let settings = RenderSettings::blended(Blend::Over).on([0.2, 0.2, 0.2]);
    let over = Oracle::new(Canvas::new(3, 3), settings).unwrap().render(&scene);
    let background = f64::from(0.2f32);
    let expected = [0.5 * w, (1.0 - 0.5 * w) * w, 0.5 * (0.5 * w + (1.0 - 0.5 * w) * w)];
    let left = (1.0 - 0.5 * w) * (1.0 - w);
    for k in 0..3 {
        assert!((over.pixels[5][k] - expected[k] - left * background).abs() < 1e-12);
    }
    // At the centre the second is opaque: α = α_max.
    let alpha_max = f64::from(settings.accuracy.alpha_max);
    assert!((over.pixels[4][1] - 0.5 * (alpha_max + (1.0 - alpha_max) * background)).abs() < 1e-12);

    let settings = RenderSettings::blended(Blend::Sum).on([0.2, 0.2, 0.2]);
    let sum = Oracle::new(Canvas::new(3, 3), settings).unwrap().render(&scene);
    assert!((sum.pixels[5][2] - w - background).abs() < 1e-12);
}

#[test]
fn the_cut_and_full_pixels_are_where_they_are_defined() {
    let view = Canvas::new(32, 1);
    let one =
        OracleScene::from(&[disc(Vec2::new(0.5, 0.5), f32::INFINITY, Vec3::ONE)].into_iter().collect::<Scene2d>());
    let oracle = Oracle::new(view, RenderSettings::blended(Blend::Sum)).unwrap();
    let image = oracle.render(&one);
    // w(x) = exp(−x²/8) ≥ 1/255 ⇔ x ≤ 6.658
    assert!(image.pixels[6][0] > 0.011 && image.pixels[7][0] == 0.0, "{:?}", &image.pixels[5..9]);
    assert!((0..32).all(|p| image.flip[p] == [0.0; 3]));

    // T after two opaque discs is 1e-6 < 1e-4: the second does not count at the centre, nor does
    // anything behind it.
    let center = Vec2::new(0.5, 0.5);
    let stack =
        [disc(center, f32::INFINITY, Vec3::X), disc(center, f32::INFINITY, Vec3::Y), disc(center, -2.0, Vec3::Z)];
    let oracle = Oracle::new(view, RenderSettings::blended(Blend::Over)).unwrap();
    let image = oracle.render(&OracleScene::from(&stack.into_iter().collect::<Scene2d>()));
    assert_eq!(image.pixels[0][1..], [0.0, 0.0]);
    assert!(image.pixels[4][1] > 0.0);
}

#[test]
fn only_discontinuities_are_reported() {
    // A disc whose weight at pixel 5 is exactly the cut, give or take a rounding of the scale.
    let sigma = 5.0 / (2.0 * 255f32.ln()).sqrt();
    let mut g = disc(Vec2::new(0.5, 0.5), f32::INFINITY, Vec3::ONE);
    g.log_scale = Vec2::splat(sigma.ln());
    let oracle = Oracle::new(Canvas::new(9, 1), RenderSettings::blended(Blend::Sum)).unwrap();
    let image = oracle.render(&OracleScene::from(&[g].into_iter().collect::<Scene2d>()));
    let near: Vec<usize> = (0..9).filter(|&p| image.flip[p].iter().any(|&v| v > 0.0)).collect();
    assert_eq!(near, [5]);
    assert!(image.flip[5].iter().all(|&f| (f - 1.0 / 255.0).abs() < 1e-4));
}

#[test]
fn guards_cull_and_count() {
    let good = disc(Vec2::splat(4.0), 0.0, Vec3::ONE);
    let scene = [
        good,
        Gaussian2d { log_scale: Vec2::splat(-4.0), ..good },
        Gaussian2d { mean: Vec2::splat(1e3), ..good },
        Gaussian2d { opacity_logit: -9.0, ..good },
        Gaussian2d { log_scale: Vec2::splat(60.0), ..good },
    ];
    let scene = OracleScene::from(&scene.into_iter().collect::<Scene2d>());
    let over = Oracle::new(Canvas::new(8, 8), RenderSettings::blended(Blend::Over)).unwrap().render(&scene);
    let culled = over.culled;
    assert_eq!((culled.degenerate, culled.outside, culled.transparent, culled.not_finite), (1, 1, 1, 1));
    assert_eq!(over.drawn, [true, false, false, false, false]);
}

#[test]
fn ssim_is_one_for_equal_images_and_near_zero_for_a_black_one() {
    let view = Canvas::new(16, 12);
    let empty = OracleScene::default();
    let target = scenes::target(16, 12, 1).unwrap();
    let dssim = Loss::L1Dssim { lambda: 1.0 };
    // A black image against a target of mean near 0.5 has SSIM near 0; a background equal to a flat
    // target has 1.
    let black = Oracle::new(view, RenderSettings::blended(Blend::Sum)).unwrap();
    assert!(black.loss(&empty, &target, &dssim).unwrap() > 0.9);
    let flat = Image::filled(16, 12, [0.25, 0.5, 0.75]).unwrap();
    let same = Oracle::new(view, RenderSettings::blended(Blend::Sum).on([0.25, 0.5, 0.75])).unwrap();
    assert!(same.loss(&empty, &flat, &dssim).unwrap().abs() < 1e-12);
}

#[test]
fn adam_takes_a_first_step_of_its_rate_and_counts_per_gaussian() {
    let draw = Draw::new(Kind2d::Typical, Blend::Over, 2, (8, 8), 1);
    let rates = Adam::default()
        .with(|s| {
            s.mean = Group::constant(0.25);
            s.epsilon = 0.0;
        })
        .at(0.0);
    let start = OracleScene::from(&draw.scene);
    let mut adam = AdamReference::new(start.clone());
    let gradients = vec![vec![2.0, -3.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]; 2];
    adam.step_some(&[0], &gradients, &rates);
    assert!((adam.scene.gaussians[0][0] - start.gaussians[0][0] + 0.25).abs() < 1e-6);
    assert!((adam.scene.gaussians[0][1] - start.gaussians[0][1] - 0.25).abs() < 1e-6);
    assert_eq!(adam.scene.gaussians[1], start.gaussians[1]);
    // Bias correction: constant gradients move by the rate at every step.
    adam.step(&gradients, &rates);
    assert!((adam.scene.gaussians[0][0] - start.gaussians[0][0] + 0.5).abs() < 1e-6);
    assert!((adam.scene.gaussians[1][0] - start.gaussians[1][0] + 0.25).abs() < 1e-6);
}

#[test]
fn best_colors_have_no_gradient_left() {
    let draw = Draw::new(Kind2d::Typical, Blend::Sum, 9, (20, 16), 3).on([0.1, 0.2, 0.3]);
    let oracle = Oracle::new(draw.view, draw.settings).unwrap();
    let (scene, target) = (OracleScene::from(&draw.scene), draw.target().unwrap());
    let best = best_colors(&oracle, &scene, &target).unwrap();
    let before = oracle.gradients(&scene, &target, &Loss::L2).unwrap();
    let after = oracle.gradients(&best, &target, &Loss::L2).unwrap();
    assert!(after.loss < 0.9 * before.loss);
    for (b, a) in before.values.iter().zip(&after.values) {
        (6..9).for_each(|k| assert!(a[k].abs() < 1e-9 * b[k].abs().max(1e-3)));
    }
}

#[test]
fn unsupported_settings_are_errors() {
    let mut settings = RenderSettings::default();
    settings.effects.order = Order::Global;
    assert!(matches!(Oracle::new(Canvas::new(4, 4), settings), Err(Error::Unsupported { .. })));
    assert!(matches!(Oracle::new(Canvas::new(0, 4), RenderSettings::default()), Err(Error::Size { .. })));
    let oracle = Oracle::new(Canvas::new(4, 4), RenderSettings::default()).unwrap();
    let target = scenes::target(5, 4, 0).unwrap();
    let scene = OracleScene::default();
    assert!(matches!(oracle.loss(&scene, &target, &Loss::L2), Err(Error::SizesDiffer { .. })));
    let image = scenes::target(4, 4, 0).unwrap();
    assert!(matches!(best_colors(&oracle, &scene, &image), Err(Error::Unsupported { .. })));
}
