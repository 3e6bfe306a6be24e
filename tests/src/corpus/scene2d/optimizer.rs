//! Losses and optimizers at their edge cases.

use glam::Vec2;
use gs_core::{Culled, Gaussian2d, Image, Loss, Scene2d, adam::Group, effects::Blend};

use super::common::{BLENDS, PLAIN, VIEW, case};
use crate::corpus::case::{Case, Goal, Picture, Slopes, Source, Training};

fn flat(value: f32) -> Goal {
    Goal::Image(Image::filled(VIEW.0, VIEW.1, [value; 3]).expect("a possible size"))
}

fn some() -> impl Iterator<Item = Gaussian2d> {
    (0..5).map(|i| Gaussian2d {
        mean: Vec2::new(4.0 + 4.0 * i as f32, 14.0 - 2.0 * i as f32),
        rotation: i as f32,
        ..PLAIN
    })
}

pub(super) fn cases() -> Vec<Case<Scene2d>> {
    BLENDS.into_iter().flat_map(|blend| [still(blend), constant(blend), steps(blend)]).flatten().collect()
}

/// Training that must not move anything.
fn still(blend: Blend) -> Vec<Case<Scene2d>> {
    // If a step's image differs by a rounding, it has a gradient, which Adam with its ε of 1e-15
    // turns into a whole step.
    let exact = |(name, loss)| {
        case(
            format!("loss exactly 0 ({name})"),
            "√v̂ is 0 where no gradient has ever been: Adam divides 0 by ε",
            Source::Report("https://github.com/nerfstudio-project/gsplat/issues/248"),
            blend,
            some(),
        )
        .after(Goal::Itself, loss)
    };
    let unseen = case(
        "Adam with gradients of 0",
        "moments decay to denormals, and 0/0",
        Source::Report("https://github.com/nerfstudio-project/gsplat/pull/214"),
        blend,
        [900.0, 1e4].map(|far| Gaussian2d { mean: Vec2::splat(far), ..PLAIN }),
    )
    .leaving_out(Culled { outside: 2, ..Culled::default() });
    [("L2", Loss::L2), ("L1", Loss::L1)]
        .map(exact)
        .into_iter()
        .chain([unseen])
        .map(|case| case.sloping(Slopes::Zero).training(Training::StandsStill))
        .collect()
}

/// Images of one colour, of which SSIM's variances are 0.
fn constant(blend: Blend) -> Vec<Case<Scene2d>> {
    let source = Source::Report("https://github.com/rahul-goel/fused-ssim/pull/37");
    let of_unit = |(name, value)| {
        let why = "variances are 0, or rounding makes them negative";
        case(format!("constant {name} image in SSIM"), why, source, blend, some())
            .after(flat(value), Loss::L1Dssim { lambda: 1.0 })
    };
    let bright = |exponent| {
        let why = "variances of HDR values are differences of their squares, which rounding makes negative, or which overflow";
        case(format!("constant image of 10^{exponent} in SSIM"), why, source, blend, some())
            .after(flat(10f32.powi(exponent)), Loss::PAPER)
            .sloping(Slopes::Finite("SSIM's squares leave no digits"))
            .training(Training::Finite("at 10⁴, what rounding leaves of a variance is more than C2"))
    };
    let why = "both images are constant and equal: SSIM is 0/0 but for its constants";
    let background = case("constant image of the background in SSIM", why, source, blend, []);
    let settings = background.settings.on([0.6; 3]);
    let equal = Image::filled(VIEW.0, VIEW.1, [0.6; 3]).expect("a possible size");
    let background = Case { settings, ..background }
        .after(flat(0.6), Loss::PAPER)
        .showing(Picture::Exact(equal))
        .sloping(Slopes::Zero)
        .training(Training::Finite("1 − SSIM is a rounding off 0"));
    let of_units = [("black", 0.0), ("white", 1.0)].map(of_unit);
    of_units.into_iter().chain([4, 30].map(bright)).chain([background]).collect()
}

/// Huge steps and gradients.
fn steps(blend: Blend) -> Vec<Case<Scene2d>> {
    // The target is the background, so that the Gaussian should shrink. It is alone, to make that
    // visible.
    let nothing = Image::filled(VIEW.0, VIEW.1, [0.2, 0.3, 0.1]).expect("a possible size");
    let shrinking = case(
        "steps of e⁴ in scale",
        "exp(η) to second order is 5 at η = −4: what should shrink grows, and more with each step",
        Source::Definition("constants::MAX_ETA"),
        blend,
        [PLAIN],
    )
    .after(Goal::Image(nothing), Loss::L2);
    let shrinking = Case { adam: shrinking.adam.with(|s| s.scale = Group::constant(4.0)), steps: 2, ..shrinking };
    let steep = |exponent| {
        case(
            format!("Adam with gradients of 10^{exponent}"),
            "g² overflows from 2·10¹⁹ on: v̂ is ∞ for ever after, and g/√v̂ is 0 or NaN",
            Source::Report("https://github.com/graphdeco-inria/gaussian-splatting/issues/41"),
            blend,
            some(),
        )
        .after(flat(10f32.powi(exponent)), Loss::L2)
        .sloping(Slopes::Finite("beyond f32's range in the loss, if not in the gradients"))
        .training(Training::Moves)
    };
    [shrinking].into_iter().chain([10, 18, 30, 38].map(steep)).collect()
}
