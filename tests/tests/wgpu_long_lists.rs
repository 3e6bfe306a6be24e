//! gs-wgpu where a tile's list is longer than one dispatch walks along: the conformance suite with walks of a few entries, and lists so long
//! that software drivers would end their loops, silently, against gs-cpu.

use std::num::NonZero;

use glam::{Vec2, Vec3};
use gs_conformance::{
    conformance::{conformance, conformance_3d},
    scenes::{Draw, Kind},
};
use gs_core::{
    Adam, Binning, Blend, Camera, Canvas, Gaussian2d, Gaussian3d, Image, Loss, Parameterization, Rasterizer,
    RenderSettings, Scene, Scene2d, Scene3d, SplatsState, TrainStep, Wait,
    effects::{Order, Statistics},
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_wgpu::{FreshBuffers, Kernels, Splats2d, Target, WgpuRasterizer, WgpuSettings};

/// A rasterizer of each kind of kernels that the adapter can run, whose dispatches walk along so many entries; `None`: as many as it can.
fn rasterizers(longest_walk: Option<u32>) -> Vec<(Kernels, WgpuRasterizer)> {
    let rasterizer = |kernels| {
        let settings = WgpuSettings {
            fresh_buffers: FreshBuffers::Poison,
            kernels: Some(kernels),
            longest_walk: longest_walk.and_then(NonZero::new),
            ..WgpuSettings::default()
        };
        Some((kernels, WgpuRasterizer::new(settings).ok()?))
    };
    let found: Vec<_> =
        [Kernels::Portable, Kernels::Subgroups, Kernels::Vectors].into_iter().filter_map(rasterizer).collect();
    assert!(!found.is_empty(), "`cargo xtask test` installs a software driver where there is no adapter");
    found
}

/// Seven is no multiple of the batches that any kernel has.
#[test]
fn scene_2d_scenes_conform_in_walks_of_seven_entries() {
    for (kernels, rasterizer) in rasterizers(Some(7)) {
        let skipped = conformance(&rasterizer).unwrap_or_else(|failure| panic!("{kernels:?}:\n{failure}"));
        assert_eq!(skipped, [], "{kernels:?}");
    }
}

#[test]
fn scenes_3d_conform_in_walks_of_seven_entries() {
    for (kernels, rasterizer) in rasterizers(Some(7)) {
        let skipped = conformance_3d(&rasterizer).unwrap_or_else(|failure| panic!("{kernels:?}:\n{failure}"));
        // There are no covariance factors for 3D scenes.
        let others: Vec<_> = skipped.iter().filter(|skipped| !skipped.refused.contains("covariance-factor")).collect();
        assert!(others.is_empty(), "{kernels:?}: {others:?}");
    }
}

/// A step on `view` towards `target`.
fn train(
    r: &WgpuRasterizer,
    splats: &mut Splats2d,
    (view, target): (&Canvas, &Target),
    (settings, loss): (&RenderSettings, Loss),
) {
    let rates = Adam::default().at(0.0);
    let step = TrainStep { settings, loss, rates: &rates, binning: Binning::Fresh };
    r.train_step(splats, view, target, &step).unwrap();
}

/// The losses since they were asked for last, and the whole state.
fn state(r: &WgpuRasterizer, splats: &mut Splats2d) -> (Vec<f32>, SplatsState) {
    let mut losses = Vec::new();
    r.losses(splats, Wait::All, &mut losses).unwrap();
    (losses, r.save(splats).unwrap())
}

/// The same numbers are added in the same order, whatever the walks, and whether a step takes one pass for it or three.
#[test]
fn walks_change_no_bit() {
    for blend in [Blend::Sum, Blend::Over] {
        let draw = Draw::new(Kind::Typical, blend, 300, (40, 30), 9).on([0.2, 0.4, 0.6]);
        for loss in [Loss::L2, Loss::L1, Loss::L1Dssim { lambda: 0.2 }] {
            for ((kernels, whole), (_, in_walks)) in rasterizers(None).iter().zip(&rasterizers(Some(7))) {
                let after = |r: &WgpuRasterizer| {
                    let target = r.for_2d().upload_target(&draw.target().unwrap()).unwrap();
                    let mut splats = r.upload(&draw.scene, Parameterization::ScaleRotation).unwrap();
                    for _ in 0..5 {
                        train(r, &mut splats, (&draw.view, &target), (&draw.settings, loss));
                    }
                    assert_ne!(r.download(&splats).unwrap(), draw.scene, "nothing moved");
                    state(r, &mut splats)
                };
                let (expected, found) = (after(whole), after(in_walks));
                assert!(expected == found, "{kernels:?}, {blend:?}, {loss:?}: {:?}, not {:?}", found.0, expected.0);
            }
        }
    }
}

/// A run that has met long lists goes on as one that was stored behind them, and has not.
#[test]
fn a_run_that_is_resumed_behind_long_lists_goes_on_bit_for_bit() {
    let gaussian = |i: u32| Gaussian2d {
        // Twenty to the left, three to the right.
        mean: Vec2::new(if i < 20 { 8.3 } else { 108.0 } + 0.5 * (i % 5) as f32, 6.0 + 0.25 * i as f32),
        log_scale: Vec2::new(1.1, 0.6),
        rotation: i as f32,
        opacity_logit: 0.5,
        color: Vec3::new(0.1, 0.05, 0.01 * i as f32),
    };
    let scene: Scene2d = (0..23).map(gaussian).collect();
    let left = Canvas::new(16, 16);
    let right = left.showing(Vec2::new(100.0, 0.0), Vec2::splat(16.0));
    let image = Image::filled(16, 16, [0.3, 0.1, 0.2]).unwrap();
    for blend in [Blend::Sum, Blend::Over] {
        let settings = RenderSettings::blended(blend);
        for (kernels, r) in rasterizers(Some(7)) {
            let target = r.for_2d().upload_target(&image).unwrap();
            let mut splats = r.upload(&scene, Parameterization::ScaleRotation).unwrap();
            train(&r, &mut splats, (&left, &target), (&settings, Loss::L2));
            let (_, stored) = state(&r, &mut splats);
            let mut resumed = r.restore(&stored).unwrap();
            let after = |splats: &mut _| {
                for _ in 0..3 {
                    train(&r, splats, (&right, &target), (&settings, Loss::L2));
                }
                state(&r, splats)
            };
            let (expected, found) = (after(&mut splats), after(&mut resumed));
            assert_ne!(expected.1, stored, "nothing moved");
            assert!(expected == found, "{kernels:?}, {blend:?}: {:?}, not {:?}", found.0, expected.0);
        }
    }
}

/// Numbers between -½ and ½.
struct Numbers(u32);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (self.0 >> 8) as f32 / (1 << 24) as f32 - 0.5
    }
}

