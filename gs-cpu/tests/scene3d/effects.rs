//! What a scene does not call for is not to be seen: pictures with what is called for, beside those with all that is wanted.

use gs_core::{
    Effects, Rasterizer, RenderSettings, Scene, Scene3d,
    constants::HALF_DISPLAY_STEP,
    effects::{Antialias, Effect, Order, called_for::Answer},
};
use pollster::FutureExt as _;

use crate::scenes::{camera, rasterizer, scene, settings};

/// Four neighbours of the scenes that others are made of, with harmonics of another strength.
fn few(number: usize, harmonics: f32) -> Scene3d {
    let many = scene(400, 3, 5.0);
    let mut few = Scene3d { sh_degree: 3, ..Scene3d::default() };
    for index in 4 * number..4 * (number + 1) {
        let mut gaussian = many.gaussian(index);
        gaussian.sh[1..].iter_mut().for_each(|c| *c *= harmonics);
        few.push(gaussian);
    }
    few
}

#[test]
fn what_is_not_called_for_is_not_seen() {
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
            let called = Effects::called_for(&scene, views, &wanted).unwrap();
            let picture = |settings: &RenderSettings| cpu.render(&scene, &view, settings).block_on().unwrap();
            let (whole, less) = (picture(&wanted), picture(&called.settings));
            let pixels = whole.pixels().as_flattened().iter().zip(less.pixels().as_flattened());
            let most = pixels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(most <= HALF_DISPLAY_STEP, "scene {number}: {most}, {:#?}", called.verdicts);
            // What is exactly absent leaves every bit as it is; depths at pixels have a kernel of their own, which rounds otherwise.
            let exact = number % 4 == 0 && wanted.effects.order == Order::Global;
            assert!(!exact || whole == less, "scene {number}: {most}, {:#?}", called.verdicts);
            answers.extend(called.verdicts.into_iter().map(|verdict| (verdict.effect, verdict.answer)));
        }
    }
    // None of this means anything unless there is something of each kind.
    use Answer::{CalledFor, InPart, NotCalledFor};
    for kind in [
        (Effect::Order, CalledFor),
        (Effect::Order, InPart),
        (Effect::Order, NotCalledFor),
        (Effect::ShDegree, CalledFor),
        (Effect::ShDegree, NotCalledFor),
        (Effect::Background, CalledFor),
        (Effect::Background, NotCalledFor),
    ] {
        let count = answers.iter().filter(|answer| **answer == kind).count();
        assert!(count >= 4, "{kind:?}: {count}");
    }
}

#[test]
fn an_order_that_is_called_for_would_be_missed() {
    let rasterizer = rasterizer(1);
    let cpu = rasterizer.for_3d();
    let view = camera(64, 48);
    let crowd = scene(60, 0, 9.0);
    let wanted = settings(Order::PerPixel, 0);
    let called = Effects::called_for(&crowd, &[view], &wanted).unwrap();
    assert_eq!(called.settings.effects.order, Order::PerPixel, "{:#?}", called.verdicts);
    let mut cheaper = wanted;
    cheaper.effects.order = Order::Global;
    let (whole, less) = (
        cpu.render(&crowd, &view, &wanted).block_on().unwrap(),
        cpu.render(&crowd, &view, &cheaper).block_on().unwrap(),
    );
    let pixels = whole.pixels().as_flattened().iter().zip(less.pixels().as_flattened());
    assert!(pixels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) > HALF_DISPLAY_STEP);
}
