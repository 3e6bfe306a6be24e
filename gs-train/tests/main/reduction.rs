//! Reducing scenes.

use gs_core::{Rasterizer, Scene, Scene3d, logit, sigmoid};
use gs_train::{l1_and_psnr, train::reduce};
use pollster::FutureExt as _;

use crate::fixture_3d::{camera, rasterizer, render, thirty};

/// Each Gaussian of the scene as two at its place that together hide as much.
fn doubled() -> Scene3d {
    let mut scene = Scene3d::default();
    for gaussian in (0..30).map(|i| thirty().gaussian(i)) {
        let mut half = gaussian.clone();
        half.opacity_logit = logit(1.0 - (1.0 - sigmoid(gaussian.opacity_logit)).sqrt());
        (0..2).for_each(|_| scene.push(half.clone()));
    }
    scene
}

#[test]
fn copies_are_merged_at_little_cost() {
    let on = rasterizer();
    let cameras: Vec<_> = (0..6).map(camera).collect();
    let scene = doubled();
    let reduced = reduce(&on, &scene, &cameras, &render(), 30).block_on().unwrap();
    assert_eq!((reduced.scene.len(), reduced.merged + reduced.removed), (30, 30));
    assert!(reduced.merged >= 15, "{} merged", reduced.merged);
    let mut pruned = Scene3d::default();
    (0..30).for_each(|i| pruned.push(scene.gaussian(2 * i)));
    let psnr = |other: &Scene3d| {
        let image = |scene| on.render(scene, &camera(7), &render()).block_on().unwrap();
        l1_and_psnr(&image(other), &image(&scene)).1
    };
    let (merged, pruned) = (psnr(&reduced.scene), psnr(&pruned));
    assert!(merged > pruned + 3.0, "{merged} dB merged, {pruned} dB without every second");
}

#[test]
fn what_no_camera_sees_is_removed_first() {
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
