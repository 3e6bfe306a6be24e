//! Orders of blending that are hard to determine, and extreme sort keys.

use glam::{Vec2, Vec3};
use gs_core::{Culled, Gaussian3d, Scene3d, effects::Order, logit};

use super::common::{camera, case, ordered, plain, seen};
use crate::corpus::case::{Case, STACK_STEPS, Slopes, Source, Training};

const ORDERS: [Order; 3] = [Order::Index, Order::Global, Order::PerPixel];

/// The source of the stacks.
const OF_STACKS: Source = Source::Report("https://github.com/nerfstudio-project/gsplat/issues/571");

pub(super) fn cases() -> Vec<Case<Scene3d>> {
    let swaps = Training::Finite("means that trade places make the loss jump");
    let by_order = ORDERS.into_iter().flat_map(|order| {
        [equal_depths(), interpenetrating(), keys_at_their_limits()].map(|case| ordered(case, order).training(swaps))
    });
    by_order.chain([opaque_stack(), faint_stack(), logits_at_their_limits(), coincident()]).collect()
}

/// Colours of a few hues, which make a wrong order visible.
fn hue(i: usize) -> Vec<Vec3> {
    vec![[Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE][i % 4] * 1.5]
}

fn equal_depths() -> Case<Scene3d> {
    case(
        "equal depths",
        "the sort decides the order of equal keys: images that flicker",
        Source::Report("https://github.com/huggingface/gsplat.js/issues/48"),
        (0..12).map(|i| Gaussian3d {
            sh: hue(i),
            ..seen(Vec2::new(9.0 + 0.5 * i as f32, 9.5), [2.0, 3.0][i % 2], Vec3::new(3.0, 2.0, 1.0))
        }),
    )
}

fn interpenetrating() -> Case<Scene3d> {
    case(
        "two that interpenetrate",
        "neither is in front: with one depth each, the picture pops when the camera turns",
        Source::Paper("§5.4"),
        [0.7f32, -0.7].into_iter().enumerate().map(|(i, turn)| Gaussian3d {
            rotation: [turn.cos(), 0.0, turn.sin(), 0.0],
            opacity_logit: 3.0,
            sh: hue(i),
            ..seen(Vec2::new(12.0, 9.5), 3.0 + 1e-3 * i as f32, Vec3::new(8.0, 4.0, 0.4))
        }),
    )
}

fn keys_at_their_limits() -> Case<Scene3d> {
    let near = camera().near;
    let depths =
        [1e18, near, near.next_up(), 1.0, 1f32.next_up(), 1f32.next_down(), 3e9, 2f32.powi(24), 1e18f32.next_up()];
    case(
        "sort keys at their limits",
        "depths that differ by one bit, the least and the largest that there are",
        Source::Report("https://github.com/matiaszanolli/ByroRedux/issues/306"),
        depths
            .into_iter()
            .enumerate()
            .map(|(i, z)| Gaussian3d { sh: hue(i), ..seen(Vec2::new(12.0 + i as f32, 9.5), z, Vec3::splat(2.5)) }),
    )
}

fn opaque_stack() -> Case<Scene3d> {
    stack("10,000 on one pixel, all opaque", f32::INFINITY, 1.0)
        .sloping(Slopes::Finite("10,000 clamped Gaussians in a pixel that two fill"))
}

fn faint_stack() -> Case<Scene3d> {
    stack("10,000 on one pixel, all at α = 1/255", logit(1.02 / 255.0), 0.25)
        .sloping(Slopes::Leading("by a mean on a pixel's centre it is 0, or a rounding of the mean"))
}

/// 10,000 Gaussians on one pixel.
fn stack(name: &str, opacity_logit: f32, scale_px: f32) -> Case<Scene3d> {
    let gaussians = (0..10_000).map(|i| Gaussian3d {
        opacity_logit,
        sh: hue(i),
        ..seen(Vec2::new(2.5, 1.5), 2.0 + 1e-4 * (i % 5000) as f32, Vec3::splat(scale_px))
    });
    let why = "transmittance is a product of 10,000 factors, and gradients divide by 1 − α";
    let mut stacked = case(name, why, OF_STACKS, gaussians)
        .training(Training::Finite("whoever comes to the front decides about the pixel"));
    // The stack of `seen` is where the whole camera has its pixel (2, 1): a crop has it there too.
    (stacked.view.width, stacked.view.height) = (5, 4);
    stacked.steps = STACK_STEPS;
    stacked
}

fn logits_at_their_limits() -> Case<Scene3d> {
    let logits = [f32::INFINITY, 88.0, 1e4, f32::NEG_INFINITY, -88.0, -1e4, 17.0];
    case(
        "opacity logits ±∞, ±88, ±10⁴",
        "exp overflows, ∞/∞ is NaN, and 1 − o is 0",
        Source::Report("https://github.com/MrNeRF/LichtFeld-Studio/pull/1615"),
        logits.into_iter().enumerate().map(|(i, opacity_logit)| {
            // The means are on pixels' centres, where opaque Gaussians are clamped.
            let pixel = Vec2::new(3.5 + 3.0 * i as f32, 4.5 + 2.0 * i as f32);
            Gaussian3d { opacity_logit, ..seen(pixel, 3.0, Vec3::new(3.0, 2.0, 1.0)) }
        }),
    )
    .leaving_out(Culled { transparent: 3, ..Culled::default() })
}

fn coincident() -> Case<Scene3d> {
    let why = "equal in everything: neither depth nor shape distinguishes them";
    case("coincident", why, OF_STACKS, vec![plain(); 7])
}
