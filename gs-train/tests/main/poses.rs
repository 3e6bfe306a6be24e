//! Camera poses that are not exact.

use crate::fixture_3d::{camera, rasterizer, render, short, thirty, views};
use glam::Vec3;
use gs_conformance::bits::bits;
use gs_core::{Adam, Camera, adam::Group};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::{
    Control, Observer, Outcome, Progress, TrainSettings, Trainer3d,
    train::{PosesReport, RefinePoses, Start, Views, evaluate_aligned},
};
use pollster::FutureExt as _;

/// A camera that is turned by 0.02 rad, and moved by as much at the distance of the scene.
fn disturbed(i: usize, camera: &Camera) -> Camera {
    let at = |k: usize| ((i * 6 + k) as f32 * 2.4).sin();
    let turn = Vec3::new(at(0), at(1), at(2)).normalize();
    let shift = Vec3::new(at(3), at(4), at(5)).normalize();
    camera.moved(0.05 * shift, 0.02 * turn)
}

fn with_disturbed(mut views: Views) -> Views {
    views.train.iter_mut().enumerate().for_each(|(i, view)| view.camera = disturbed(i, &view.camera));
    views
}

fn settings(refine: RefinePoses) -> TrainSettings {
    let mut settings = short(900).with(|s| s.refine_poses = refine);
    settings.render.effects.sh_degree = 0;
    // A run this short takes larger steps.
    let faster = |group: Group| group.with(|s| s.learning_rate = 4.0 * group.learning_rate);
    let Adam { mean, scale, rotation, color, .. } = settings.adam;
    settings.adam = settings.adam.with(|s| {
        s.mean = faster(mean);
        s.scale = faster(scale);
        s.rotation = faster(rotation);
        s.color = faster(color);
    });
    settings
}

/// Largest distance between where two cameras show some points of the scene, root mean square, px.
fn difference(a: &Camera, b: &Camera) -> f32 {
    let points: Vec<Vec3> = thirty().means;
    let squared = |&point: &Vec3| a.project(point).unwrap().0.distance_squared(b.project(point).unwrap().0);
    (points.iter().map(squared).sum::<f32>() / points.len() as f32).sqrt()
}

/// Trains from random Gaussians.
fn trained(rasterizer: &CpuRasterizer, views: Views, refine: RefinePoses) -> Trainer3d<'_, CpuRasterizer> {
    let start = Start::Random;
    let mut trainer = Trainer3d::from_views(rasterizer, views, start, settings(refine)).block_on().unwrap();
    trainer.run(&mut ()).block_on().unwrap();
    trainer
}

fn errors(trainer: &Trainer3d<'_, CpuRasterizer>) -> f32 {
    let cameras = trainer.views().train_cameras().enumerate();
    let errors: Vec<f32> = cameras.map(|(i, found)| difference(&camera(i), found)).collect();
    errors.iter().sum::<f32>() / errors.len() as f32
}

#[test]
fn disturbed_poses_are_found_again() {
    let rasterizer = rasterizer();
    let all = || with_disturbed(views(&rasterizer));
    let without = trained(&rasterizer, all(), RefinePoses::Off);
    let refined = trained(&rasterizer, all(), RefinePoses::Auto);
    let (before, after) = (errors(&without), errors(&refined));
    assert!(before > 1.0 && after < 0.5 * before, "{before} px, {after} px");
    let report: PosesReport = refined.poses().unwrap();
    assert!(report.used && report.median_degrees > 0.3 && report.most_percent < 5.0, "{report:?}");
    assert!(without.poses().is_none());
    let judged = |trainer: &Trainer3d<'_, CpuRasterizer>| {
        let scene = trainer.scene().block_on().unwrap();
        let test = &trainer.views().test;
        evaluate_aligned(&rasterizer, &scene, test, &trainer.shown()).block_on().unwrap().pose_matched.unwrap().psnr
    };
    assert!(judged(&refined) > judged(&without) + 3.0, "{} dB, {} dB", judged(&refined), judged(&without));
    assert!(refined.evaluate(&|_, _, _| Ok(())).block_on().unwrap().pose_matched.is_some());
}

