//! Stage `project`: computes the [`Splat`] of every Gaussian. Parallel over Gaussians.
//!
//! With L′ = the factor L on the canvas, Σ′ = L′ L′ᵀ + δ I. Its determinant is computed as
//! det² L′ + δ tr + δ², which does not cancel.

use glam::{Mat2, Vec2};
use gs_core::{Blend, Canvas, CullCause, Culled, RenderSettings, constants::MIN_DETERMINANT_PX4, sigmoid};
use rayon::prelude::*;

use super::splats::Splats2d;
use crate::{
    splat::{CHUNK, Covariance, Splat},
    tiles::Tiles,
};

/// L′ and the mean on the canvas: plane coordinates scaled to pixels.
pub(crate) fn on_canvas(canvas: &Canvas, mean: Vec2, factor: Mat2) -> (Vec2, Mat2) {
    let scale = canvas.scale();
    ((mean - canvas.origin) * scale, Mat2::from_cols(factor.x_axis * scale, factor.y_axis * scale))
}

/// One Gaussian's splat, or the reason why it is culled.
fn project(mean: Vec2, l: Mat2, color: [f32; 3], opacity: f32, settings: &RenderSettings) -> Result<Splat, CullCause> {
    let antialias = settings.effects.antialias;
    let delta = antialias.dilation();
    let xx = l.x_axis.x * l.x_axis.x + l.y_axis.x * l.y_axis.x;
    let yy = l.x_axis.y * l.x_axis.y + l.y_axis.y * l.y_axis.y;
    let xy = l.x_axis.x * l.x_axis.y + l.y_axis.x * l.y_axis.y;
    let undilated = l.determinant().powi(2);
    let determinant = undilated + delta * (xx + yy) + delta * delta;
    let (xx, yy) = (xx + delta, yy + delta);
    let placed = mean.is_finite() && !opacity.is_nan();
    let sized = determinant.is_finite() && (xx * yy).is_finite();
    let colored = color.iter().all(|c| c.is_finite());
    if !(placed && sized && colored) {
        return Err(CullCause::NotFinite);
    }
    if !(determinant >= MIN_DETERMINANT_PX4) {
        return Err(CullCause::Degenerate);
    }
    let opacity = match (settings.effects.blend, antialias) {
        (Blend::Over, antialias) if antialias.compensates() => opacity * (undilated / determinant).sqrt(),
        _ => opacity,
    };
    if !(opacity >= settings.accuracy.alpha_cut) {
        return Err(CullCause::Transparent);
    }
    Ok(Splat::new(mean, Covariance { xx, xy, yy, determinant }, color, (opacity, settings.accuracy.alpha_cut)))
}

/// Projects all Gaussians in the order `order` (rank → index) into `tiles`, and counts the culled.
pub(crate) fn project_all(splats: &Splats2d, canvas: &Canvas, order: &[u32], tiles: &mut Tiles) {
    let Tiles { settings, projected, .. } = tiles;
    let settings = &*settings;
    projected.resize(order.len(), Splat::CULLED);
    let opaque = settings.effects.blend == Blend::Sum || splats.opacity_logits.is_empty();
    let chunk = |(out, order): (&mut [Splat], &[u32])| {
        let mut culled = Culled::default();
        for (splat, &index) in out.iter_mut().zip(order) {
            let index = index as usize;
            let (mean, l) = on_canvas(canvas, splats.means[index], splats.factor(index));
            let opacity = if opaque { 1.0 } else { sigmoid(splats.opacity_logits[index]) };
            *splat = project(mean, l, splats.colors[index], opacity, settings).unwrap_or_else(|cause| {
                culled.count(cause);
                Splat::CULLED
            });
        }
        culled
    };
    let chunks = projected.par_chunks_mut(CHUNK).zip(order.par_chunks(CHUNK)).map(chunk);
    tiles.culled = chunks.reduce(Culled::default, Culled::plus);
}
