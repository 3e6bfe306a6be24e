//! Stage `project_bwd`: computes the gradient of a Gaussian's parameters from those of its entries.
//!
//! Everything goes through the whitened coordinates: with z = L′⁻¹ d, a step μ += L ξ, L ← L exp(η)
//! changes σ by −zᵀξ − zᵀηz, so that v_ξ = Σ t z and v_η = Σ t z zᵀ; no covariance is inverted. The
//! kernels' sums over (dx, u) are whitened by the lower-triangular root of Σ′ (a scaling per axis),
//! and a rotation leads from there to the factor of L′.

use glam::{Mat2, Vec2};
use gs_core::{
    Blend, Scene2d,
    effects::{Antialias, Statistics},
    math::whitened::solve_transposed,
    sigmoid,
};
use rayon::prelude::*;

use super::{
    buffers::{Buffers2d, Gradient},
    project::on_canvas,
    splats::{Shapes, Splats2d},
};
use crate::{
    splat::{CHUNK, Share},
    workspace::Workspace,
};

/// Writes every Gaussian's gradient, times `scale`, into the workspace (by rank).
pub(crate) fn all(workspace: &mut Workspace<Buffers2d>, splats: &Splats2d, scale: f32) {
    let mut gradients = std::mem::take(&mut workspace.buffers.gradients);
    gradients.resize(workspace.len, Gradient::default());
    let workspace_ = &*workspace;
    gradients.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, gradients)| {
        for (i, out) in gradients.iter_mut().enumerate() {
            *out = gradient(workspace_, splats, chunk * CHUNK + i, scale).unwrap_or_default();
        }
    });
    workspace.buffers.gradients = gradients;
}

/// The gradient of the Gaussian at `rank`, times `scale`; `None` where no tile lists it.
#[inline(always)]
fn gradient(workspace: &Workspace<Buffers2d>, splats: &Splats2d, rank: usize, scale: f32) -> Option<Gradient> {
    let Workspace { tiles, buffers, .. } = workspace;
    let effects = tiles.settings.effects;
    let index = buffers.order[rank] as usize;
    let splat = &tiles.projected[rank];
    let received = tiles.received(rank).filter(|_| !splat.is_culled())?;
    let first = received.first * scale;
    let [xx, xu, uu] = received.second.map(|v| v * scale);
    let zeroth = received.zeroth * scale;
    let (_, l) = on_canvas(&buffers.canvas, splats.means[index], splats.factor(index));
    let (xi, moment) = match effects.antialias {
        Antialias::None => {
            let (root_x, root_u) = (splat.inverse_xx.sqrt(), splat.c.sqrt());
            let e = Vec2::new(first.x * root_x, first.y * root_u);
            let (e_00, e_01, e_11) = (xx * splat.inverse_xx, xu * root_x * root_u, uu * splat.c);
            let q = rotation_from_triangular(l);
            (q * e, q * Mat2::from_cols_array(&[e_00, e_01, e_01, e_11]) * q.transpose())
        }
        // L′ is no root of Σ′ here. The dilation keeps Σ′ from being a needle.
        Antialias::Dilate | Antialias::Mip | Antialias::Compensated => {
            let q = l.transpose() * splat.conic_of_ridge();
            let mut moment = q * Mat2::from_cols_array(&[xx, xu, xu, uu]) * q.transpose();
            if effects.antialias.compensates() && effects.blend == Blend::Over {
                // ln ρ = ½ (ln D − ln D′) with D = det² L′ and D′ = D + δ tr L′ L′ᵀ + δ².
                let (det, delta) = (l.determinant().powi(2), effects.antialias.dilation());
                let trace = l.x_axis.length_squared() + l.y_axis.length_squared();
                let inverse = 1.0 / (det + delta * (trace + delta));
                let gram = l.transpose() * l;
                moment += (Mat2::IDENTITY * (1.0 - det * inverse) - gram * (delta * inverse)) * zeroth;
            }
            (q * first, moment)
        }
    };
    let mean_gradient = || {
        let by_mean = match effects.antialias {
            Antialias::None => solve_transposed(l, xi),
            Antialias::Dilate | Antialias::Mip | Antialias::Compensated => splat.conic_of_ridge() * first,
        };
        (by_mean * tiles.half_size()).length()
    };
    let share = match effects.statistics {
        Statistics::None => Share::default(),
        Statistics::MeanGradient => Share::once(mean_gradient()),
        Statistics::AbsoluteGradient => {
            Share::once((Vec2::from_array(received.collected) * scale * tiles.half_size()).length())
        }
        // A canvas has no depths.
        Statistics::PixelGradient => Share::weighted(mean_gradient(), received.collected[0]),
        // The pixel errors do not depend on the loss, so `scale` does not apply.
        Statistics::PixelError => Share::once(received.collected[0]),
    };
    let opacity_logit = match effects.blend {
        Blend::Over if !splats.opacity_logits.is_empty() => zeroth * sigmoid(-splats.opacity_logits[index]),
        _ => 0.0,
    };
    Some(Gradient {
        color: received.color.map(|v| v * scale),
        xi,
        eta: [moment.x_axis.x, moment.x_axis.y, moment.y_axis.y],
        opacity_logit,
        share,
        visible: true,
    })
}

/// The orthogonal Q with L⁻¹ = Q K⁻¹, where K is the lower-triangular root of L Lᵀ.
fn rotation_from_triangular(l: Mat2) -> Mat2 {
    // The first row of L is √Σxx times the first row of Qᵀ.
    let first = Vec2::new(l.x_axis.x, l.y_axis.x).normalize_or(Vec2::X);
    let second = if l.determinant() >= 0.0 { first.perp() } else { -first.perp() };
    Mat2::from_cols(first, second)
}

/// The gradients as a scene of derivatives: with respect to mean (px⁻¹), log-scale, rotation
/// (rad⁻¹), opacity logit and colour.
pub(crate) fn as_scene<'g>(splats: &Splats2d, gradient_of: impl Fn(usize) -> &'g Gradient) -> Scene2d {
    let mut scene = Scene2d::default();
    for index in 0..splats.len() {
        let gradient = gradient_of(index);
        let (l, log_ratio, whitened) = match &splats.shapes {
            Shapes::ScaleRotation(shapes) => {
                let [x, y, _] = shapes[index];
                (splats.factor(index), x - y, gradient.whitened())
            }
            Shapes::CovarianceFactor(factors) => gradient.whitened().in_axes(factors[index]),
        };
        let (mean, [x, y, angle]) =
            if gradient.visible { whitened.by_scale_rotation(l, log_ratio) } else { (Vec2::ZERO, [0.0; 3]) };
        scene.means.push(mean);
        scene.log_scales.push(Vec2::new(x, y));
        scene.rotations.push(angle);
        scene.colors.push(gradient.color.into());
        if !splats.opacity_logits.is_empty() {
            scene.opacity_logits.push(gradient.opacity_logit);
        }
    }
    scene
}