const MANY: usize = 70_000;

/// More Gaussians in one tile than software drivers let an invocation loop over, half a pixel wide and hardly opaque, so that the last ones
/// are seen, too.
fn scene_2d() -> (Scene2d, Canvas) {
    let mut numbers = Numbers(1);
    let gaussian = |_| Gaussian2d {
        mean: Vec2::new(8.0 + 15.0 * numbers.next(), 8.0 + 15.0 * numbers.next()),
        log_scale: Vec2::new(0.4, 0.5).map(f32::ln),
        rotation: 3.0 * numbers.next(),
        opacity_logit: -4.5,
        color: Vec3::new(numbers.next(), numbers.next(), numbers.next()),
    };
    ((0..MANY).map(gaussian).collect(), Canvas::new(16, 16))
}

/// The same in 3D, at a pixel about as deep as they are apart there.
fn scene_3d() -> (Scene3d, Camera) {
    let view = Camera::looking_forward(16, 16, 1.0);
    let mut scene = Scene3d::default();
    let mut numbers = Numbers(1);
    for _ in 0..MANY {
        let z = 6.0 + 2.0 * numbers.next();
        let size = z / view.focal.x;
        scene.push(Gaussian3d {
            mean: Vec3::new(numbers.next() * 15.0 * size, numbers.next() * 15.0 * size, z),
            log_scale: Vec3::new(0.4 * size, 0.5 * size, 0.0005).map(f32::ln),
            rotation: [1.0, 0.02 * numbers.next(), 0.02 * numbers.next(), 0.0],
            opacity_logit: -4.5,
            sh: vec![Vec3::new(numbers.next(), numbers.next(), numbers.next())],
        });
    }
    (scene, view)
}

