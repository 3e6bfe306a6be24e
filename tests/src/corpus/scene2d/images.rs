//! Images of awkward sizes, and very few or very many Gaussians.

use glam::{Vec2, Vec3};
use gs_core::{Canvas, Gaussian2d, Image, Loss, Scene2d, effects::Blend};

use super::common::{BLENDS, PLAIN, case};
use crate::corpus::case::{Case, Goal, Picture, Slopes, Source, Training};

/// Number of entries in one tile: 2²⁰. Twice as many Gaussians exceed WebGPU's default buffer
/// sizes.
const MILLION: usize = 1 << 20;

pub(super) fn cases() -> Vec<Case<Scene2d>> {
    let mut cases = Vec::new();
    for blend in BLENDS {
        cases.push(
            case(
                "no Gaussian",
                "buffers of no length, launches of no threads",
                Source::Report("https://github.com/nerfstudio-project/gsplat/pull/100"),
                blend,
                [],
            )
            .sloping(Slopes::Zero),
        );
        cases.push(case(
            "one Gaussian",
            "the smallest scene that there is",
            Source::Report("https://github.com/nerfstudio-project/gsplat/issues/571"),
            blend,
            [PLAIN],
        ));
        for (width, height) in [(1, 1), (1, 17), (17, 1), (15, 15), (16, 16), (17, 17), (257, 3)] {
            let size = Vec2::new(width as f32, height as f32);
            let gaussians =
                (0..5).map(|i| Gaussian2d { mean: size * (0.1 + 0.2 * i as f32), rotation: 0.7 * i as f32, ..PLAIN });
            let case = case(
                format!("image of {width}×{height} px"),
                "tiles and vectors that are partly beyond the image; SSIM's window wider than it",
                Source::Report("https://github.com/graphdeco-inria/gaussian-splatting/issues/781"),
                blend,
                gaussians,
            );
            cases.push(Case { view: Canvas::new(width, height), ..case }.after(Goal::Likeness(5), Loss::PAPER));
        }
    }
    cases.extend([million(Blend::Sum), million(Blend::Over)]);
    cases
}

/// Tolerance of a sum of a million, in entries: weights of the recurrence are off by some ulps, all
/// alike.
const UNSEEN: f32 = 10.0;

/// 2²⁰ equal Gaussians on the centre of one pixel, of which the sum is 1; under `Over` the first
/// fill the pixel.
fn million(blend: Blend) -> Case<Scene2d> {
    let gaussian = Gaussian2d {
        mean: Vec2::splat(0.5),
        log_scale: Vec2::ZERO,
        rotation: 0.0,
        opacity_logit: 0.0,
        color: Vec3::splat(if blend == Blend::Sum { 1.0 / MILLION as f32 } else { 0.5 }),
    };
    let why = "counts of entries beyond 16 bits, sums of millions, and loops that drivers cut short";
    let source = Source::Report("https://github.com/openvdb/fvdb-core/pull/708");
    let mut case = case("a million entries in one tile", why, source, blend, std::iter::repeat_n(gaussian, MILLION));
    case.view = Canvas::new(1, 1);
    case.settings.effects.background = Default::default();
    case.steps = 1;
    let all = |shown| Image::filled(1, 1, [shown; 3]).expect("one pixel is a possible size");
    let picture = match blend {
        Blend::Sum => Picture::Within(all(1.0), UNSEEN / MILLION as f32),
        // 13 halves leave 2⁻¹³; the next would leave less than the least transmittance of 10⁻⁴.
        Blend::Over => Picture::Exact(all(0.5 * (1.0 - 2f32.powi(-13)))),
    };
    case.showing(picture)
        .sloping(Slopes::Finite("a dense oracle would take minutes"))
        .training(Training::Finite("one step"))
}
