//! What is masked or transparent counts as it should.

use std::sync::Arc;

use crate::{
    fixture_3d::{changed, rasterizer, render, short, thirty, views},
    train::trained,
};
use gs_core::Image;
use gs_density::Policy;
use gs_io::dataset::PosedImage;
use gs_train::{
    Error, Trainer3d,
    train::{Start, evaluate},
};
use pollster::FutureExt as _;

#[test]
fn masked_pixels_do_not_count() {
    let rasterizer = rasterizer();
    // The left half of every image is painted over, and masked.
    let spoiled = |masked: bool| {
        changed(views(&rasterizer), |_, posed| {
            let (width, height) = posed.image.size();
            let left = |x: u32| x < width / 2;
            let paint = |x, y| if left(x) { [0.0, 1.0, 0.0] } else { posed.image.pixel(x, y) };
            let image = Image::from_fn(width, height, paint).unwrap();
            let mask = (0..height).flat_map(|_| (0..width).map(left)).map(|painted| !painted).collect();
            PosedImage { image, alpha: None, mask: masked.then_some(mask) }
        })
    };
    let quality = |masked| {
        let mut settings = short(40);
        settings.policy = Policy::None;
        trained(settings, spoiled(masked), Start::Scene(thirty())).1.psnr
    };
    let (with_mask, without) = (quality(true), quality(false));
    assert!(with_mask > 32.0 && without < with_mask - 5.0, "{with_mask} dB with the mask, {without} dB without");
}

#[test]
fn the_loss_of_a_masked_step_is_reported_in_its_place() {
    let rasterizer = rasterizer();
    let half_masked = changed(views(&rasterizer), |i, posed| {
        let mask = (i % 2 == 0).then(|| vec![true; posed.image.pixels().len()]);
        PosedImage { mask, ..posed }
    });
    let losses = |views| {
        let mut trainer = Trainer3d::from_views(&rasterizer, views, Start::Random, short(24)).block_on().unwrap();
        let mut losses = Vec::new();
        while !trainer.is_finished() {
            trainer.step_once().block_on().unwrap();
            losses.extend_from_slice(trainer.new_losses().1);
        }
        losses
    };
    let (plain, masked) = (losses(views(&rasterizer)), losses(half_masked));
    assert_eq!((plain.len(), masked.len()), (24, 24));
    for (step, (plain, masked)) in plain.iter().zip(&masked).enumerate() {
        assert!((plain - masked).abs() < 1e-3 * plain, "step {step}: a mask that hides nothing: {plain}, {masked}");
    }
}

#[test]
fn a_test_view_of_which_no_pixel_counts_is_in_no_mean() {
    let rasterizer = rasterizer();
    let masked = |hidden: usize| {
        let mut views = views(&rasterizer);
        for view in &mut views.test[..hidden] {
            let posed = view.image().unwrap();
            let mask = Some(vec![false; posed.image.pixels().len()]);
            view.source = Arc::new(PosedImage { mask, ..posed });
        }
        views
    };
    // Not the scene that the images show, whose PSNR is infinite.
    let mut fainter = thirty();
    fainter.opacity_logits.iter_mut().for_each(|logit| *logit -= 0.5);
    let judged = |hidden| evaluate(&rasterizer, &fainter, &masked(hidden).test, &render()).block_on();
    let two = judged(1).unwrap();
    assert_eq!((two.views.len(), two.unmeasured.as_slice()), (2, &["view-12".to_owned()][..]));
    let all = judged(0).unwrap();
    assert!((two.ssim - (all.views[1].ssim + all.views[2].ssim) / 2.0).abs() < 1e-12 && two.psnr.is_finite());
    assert!(matches!(judged(3), Err(Error::NothingCounts { views: 3 })));
    // While it trains, too.
    let quality = |hidden| {
        Trainer3d::from_views(&rasterizer, masked(hidden), Start::Scene(fainter.clone()), short(40))
            .block_on()
            .unwrap()
            .quality()
            .block_on()
    };
    // A measurement lists the views that count, as the evaluation does.
    let (seen, judged) = (quality(1).unwrap(), judged(1).unwrap());
    assert_eq!(seen.views, judged.views.iter().map(|view| view.psnr).collect::<Vec<_>>());
    assert_eq!((seen.views.len(), seen.psnr), (2, judged.psnr));
    assert!(quality(2).unwrap().psnr.is_finite());
    assert!(matches!(quality(3), Err(Error::NothingCounts { views: 3 })));
}
