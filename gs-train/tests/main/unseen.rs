//! Gaussians that no training view shows.

use gs_core::{Scene, Scene3d};
use gs_density::Policy;
use gs_io::dataset::Point;
use gs_train::{
    TrainPreset, TrainSettings, Trainer3d,
    train::{Start, Views},
};
use pollster::FutureExt as _;

use crate::fixture_3d::{camera, rasterizer, short, thirty, views};

/// Number of Gaussians after a few steps on a single view, and how many were pruned.
fn trained(start: Start, settings: TrainSettings) -> (usize, u32) {
    let rasterizer = rasterizer();
    let all = views(&rasterizer);
    let views = Views::new(all.train.into_iter().take(1).collect(), all.test);
    let mut trainer = Trainer3d::from_views(&rasterizer, views, start, settings).block_on().unwrap();
    trainer.run(&mut ()).block_on().unwrap();
    (trainer.scene().block_on().unwrap().len(), trainer.edits().pruned())
}

#[test]
fn gaussians_no_training_view_shows_are_removed_at_the_end() {
    // Behind the only camera, where another view may see it.
    let behind = 2.0 * camera(0).position();
    let mut scene: Scene3d = thirty();
    let mut outsider = scene.gaussian(0);
    outsider.mean = behind;
    scene.push(outsider);
    let points = |scene: &Scene3d| -> Vec<Point> {
        scene.means.iter().map(|&position| Point { position, color: [0.5; 3] }).collect()
    };
    let with = |remove_unseen, exactly| {
        short(6).with(|s| {
            s.policy = Policy::None;
            (s.remove_unseen, s.exactly, s.gaussians) = (remove_unseen, exactly, 31);
        })
    };
    assert_eq!(trained(Start::Points(points(&scene)), with(true, false)), (30, 1));
    assert_eq!(trained(Start::Points(points(&scene)), with(false, false)), (31, 0));
    assert_eq!(trained(Start::Points(points(&scene)), with(true, true)), (31, 0), "exactly 31 were asked for");
    assert_eq!(trained(Start::Scene(scene), with(true, false)), (31, 0), "a scene that is given is not cut");
}

#[test]
fn presets_of_minutes_remove_what_is_unseen() {
    let removing = TrainPreset::ALL.map(|preset| (preset, preset.settings(None).remove_unseen));
    for (preset, removes) in removing {
        assert_eq!(removes, matches!(preset, TrainPreset::Standard | TrainPreset::Quick), "{preset}");
    }
}