#[test]
fn exact_poses_stay_and_the_run_has_the_bits_of_one_without_refinement() {
    let rasterizer = rasterizer();
    let mut off = trained(&rasterizer, views(&rasterizer), RefinePoses::Off);
    let mut auto = trained(&rasterizer, views(&rasterizer), RefinePoses::Auto);
    let report = auto.poses().unwrap();
    assert!(!report.used && report.trial_db.unwrap() < 0.1, "{report:?}");
    assert!(auto.views().train_cameras().eq(off.views().train_cameras()));
    assert!(auto.evaluate(&|_, _, _| Ok(())).block_on().unwrap().pose_matched.is_none());
    let checkpoints = [&mut off, &mut auto].map(|trainer| trainer.checkpoint().block_on().unwrap());
    assert_eq!(bits(&checkpoints[0].state), bits(&checkpoints[1].state));
    // A resumed run knows what was decided.
    let [_, checkpoint] = checkpoints;
    let resumed = Trainer3d::resume_views(&rasterizer, views(&rasterizer), checkpoint).unwrap();
    assert_eq!(resumed.poses(), Some(report));
}

#[test]
fn runs_begin_alike_on_any_number_of_threads() {
    let begun = |threads: usize, refine: RefinePoses| {
        let level = None;
        let on = CpuRasterizer::new(CpuSettings::default().with(|s| (s.threads, s.level) = (Some(threads), level)));
        let on = on.unwrap();
        let views = with_disturbed(views(&on));
        let trainer = Trainer3d::from_views(&on, views, Start::Random, settings(refine)).block_on().unwrap();
        assert_eq!(trainer.step(), 0);
        let cameras: Vec<Camera> = trainer.views().train_cameras().copied().collect();
        (trainer.poses().unwrap(), cameras, trainer.scene().block_on().unwrap())
    };
    for refine in [RefinePoses::On, RefinePoses::Auto] {
        assert!(begun(1, refine) == begun(3, refine), "{refine}");
    }
}

#[test]
fn a_scene_is_judged_at_aligned_poses() {
    let rasterizer = rasterizer();
    let mut views = views(&rasterizer);
    views.test.iter_mut().enumerate().for_each(|(i, view)| view.camera = disturbed(i, &view.camera));
    let judged = evaluate_aligned(&rasterizer, &thirty(), &views.test, &render()).block_on().unwrap();
    let aligned = judged.pose_matched.unwrap().psnr;
    assert!(judged.psnr < 30.0 && aligned > judged.psnr + 15.0, "{} dB, {aligned} dB", judged.psnr);
}

/// Stops after a step.
struct StopAt(u32);

impl Observer for StopAt {
    fn on_step(&mut self, progress: &Progress) -> Control {
        if progress.step == self.0 { Control::Stop } else { Control::Continue }
    }
}

#[test]
fn a_resumed_run_keeps_its_poses_on_any_number_of_threads() {
    let rasterizer = rasterizer();
    let all = || with_disturbed(views(&rasterizer));
    let mut whole = trained(&rasterizer, all(), RefinePoses::On);
    let one = CpuRasterizer::new(CpuSettings::default().with(|s| (s.threads, s.level) = (Some(1), None))).unwrap();
    let start = Start::Random;
    let mut first = Trainer3d::from_views(&one, all(), start, settings(RefinePoses::On)).block_on().unwrap();
    assert_eq!(first.run(&mut StopAt(400)).block_on().unwrap(), Outcome::Stopped);
    let checkpoint = first.checkpoint().block_on().unwrap();
    let mut damaged = checkpoint.clone();
    damaged.metadata.insert("refined-poses".to_owned(), "of-views = []\nodd = 1".to_owned());
    assert!(Trainer3d::resume_views(&one, all(), damaged).is_err());
    let mut second = Trainer3d::resume_views(&one, all(), checkpoint).unwrap();
    second.run(&mut ()).block_on().unwrap();
    let cameras = |trainer: &Trainer3d<'_, CpuRasterizer>| trainer.views().train_cameras().copied().collect::<Vec<_>>();
    assert_eq!(cameras(&whole), cameras(&second));
    assert_eq!(whole.poses(), second.poses());
    let states = [&mut whole, &mut second].map(|trainer| trainer.checkpoint().block_on().unwrap().state);
    assert_eq!(bits(&states[0]), bits(&states[1]));
}