fn cpu() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings { threads: Some(2), level: None }).unwrap()
}

/// How far `found` is from `expected`, as a share of how large that is.
fn apart(found: impl Iterator<Item = f32>, expected: impl Iterator<Item = f32>) -> f64 {
    let (mut squares, mut all) = (0.0, 0.0);
    for (found, expected) in found.zip(expected) {
        squares += f64::from(found - expected).powi(2);
        all += f64::from(expected).powi(2);
    }
    assert!(all > 0.0, "there is nothing to compare");
    (squares / all).sqrt()
}

fn numbers(image: &Image) -> impl Iterator<Item = f32> {
    image.pixels().iter().flatten().copied()
}

/// Image, loss and gradients, the last as rows of numbers.
fn outcome<S: Scene, R: Rasterizer<S>>(
    r: &R,
    (scene, view): (&S, &S::View),
    target: &Image,
    settings: &RenderSettings,
) -> (Image, f32, S) {
    let splats = r.upload(scene, Parameterization::ScaleRotation).unwrap();
    let target = r.upload_target(target).unwrap();
    let frame = r.forward(&splats, view, settings).unwrap();
    let image = r.image(&frame).unwrap();
    let (loss, gradients) = r.backward(&splats, frame, &target, &Loss::L2).unwrap();
    (image, loss, r.download_gradients(&splats, &gradients).unwrap())
}

/// What rounding may come to; 1.9e-6 was the most that was measured.
const APART: f64 = 1e-5;

#[test]
fn a_tile_of_many_2d_gaussians_is_that_of_the_cpu() {
    let (scene, view) = scene_2d();
    let target = Image::filled(16, 16, [0.3, 0.1, -0.2]).unwrap();
    for blend in [Blend::Sum, Blend::Over] {
        let settings = RenderSettings::blended(blend).on([0.1, 0.2, 0.3]);
        let expected = outcome(&cpu(), (&scene, &view), &target, &settings);
        for (kernels, r) in rasterizers(None) {
            let found = outcome(&r, (&scene, &view), &target, &settings);
            let image = apart(numbers(&found.0), numbers(&expected.0));
            let of = |scene: &Scene2d| scene.means.iter().flat_map(|m| m.to_array()).collect::<Vec<_>>();
            let means = apart(of(&found.2).into_iter(), of(&expected.2).into_iter());
            let of = |scene: &Scene2d| scene.colors.iter().flat_map(|c| c.to_array()).collect::<Vec<_>>();
            let colors = apart(of(&found.2).into_iter(), of(&expected.2).into_iter());
            assert!(
                image < APART && means < APART && colors < APART,
                "{kernels:?}, {blend:?}: {image}, {means}, {colors}"
            );
        }
    }
}

/// Neighbours in the scene that cover ten thousand tiles each: together more than a software driver lets an invocation loop over, where one
/// adds up what eight of them receive.
#[test]
fn gaussians_that_cover_many_tiles_receive_what_they_do_on_the_cpu() {
    let gaussian = |i: usize| Gaussian2d {
        mean: Vec2::new(200.0 + 170.0 * i as f32, 1500.0 - 150.0 * i as f32),
        log_scale: Vec2::splat(3000.0f32.ln()),
        rotation: 0.3 * i as f32,
        opacity_logit: -1.5,
        color: Vec3::new(0.9, 0.1 * i as f32, 0.5),
    };
    let (scene, view): (Scene2d, _) = ((0..8).map(gaussian).collect(), Canvas::new(1600, 1600));
    let target = Image::filled(1600, 1600, [0.3, 0.1, 0.2]).unwrap();
    let settings = RenderSettings::blended(Blend::Over);
    let expected = outcome(&cpu(), (&scene, &view), &target, &settings).2;
    for (kernels, r) in rasterizers(None) {
        let found = outcome(&r, (&scene, &view), &target, &settings).2;
        for i in 0..8 {
            let of = |scene: &Scene2d| {
                let g = scene.gaussian(i);
                [g.color.to_array().to_vec(), g.mean.to_array().to_vec(), vec![g.opacity_logit]].concat()
            };
            let (found, expected) = (of(&found), of(&expected));
            let apart = apart(found.iter().copied(), expected.iter().copied());
            // Sums of 2.6 million pixels.
            assert!(apart < 1e-3, "{kernels:?}, Gaussian {i}: {found:?} instead of {expected:?}");
        }
    }
}

