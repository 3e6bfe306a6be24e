//! Scenes and cameras that mean harm: no panic, no NaN, and every Gaussian that is left out is counted.

use glam::{Mat3, Vec2, Vec3};
use gs_core::{
    Adam, Blend, Camera, Chart, CloudState, Error, Image, Loss, Rasterizer, Scene, SpatialGaussian, SpatialScene,
    TrainStep,
    effects::{Antialias, Exposure, Lens, Order, Outputs},
    rasterizer::Binning,
    state::{Tensor, TensorData},
    statistics::Culled,
};

use crate::scenes::{camera, image, rasterizer, scene, settings};

const CHARTS: [Chart; 2] = [Chart::ScaleRotation, Chart::LocalFrame];

fn good() -> SpatialGaussian {
    SpatialGaussian {
        mean: Vec3::new(0.1, 0.1, 3.0),
        log_scale: Vec3::new(-2.0, -2.5, -1.5),
        rotation: [1.0, 0.2, 0.1, -0.3],
        opacity_logit: 1.0,
        sh: vec![Vec3::splat(0.3); 4],
    }
}

fn hostile() -> SpatialScene {
    let mut scene = SpatialScene { sh_degree: 1, ..SpatialScene::default() };
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    for gaussian in [
        good(),
        // Around, at and behind the camera.
        SpatialGaussian { mean: at(0.0, 0.0, 0.3), log_scale: Vec3::splat(2.0), ..good() },
        SpatialGaussian { mean: camera(40, 30).position(), ..good() },
        SpatialGaussian { mean: at(0.0, 0.0, -3.0), ..good() },
        SpatialGaussian { mean: at(1e30, -1e30, 1e30), ..good() },
        SpatialGaussian { mean: at(3e38, 3e38, 3e38), ..good() },
        SpatialGaussian { mean: at(1e6, 0.0, 0.5), log_scale: Vec3::splat(10.0), ..good() },
        // Opaque and vanishing.
        SpatialGaussian { opacity_logit: f32::INFINITY, ..good() },
        SpatialGaussian { opacity_logit: f32::NEG_INFINITY, ..good() },
        SpatialGaussian { opacity_logit: 300.0, ..good() },
        // Without direction, without extent, without bounds.
        SpatialGaussian { rotation: [0.0; 4], ..good() },
        SpatialGaussian { rotation: [1e30, 0.0, 0.0, 1e30], ..good() },
        SpatialGaussian { log_scale: Vec3::splat(-100.0), ..good() },
        SpatialGaussian { log_scale: Vec3::new(8.0, -100.0, -100.0), ..good() },
        SpatialGaussian { log_scale: Vec3::splat(40.0), ..good() },
        SpatialGaussian { log_scale: Vec3::splat(100.0), ..good() },
        SpatialGaussian { sh: vec![Vec3::splat(3e4); 4], ..good() },
        SpatialGaussian { sh: vec![Vec3::splat(-3e4); 4], ..good() },
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
    let cpu = cpu.spatial();
    let (view, target) = (camera(40, 30), cpu.upload_target(&image(40, 30)).unwrap());
    let orders = [(Blend::Sum, Order::Index), (Blend::Over, Order::TileDepth), (Blend::Over, Order::PixelDepth)];
    for ((blend, order), chart) in orders.iter().copied().flat_map(|o| CHARTS.map(|chart| (o, chart))) {
        for antialias in Antialias::ALL {
            let mut settings = settings(order, 1);
            settings.effects.blend = blend;
            settings.effects.antialias = antialias;
            let mut cloud = cpu.upload(&hostile(), chart).unwrap();
            let frame = cpu.forward(&cloud, &view, &settings).unwrap();
            assert!(finite(&cpu.image(&frame).unwrap()), "{blend:?} {order:?} {antialias:?}");
            let culled = cpu.culled(&frame).unwrap();
            assert!(culled.near >= 2 && culled.not_finite >= 2, "{culled:?}");
            assert!(culled.degenerate >= 1 || chart == Chart::LocalFrame, "{culled:?}");
            assert!(total(culled) < hostile().len() as u32);
            let (loss, gradients) = cpu.backward(&cloud, frame, &target, &Loss::PAPER).unwrap();
            assert!(loss.is_finite(), "{blend:?} {order:?} {antialias:?}");
            let g = cpu.download_gradients(&cloud, &gradients).unwrap();
            let vectors = g.means.iter().chain(&g.log_scales).chain(&g.sh).flat_map(|v| v.to_array());
            let mut numbers = vectors.chain(g.rotations.iter().flatten().copied()).chain(g.opacity_logits.clone());
            assert!(numbers.all(f32::is_finite), "{blend:?} {order:?} {antialias:?}: {g:?}");
            let rates = Adam { min_scale: 1e-4, ..Adam::default() }.at(0.0);
            let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
            for _ in 0..3 {
                cpu.train_step(&mut cloud, &view, &target, &step).unwrap();
            }
        }
    }
}

/// A state whose `what` of every Gaussian is `value`.
fn spoilt(state: &CloudState, what: &str, value: f32) -> CloudState {
    let mut state = state.clone();
    let Some(Tensor { data: TensorData::F32(numbers), .. }) = state.tensors.get_mut(what) else { panic!("no {what}") };
    numbers.fill(value);
    state
}

#[test]
fn parameters_that_training_has_lost_are_counted_and_draw_nothing() {
    let cpu = rasterizer(1);
    let cpu = cpu.spatial();
    let settings = settings(Order::TileDepth, 1);
    let in_chart = |chart| cpu.save(&cpu.upload(&scene(9, 1, 4.0), chart).unwrap()).unwrap();
    let (sound, framed) = (in_chart(Chart::ScaleRotation), in_chart(Chart::LocalFrame));
    let all = ["mean", "log_scale", "rotation", "opacity_logit", "sh"].map(|what| (&sound, what));
    for (sound, what) in all.into_iter().chain([(&framed, "mean"), (&framed, "frame")]) {
        let cloud = cpu.restore(&spoilt(sound, what, f32::NAN)).unwrap();
        let frame = cpu.forward(&cloud, &camera(40, 30), &settings).unwrap();
        assert_eq!(cpu.culled(&frame).unwrap(), Culled { not_finite: 9, ..Culled::default() }, "{what}");
        assert!(cpu.image(&frame).unwrap().pixels().iter().all(|&p| p == settings.backdrop()));
        let target = cpu.upload_target(&image(40, 30)).unwrap();
        let (loss, _) = cpu.backward(&cloud, frame, &target, &Loss::L1).unwrap();
        assert!(loss.is_finite());
    }
}

#[test]
fn views_of_nothing_are_the_backdrop() {
    let cpu = rasterizer(2);
    let cpu = cpu.spatial();
    let settings = settings(Order::TileDepth, 1);
    let away = Camera { rotation: Mat3::from_diagonal(Vec3::new(-1.0, 1.0, -1.0)), ..camera(40, 30) };
    for (scene, near) in [(scene(30, 1, 3.0), 30), (SpatialScene::default(), 0)] {
        let mut cloud = cpu.upload(&scene, Chart::ScaleRotation).unwrap();
        let frame = cpu.forward(&cloud, &away, &settings).unwrap();
        assert_eq!(cpu.culled(&frame).unwrap(), Culled { near, ..Culled::default() });
        assert!(cpu.image(&frame).unwrap().pixels().iter().all(|&p| p == settings.backdrop()));
        let target = cpu.upload_target(&image(40, 30)).unwrap();
        let rates = Adam::default().at(0.0);
        let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
        cpu.train_step(&mut cloud, &away, &target, &step).unwrap();
    }
}

#[test]
fn what_is_not_possible_is_an_error() {
    let cpu = rasterizer(1);
    let cpu = cpu.spatial();
    let cloud = cpu.upload(&scene(3, 0, 3.0), Chart::ScaleRotation).unwrap();
    let sound = settings(Order::TileDepth, 0);
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
        assert!(cpu.forward(&cloud, &view, &sound).is_err(), "{view:?}");
    }
    let mut spoilt = [sound; 3];
    spoilt[0].effects.outputs = Outputs::ColorAlphaDepth;
    spoilt[1].effects.lens = Lens::Distorted;
    spoilt[2].effects.exposure = Exposure::AffinePerView;
    for settings in spoilt {
        assert!(matches!(cpu.forward(&cloud, &view, &settings), Err(Error::Unsupported { .. })));
    }
    let mut cloud = cpu.upload(&scene(3, 0, 3.0), Chart::ScaleRotation).unwrap();
    let target = cpu.upload_target(&image(20, 20)).unwrap();
    let solved = cpu.solve_colors(&mut cloud, &view, &target, &sound, 3);
    assert!(matches!(solved, Err(Error::Unsupported { .. })));
    let frame = cpu.forward(&cloud, &view, &sound).unwrap();
    let other = cpu.upload(&scene(3, 0, 3.0), Chart::ScaleRotation).unwrap();
    assert!(matches!(cpu.backward(&other, frame, &target, &Loss::L1), Err(Error::State(_))));
}
