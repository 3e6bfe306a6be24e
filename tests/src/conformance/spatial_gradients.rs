//! Cases: losses of spatial scenes and their gradients against the oracle.

use gs_core::{
    Chart, Loss, Rasterizer, SpatialScene,
    effects::{Antialias, Blend, Order},
};

use super::{LOSSES, check_gradients, is_refused};
use crate::{
    failure::Failure,
    scenes::{Draw, SpatialKind},
};

/// Every kind of scene, both blends, every loss.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn spatial_gradients_match<R: Rasterizer<SpatialScene>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        for loss in LOSSES {
            for (seed, kind) in (2300..).zip(SpatialKind::ALL) {
                let draw = Draw::spatial(kind, blend, 24, (35, 26), seed).on([0.3, 0.6, 0.2]);
                check_gradients(rasterizer, &draw, &loss, Chart::ScaleRotation)?;
            }
        }
    }
    Ok(())
}

/// Gradients in the order of the scene and, where the backend does not refuse it, in that of each pixel's depths.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn gradients_match_in_all_orders<R: Rasterizer<SpatialScene>>(rasterizer: &R) -> Result<(), Failure> {
    for order in [Order::Index, Order::PixelDepth] {
        for (seed, kind) in
            (2320..).zip([SpatialKind::Typical, SpatialKind::Needles, SpatialKind::Overlapping, SpatialKind::Edge])
        {
            let draw = Draw::spatial(kind, Blend::Over, 20, (35, 26), seed).on([0.3, 0.6, 0.2]).in_order(order);
            if order == Order::Index || !is_refused(rasterizer, &draw)? {
                check_gradients(rasterizer, &draw, &Loss::L2, Chart::ScaleRotation)?;
            }
        }
    }
    Ok(())
}

/// Gradients through a widened Σ′, and through the compensation of the opacity.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn antialiased_gradients_match<R: Rasterizer<SpatialScene>>(rasterizer: &R) -> Result<(), Failure> {
    for (antialias, blend) in [
        (Antialias::Dilate, Blend::Over),
        (Antialias::Mip, Blend::Over),
        (Antialias::Mip, Blend::Sum),
        (Antialias::Compensated, Blend::Over),
    ] {
        for (seed, kind) in
            (2340..).zip([SpatialKind::Typical, SpatialKind::Tiny, SpatialKind::Needles, SpatialKind::Edge])
        {
            let draw = Draw::spatial(kind, blend, 20, (35, 26), seed).on([0.3, 0.6, 0.2]).antialiased(antialias);
            check_gradients(rasterizer, &draw, &Loss::L2, Chart::ScaleRotation)?;
        }
    }
    Ok(())
}

/// Gradients of all coefficients, and through the direction, where scenes and renderings have other degrees.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn harmonics_gradients_match<R: Rasterizer<SpatialScene>>(rasterizer: &R) -> Result<(), Failure> {
    for seed in 2360..2364 {
        for sh_degree in 0..=3 {
            let mut draw = Draw::spatial(SpatialKind::Overlapping, Blend::Over, 10, (20, 17), seed);
            draw.settings.effects.sh_degree = sh_degree;
            check_gradients(rasterizer, &draw, &Loss::L2, Chart::ScaleRotation)?;
        }
    }
    for (seed, size) in (2370..).zip([(1, 1), (1, 17), (16, 16), (33, 3)]) {
        let draw = Draw::spatial(SpatialKind::Overlapping, Blend::Over, 6, size, seed);
        check_gradients(rasterizer, &draw, &Loss::L2, Chart::ScaleRotation)?;
    }
    Ok(())
}
