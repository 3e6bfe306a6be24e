//! Scenes and cameras that mean harm: no panic, no NaN, and every Gaussian that is left out is counted.

use glam::{Mat3, Vec2, Vec3};
use gs_core::Optimizer as _;
use gs_core::{
    Adam, Blend, Camera, Error, Gaussian3d, Image, Loss, Parameterization, Rasterizer, Scene, Scene3d, SplatsState,
    TrainStep,
    effects::{Antialias, Order},
    rasterizer::Binning,
    state::{Tensor, TensorData},
    statistics::Culled,
};
use pollster::FutureExt as _;

use crate::scenes::{camera, image, rasterizer, scene, settings};

const CHARTS: [Parameterization; 2] = [Parameterization::ScaleRotation, Parameterization::CovarianceFactor];

fn good() -> Gaussian3d {
    Gaussian3d {
        mean: Vec3::new(0.1, 0.1, 3.0),
        log_scale: Vec3::new(-2.0, -2.5, -1.5),
        rotation: [1.0, 0.2, 0.1, -0.3],
        opacity_logit: 1.0,
        sh: vec![Vec3::splat(0.3); 4],
    }
}

fn hostile() -> Scene3d {
    let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    for gaussian in [
        good(),
        // Around, at and behind the camera.
        Gaussian3d { mean: at(0.0, 0.0, 0.3), log_scale: Vec3::splat(2.0), ..good() },
        Gaussian3d { mean: camera(40, 30).position(), ..good() },
        Gaussian3d { mean: at(0.0, 0.0, -3.0), ..good() },
        Gaussian3d { mean: at(1e30, -1e30, 1e30), ..good() },
        Gaussian3d { mean: at(3e38, 3e38, 3e38), ..good() },
        Gaussian3d { mean: at(1e6, 0.0, 0.5), log_scale: Vec3::splat(10.0), ..good() },
        // Opaque and vanishing.
        Gaussian3d { opacity_logit: f32::INFINITY, ..good() },
        Gaussian3d { opacity_logit: f32::NEG_INFINITY, ..good() },
        Gaussian3d { opacity_logit: 300.0, ..good() },
        // Without direction, without extent, without bounds.
        Gaussian3d { rotation: [0.0; 4], ..good() },
        Gaussian3d { rotation: [1e30, 0.0, 0.0, 1e30], ..good() },
        Gaussian3d { log_scale: Vec3::splat(-100.0), ..good() },
        Gaussian3d { log_scale: Vec3::new(8.0, -100.0, -100.0), ..good() },
        Gaussian3d { log_scale: Vec3::splat(40.0), ..good() },
        Gaussian3d { log_scale: Vec3::splat(100.0), ..good() },
        Gaussian3d { sh: vec![Vec3::splat(3e4); 4], ..good() },
        Gaussian3d { sh: vec![Vec3::splat(-3e4); 4], ..good() },
    ] {
        scene.push(gaussian);
    }
    scene
}

fn finite(image: &Image) -> bool {
    image.pixels().as_flattened().iter().all(|v| v.is_finite())
}

fn total(culled: Culled) -> u32 {
    culled.not_finite + culled.near + culled.degenerate + culled.transparent + culled.outside
}

#[test]
fn hostile_gaussians_leave_pictures_and_gradients_finite() {
    let cpu = rasterizer(2);
    let cpu = cpu.for_3d();
    let (view, target) = (camera(40, 30), cpu.upload_target(&image(40, 30)).unwrap());
    let orders = [(Blend::Sum, Order::Index), (Blend::Over, Order::Global), (Blend::Over, Order::PerPixel)];
    for ((blend, order), parameterization) in
        orders.iter().copied().flat_map(|o| CHARTS.map(|parameterization| (o, parameterization)))
    {
        for antialias in Antialias::ALL {
            let mut settings = settings(order, 1);
            settings.effects.blend = blend;
            settings.effects.antialias = antialias;
            let mut splats = cpu.upload(&hostile(), parameterization).unwrap();
            let factor = cpu.forward(&splats, &view, &settings).block_on().unwrap();
            assert!(finite(&cpu.image(&factor).block_on().unwrap()), "{blend:?} {order:?} {antialias:?}");
            let culled = cpu.culled(&factor);
            assert!(culled.near >= 2 && culled.not_finite >= 2, "{culled:?}");
            assert!(culled.degenerate >= 1 || parameterization == Parameterization::CovarianceFactor, "{culled:?}");
            assert!(total(culled) < hostile().len() as u32);
            let (loss, gradients) = cpu.backward(&splats, factor, &target, &Loss::PAPER).block_on().unwrap();
            assert!(loss.is_finite(), "{blend:?} {order:?} {antialias:?}");
            let g = cpu.gradients(&splats, &gradients).block_on().unwrap();
            let vectors = g.means.iter().chain(&g.log_scales).chain(&g.sh).flat_map(|v| v.to_array());
            let mut numbers = vectors.chain(g.rotations.iter().flatten().copied()).chain(g.opacity_logits.clone());
            assert!(numbers.all(f32::is_finite), "{blend:?} {order:?} {antialias:?}: {g:?}");
            let rates = Adam { min_scale: 1e-4, ..Adam::default() }.at(0.0);
            let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
            for _ in 0..3 {
                cpu.train_step(&mut splats, &view, &target, &step).block_on().unwrap();
            }
        }
    }
}

