//! gs-wgpu with 3D scenes: the conformance suite with all kernels, drawn scenes compared with the
//! oracle and with gs-cpu, and determinism.

mod moments;

use gs_core::Rasterizer as _;
use pollster::FutureExt as _;

use glam::Vec3;
use gs_conformance::{
    bits::bits,
    conformance::{check_gradients, check_image, conformance_3d},
    properties::{judge, repeatable},
    scenes::{Draw, Kind3d, draws_3d},
};
use gs_core::{
    Accuracy, Adam, AdamRates, Binning, Blend, Camera, Cut, EditPlan, Error, Gaussian3d, Image, Loss, MomentFormat,
    Optimizer, Parameterization, Participants, Penalty, RenderSettings, Scene, Scene3d, SplatsState, TrainStep, Wait,
    effects::{Order, Statistics},
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use proptest::prelude::*;

use crate::gpus::rasterizers;

#[test]
fn conforms_with_all_kernels() {
    for (kernels, rasterizer) in rasterizers() {
        let skipped = conformance_3d(rasterizer).unwrap_or_else(|failure| panic!("{kernels:?}: {failure}"));
        // Covariance factors are the only optional feature that it refuses.
        let others: Vec<_> = skipped.iter().filter(|skipped| !skipped.refused.contains("covariance-factor")).collect();
        assert!(others.is_empty(), "{kernels:?}: {others:?}");
    }
}

const ORDERS: [Order; 3] = [Order::Index, Order::Global, Order::PerPixel];

/// More Gaussians than two blocks of the sort, many of which cover many tiles.
fn many(order: Order) -> Draw<Scene3d> {
    let mut draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 1200, (115, 94), 42).on([0.1, 0.5, 0.3]);
    draw.settings.effects.order = order;
    draw.settings.effects.statistics = Statistics::MeanGradient;
    draw
}

fn cpu() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(2);
        s.level = None;
    }))
    .unwrap()
}

fn root_mean_square(a: &Image, b: &Image) -> f32 {
    let squares = a.pixels().iter().flatten().zip(b.pixels().iter().flatten()).map(|(a, b)| (a - b).powi(2));
    (squares.sum::<f32>() / (3 * a.pixels().len()) as f32).sqrt()
}

/// The comparison would detect a wrong order of two Gaussians in a thousand.
#[test]
fn images_of_many_gaussians_match_the_cpu() {
    for order in ORDERS {
        let draw = many(order);
        let expected = cpu().render(&draw.scene, &draw.view, &draw.settings).block_on().unwrap();
        for (kernels, r) in rasterizers() {
            let found = r.render(&draw.scene, &draw.view, &draw.settings).block_on().unwrap();
            let apart = root_mean_square(&found, &expected);
            assert!(apart < 1e-5, "{kernels:?}, {order:?}: {apart}");
        }
    }
    let images = ORDERS.map(many).map(|d| cpu().render(&d.scene, &d.view, &d.settings).block_on().unwrap());
    for (one, other) in [(0, 1), (1, 2)] {
        let apart = root_mean_square(&images[one], &images[other]);
        assert!(apart > 1e-3, "{:?} is all but {:?}: the comparison cannot fail", ORDERS[one], ORDERS[other]);
    }
}

