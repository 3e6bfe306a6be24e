//! Cases of losses and gradients, compared with the oracle's.

use glam::Vec2;
use gs_core::{
    Canvas, Loss, Optimizer, Parameterization, Scene2d,
    effects::{Antialias, Blend},
};

use super::{LOSSES, check_gradients, rendering::BLENDS};
use crate::{
    failure::Failure,
    scenes::{Draw, Kind2d},
};

/// Gradients match for every kind of scene, both blends and every loss.
pub(crate) fn gradients_match<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in BLENDS {
        for loss in LOSSES {
            for (seed, kind) in (500..).zip(Kind2d::ALL) {
                let draw = Draw::new(kind, blend, 24, (35, 26), seed).on([0.3, 0.6, 0.2]);
                check_gradients(rasterizer, &draw, &loss, Parameterization::ScaleRotation)?;
            }
        }
    }
    Ok(())
}

/// Gradients match through a dilated Σ′, and through the compensation of the opacity.
pub(crate) fn antialiased_gradients_match_2d<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for (antialias, blend) in [
        (Antialias::Dilate, Blend::Sum),
        (Antialias::Dilate, Blend::Over),
        (Antialias::Mip, Blend::Over),
        (Antialias::Compensated, Blend::Over),
    ] {
        // Sums in the axes of the canvas have too few digits along the axes of dilated needles.
        for (seed, kind) in (2950..).zip(Kind2d::ALL.into_iter().filter(|&kind| kind != Kind2d::Needles)) {
            let draw = Draw::new(kind, blend, 20, (35, 26), seed).on([0.3, 0.6, 0.2]).antialiased(antialias);
            check_gradients(rasterizer, &draw, &Loss::L2, Parameterization::ScaleRotation)?;
        }
    }
    Ok(())
}

/// Gradients match through canvases of odd sizes and other scales.
pub(crate) fn gradients_match_through_canvases<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let views = [
        Canvas::new(1, 1),
        Canvas::new(1, 17),
        Canvas::new(16, 16),
        Canvas::new(33, 3),
        Canvas::new(20, 15).resized(45, 40),
        Canvas::new(20, 15).showing(Vec2::new(5.0, 2.5), Vec2::new(8.0, 11.0)),
    ];
    for blend in BLENDS {
        for loss in LOSSES {
            for (seed, view) in (600..).zip(views) {
                let plane = (view.extent.x as u32, view.extent.y as u32);
                let draw = Draw::new(Kind2d::Overlapping, blend, 6, plane, seed).through(view);
                check_gradients(rasterizer, &draw, &loss, Parameterization::ScaleRotation)?;
            }
        }
    }
    Ok(())
}

/// Gradients are by the scene's parameters in the parameterization of covariance factors, too.
pub(crate) fn gradients_match_in_covariance_factors<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in BLENDS {
        for (seed, kind) in (700..).zip([Kind2d::Typical, Kind2d::OffCanvas, Kind2d::Opaque]) {
            let draw = Draw::new(kind, blend, 20, (30, 30), seed);
            check_gradients(rasterizer, &draw, &Loss::L2, Parameterization::CovarianceFactor)?;
        }
    }
    Ok(())
}
