//! What keeps a training from fitting its views too closely: dropout, and penalties on opacities and
//! scales.

use crate::{
    fixture_3d::{rasterizer, short, thirty, views},
    train::trained,
};
use gs_core::{Penalty, Scene as _, sigmoid};
use gs_density::Policy;
use gs_train::{MetricsLog, Trainer3d, train::Start};
use pollster::FutureExt as _;

#[test]
fn a_dropout_leaves_out_more_and_more_gaussians() {
    let rasterizer = rasterizer();
    let loss = |dropout: f32| {
        let mut settings = short(40).with(|s| s.dropout = dropout);
        settings.policy = Policy::None;
        // Only the dropout changes what is seen.
        settings.adam = settings.adam.with(|s| s.opacity.learning_rate = 0.0);
        let mut log = MetricsLog::new(1);
        let mut trainer = Trainer3d::from_views(&rasterizer, views(&rasterizer), Start::Scene(thirty()), settings)
            .block_on()
            .unwrap();
        trainer.run(&mut log).block_on().unwrap();
        let losses: Vec<f32> = log.rows().iter().map(|row| row.loss).collect();
        [&losses[..10], &losses[30..]].map(|part| part.iter().sum::<f32>() / part.len() as f32)
    };
    let ([_, without], [first, last]) = (loss(0.0), loss(0.5));
    assert!(last > 1.5 * first && first > without, "{without}, {first}, {last}");
}

#[test]
fn penalties_make_gaussians_fainter_and_smaller() {
    let rasterizer = rasterizer();
    let means = |penalty| {
        let mut settings = short(60).with(|s| s.policy = Policy::None);
        settings.adam.penalty = penalty;
        let (scene, _) = trained(settings, views(&rasterizer), Start::Random);
        let count = scene.len() as f32;
        let opacity = scene.opacity_logits.iter().map(|&l| sigmoid(l)).sum::<f32>() / count;
        (opacity, scene.log_scales.iter().map(|s| s.map(f32::exp).element_sum()).sum::<f32>() / (3.0 * count))
    };
    let (opacity, scale) = means(Penalty::NONE);
    let (fainter, _) = means(Penalty { opacity: 10.0, scale: 0.0 });
    assert!(fainter < 0.5 * opacity, "{fainter}, not {opacity}");
    let (_, smaller) = means(Penalty { opacity: 0.0, scale: 10.0 });
    assert!(smaller < 0.9 * scale, "{smaller}, not {scale}");
}
