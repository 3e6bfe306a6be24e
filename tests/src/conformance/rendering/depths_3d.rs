//! Cases of renderings of inverse depths and of alpha.

use gs_core::{
    Image, Loss, Optimizer, Output, RenderSettings, Scene3d,
    effects::{Antialias, Blend, Order},
};
use pollster::FutureExt as _;

use crate::conformance::{check_gradients, check_image, is_refused, parameterizations};
use crate::{
    failure::Failure,
    scenes::{Draw, Kind3d},
};

/// Images of inverse depths and their gradients match, in every order that the backend offers, for
/// both blends and every parameterization.
pub(crate) fn inverse_depths_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    output_matches(rasterizer, Output::InverseDepth)
}

/// Alphas and their gradients match likewise, and are what shows of the background: the difference of
/// a picture before white and before black is 1 − alpha.
pub(crate) fn alphas_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    output_matches(rasterizer, Output::Alpha)?;
    for (seed, kind) in (2670..).zip([Kind3d::Typical, Kind3d::Overlapping]) {
        let draw = Draw::for_3d(kind, Blend::Over, 20, (35, 26), seed);
        let image = |settings: &RenderSettings| rasterizer.render(&draw.scene, &draw.view, settings).block_on();
        let [black, white] = [0.0, 1.0].map(|value| image(&draw.settings.on([value; 3])));
        let (black, white, alpha) = (black?, white?, image(&draw.settings.of_alpha())?);
        let values = |image: &Image| image.pixels().as_flattened().to_vec();
        let (black, white, alpha) = (values(&black), values(&white), values(&alpha));
        let off = |i: usize| (white[i] - black[i] - (1.0 - alpha[i])).abs();
        let worst = (0..alpha.len()).map(off).fold(0.0, f32::max);
        Failure::unless(worst < 1e-5, || format!("{kind:?}: alpha is off by {worst}"))?;
        let most = alpha.iter().copied().fold(0.0, f32::max);
        Failure::unless(most > 0.5 && most <= 1.0, || format!("{kind:?}: alpha reaches {most}"))?;
    }
    Ok(())
}

fn output_matches<R: Optimizer<Scene3d>>(rasterizer: &R, output: Output) -> Result<(), Failure> {
    for (order, blend, antialias) in [
        (Order::Global, Blend::Over, Antialias::Dilate),
        (Order::Global, Blend::Sum, Antialias::None),
        (Order::Index, Blend::Over, Antialias::Mip),
        (Order::PerPixel, Blend::Over, Antialias::None),
    ] {
        for (seed, kind) in (2660..).zip([Kind3d::Typical, Kind3d::Overlapping, Kind3d::Edge]) {
            let mut draw = Draw::for_3d(kind, blend, 20, (35, 26), seed).in_order(order).antialiased(antialias);
            draw.settings.output = output;
            if order == Order::PerPixel && is_refused(rasterizer, &draw)? {
                continue;
            }
            check_image(rasterizer, &draw)?;
            for parameterization in parameterizations::<Scene3d, R>(rasterizer)? {
                for loss in [Loss::L1, Loss::L2] {
                    check_gradients(rasterizer, &draw, &loss, parameterization)?;
                }
            }
        }
    }
    Ok(())
}
