//! Opacities, weights and transmittances at the edges of their definitions.

use glam::{Vec2, Vec3};
use gs_core::{Canvas, Culled, Gaussian2d, Image, Scene, Scene2d, effects::Blend, logit};

use super::common::{PLAIN, case};
use crate::{
    corpus::case::{Case, Picture, STACK_STEPS, Slopes, Source, Training},
    oracle::{Oracle, OracleScene},
};

pub(super) fn cases() -> Vec<Case<Scene2d>> {
    [logits(), edges(), stacks()].into_iter().flatten().collect()
}

fn logits() -> Vec<Case<Scene2d>> {
    let logits = [f32::INFINITY, 88.0, 1e4, f32::NEG_INFINITY, -88.0, -1e4, 89.0, -89.0, 17.0, -5.0];
    let spread = |(i, &opacity_logit): (usize, &f32)| Gaussian2d {
        mean: Vec2::new(2.0 + 2.2 * i as f32, 4.0 + 1.3 * i as f32),
        opacity_logit,
        ..PLAIN
    };
    vec![
        case(
            "opacity logits ±∞, ±88, ±89, ±10⁴",
            "exp overflows, ∞/∞ is NaN, and 1 − o is 0",
            Source::Report("https://github.com/MrNeRF/LichtFeld-Studio/pull/1615"),
            Blend::Over,
            logits.iter().enumerate().map(spread),
        )
        .leaving_out(Culled { transparent: 4, ..Culled::default() }),
    ]
}

/// A pixel with a Gaussian on its centre, so that α is its opacity, exactly or to an ulp: kernels
/// may have it as a power of 2, whose exponent of −1 or so is rounded by as much.
fn one_pixel(name: &str, why: &'static str, source: Source, logit: f32, shown: f32) -> Case<Scene2d> {
    let gaussian = Gaussian2d {
        mean: Vec2::splat(0.5),
        log_scale: Vec2::ZERO,
        rotation: 0.0,
        opacity_logit: logit,
        color: Vec3::ONE,
    };
    let mut case = case(name, why, source, Blend::Over, [gaussian]);
    case.view = Canvas::new(1, 1);
    case.settings.effects.background = Default::default();
    case.showing(Picture::Exact(all(shown)))
}

/// An image of one pixel.
fn all(shown: f32) -> Image {
    Image::filled(1, 1, [shown; 3]).expect("one pixel is a possible size")
}

/// sigmoid(0) is ½ to the bit, and sigmoid of this is 1/(2 + 2⁻²²): two ulps below ½. No opacity is
/// nearer, as 1 + e⁻ˣ is a number above 2, and these are 2⁻²² apart.
const BELOW_HALF: f32 = -2.384_185_8e-7;
const JUST_BELOW_HALF: f32 = 0.499_999_94;

/// Ulps of an opacity that is a hair from another. Four are the rounding of a logit of −5.5, as
/// many that of an exponential and a quotient.
const HAIR_ULPS: f32 = 16.0;

