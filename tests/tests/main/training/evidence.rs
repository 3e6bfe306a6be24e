//! Evidence over several views, gathered on both backends.

use super::fixture_3d;
use gs_core::{Optimizer, Scene3d};
use gs_density::{Evidence, EvidenceRequest, PixelSums};
use gs_train::{
    Rounds,
    train::{Start, Trainer3d},
};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use pollster::FutureExt as _;

/// A request for all evidence of all views.
fn everything() -> EvidenceRequest {
    EvidenceRequest::default().with(|s| {
        (s.views, s.edges, s.high_error) = (0, 0.5, 0.3);
        (s.blended, s.covered, s.geometry, s.splitting) = (true, true, true, true);
    })
}

/// The evidence of a round after a step that moves nothing.
fn gathered(on: &impl Optimizer<Scene3d>) -> Evidence {
    let mut settings = fixture_3d::short(2);
    settings.rounds = Rounds::until(1, 1);
    let adam = &mut settings.adam;
    for group in
        [&mut adam.mean, &mut adam.scale, &mut adam.rotation, &mut adam.opacity, &mut adam.color, &mut adam.color_rest]
    {
        group.learning_rate = 0.0;
    }
    let policy = fixture_3d::Curious::new(Some(everything()));
    let views = fixture_3d::views(&fixture_3d::rasterizer());
    let mut trainer =
        Trainer3d::from_views(on, views, Start::Random, settings).block_on().unwrap().controlled_by(policy.clone());
    trainer.run(&mut ()).block_on().unwrap();
    policy.seen.lock().unwrap().take().expect("there was a round").1
}

/// Largest difference, relative to the size of the numbers or to `unit`, whichever is larger.
fn difference<T: Copy + Into<f64>>(found: &[T], expected: &[T], unit: f64) -> f64 {
    assert!(!expected.is_empty() && found.len() == expected.len());
    let of = |(&found, &expected): (&T, &T)| {
        let (found, expected): (f64, f64) = (found.into(), expected.into());
        (found - expected).abs() / expected.abs().max(unit)
    };
    found.iter().zip(expected).map(of).fold(0.0, f64::max)
}

#[test]
fn both_backends_gather_the_same_evidence() {
    let wgpu = WgpuRasterizer::new(WgpuSettings::default()).block_on().expect("`cargo xtask test` installs a driver");
    let (found, expected) = (gathered(&wgpu), gathered(&fixture_3d::rasterizer()));
    assert_eq!((found.views.len(), expected.views.len()), (12, 12));
    for (number, (found, expected)) in found.views.iter().zip(&expected.views).enumerate() {
        let near = |what: &str, difference: f64, most: f64| {
            assert!(difference < most, "{what} of view {number} differ by {difference}");
        };
        near("losses", difference(&[found.loss], &[expected.loss], 1e-3), 1e-4);
        near("depths", difference(&found.depth, &expected.depth, 1e-3), 1e-4);
        near("radii", difference(&found.radius_px, &expected.radius_px, 1.0), 1e-3);
        for (kind, found, expected) in
            [("blended", &found.blended, &expected.blended), ("covered", &found.covered, &expected.covered)]
        {
            let PixelSums { pixels, error, high_error } = found;
            // Pixels at the edge of a footprint, and at the bound of high errors, may be on either
            // side.
            let edge = if kind == "covered" { 100.0 } else { 1.0 };
            near(&format!("pixels, {kind},"), difference(pixels, &expected.pixels, edge), 0.02);
            near(&format!("errors, {kind},"), difference(error, &expected.error, edge), 0.02);
            near(&format!("high errors, {kind},"), difference(high_error, &expected.high_error, 100.0), 0.05);
            let sum = |values: &[f32]| values.iter().sum::<f32>();
            assert!(sum(&expected.error) > 10.0 && sum(&expected.high_error) > 10.0, "{kind}: {number}");
            let of_all = difference(&[sum(high_error)], &[sum(&expected.high_error)], 1.0);
            near(&format!("sums of high errors, {kind},"), of_all, 0.02);
        }
    }
    let [found, expected] = [&found, &expected].map(|evidence| evidence.splitting.as_flattened());
    let largest = expected.iter().fold(0.0f32, |largest, v| largest.max(v.abs()));
    let of_splitting = difference(found, expected, f64::from(largest) / 100.0);
    assert!(largest > 0.0 && of_splitting < 0.01, "splitting matrices differ by {of_splitting}");
}
