//! Tests of the comparators: correct results pass, and every kind of wrong result is rejected.

use glam::{Vec2, Vec3};
use gs_conformance::{
    Failure,
    oracle::{Gradients, Oracle, OracleScene, Rendering},
    scenes::{Draw, Kind2d},
    tolerance::{compare_gradients, compare_images, compare_loss},
};
use gs_core::{Image, Loss, RenderSettings, Scene2d, effects::Blend};

fn rendering(blend: Blend) -> Rendering {
    let draw = Draw::new(Kind2d::Typical, blend, 20, (40, 30), 11);
    Oracle::new(draw.view, draw.settings).unwrap().render(&OracleScene::from(&draw.scene))
}

fn gradients(blend: Blend, loss: Loss) -> Gradients {
    let draw = Draw::new(Kind2d::Typical, blend, 20, (40, 30), 11);
    let oracle = Oracle::new(draw.view, draw.settings).unwrap();
    oracle.gradients(&OracleScene::from(&draw.scene), &draw.target().unwrap(), &loss).unwrap()
}

/// The gradients in the form of a backend's download.
fn downloaded(gradients: &Gradients) -> Scene2d {
    let f = |v: f64| v as f32;
    Scene2d {
        means: gradients.values.iter().map(|g| Vec2::new(f(g[0]), f(g[1]))).collect(),
        log_scales: gradients.values.iter().map(|g| Vec2::new(f(g[2]), f(g[3]))).collect(),
        rotations: gradients.values.iter().map(|g| f(g[4])).collect(),
        opacity_logits: gradients.values.iter().map(|g| f(g[5])).collect(),
        colors: gradients.values.iter().map(|g| Vec3::new(f(g[6]), f(g[7]), f(g[8]))).collect(),
    }
}

#[test]
fn only_correct_images_pass() {
    for blend in [Blend::Sum, Blend::Over] {
        let expected = rendering(blend);
        let image = expected.image();
        let agreement = compare_images(&expected, &image).unwrap();
        assert!(agreement.worst_roundings < 1.0 && agreement.flips == 0, "{agreement:?}");

        let (w, h) = image.size();
        let shifted = Image::from_fn(w, h, |x, y| image.pixel((x + 1) % w, y)).unwrap();
        let transposed_channels = Image::from_fn(w, h, |x, y| {
            let [r, g, b] = image.pixel(x, y);
            [b, g, r]
        })
        .unwrap();
        let brighter = Image::from_fn(w, h, |x, y| image.pixel(x, y).map(|v| v * 1.001)).unwrap();
        let black = Image::filled(w, h, [0.0; 3]).unwrap();
        let not_a_number = Image::filled(w, h, [f32::NAN; 3]).unwrap();
        for wrong in [shifted, transposed_channels, brighter, black, not_a_number] {
            assert!(matches!(compare_images(&expected, &wrong), Err(Failure::Differs { .. })));
        }
        assert!(compare_images(&expected, &Image::filled(w + 1, h, [0.0; 3]).unwrap()).is_err());
    }
}

#[test]
fn one_wrong_pixel_is_named() {
    let expected = rendering(Blend::Over);
    let mut image = expected.image();
    let index = (0..1200).find(|&p| p > 500 && !expected.flip[p].iter().any(|&v| v > 0.0)).unwrap();
    image.pixels_mut()[index][1] += 1e-3;
    let Err(Failure::Differs { what, others, .. }) = compare_images(&expected, &image) else { panic!("accepted") };
    assert_eq!((what, others), (format!("pixel ({}, {}), channel 1", index % 40, index / 40), 0));
}

/// Pixels within rounding of the cut may differ by its height, but no other pixel, not by more, and
/// not too many.
#[test]
fn flips_are_only_allowed_at_discontinuities() {
    let mut expected = rendering(Blend::Sum);
    let image = expected.image();
    expected.flip.iter_mut().for_each(|f| *f = [0.0; 3]);
    let flipped = |pixels: &[usize], by: f32| {
        let mut image = image.clone();
        pixels.iter().for_each(|&p| image.pixels_mut()[p][0] += by);
        image
    };
    let step = 1.0 / 255.0;
    assert!(compare_images(&expected, &flipped(&[7], step as f32)).is_err());
    expected.flip[7] = [step; 3];
    assert_eq!(compare_images(&expected, &flipped(&[7], step as f32)).unwrap().flips, 1);
    assert!(compare_images(&expected, &flipped(&[8], step as f32)).is_err());
    assert!(compare_images(&expected, &flipped(&[7], 2.0 * step as f32)).is_err());
    expected.flip.iter_mut().for_each(|f| *f = [step; 3]);
    let many: Vec<usize> = (0..60).collect();
    assert!(matches!(
        compare_images(&expected, &flipped(&many, step as f32)),
        Err(Failure::TooManyFlips { found: 60, .. })
    ));
}