#[test]
fn training_steps_in_a_tile_of_many_are_those_of_the_cpu() {
    let (scene, view) = scene_2d();
    let target = Image::filled(16, 16, [0.3, 0.1, -0.2]).unwrap();
    let mut settings = RenderSettings::blended(Blend::Over);
    settings.effects.statistics = Statistics::PixelError;
    let rates = Adam::default().at(0.0);
    fn steps<R: Rasterizer<Scene2d>>(
        r: &R,
        scene: &Scene2d,
        (view, target): (&Canvas, &Image),
        step: &TrainStep<'_>,
    ) -> Vec<f32> {
        let mut splats = r.upload(scene, Parameterization::ScaleRotation).unwrap();
        let target = r.upload_target(target).unwrap();
        for _ in 0..3 {
            r.train_step(&mut splats, view, &target, step).unwrap();
        }
        let mut losses = Vec::new();
        r.losses(&mut splats, Wait::All, &mut losses).unwrap();
        losses.extend(r.statistics(&splats).unwrap().gradient_sum);
        losses
    }
    let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let expected = steps(&cpu(), &scene, (&view, &target), &step);
    for (kernels, r) in rasterizers(None) {
        let found = steps(&r, &scene, (&view, &target), &step);
        assert_eq!(found.len(), 3 + MANY);
        let apart = apart(found.into_iter(), expected.iter().copied());
        // Adam's first steps are as long for the smallest gradient as for the largest: 7e-4 was measured.
        assert!(apart < 5e-3, "{kernels:?}: {apart}");
    }
}

#[test]
fn a_tile_of_many_3d_gaussians_is_that_of_the_cpu() {
    let (scene, view) = scene_3d();
    let target = Image::filled(16, 16, [0.3, 0.1, 0.2]).unwrap();
    let mut images = Vec::new();
    for order in [Order::Index, Order::Global, Order::PerPixel] {
        let mut settings = RenderSettings::blended(Blend::Over);
        settings.effects.order = order;
        let expected = outcome(&cpu(), (&scene, &view), &target, &settings);
        for (kernels, r) in rasterizers(None) {
            // There is one kernel for the order of pixels.
            if order == Order::PerPixel && kernels != Kernels::Portable {
                continue;
            }
            let frame =
                r.forward(&r.upload(&scene, Parameterization::ScaleRotation).unwrap(), &view, &settings).unwrap();
            assert!(frame.entries() > 65_535, "{} entries", frame.entries());
            let image = apart(numbers(&r.image(&frame).unwrap()), numbers(&expected.0));
            assert!(image < APART, "{kernels:?}, {order:?}: {image}");
            if order == Order::PerPixel {
                continue; // Half a minute on a software driver; its gradients are held against the oracle's on smaller scenes.
            }
            let found = outcome(&r, (&scene, &view), &target, &settings);
            let of = |scene: &Scene3d| scene.means.iter().flat_map(|m| m.to_array()).collect::<Vec<_>>();
            let means = apart(of(&found.2).into_iter(), of(&expected.2).into_iter());
            assert!(means < APART, "{kernels:?}, {order:?}: {means}");
        }
        images.push(expected.0);
    }
    for (one, other) in [(0, 1), (1, 2), (0, 2)] {
        let apart = apart(numbers(&images[one]), numbers(&images[other]));
        assert!(apart > 3.0 * APART, "the order makes no difference: {apart}");
    }
}