/// Drawing needs no moments, and no buffer of moments is larger than that of the SH coefficients:
/// software drivers allow 128 MiB.
#[test]
fn every_scene_that_fits_is_drawn_and_trained() {
    let (_, r) = &rasterizers()[0];
    let view = Camera::looking_forward(16, 16, 1.0);
    let mut scene = Scene3d { sh_degree: 3, ..Scene3d::default() };
    let gaussian = Gaussian3d {
        mean: Vec3::new(0.0, 0.0, 5.0),
        log_scale: Vec3::splat(-1.0),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: 0.0,
        sh: vec![Vec3::splat(0.5); 16],
    };
    scene.push(gaussian.clone());
    // Behind the camera.
    let behind = Gaussian3d { mean: Vec3::new(0.0, 0.0, -5.0), ..gaussian };
    for _ in 0..400_000 {
        scene.push(behind.clone());
    }
    let settings = RenderSettings::blended(Blend::Over);
    let target = r.for_3d().upload_target(&Image::filled(16, 16, [0.2; 3]).unwrap()).unwrap();
    let mut splats = r.upload(&scene, Parameterization::ScaleRotation).unwrap();
    let pass = r.forward(&splats, &view, &settings).block_on().unwrap();
    let drawn = r.image(&pass).block_on().unwrap();
    assert!(drawn.pixels().iter().any(|p| p[0] > 0.1));
    let rates = Adam::default().at(0.0);
    let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    r.train_step(&mut splats, &view, &target, &step).block_on().unwrap();
    r.losses(&mut splats, Wait::All, &mut Vec::new()).block_on().unwrap();
    let after = r.download(&splats).block_on().unwrap();
    assert_ne!(after.sh[0], scene.sh[0]);
    assert_eq!(after.sh[16..], scene.sh[16..]);
    // An edit of splats without moments creates them.
    let mut untouched = r.upload(&scene, Parameterization::ScaleRotation).unwrap();
    r.edit(&mut untouched, &EditPlan::default()).block_on().unwrap();
    assert!(r.save(&untouched).block_on().unwrap().matrix("moment1").unwrap().1.iter().all(|&m| m == 0.0));
}

/// Small steps, which do not turn rounding errors of gradients into whole steps.
fn rates(participants: Participants) -> AdamRates {
    let mut adam = Adam::default().with(|s| {
        s.epsilon = 1e-6;
        s.min_scale = 1e-4;
        s.participants = participants;
    });
    adam.mean.learning_rate = 1e-3;
    adam.at(0.0)
}

fn trained<R: Optimizer<Scene3d>>(
    r: &R,
    draw: &Draw<Scene3d>,
    rates: &AdamRates,
    steps: usize,
) -> (SplatsState, Vec<f32>) {
    let target = r.upload_target(&draw.target().unwrap()).unwrap();
    let mut splats = r.upload(&draw.scene, Parameterization::ScaleRotation).unwrap();
    for _ in 0..steps {
        let step = TrainStep { settings: &draw.settings, loss: Loss::PAPER, rates, binning: Binning::Reuse };
        r.train_step(&mut splats, &draw.view, &target, &step).block_on().unwrap();
    }
    let mut losses = Vec::new();
    r.losses(&mut splats, Wait::All, &mut losses).block_on().unwrap();
    (r.save(&splats).block_on().unwrap(), losses)
}

#[test]
fn results_have_the_same_bits_with_and_without_repeated_steps() {
    let by_depth = [Order::Global, Order::PerPixel].map(|order| {
        let mut draw = large();
        draw.settings.effects.order = order;
        draw
    });
    let kernels = rasterizers().iter().map(|&(kernels, _)| kernels);
    for (kernels, draw) in kernels.flat_map(|kernels| by_depth.iter().map(move |draw| (kernels, draw))) {
        let r = WgpuRasterizer::new(WgpuSettings::default().with(|s| s.kernels = Some(kernels))).block_on().unwrap();
        let three_steps = || {
            let before = r.bytes_moved();
            let (state, losses) = trained(&r, draw, &rates(Participants::All), 3);
            (state, losses, r.bytes_moved() - before)
        };
        let (one, losses, more_bytes) = three_steps();
        // The pool has large buffers from now on.
        r.render(&draw.scene, &draw.view, &draw.settings).block_on().unwrap();
        let (two, again, bytes_moved) = three_steps();
        assert!(more_bytes > bytes_moved, "{kernels:?}: no step was repeated");
        assert_eq!(bits(&one), bits(&two), "{kernels:?}");
        assert_eq!((losses.len(), &losses), (3, &again), "{kernels:?}");
        assert!(losses[2] < losses[0], "{kernels:?}: {losses:?}");
        assert_ne!(bits(&one), bits(&trained(&r, draw, &rates(Participants::All), 2).0), "a step changes nothing");
    }
}