#[test]
fn empty_images_are_refused() {
    let draw = Draw::new(Kind2d::Typical, Blend::Over, 0, (8, 8), 1).on([0.5; 3]);
    let nothing = Oracle::new(draw.view, draw.settings).unwrap().render(&OracleScene::default());
    assert!(matches!(compare_images(&nothing, &nothing.image()), Err(Failure::Nothing(_))));
}

#[test]
fn only_correct_gradients_pass() {
    for blend in [Blend::Sum, Blend::Over] {
        for loss in [Loss::L2, Loss::L1, Loss::PAPER] {
            let expected = gradients(blend, loss);
            let right = downloaded(&expected);
            let agreement = compare_gradients(&expected, &right).unwrap();
            assert!(agreement.worst_roundings < 1.0 && agreement.flips == 0, "{agreement:?}");

            let mut wrong = vec![right.clone(); 7];
            wrong[0].rotations.iter_mut().for_each(|v| *v = -*v);
            wrong[1].means.iter_mut().for_each(|v| *v = Vec2::new(v.y, v.x));
            wrong[2].log_scales[3].x *= 1.02;
            // D-SSIM has larger tolerances, because its variances are small differences of large
            // moments.
            let one = if matches!(loss, Loss::L1Dssim { .. }) { 1e-2 } else { 1e-3 };
            wrong[3].colors[5].z += one * wrong[3].colors[5].length();
            wrong[4].means.iter_mut().for_each(|v| *v *= 1.01);
            wrong[5].means.swap(2, 4);
            wrong[6].colors[0].x = f32::NAN;
            for (i, wrong) in wrong.iter().enumerate() {
                let result = compare_gradients(&expected, wrong);
                assert!(matches!(result, Err(Failure::Differs { .. })), "{blend:?} {loss:?} {i}: {result:?}");
            }
            if blend == Blend::Over {
                let mut opacity = right.clone();
                opacity.opacity_logits[6] *= -1.0;
                assert!(compare_gradients(&expected, &opacity).is_err());
            }
            let mut short = right.clone();
            short.means.pop();
            assert!(matches!(compare_gradients(&expected, &short), Err(Failure::Nothing(_))));
        }
    }
}

#[test]
fn meaningless_gradients_are_refused() {
    let mut expected = gradients(Blend::Over, Loss::L2);
    let right = downloaded(&expected);
    expected.rounding.iter_mut().for_each(|row| row.iter_mut().for_each(|v| *v *= 1e6));
    assert!(matches!(compare_gradients(&expected, &right), Err(Failure::Nothing(_))));
    expected.values.iter_mut().for_each(|row| row.fill(0.0));
    assert!(matches!(compare_gradients(&expected, &downloaded(&expected)), Err(Failure::Nothing(_))));
}

#[test]
fn a_wrong_loss_is_rejected() {
    for loss in [Loss::L2, Loss::L1, Loss::PAPER] {
        let expected = gradients(Blend::Over, loss);
        compare_loss(&expected, expected.loss as f32).unwrap();
        assert!(compare_loss(&expected, (expected.loss * 1.001) as f32).is_err());
        assert!(compare_loss(&expected, (expected.loss * 3.0) as f32).is_err());
        assert!(compare_loss(&expected, f32::NAN).is_err());
    }
    let zero = Gradients { loss: 0.0, ..gradients(Blend::Sum, Loss::L2) };
    assert!(matches!(compare_loss(&zero, 0.0), Err(Failure::Nothing(_))));
}

/// Ill-conditioned Gaussians have larger tolerances.
#[test]
fn a_needle_is_allowed_more_than_a_disc() {
    let room = |kind| {
        let draw = Draw::new(kind, Blend::Sum, 12, (40, 30), 5);
        let image = Oracle::new(draw.view, RenderSettings::blended(Blend::Sum)).unwrap().render(&(&draw.scene).into());
        image.rounding.as_flattened().iter().copied().fold(0.0, f64::max)
    };
    let (needles, discs) = (room(Kind2d::Needles), room(Kind2d::Overlapping));
    assert!(needles > 4.0 * discs, "{needles:e} and {discs:e}");
    assert!(discs < 1e-5);
}
