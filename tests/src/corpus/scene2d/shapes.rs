//! 2D Gaussians of extreme shapes and positions.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::Vec2;
use gs_core::{Canvas, Culled, Gaussian2d, Scene2d, effects::Blend};

use super::common::{BLENDS, PLAIN, VIEW, case};
use crate::corpus::case::{Case, Slopes, Source, Training};

pub(super) fn cases() -> Vec<Case<Scene2d>> {
    BLENDS.into_iter().flat_map(|blend| [thin(blend), needles(blend), sizes(blend), places(blend)]).flatten().collect()
}

/// Gaussians with almost no extent along one or both axes.
fn thin(blend: Blend) -> Vec<Case<Scene2d>> {
    // exp(-104) is 0 in f32. det Σ′ of the first three is at least 1e-6 px⁴.
    let one_axis = [-2.0, -5.0, -7.5, -20.0, -60.0, -104.0];
    let both_axes = [-1.0, -3.0, -3.4, -4.0, -40.0, -104.0];
    vec![
        case(
            "scale → 0 in one axis",
            "Σ becomes singular, and its inverse infinite",
            Source::Paper("§3.4.2"),
            blend,
            one_axis.iter().enumerate().map(|(i, &thin)| Gaussian2d {
                mean: Vec2::new(12.0, 3.5 + 2.0 * i as f32),
                log_scale: Vec2::new(1.5, thin),
                rotation: 0.0,
                ..PLAIN
            }),
        )
        .leaving_out(Culled { degenerate: 3, ..Culled::default() }),
        case(
            "scale → 0 in all axes",
            "Σ becomes 0; what is far narrower than a pixel is seen only where it hits a pixel's centre",
            Source::Report("https://github.com/graphdeco-inria/gaussian-splatting/issues/41"),
            blend,
            both_axes.iter().enumerate().map(|(i, &thin)| Gaussian2d {
                mean: Vec2::new(3.5 + 3.0 * i as f32, 8.5),
                log_scale: Vec2::splat(thin),
                ..PLAIN
            }),
        )
        .leaving_out(Culled { degenerate: 3, ..Culled::default() })
        .training(Training::Finite("a Gaussian between pixel centres is not seen, and moves at random")),
    ]
}

/// Needles, and rotations by angles at which an off-diagonal is lost.
fn needles(blend: Blend) -> Vec<Case<Scene2d>> {
    let cut = Training::Finite("no scale is above 10⁴ px in training: they are cut to it in the first step");
    vec![
        case(
            "needles of aspect 10⁶ at every angle",
            "a·c − b² loses all its digits, and an angle's rounding is as wide as the needle",
            Source::Report("https://github.com/ArthurBrussee/brush/pull/479"),
            blend,
            (0..24).map(|i| Gaussian2d {
                mean: Vec2::new(1.3 + 0.9 * i as f32, 17.2 - 0.7 * i as f32),
                log_scale: Vec2::new(0.3 * 1e6, 0.3).map(f32::ln),
                rotation: PI / 24.0 * i as f32,
                ..PLAIN
            }),
        )
        .sloping(Slopes::Leading(
            "a vertical needle is 10⁴ times steeper than the ridge that kernels follow is from column to column",
        ))
        .training(cut),
        case(
            "needles along the diagonal",
            "Σxx Σyy − Σxy² cancels most where Σxx = Σyy",
            Source::Report("https://github.com/aras-p/UnityGaussianSplatting/pull/14"),
            blend,
            [2.0, 3.0, 4.0, 5.0, 6.0].iter().enumerate().map(|(i, &decades)| Gaussian2d {
                mean: Vec2::new(4.0 + 4.0 * i as f32, 9.0),
                log_scale: Vec2::new(0.4 * 10f32.powf(decades), 0.4).map(f32::ln),
                rotation: 0.5 * FRAC_PI_2,
                ..PLAIN
            }),
        )
        .training(cut),
        case(
            "axis-aligned",
            "the off-diagonal is exactly 0, and with it the eigenvector that some compute from it",
            Source::Report("https://github.com/LioQing/wgpu-3dgs-viewer/pull/18"),
            blend,
            [0.0, FRAC_PI_2, PI, -FRAC_PI_2, -0.0, 2.0 * PI].iter().enumerate().map(|(i, &rotation)| Gaussian2d {
                mean: Vec2::new(3.0 + 3.5 * i as f32, 5.0 + 1.5 * i as f32),
                log_scale: Vec2::new(1.5, -0.3),
                rotation,
                ..PLAIN
            }),
        ),
    ]
}

