//! Results have the same bits for every number of threads.

use gs_core::Optimizer as _;
use gs_core::{
    Adam, Binning, Blend, Loss, MomentFormat, Parameterization, Rasterizer, TrainStep, Wait,
    effects::{Antialias, Order, Statistics},
};
use pollster::FutureExt as _;

use super::scenes::{camera, image, rasterizer, scene, settings};

#[test]
fn results_have_the_same_bits_for_every_number_of_threads() {
    // More Gaussians than fit into one task or one block of the sort.
    let scene = scene(9000, 1, 3.0);
    let (view, image) = (camera(150, 110), image(150, 110));
    for (blend, order, antialias, statistics) in [
        (Blend::Over, Order::Global, Antialias::Mip, Statistics::MeanGradient),
        (Blend::Over, Order::PerPixel, Antialias::Dilate, Statistics::AbsoluteGradient),
        (Blend::Sum, Order::Index, Antialias::None, Statistics::PixelError),
        (Blend::Over, Order::Global, Antialias::Mip, Statistics::PixelGradient),
    ] {
        let mut settings = settings(order, 1);
        settings.effects.blend = blend;
        settings.effects.antialias = antialias;
        settings.effects.statistics = statistics;
        settings.camera_gradient = true;
        let results = [1, 2, 5].map(|threads| {
            let r = rasterizer(threads);
            let r = r.for_3d();
            let target = r.upload_target(&image).unwrap();
            let mut splats = r.upload(&scene, Parameterization::ScaleRotation).unwrap();
            let pass = r.forward(&splats, &view, &settings).block_on().unwrap();
            let rendered = r.image(&pass).block_on().unwrap();
            let (_, gradients) = r.backward(&splats, pass, &target, &Loss::PAPER).block_on().unwrap();
            let mut by_camera = vec![r.camera_gradient(&gradients).block_on().unwrap()];
            let gradients = r.gradients(&splats, &gradients).block_on().unwrap();
            assert!(gradients.means.iter().any(|g| g.length() > 0.0));
            let mut rates = Adam::default().with(|s| s.min_scale = 1e-4).at(0.0);
            if blend == Blend::Over {
                rates.color_rest_moments = MomentFormat::Bf16;
            }
            let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
            for _ in 0..3 {
                r.train_step(&mut splats, &view, &target, &step).block_on().unwrap();
            }
            let mut losses = Vec::new();
            r.losses(&mut splats, Wait::All, &mut losses).block_on().unwrap();
            assert!(losses.iter().all(|loss| loss.is_finite()));
            r.camera_gradients(&mut splats, Wait::All, &mut by_camera).block_on().unwrap();
            assert!(by_camera.len() == 4 && by_camera[1..].iter().all(|g| g.to_array().iter().all(|v| *v != 0.0)));
            let saved = r.save(&splats).block_on().unwrap();
            (rendered, gradients, (losses, by_camera), saved)
        });
        assert!(results[0].3.rows::<1>("gradient_sum").unwrap().iter().any(|[g]| *g > 0.0));
        assert!(results[0] == results[1] && results[1] == results[2], "{blend:?} {order:?}");
    }
}

#[test]
fn training_steps_are_forward_backward_and_step() {
    let scene = scene(300, 2, 4.0);
    let (view, image) = (camera(60, 50), image(60, 50));
    let mut settings = settings(Order::Global, 2);
    settings.effects.statistics = Statistics::MeanGradient;
    let r = rasterizer(2);
    let r = r.for_3d();
    let target = r.upload_target(&image).unwrap();
    let rates = Adam::default().with(|s| {
        s.min_scale = 1e-4;
    });
    let rates = rates.at(0.3);
    let [mut whole, mut parts] = [0, 1].map(|_| r.upload(&scene, Parameterization::ScaleRotation).unwrap());
    let mut losses = Vec::new();
    for _ in 0..5 {
        let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
        r.train_step(&mut whole, &view, &target, &step).block_on().unwrap();
        let pass = r.forward(&parts, &view, &settings).block_on().unwrap();
        let (loss, gradients) = r.backward(&parts, pass, &target, &Loss::PAPER).block_on().unwrap();
        r.step(&mut parts, &gradients, &rates).block_on().unwrap();
        losses.push(loss);
    }
    let mut found = Vec::new();
    r.losses(&mut whole, Wait::All, &mut found).block_on().unwrap();
    assert_eq!(found, losses);
    assert!(losses[4] < losses[0]);
    assert_eq!(r.save(&whole).block_on().unwrap(), r.save(&parts).block_on().unwrap());
}