fn edges() -> Vec<Case<Scene2d>> {
    let cut = "the cut is a step in the image: whether α = cut counts must be the same forward, backward and in every backend";
    let clamp = "the gradient of a clamped α is 0, of one just below it is not";
    let at_cut = |name, logit, shown| {
        let mut case = one_pixel(name, cut, Source::Definition("constants::ALPHA_CUT"), logit, shown);
        case.settings.accuracy.alpha_cut = 0.5;
        case.training(Training::Finite("with a cut of ½ half of the range is not drawn at all"))
    };
    let at_clamp = |name, logit, shown| {
        let source = Source::Report("https://github.com/nerfstudio-project/gsplat/issues/65");
        let mut case = one_pixel(name, clamp, source, logit, shown);
        case.settings.accuracy.alpha_max = 0.5;
        case
    };
    let transparent = Culled { transparent: 1, ..Culled::default() };
    let uncertain = Slopes::Finite("one rounding decides between two gradients");
    let mut cases = vec![
        at_cut("α = cut", 0.0, 0.5).sloping(uncertain),
        at_cut("α two ulps below the cut", BELOW_HALF, 0.0).leaving_out(transparent).sloping(Slopes::Zero),
        at_cut("α above the cut", 1e-3, 0.500_25).showing(Picture::Oracle).sloping(uncertain),
        at_clamp("α = clamp", 0.0, 0.5).sloping(uncertain),
        // To less than two ulps: not the clamp itself.
        at_clamp("α two ulps below the clamp", BELOW_HALF, JUST_BELOW_HALF)
            .showing(Picture::Within(all(JUST_BELOW_HALF), f32::EPSILON))
            .sloping(uncertain),
        at_clamp("α above the clamp", 1e-3, 0.5),
    ];
    // The default values, at the smallest distance at which sigmoids of a few ulps can be
    // distinguished from them.
    for (name, opacity, transparent) in [("1/255", 1.0 / 255.0, 1), ("0.999", 0.999f32, 0)] {
        let (at, ulp) = (logit(opacity), opacity.next_up() - opacity);
        let hair = HAIR_ULPS * ulp / (opacity * (1.0 - opacity));
        for (side, logit, transparent) in [("below", at - hair, transparent), ("above", at + hair, 0)] {
            let gaussian =
                Gaussian2d { mean: Vec2::new(8.5, 8.5), opacity_logit: logit, log_scale: Vec2::ZERO, ..PLAIN };
            // Another one, so that there is always something to compare.
            let beside = Gaussian2d { mean: Vec2::new(16.0, 8.0), ..PLAIN };
            let source = Source::Definition("constants::ALPHA_MAX");
            let case = case(format!("o a hair {side} {name}"), cut, source, Blend::Over, [gaussian, beside]);
            cases.push(case.leaving_out(Culled { transparent, ..Culled::default() }).sloping(uncertain));
        }
    }
    cases
}

fn stacks() -> Vec<Case<Scene2d>> {
    let many = 10_000;
    let at = |opacity_logit: f32, scale: f32| {
        (0..many).map(move |i| Gaussian2d {
            mean: Vec2::new(2.5, 1.5),
            log_scale: Vec2::splat(scale.ln()),
            opacity_logit,
            color: Vec3::new(0.9, 0.5, (i % 7) as f32 / 7.0),
            ..PLAIN
        })
    };
    let why = "transmittance is a product of 10,000 factors, and gradients divide by 1 − α";
    let source = Source::Report("https://github.com/nerfstudio-project/gsplat/issues/571");
    let small = |mut case: Case<Scene2d>| {
        case.view = Canvas::new(5, 4);
        case.steps = STACK_STEPS;
        case
    };
    vec![
        small(case("10,000 on one pixel, all opaque", why, source, Blend::Over, at(f32::INFINITY, 1.0)))
            .sloping(Slopes::Finite("10,000 clamped Gaussians in a pixel that two fill")),
        small(case("12 on one pixel, nearly opaque", why, source, Blend::Over, at(6.0, 1.0).take(12)))
            .sloping(Slopes::Finite("what is behind the second is 10⁻⁵ of a pixel")),
        small(case("10,000 on one pixel, all at α = 1/255", why, source, Blend::Over, at(logit(1.02 / 255.0), 0.25))),
        summed(small(case("10,000 on one pixel", why, source, Blend::Sum, at(f32::INFINITY, 1.0)))),
    ]
}

/// Expects the image of one Gaussian that has the summed colours: the case's Gaussians differ in
/// colour only.
fn summed(case: Case<Scene2d>) -> Case<Scene2d> {
    let color = case.scene.colors.iter().map(|color| color.as_dvec3()).sum::<glam::DVec3>().as_vec3();
    let one: Scene2d = [Gaussian2d { color, ..case.scene.gaussian(0) }].into_iter().collect();
    let oracle = Oracle::new(case.view, case.settings).expect("a possible view");
    // A sum of n equal terms may be rounded to the same side n times.
    let worst = case.scene.len() as f32 * f32::EPSILON;
    case.showing(Picture::Within(oracle.render(&OracleScene::from(&one)).image(), worst))
        .sloping(Slopes::Finite("a sum of n equal terms may be rounded to the same side n times"))
        .training(Training::Finite("10,000 colours that all move by a step overshoot 10,000 times"))
}
