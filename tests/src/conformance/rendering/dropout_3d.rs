//! Cases of renderings that leave out Gaussians at random.

use gs_core::{
    Dropout, Loss, Optimizer, Scene3d,
    effects::{Antialias, Blend, Order},
};

use crate::conformance::{check_gradients, check_image, is_refused, parameterizations, rendering::culled};
use crate::{
    failure::Failure,
    scenes::{Draw, Kind3d},
};

/// Images and their gradients match with dropout, in every order that the backend offers, and the
/// Gaussians that are left out count as transparent.
pub(crate) fn dropouts_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for (order, antialias, rate) in [
        (Order::Global, Antialias::Dilate, 0.1),
        (Order::Global, Antialias::Compensated, 0.5),
        (Order::Index, Antialias::Mip, 0.6),
        (Order::PerPixel, Antialias::None, 0.3),
    ] {
        for (seed, kind) in (2680..).zip([Kind3d::Typical, Kind3d::Overlapping, Kind3d::Edge]) {
            let draw = Draw::for_3d(kind, Blend::Over, 40, (35, 26), seed).in_order(order).antialiased(antialias);
            for seed in [7, u32::MAX] {
                let mut draw = draw.clone();
                draw.settings.dropout = Dropout::default().with(|s| (s.rate, s.seed) = (rate, seed));
                if order == Order::PerPixel && is_refused(rasterizer, &draw)? {
                    continue;
                }
                check_image(rasterizer, &draw)?;
                let left_out = (0..40).filter(|&index| draw.settings.dropout.leaves_out(index)).count() as u32;
                let found = culled(rasterizer, &draw.scene, &draw.view, &draw.settings)?.transparent;
                Failure::unless(found >= left_out, || format!("{left_out} are left out, {found} are transparent"))?;
                for parameterization in parameterizations::<Scene3d, R>(rasterizer)? {
                    check_gradients(rasterizer, &draw, &Loss::L2, parameterization)?;
                }
            }
        }
    }
    Ok(())
}
