//! Cases of gradients from a given gradient of the image, compared with the oracle's.

use gs_core::{
    Error, Image, Loss, Optimizer, Parameterization,
    effects::{Blend, Statistics},
};
use pollster::FutureExt as _;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{place, refused};
use crate::{failure::Failure, oracle::Oracle, scenes::Draw, subject::Subject, tolerance::compare_gradients};

/// Gradients from a random gradient of the image, and from that of a loss, match those of the
/// oracle, whichever statistic the pass collects. A gradient of another size, or one that is not
/// finite, is an error.
pub(crate) fn image_vjps_match<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        for (seed, statistics) in (2380..).zip([Statistics::None, Statistics::PixelError]) {
            for draw in [S::typical(blend, 20, (35, 26), seed), S::overlapping(blend, 12, (17, 9), seed)] {
                let mut draw = draw.on([0.3, 0.6, 0.2]);
                draw.settings.effects.statistics = statistics;
                check(rasterizer, &draw)?;
            }
        }
    }
    let draw = S::typical(Blend::Over, 6, (10, 10), 2384);
    let splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
    for (width, height) in [(11, 10), (10, 9), (5, 20)] {
        let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
        let v_image = Image::filled(width, height, [1.0; 3])?;
        let what = format!("a gradient of {width}x{height} px for a canvas of 10x10 px");
        let found = rasterizer.image_vjp(&splats, pass, &v_image).block_on();
        refused(&what, found, |error| matches!(error, Error::SizesDiffer { .. }))?;
    }
    let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
    let found = rasterizer.image_vjp(&splats, pass, &Image::filled(10, 10, [0.0, f32::NAN, 0.0])?).block_on();
    refused("a gradient that is NaN", found, |error| matches!(error, Error::Pixel { .. }))
}

fn check<S: Subject, R: Optimizer<S>>(rasterizer: &R, draw: &Draw<S>) -> Result<(), Failure> {
    let splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
    let oracle = Oracle::new(draw.view, draw.settings)?;
    let scene = rasterizer.download(&splats).block_on()?.rows();
    let in_place = |failure: Failure| failure.at(place(draw));

    let (width, height) = draw.target()?.size();
    let mut rng = Pcg64::seed_from_u64(draw.target_seed);
    let random = Image::from_fn(width, height, |_, _| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))?;
    let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
    let found = rasterizer.image_vjp(&splats, pass, &random).block_on()?;
    let found = rasterizer.gradients(&splats, &found).block_on()?;
    compare_gradients(&oracle.image_vjp(&scene, &random)?, &found).map_err(in_place)?;

    // ∂L2/∂C = 2 (C − Y) / (3 H W).
    let target = draw.target()?;
    let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
    let image = rasterizer.image(&pass).block_on()?;
    let scale = 2.0 / (3.0 * width as f32 * height as f32);
    let of_loss = Image::from_fn(width, height, |x, y| {
        std::array::from_fn(|k| scale * (image.pixel(x, y)[k] - target.pixel(x, y)[k]))
    })?;
    let found = rasterizer.image_vjp(&splats, pass, &of_loss).block_on()?;
    let found = rasterizer.gradients(&splats, &found).block_on()?;
    compare_gradients(&oracle.gradients(&scene, &target, &Loss::L2)?, &found).map_err(in_place)?;
    Ok(())
}
