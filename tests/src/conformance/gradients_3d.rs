//! Cases of losses and gradients of 3D scenes, compared with the oracle's.

use gs_core::{
    Loss, Optimizer, Parameterization, Scene3d,
    effects::{Antialias, Blend, Order},
};

use super::{LOSSES, check_gradients, is_refused};
use crate::{
    failure::Failure,
    scenes::{Draw, Kind3d},
};

/// Gradients match for every kind of scene, both blends and every loss.
pub(crate) fn gradients_match_3d<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
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

/// Gradients match in the order of the scene and, unless the backend refuses it, with a sort at
/// each pixel.
pub(crate) fn gradients_match_in_all_orders<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
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

/// Gradients match through a dilated Σ′, and through the compensation of the opacity.
pub(crate) fn antialiased_gradients_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
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

/// Gradients by all SH coefficients, and through the direction, match if scene and rendering have
/// different degrees.
pub(crate) fn sh_gradients_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
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
