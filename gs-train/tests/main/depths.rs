//! Trainings with depth maps.

use std::sync::Arc;

use glam::Vec3;
use gs_conformance::bits::bits;
use gs_core::{Camera, Image, Output, Rasterizer as _, RenderSettings, Scene3d, effects::Background};
use gs_cpu::CpuRasterizer;
use gs_density::Policy;
use gs_io::dataset::{DepthMap, PosedImage};
use gs_train::{
    Control, Observer, Progress, Recovery, TrainSettings, Trainer3d,
    train::{DepthLoss, ImageSource, PosedView, Start, Views},
};
use pollster::FutureExt as _;

use crate::fixture_3d::{rasterizer, render, short, thirty, views};

/// An image with a depth map.
struct Mapped(PosedImage, DepthMap);

impl ImageSource for Mapped {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        Ok(self.0.clone())
    }

    fn depth(&self) -> Result<Option<DepthMap>, gs_io::Error> {
        Ok(Some(self.1.clone()))
    }
}

/// Inverse depths of a scene; 0 where nothing is.
fn inverse_depths(on: &CpuRasterizer, scene: &Scene3d, camera: &Camera) -> Image {
    let settings: RenderSettings = render().with(|s| {
        s.output = Output::InverseDepth;
        s.effects.background = Background::None;
    });
    on.render(scene, camera, &settings).block_on().unwrap()
}

/// The views of the fixture with maps of the true depths. `value` computes the value of a map from
/// the number of the view and the inverse depth.
fn mapped(on: &CpuRasterizer, unit: Option<f32>, value: impl Fn(usize, f32) -> f32) -> Views {
    let views = views(on);
    let with_map = |(number, view): (usize, PosedView)| {
        let image = inverse_depths(on, &thirty(), &view.camera);
        let values = image.pixels().iter().map(|[inverse, ..]| value(number, *inverse)).collect();
        let map = DepthMap { camera: view.camera, values, unit };
        PosedView { source: Arc::new(Mapped(view.image().unwrap(), map)), ..view }
    };
    Views { train: views.train.into_iter().enumerate().map(with_map).collect(), ..views }
}

/// Depths in world units.
fn metric(_: usize, inverse: f32) -> f32 {
    if inverse > 0.2 { 1.0 / inverse } else { 0.0 }
}

fn settings(weight: f32) -> TrainSettings {
    short(200).with(|s| {
        s.policy = Policy::None;
        s.depth_loss = DepthLoss::default().with(|s| s.weight = weight);
    })
}

#[test]
fn depth_maps_correct_depths_that_images_leave_open() {
    let rasterizer = rasterizer();
    let error = |weight: f32| {
        let mut views = mapped(&rasterizer, Some(1.0), metric);
        views.train.truncate(1);
        let camera = views.train[0].camera;
        // Seen from the camera, a Gaussian that is nearer or farther and of fitting size looks the same.
        let mut scene = thirty();
        for (index, (mean, scale)) in scene.means.iter_mut().zip(&mut scene.log_scales).enumerate() {
            let away = [0.75f32, 1.3][index % 2];
            *mean = camera.position() + away * (*mean - camera.position());
            *scale += Vec3::splat(away.ln());
        }
        let mut settings = settings(weight);
        settings.adam.mean.learning_rate *= 20.0;
        let mut trainer = Trainer3d::from_views(&rasterizer, views, Start::Scene(scene), settings).block_on().unwrap();
        assert_eq!(trainer.depth_maps().map(|counts| (counts.maps, counts.used)), (weight > 0.0).then_some((1, 1)));
        trainer.run(&mut ()).block_on().unwrap();
        let [found, expected] =
            [trainer.scene().block_on().unwrap(), thirty()].map(|scene| inverse_depths(&rasterizer, &scene, &camera));
        let apart = |(a, b): (&[f32; 3], &[f32; 3])| f64::from((a[0] - b[0]).abs());
        found.pixels().iter().zip(expected.pixels()).map(apart).sum::<f64>() / found.pixels().len() as f64
    };
    let (without, with) = (error(0.0), error(1.0));
    assert!(with < 0.75 * without, "{with} with depth maps, {without} without");
}

/// Stops at the given steps.
struct StopAt(Vec<u32>);

impl Observer for StopAt {
    fn on_step(&mut self, progress: &Progress) -> Control {
        if self.0.contains(&progress.step) { Control::Stop } else { Control::Continue }
    }
}

#[test]
fn a_resumed_training_with_depth_maps_ends_bit_identical() {
    // Maps of unknown scale and shift, which are fitted to the renderings of steps 12, 21 and 30.
    let unknown = |number: usize, inverse: f32| inverse * (1.0 + number as f32) + 0.1;
    let first = rasterizer();
    let all = |on: &CpuRasterizer| mapped(on, None, unknown);
    let start = || Start::Scene(thirty());
    let settings = short(60).with(|s| {
        s.depth_loss = DepthLoss::default().with(|s| s.weight = 0.3);
        // A restart would begin with the scene of the checkpoint.
        s.recovery = Recovery::Never;
    });
    let mut whole = Trainer3d::from_views(&first, all(&first), start(), settings.clone()).block_on().unwrap();
    whole.run(&mut ()).block_on().unwrap();
    let mut trainer = Trainer3d::from_views(&first, all(&first), start(), settings).block_on().unwrap();
    let mut stops = StopAt(vec![1, 12, 25]);
    trainer.run(&mut stops).block_on().unwrap();
    for _ in 0..3 {
        let checkpoint = trainer.checkpoint().block_on().unwrap();
        trainer = Trainer3d::resume_views(&first, all(&first), checkpoint).unwrap();
        trainer.run(&mut stops).block_on().unwrap();
    }
    assert!(trainer.is_finished() && trainer.depth_maps().unwrap().maps == 12, "{:?}", trainer.depth_maps());
    assert_eq!(trainer.depth_maps(), whole.depth_maps());
    let [resumed, whole] = [trainer, whole].map(|mut t| t.checkpoint().block_on().unwrap().state);
    assert!(bits(&resumed) == bits(&whole));
}

#[test]
fn without_depth_maps_the_setting_changes_nothing() {
    let rasterizer = rasterizer();
    let state = |weight: f32| {
        let mut trainer =
            Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Scene(thirty()), settings(weight))
                .block_on()
                .unwrap();
        for _ in 0..20 {
            trainer.step_once().block_on().unwrap();
        }
        trainer.checkpoint().block_on().unwrap().state
    };
    assert!(bits(&state(0.0)) == bits(&state(1.0)));
}