/// Steps that are repeated report their gradients by the camera once, and with the same bits.
#[test]
fn repeated_steps_leave_camera_gradients_bit_identical() {
    let mut draw = large();
    draw.settings.camera_gradient = true;
    let all = rates(Participants::All);
    for kernels in rasterizers().iter().map(|&(kernels, _)| kernels) {
        let r = WgpuRasterizer::new(WgpuSettings::default().with(|s| s.kernels = Some(kernels))).block_on().unwrap();
        let target = r.for_3d().upload_target(&draw.target().unwrap()).unwrap();
        let four_steps = || {
            let before = r.bytes_moved();
            let mut splats = r.upload(&draw.scene, Parameterization::ScaleRotation).unwrap();
            let mut gradients = Vec::new();
            for loss in [Loss::L2, Loss::PAPER, Loss::L1, Loss::L2] {
                let step = TrainStep { settings: &draw.settings, loss, rates: &all, binning: Binning::Fresh };
                r.train_step(&mut splats, &draw.view, &target, &step).block_on().unwrap();
                r.camera_gradients(&mut splats, Wait::Arrived, &mut gradients).block_on().unwrap();
            }
            r.camera_gradients(&mut splats, Wait::All, &mut gradients).block_on().unwrap();
            (gradients.iter().map(|g| g.to_array().map(f32::to_bits)).collect::<Vec<_>>(), r.bytes_moved() - before)
        };
        let (repeated, more_bytes) = four_steps();
        // The pool has large buffers from now on.
        r.render(&draw.scene, &draw.view, &draw.settings).block_on().unwrap();
        let (at_once, bytes_moved) = four_steps();
        assert!(more_bytes > bytes_moved, "{kernels:?}: no step was repeated");
        assert_eq!((repeated.len(), &repeated), (4, &at_once), "{kernels:?}");
        assert!(repeated.iter().flatten().all(|v| *v != 0), "{kernels:?}: {repeated:?}");
    }
}

/// Gaussians whose lists do not fit the buffers of a new device.
fn large() -> Draw<Scene3d> {
    Draw::for_3d(Kind3d::Large, Blend::Over, 150, (128, 96), 43)
}

/// The image of a state, by gs-cpu.
fn image_of(state: &SplatsState, draw: &Draw<Scene3d>) -> Image {
    let cpu = cpu();
    let cpu = cpu.for_3d();
    let splats = cpu.restore(state).unwrap();
    cpu.image(&cpu.forward(&splats, &draw.view, &draw.settings).block_on().unwrap()).block_on().unwrap()
}

#[test]
fn ten_steps_match_the_cpu() {
    let draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 60, (60, 44), 11).on([0.3, 0.2, 0.6]);
    let before = cpu().render(&draw.scene, &draw.view, &draw.settings).block_on().unwrap();
    let all = rates(Participants::All);
    let (usual, _) = trained(cpu().for_3d(), &draw, &all, 10);
    let usual = image_of(&usual, &draw);
    let penalised = AdamRates { penalty: Penalty { opacity: 1.0, scale: 1.0 }, ..all };
    // Negative controls: the comparison must reject these.
    for (rates, other) in [(all, &before), (rates(Participants::Visible), &before), (penalised, &usual)] {
        let (expected, _) = trained(cpu().for_3d(), &draw, &rates, 10);
        let image = image_of(&expected, &draw);
        let moved = root_mean_square(&image, other);
        assert!(moved > 1e-3, "{rates:?} move the image by {moved} only");
        for (kernels, r) in rasterizers() {
            let (found, _) = trained(r, &draw, &rates, 10);
            assert_eq!(found.integers("steps").unwrap(), expected.integers("steps").unwrap());
            let apart = root_mean_square(&image_of(&found, &draw), &image);
            assert!(apart < 0.03 * moved, "{kernels:?}: {apart} apart after moving by {moved}");
        }
    }
}

