//! Effects that a scene does not need change no pixel by more than half a display step.

use gs_core::{
    Effects, Rasterizer, RenderSettings, Scene, Scene3d,
    constants::HALF_DISPLAY_STEP,
    effects::{Antialias, Effect, Order, Requirement},
};
use pollster::FutureExt as _;

use super::scenes::{camera, rasterizer, scene, settings};

/// Four Gaussians of a larger scene, with their SH above degree 0 scaled by `sh_scale`.
fn few(number: usize, sh_scale: f32) -> Scene3d {
    let many = scene(400, 3, 5.0);
    let mut few = Scene3d { sh_degree: 3, ..Scene3d::default() };
    for index in 4 * number..4 * (number + 1) {
        let mut gaussian = many.gaussian(index);
        gaussian.sh[1..].iter_mut().for_each(|c| *c *= sh_scale);
        few.push(gaussian);
    }
    few
}

#[test]
fn effects_that_are_not_required_are_invisible() {
    let rasterizer = rasterizer(2);
    let cpu = rasterizer.for_3d();
    let view = camera(64, 48);
    let mut answers = Vec::new();
    for number in 0..60 {
        let scene = few(number, [0.0, 1e-3, 4e-3, 1.0][number % 4]);
        let mut wanted = settings([Order::PerPixel, Order::Global][number / 4 % 2], 3);
        wanted.effects.antialias = Antialias::Dilate;
        if number % 3 == 0 {
            wanted = wanted.on([0.0; 3]);
        }
        for views in [&[view][..], &[]] {
            let required = Effects::required(&scene, views, &wanted).unwrap();
            let picture = |settings: &RenderSettings| cpu.render(&scene, &view, settings).block_on().unwrap();
            let (whole, less) = (picture(&wanted), picture(&required.settings));
            let pixels = whole.pixels().as_flattened().iter().zip(less.pixels().as_flattened());
            let most = pixels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(most <= HALF_DISPLAY_STEP, "scene {number}: {most}, {:#?}", required.decisions);
            // An effect of exactly zero changes no bit. The sort at each pixel has a kernel of its
            // own, which rounds differently.
            let exact = number % 4 == 0 && wanted.effects.order == Order::Global;
            assert!(!exact || whole == less, "scene {number}: {most}, {:#?}", required.decisions);
            answers.extend(required.decisions.into_iter().map(|verdict| (verdict.effect, verdict.answer)));
        }
    }
    // The scenes must cover every kind of answer.
    use Requirement::{InPart, NotRequired, Required};
    for kind in [
        (Effect::Order, Required),
        (Effect::Order, InPart),
        (Effect::Order, NotRequired),
        (Effect::ShDegree, Required),
        (Effect::ShDegree, NotRequired),
        (Effect::Background, Required),
        (Effect::Background, NotRequired),
    ] {
        let count = answers.iter().filter(|answer| **answer == kind).count();
        assert!(count >= 4, "{kind:?}: {count}");
    }
}

#[test]
fn a_required_order_is_visible() {
    let rasterizer = rasterizer(1);
    let cpu = rasterizer.for_3d();
    let view = camera(64, 48);
    let crowd = scene(60, 0, 9.0);
    let wanted = settings(Order::PerPixel, 0);
    let required = Effects::required(&crowd, &[view], &wanted).unwrap();
    assert_eq!(required.settings.effects.order, Order::PerPixel, "{:#?}", required.decisions);
    let mut cheaper = wanted;
    cheaper.effects.order = Order::Global;
    let (whole, less) = (
        cpu.render(&crowd, &view, &wanted).block_on().unwrap(),
        cpu.render(&crowd, &view, &cheaper).block_on().unwrap(),
    );
    let pixels = whole.pixels().as_flattened().iter().zip(less.pixels().as_flattened());
    assert!(pixels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) > HALF_DISPLAY_STEP);
}
