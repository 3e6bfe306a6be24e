//! The same bits for every number of threads.

use gs_core::{
    Adam, Blend, Chart, Loss, Rasterizer, TrainStep, Wait,
    effects::{Antialias, Order, Statistics},
    rasterizer::Binning,
};

use crate::scenes::{camera, image, rasterizer, scene, settings};

#[test]
fn images_gradients_and_training_are_the_same_bits_for_every_number_of_threads() {
    // More Gaussians than a task or a block of the sort takes at once.
    let scene = scene(9000, 1, 3.0);
    let (view, image) = (camera(150, 110), image(150, 110));
    for (chart, blend, order, antialias, statistics) in [
        (Chart::ScaleRotation, Blend::Over, Order::TileDepth, Antialias::Mip, Statistics::MeanGradient),
        (Chart::ScaleRotation, Blend::Over, Order::PixelDepth, Antialias::Dilate, Statistics::AbsoluteGradient),
        (Chart::ScaleRotation, Blend::Sum, Order::Index, Antialias::None, Statistics::PixelError),
        (Chart::LocalFrame, Blend::Over, Order::TileDepth, Antialias::Mip, Statistics::MeanGradient),
    ] {
        let mut settings = settings(order, 1);
        settings.effects.blend = blend;
        settings.effects.antialias = antialias;
        settings.effects.statistics = statistics;
        let results = [1, 2, 5].map(|threads| {
            let r = rasterizer(threads);
            let r = r.spatial();
            let target = r.upload_target(&image).unwrap();
            let mut cloud = r.upload(&scene, chart).unwrap();
            let frame = r.forward(&cloud, &view, &settings).unwrap();
            let rendered = r.image(&frame).unwrap();
            let (_, gradients) = r.backward(&cloud, frame, &target, &Loss::PAPER).unwrap();
            let gradients = r.download_gradients(&cloud, &gradients).unwrap();
            assert!(gradients.means.iter().any(|g| g.length() > 0.0));
            let rates = Adam { min_scale: 1e-4, ..Adam::default() }.at(0.0);
            let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
            for _ in 0..3 {
                r.train_step(&mut cloud, &view, &target, &step).unwrap();
            }
            let mut losses = Vec::new();
            r.losses(&mut cloud, Wait::All, &mut losses).unwrap();
            assert!(losses.iter().all(|loss| loss.is_finite()));
            (rendered, gradients, losses, r.save(&cloud).unwrap())
        });
        assert!(results[0].3.rows::<1>("gradient_sum").unwrap().iter().any(|[g]| *g > 0.0));
        assert!(results[0] == results[1] && results[1] == results[2], "{chart:?} {blend:?} {order:?}");
    }
}

#[test]
fn training_steps_are_forward_backward_and_step() {
    let scene = scene(300, 2, 4.0);
    let (view, image) = (camera(60, 50), image(60, 50));
    let mut settings = settings(Order::TileDepth, 2);
    settings.effects.statistics = Statistics::MeanGradient;
    let r = rasterizer(2);
    let r = r.spatial();
    let target = r.upload_target(&image).unwrap();
    let rates = Adam { min_scale: 1e-4, ..Adam::default() }.at(0.3);
    let [mut whole, mut parts] = [0, 1].map(|_| r.upload(&scene, Chart::ScaleRotation).unwrap());
    let mut losses = Vec::new();
    for _ in 0..5 {
        let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
        r.train_step(&mut whole, &view, &target, &step).unwrap();
        let frame = r.forward(&parts, &view, &settings).unwrap();
        let (loss, gradients) = r.backward(&parts, frame, &target, &Loss::PAPER).unwrap();
        r.step(&mut parts, &gradients, &rates).unwrap();
        losses.push(loss);
    }
    let mut found = Vec::new();
    r.losses(&mut whole, Wait::All, &mut found).unwrap();
    assert_eq!(found, losses);
    assert!(losses[4] < losses[0]);
    assert_eq!(r.save(&whole).unwrap(), r.save(&parts).unwrap());
}