#[test]
fn a_training_step_moves_few_bytes_however_many_gaussians_there_are() {
    let bytes = |gaussians: usize| {
        let r = WgpuRasterizer::new(WgpuSettings::default()).block_on().unwrap();
        let draw = Draw::for_3d(Kind3d::Typical, Blend::Over, gaussians, (120, 80), 3);
        let target = r.for_3d().upload_target(&draw.target().unwrap()).unwrap();
        let mut splats = r.upload(&draw.scene, Parameterization::ScaleRotation).unwrap();
        let rates = rates(Participants::All);
        let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
        // Buffers grow in the first step.
        r.train_step(&mut splats, &draw.view, &target, &step).block_on().unwrap();
        r.losses(&mut splats, Wait::All, &mut Vec::new()).block_on().unwrap();
        let before = r.bytes_moved();
        for _ in 0..5 {
            r.train_step(&mut splats, &draw.view, &target, &step).block_on().unwrap();
        }
        r.losses(&mut splats, Wait::All, &mut Vec::new()).block_on().unwrap();
        r.bytes_moved() - before
    };
    let [few, many] = [30, 3000].map(bytes);
    assert_eq!(few, many);
    assert!(few > 0 && few <= 5 * 560, "{few} bytes in 5 steps");
}

/// The suite allows backends to refuse these; this one offers them.
#[test]
fn all_orders_and_statistics_are_offered() {
    let (_, r) = &rasterizers()[0];
    let mut draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 5, (20, 20), 3);
    for order in ORDERS {
        for statistics in Statistics::ALL.into_iter().filter(|&which| which != Statistics::None) {
            (draw.settings.effects.order, draw.settings.effects.statistics) = (order, statistics);
            r.render(&draw.scene, &draw.view, &draw.settings).block_on().unwrap();
        }
    }
}

/// The statistics with a sort at each pixel, whose kernel has its own sums, compared with gs-cpu.
#[test]
fn statistics_with_a_sort_at_each_pixel_match_the_cpu() {
    let mut draw = Draw::for_3d(Kind3d::Overlapping, Blend::Over, 40, (60, 44), 12).on([0.3, 0.2, 0.6]);
    draw.settings.effects.order = Order::PerPixel;
    let all = rates(Participants::All);
    for statistics in Statistics::ALL.into_iter().filter(|&which| which != Statistics::None) {
        draw.settings.effects.statistics = statistics;
        let means = |state: &SplatsState| -> Vec<(f32, u32)> {
            let (sums, weights) = (state.rows::<1>("gradient_sum").unwrap(), state.integers("visible").unwrap());
            sums.iter().zip(weights).map(|([sum], weight)| (sum / weight.max(1) as f32, weight)).collect()
        };
        let expected = means(&trained(cpu().for_3d(), &draw, &all, 1).0);
        let found = means(&trained(&rasterizers()[0].1, &draw, &all, 1).0);
        let largest = expected.iter().fold(0.0f32, |most, &(mean, _)| most.max(mean));
        assert!(largest > 0.0);
        for (i, ((a, pixels), (b, others))) in expected.into_iter().zip(found).enumerate() {
            // A pixel where the Gaussian is at the cut may count on one of them only.
            assert!(pixels.abs_diff(others) <= 1, "{statistics:?} of Gaussian {i}: {pixels} and {others} px");
            assert!((a - b).abs() <= 1e-3 * (a + 1e-2 * largest), "{statistics:?} of Gaussian {i}: {a} and {b}");
        }
    }
}

