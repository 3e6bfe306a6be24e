//! Reducing scenes.

use glam::{Vec2, Vec3};
use gs_core::{Gaussian3d, Rasterizer, Scene, Scene3d, logit, metrics::l1_and_psnr};
use gs_train::limits::reduce;
use pollster::FutureExt as _;

use crate::fixture_3d::{camera, rasterizer, render, thirty};

/// Six Gaussians around the origin, and a fainter copy of each.
fn copied() -> Scene3d {
    let mut scene = Scene3d::default();
    for i in 0..6 {
        let around = Vec2::from_angle(i as f32 * std::f32::consts::FRAC_PI_3).extend(0.2 * i as f32 - 0.5);
        for opacity in [0.6, 0.4] {
            scene.push(Gaussian3d {
                mean: 0.8 * around,
                log_scale: Vec3::splat(-2.0),
                rotation: [1.0, 0.0, 0.0, 0.0],
                opacity_logit: logit(opacity),
                sh: vec![Vec3::new(1.0, 0.3 * i as f32, 0.5)],
            });
        }
    }
    scene
}

#[test]
fn copies_are_merged_at_little_cost() {
    let on = rasterizer();
    let cameras: Vec<_> = (0..6).map(camera).collect();
    let scene = copied();
    let reduced = reduce(&on, &scene, &cameras, &render(), 6).block_on().unwrap();
    assert_eq!((reduced.scene.len(), reduced.merged, reduced.removed), (6, 6, 0));
    let mut pruned = Scene3d::default();
    (0..6).for_each(|i| pruned.push(scene.gaussian(2 * i)));
    let psnr = |other: &Scene3d| {
        let image = |scene| on.render(scene, &camera(7), &render()).block_on().unwrap();
        l1_and_psnr(&image(other), &image(&scene)).unwrap().1
    };
    let (merged, pruned) = (psnr(&reduced.scene), psnr(&pruned));
    assert!(merged > pruned + 3.0, "{merged} dB merged, {pruned} dB without the copies");
}

#[test]
fn gaussians_no_camera_sees_are_removed_first() {
    let on = rasterizer();
    let cameras: Vec<_> = (0..3).map(camera).collect();
    let mut scene = thirty();
    let mut hidden = scene.gaussian(0);
    hidden.mean.z += 1000.0;
    scene.push(hidden);
    let reduced = reduce(&on, &scene, &cameras, &render(), 30).block_on().unwrap();
    assert_eq!((reduced.scene, reduced.merged, reduced.removed), (thirty(), 0, 1));
    let all = reduce(&on, &scene, &cameras, &render(), 100).block_on().unwrap();
    assert_eq!((all.scene, all.merged, all.removed), (scene.clone(), 0, 0));
    assert!(reduce(&on, &scene, &cameras, &render(), 0).block_on().is_err());
    assert!(reduce(&on, &scene, &[], &render(), 5).block_on().is_err());
}