/// A state whose `what` of every Gaussian is `value`.
fn spoilt(state: &SplatsState, what: &str, value: f32) -> SplatsState {
    let mut state = state.clone();
    let Some(Tensor { data: TensorData::F32(numbers), .. }) = state.tensors.get_mut(what) else { panic!("no {what}") };
    numbers.fill(value);
    state
}

#[test]
fn parameters_that_training_has_lost_are_counted_and_draw_nothing() {
    let cpu = rasterizer(1);
    let cpu = cpu.for_3d();
    let settings = settings(Order::Global, 1);
    let in_parameterization =
        |parameterization| cpu.save(&cpu.upload(&scene(9, 1, 4.0), parameterization).unwrap()).block_on().unwrap();
    let (sound, framed) =
        (in_parameterization(Parameterization::ScaleRotation), in_parameterization(Parameterization::CovarianceFactor));
    let all = ["mean", "log_scale", "rotation", "opacity_logit", "sh"].map(|what| (&sound, what));
    for (sound, what) in all.into_iter().chain([(&framed, "mean"), (&framed, "factor")]) {
        let splats = cpu.restore(&spoilt(sound, what, f32::NAN)).unwrap();
        let factor = cpu.forward(&splats, &camera(40, 30), &settings).block_on().unwrap();
        assert_eq!(cpu.culled(&factor), Culled { not_finite: 9, ..Culled::default() }, "{what}");
        assert!(cpu.image(&factor).block_on().unwrap().pixels().iter().all(|&p| p == settings.background_color()));
        let target = cpu.upload_target(&image(40, 30)).unwrap();
        let (loss, _) = cpu.backward(&splats, factor, &target, &Loss::L1).block_on().unwrap();
        assert!(loss.is_finite());
    }
}

#[test]
fn views_of_nothing_are_the_background() {
    let cpu = rasterizer(2);
    let cpu = cpu.for_3d();
    let settings = settings(Order::Global, 1);
    let away = Camera { rotation: Mat3::from_diagonal(Vec3::new(-1.0, 1.0, -1.0)), ..camera(40, 30) };
    for (scene, near) in [(scene(30, 1, 3.0), 30), (Scene3d::default(), 0)] {
        let mut splats = cpu.upload(&scene, Parameterization::ScaleRotation).unwrap();
        let factor = cpu.forward(&splats, &away, &settings).block_on().unwrap();
        assert_eq!(cpu.culled(&factor), Culled { near, ..Culled::default() });
        assert!(cpu.image(&factor).block_on().unwrap().pixels().iter().all(|&p| p == settings.background_color()));
        let target = cpu.upload_target(&image(40, 30)).unwrap();
        let rates = Adam::default().at(0.0);
        let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
        cpu.train_step(&mut splats, &away, &target, &step).block_on().unwrap();
    }
}

#[test]
fn what_is_not_possible_is_an_error() {
    let cpu = rasterizer(1);
    let cpu = cpu.for_3d();
    let splats = cpu.upload(&scene(3, 0, 3.0), Parameterization::ScaleRotation).unwrap();
    let sound = settings(Order::Global, 0);
    let view = camera(20, 20);
    for spoil in [
        |c: &mut Camera| c.focal = Vec2::new(0.0, 10.0),
        |c: &mut Camera| c.near = f32::NAN,
        |c: &mut Camera| c.width = 0,
        |c: &mut Camera| c.rotation *= 2.0,
        |c: &mut Camera| c.translation.x = f32::INFINITY,
    ] {
        let mut view = view;
        spoil(&mut view);
        assert!(cpu.forward(&splats, &view, &sound).block_on().is_err(), "{view:?}");
    }
    let mut splats = cpu.upload(&scene(3, 0, 3.0), Parameterization::ScaleRotation).unwrap();
    let target = cpu.upload_target(&image(20, 20)).unwrap();
    let solved = cpu.solve_colors(&mut splats, &view, &target, &sound, 3);
    assert!(matches!(solved.block_on(), Err(Error::Unsupported { .. })));
    let factor = cpu.forward(&splats, &view, &sound).block_on().unwrap();
    let other = cpu.upload(&scene(3, 0, 3.0), Parameterization::ScaleRotation).unwrap();
    assert!(matches!(cpu.backward(&other, factor, &target, &Loss::L1).block_on(), Err(Error::State(_))));
}