/// 60,000 faint Gaussians at one pixel: more than it can sort.
fn too_many_to_order() -> (Scene3d, Camera, RenderSettings) {
    let g = Gaussian3d {
        mean: Vec3::new(0.0, 0.0, 4.0),
        log_scale: Vec3::splat(0.0),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: -11.0,
        sh: vec![Vec3::ONE],
    };
    let at = |i: u16| Gaussian3d { mean: g.mean + Vec3::Z * (f32::from(i) / 65_535.0), ..g.clone() };
    let mut scene = Scene3d::default();
    (0..60_000).for_each(|i| scene.push(at(i)));
    let mut settings = RenderSettings::blended(Blend::Over);
    settings.effects.order = Order::PerPixel;
    (settings.accuracy.alpha_cut, settings.accuracy.transmittance_min) = (1e-6, 0.0);
    (scene, Camera::looking_forward(1, 1, 1.0), settings)
}

#[test]
fn more_gaussians_than_a_pixel_can_sort_are_an_error() {
    let (_, r) = &rasterizers()[0];
    let (scene, view, settings) = too_many_to_order();
    let error = r.render(&scene, &view, &settings).block_on().unwrap_err();
    assert!(error.to_string().contains("more Gaussians than the backend can sort"), "{error}");
}

/// Pending steps after it do not change anything, either.
#[test]
fn a_step_with_unsorted_pixels_changes_nothing() {
    let (_, r) = &rasterizers()[0];
    let (scene, view, settings) = too_many_to_order();
    let target = r.for_3d().upload_target(&Image::filled(1, 1, [0.5; 3]).unwrap()).unwrap();
    let mut splats = r.upload(&scene, Parameterization::ScaleRotation).unwrap();
    let before = r.save(&splats).block_on().unwrap();
    let rates = rates(Participants::All);
    let mut step = |settings: &RenderSettings| {
        let step = TrainStep { settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
        r.train_step(&mut splats, &view, &target, &step).block_on().unwrap();
    };
    step(&settings);
    let mut in_order_of_means = settings;
    in_order_of_means.effects.order = Order::Global;
    step(&in_order_of_means);
    let mut losses = Vec::new();
    let error = r.losses(&mut splats, Wait::All, &mut losses).block_on().unwrap_err();
    assert!(error.to_string().contains("more Gaussians than the backend can sort"), "{error}");
    assert!(losses.is_empty());
    assert!(r.save(&splats).block_on().unwrap() == before, "the splats have changed");

    // Training goes on: with the usual cut, no list is too long for a software driver.
    in_order_of_means.accuracy = Accuracy::default();
    let step = TrainStep { settings: &in_order_of_means, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    r.train_step(&mut splats, &view, &target, &step).block_on().unwrap();
    r.losses(&mut splats, Wait::All, &mut losses).block_on().unwrap();
    assert!(losses.len() == 1 && r.save(&splats).block_on().unwrap() != before, "{losses:?}");
}

#[test]
fn unsupported_features_are_errors_that_name_them() {
    let (_, r) = &rasterizers()[0];
    let draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 5, (20, 20), 3);
    let mut smooth = draw.settings;
    smooth.accuracy.cut = Cut::Smooth;
    let error = r.render(&draw.scene, &draw.view, &smooth).block_on().unwrap_err();
    assert!(matches!(&error, Error::Unsupported { backend: "wgpu", effect } if effect.contains("smooth")), "{error}");
}

proptest! {
    #![proptest_config(repeatable(200, 2027))]

    #[test]
    fn drawn_images_match(draw in draws_3d()) {
        for (_, rasterizer) in rasterizers() {
            judge(check_image(rasterizer, &draw))?;
        }
    }

    #[test]
    fn drawn_gradients_match(draw in draws_3d(), loss in prop_oneof![Just(Loss::L2), Just(Loss::L1), Just(Loss::PAPER)]) {
        for (_, rasterizer) in rasterizers() {
            judge(check_gradients(rasterizer, &draw, &loss, Parameterization::ScaleRotation))?;
        }
    }
}