/// Gaussians much larger than the image, and extreme parameters.
fn sizes(blend: Blend) -> Vec<Case<Scene2d>> {
    // e^(−1/σ²), by which a weight's growth itself grows from row to row, is half way between 1 and
    // the number below it.
    let wide = case(
        "a wide Gaussian down a tall image",
        "weights that follow from those of the row before multiply roundings with each other, hundreds of rows long",
        Source::Definition("constants::ALPHA_CUT"),
        blend,
        [Gaussian2d { mean: Vec2::new(2.3, 90.0), log_scale: Vec2::splat(5793.0f32.ln()), rotation: 0.0, ..PLAIN }],
    );
    vec![
        case(
            "larger than the image",
            "every tile lists each of them, and their slopes are below the rounding of a pixel's place",
            Source::Report("https://github.com/MrNeRF/LichtFeld-Studio/pull/2185"),
            blend,
            [1e2, 1e3, 1e4, 1e6, 1e9, 1e10]
                .iter()
                .map(|&scale: &f32| Gaussian2d { log_scale: Vec2::new(scale, 0.5 * scale).map(f32::ln), ..PLAIN }),
        )
        // (0.5e20 px²)² is beyond f32.
        .leaving_out(Culled { not_finite: 1, ..Culled::default() })
        .training(Training::Finite("no scale is above 10⁴ px in training")),
        Case { view: Canvas::new(5, 257), steps: 50, ..wide },
        case(
            "denormal parameters",
            "GPUs flush them to 0, and a quotient of two is anything",
            Source::Report("https://github.com/ArthurBrussee/brush/pull/522"),
            blend,
            [1e-45, -1e-45, 1e-40, f32::MIN_POSITIVE].iter().map(|&tiny| Gaussian2d {
                mean: Vec2::new(tiny, 9.0 + tiny),
                log_scale: Vec2::new(1.0 + tiny, tiny),
                rotation: tiny,
                opacity_logit: tiny,
                color: glam::Vec3::new(tiny, 0.5, -tiny),
            }),
        ),
    ]
}

/// Gaussians far from the image, and far from the origin.
fn places(blend: Blend) -> Vec<Case<Scene2d>> {
    let far = Canvas::new(VIEW.0, VIEW.1).showing(Vec2::splat(16_777_216.0), Vec2::new(24.0, 19.0));
    let whole = case(
        "coordinates without sub-pixel bits",
        "from 2²⁴ px on, a mean is a whole number of pixels, and a step of Adam is lost or is a pixel",
        Source::Report("https://github.com/mkkellogg/GaussianSplats3D/issues/336"),
        blend,
        (0..4).map(|i| Gaussian2d { mean: Vec2::splat(16_777_216.0) + Vec2::new(4.0 + 4.0 * i as f32, 8.0), ..PLAIN }),
    );
    vec![
        case(
            "10⁶ px away",
            "offsets squared, and the bounds of tiles, far beyond the image",
            Source::Report("https://github.com/aras-p/UnityGaussianSplatting/issues/196"),
            blend,
            [1.0, 4e5, 1e6, 3e6].iter().enumerate().map(|(i, &scale): (usize, &f32)| Gaussian2d {
                mean: Vec2::from_angle(1.4 * i as f32) * 1e6,
                log_scale: Vec2::splat(scale.ln()),
                ..PLAIN
            }),
        )
        .leaving_out(Culled { outside: 1, ..Culled::default() })
        .training(Training::Finite("no scale is above 10⁴ px in training: those that reach the image do so no more")),
        Case { view: far, ..whole }
            .sloping(Slopes::Finite("the analysis allows for means that are off by their own rounding, 2 px"))
            .training(Training::Finite("means move by whole pixels or not at all")),
    ]
}
