//! Cases: losses of 3D scenes and their gradients against the oracle.

use gs_core::{
    Loss, Optimizer, Parameterization, Scene3d,
    effects::{Antialias, Blend, Order},
};

use super::{LOSSES, check_gradients, is_refused};
use crate::{
    failure::Failure,
    scenes::{Draw, Kind3d},
};

/// Every kind of scene, both blends, every loss.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn gradients_match_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        for loss in LOSSES {
            for (seed, kind) in (2300..).zip(Kind3d::ALL) {
                let draw = Draw::for_3d(kind, blend, 24, (35, 26), seed).on([0.3, 0.6, 0.2]);
                check_gradients(rasterizer, &draw, &loss, Parameterization::ScaleRotation)?;
            }
        }
    }
    Ok(())
}

/// Gradients in the order of the scene and, where the backend does not refuse it, in that of each pixel's depths.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn gradients_match_in_all_orders<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for order in [Order::Index, Order::PerPixel] {
        for (seed, kind) in (2320..).zip([Kind3d::Typical, Kind3d::Needles, Kind3d::Overlapping, Kind3d::Edge]) {
            let draw = Draw::for_3d(kind, Blend::Over, 20, (35, 26), seed).on([0.3, 0.6, 0.2]).in_order(order);
            if order == Order::Index || !is_refused(rasterizer, &draw)? {
                check_gradients(rasterizer, &draw, &Loss::L2, Parameterization::ScaleRotation)?;
            }
        }
    }
    Ok(())
}

/// Gradients through a widened Σ′, and through the compensation of the opacity.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn antialiased_gradients_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for (antialias, blend) in [
        (Antialias::Dilate, Blend::Over),
        (Antialias::Mip, Blend::Over),
        (Antialias::Mip, Blend::Sum),
        (Antialias::Compensated, Blend::Over),
    ] {
        for (seed, kind) in (2340..).zip([Kind3d::Typical, Kind3d::Tiny, Kind3d::Needles, Kind3d::Edge]) {
            let draw = Draw::for_3d(kind, blend, 20, (35, 26), seed).on([0.3, 0.6, 0.2]).antialiased(antialias);
            check_gradients(rasterizer, &draw, &Loss::L2, Parameterization::ScaleRotation)?;
        }
    }
    Ok(())
}

/// Gradients of all coefficients, and through the direction, where scenes and renderings have other degrees.
///
/// # Errors
/// [`Failure`] where the backend does not do so.
pub fn sh_gradients_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    for seed in 2360..2364 {
        for sh_degree in 0..=3 {
            let mut draw = Draw::for_3d(Kind3d::Overlapping, Blend::Over, 10, (20, 17), seed);
            draw.settings.effects.sh_degree = sh_degree;
            check_gradients(rasterizer, &draw, &Loss::L2, Parameterization::ScaleRotation)?;
        }
    }
    for (seed, size) in (2370..).zip([(1, 1), (1, 17), (16, 16), (33, 3)]) {
        let draw = Draw::for_3d(Kind3d::Overlapping, Blend::Over, 6, size, seed);
        check_gradients(rasterizer, &draw, &Loss::L2, Parameterization::ScaleRotation)?;
    }
    Ok(())
}
