//! Stage `project_bwd`: computes the gradient of a Gaussian's parameters from those of its entries.
//! Parallel over Gaussians.
//!
//! With Σ′⁻¹ d = A (dx, u) and t = o·w·v_(o·w): v_μ′ = Σ t Σ′⁻¹ d and v_Σ′ = ½ Σ t (Σ′⁻¹ d)(Σ′⁻¹
//! d)ᵀ, both linear in the kernels' sums.

use std::sync::atomic::Ordering::Relaxed;

use glam::{Mat2, Vec2};
use gs_core::{
    Parameterization,
    effects::Statistics,
    math::{perspective::ProjectionGradient, sh},
};
use rayon::prelude::*;

use super::{
    own::{NO_PLACE, Own3d},
    project::Eye,
    splats::{self, LOG_SCALE, MEAN, OPACITY, ROTATION, SH, STRETCH, Splats3d},
};
use crate::{
    splat::{CHUNK, Splat},
    tiles::Tiles,
};

/// Writes the gradients of all listed Gaussians, times `scale`, into `own.gradients` and
/// `own.shares`.
pub(crate) fn all(tiles: &Tiles, own: &mut Own3d, splats: &Splats3d, scale: f32) {
    let Some(eye) = own.eye else { return };
    let (pitch, of_parameters) = (own.gradient_pitch(), splats.pitch());
    own.gradients.resize(splats.len() * pitch, 0.0);
    own.shares.resize(splats.len(), 0.0);
    let (projected, place_of) = (&own.projected, &own.place_of);
    let out = own.gradients.par_chunks_mut(CHUNK * pitch).zip(own.shares.par_chunks_mut(CHUNK)).enumerate();
    out.for_each(|(chunk, (gradients, shares))| {
        for (i, (row, share)) in gradients.chunks_exact_mut(pitch).zip(shares).enumerate() {
            let index = chunk * CHUNK + i;
            let place = place_of[index].load(Relaxed);
            if place != NO_PLACE {
                let parameters = &splats.parameters[index * of_parameters..][..of_parameters];
                *share = gradient(tiles, &eye, place as usize, &projected[index], parameters, scale, row);
            }
        }
    });
}

/// Writes one Gaussian's gradient into `row`, and returns its contribution to the statistic.
///
/// Leaves `row` unchanged where no tile lists the splat.
#[inline(always)]
fn gradient(
    tiles: &Tiles,
    eye: &Eye,
    place: usize,
    splat: &Splat,
    parameters: &[f32],
    scale: f32,
    row: &mut [f32],
) -> f32 {
    let Some(received) = tiles.received(place) else { return 0.0 };
    let conic = splat.conic_of_ridge();
    let v_mean = conic * received.first * scale;
    let [xx, xu, uu] = received.second.map(|v| 0.5 * scale * v);
    let v_covariance = conic * Mat2::from_cols_array(&[xx, xu, xu, uu]) * conic.transpose();
    let upstream = ProjectionGradient {
        mean: v_mean,
        covariance: [v_covariance.x_axis.x, v_covariance.x_axis.y, v_covariance.y_axis.y],
        log_opacity: received.zeroth * scale,
    };
    let v_color = received.color.map(|v| v * scale);
    row[SH..].fill(0.0);
    let mean = splats::mean(parameters);
    let (sh_row, direction) = (row[SH..].as_chunks_mut().0, eye.direction(mean));
    let v_direction = sh::color_vjp(eye.degree, direction, splats::sh(parameters), v_color, sh_row);
    let by_direction = eye.direction_vjp(mean, v_direction);
    match eye.parameterization {
        Parameterization::ScaleRotation => {
            let v = eye.perspective.project_vjp(&splats::ellipsoid(parameters), &upstream);
            (v.mean + by_direction).write_to_slice(&mut row[MEAN]);
            v.log_scale.write_to_slice(&mut row[LOG_SCALE]);
            row[ROTATION].copy_from_slice(&v.rotation);
            row[OPACITY] = v.opacity_logit;
        }
        Parameterization::CovarianceFactor => {
            let v = eye.perspective.project_factored_vjp(&splats::factored(parameters), &upstream);
            (v.mean + by_direction).write_to_slice(&mut row[MEAN]);
            row[STRETCH].copy_from_slice(&v.stretch);
            row[STRETCH.end..OPACITY].fill(0.0);
            row[OPACITY] = v.opacity_logit;
        }
    }
    match tiles.settings.effects.statistics {
        Statistics::None => 0.0,
        Statistics::MeanGradient => (v_mean * tiles.half_size()).length(),
        Statistics::AbsoluteGradient => (Vec2::from_array(received.collected) * scale * tiles.half_size()).length(),
        // The pixel errors do not depend on the loss, so `scale` does not apply.
        Statistics::PixelError => received.collected[0],
    }
}
