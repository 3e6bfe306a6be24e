//! Stage `project_bwd`: computes the gradient of a Gaussian's parameters from those of its entries.
//! Parallel over Gaussians.
//!
//! With Σ′⁻¹ d = A (dx, u) and t = o·w·v_(o·w): v_μ′ = Σ t Σ′⁻¹ d and v_Σ′ = ½ Σ t (Σ′⁻¹ d)(Σ′⁻¹
//! d)ᵀ, both linear in the kernels' sums.

use std::sync::atomic::Ordering::Relaxed;

use glam::{Mat2, Vec2};
use gs_core::{effects::Statistics, math::perspective::ProjectionGradient};
use rayon::prelude::*;

use super::{
    buffers::{Buffers3d, NO_RANK},
    project::Eye,
    splats::{self, LOG_SCALE, MEAN, MOST_NUMBERS, OPACITY, ROTATION, SH, Splats3d},
};
use crate::{
    splat::{CHUNK, Received, Share, Splat},
    tiles::Tiles,
    workspace::Workspace,
};

/// Gaussians whose gradients are computed one after the other, from entries gathered at once.
pub(crate) const BLOCK: usize = 16;

/// The gradients of up to [`BLOCK`] Gaussians.
pub(crate) struct Block {
    /// Rows, laid out as the splats' parameters, up to the evaluated SH. Unspecified for Gaussians
    /// that no tile lists.
    pub(crate) rows: [[f32; MOST_NUMBERS]; BLOCK],
    /// Contributions to the statistic; `None` for Gaussians that no tile lists.
    pub(crate) shares: [Option<Share>; BLOCK],
}

impl Block {
    pub(crate) const EMPTY: Self = Self { rows: [[0.0; MOST_NUMBERS]; BLOCK], shares: [None; BLOCK] };
}

/// What gradients are computed from.
pub(crate) struct Backward<'a> {
    tiles: &'a Tiles,
    buffers: &'a Buffers3d,
    eye: Eye,
    /// Numbers from a row of parameters to the next.
    pitch: usize,
    scale: f32,
}

impl<'a> Backward<'a> {
    /// Of gradients times `scale`; `None` before a projection.
    pub(crate) fn new(workspace: &'a Workspace<Buffers3d>, splats: &Splats3d, scale: f32) -> Option<Self> {
        let Workspace { tiles, buffers, .. } = workspace;
        Some(Self { tiles, buffers, eye: buffers.eye?, pitch: splats.pitch(), scale })
    }

    /// Computes the gradients of the Gaussians from `first` on that have these parameters.
    #[inline(always)]
    pub(crate) fn block(&self, first: usize, parameters: &[f32], block: &mut Block) {
        let rank = |i: usize| {
            let rank = self.buffers.rank_of.get(first + i).map_or(NO_RANK, |rank| rank.load(Relaxed));
            (rank != NO_RANK).then_some(rank as usize)
        };
        let received = self.tiles.gather::<BLOCK>(std::array::from_fn(rank));
        let width = self.buffers.gradient_pitch();
        for (i, parameters) in parameters.chunks_exact(self.pitch).enumerate() {
            let (splat, row) = (&self.tiles.projected[first + i], &mut block.rows[i][..width]);
            block.shares[i] = received[i]
                .map(|received| gradient(self.tiles, &self.eye, received, splat, parameters, self.scale, row));
        }
    }
}

/// Writes the gradients of all listed Gaussians, times `scale`, into `own.gradients` and
/// `own.shares`.
pub(crate) fn all(workspace: &mut Workspace<Buffers3d>, splats: &Splats3d, scale: f32) {
    let buffers = &mut workspace.buffers;
    let (mut gradients, mut shares) = (std::mem::take(&mut buffers.gradients), std::mem::take(&mut buffers.shares));
    let (width, pitch) = (buffers.gradient_pitch(), splats.pitch());
    gradients.resize(splats.len() * width, 0.0);
    shares.resize(splats.len(), Share::default());
    if let Some(backward) = Backward::new(workspace, splats, scale) {
        let out = gradients.par_chunks_mut(BLOCK * width).zip(shares.par_chunks_mut(BLOCK));
        let blocks = out.zip(splats.parameters.par_chunks(BLOCK * pitch)).enumerate().with_min_len(CHUNK / BLOCK);
        blocks.for_each(|(number, ((gradients, shares), parameters))| {
            let mut block = Block::EMPTY;
            backward.block(number * BLOCK, parameters, &mut block);
            let found = block.rows.iter().zip(block.shares);
            for ((out, share), (row, found)) in gradients.chunks_exact_mut(width).zip(shares).zip(found) {
                if let Some(found) = found {
                    out.copy_from_slice(&row[..width]);
                    *share = found;
                }
            }
        });
    }
    (workspace.buffers.gradients, workspace.buffers.shares) = (gradients, shares);
}

/// Adds `weight` times the added gradients to those of `own.gradients`, for Gaussians that some tile
/// lists in both.
pub(crate) fn add(workspace: &mut Workspace<Buffers3d>, added: &Workspace<Buffers3d>, weight: f32) {
    let mut gradients = std::mem::take(&mut workspace.buffers.gradients);
    let rows = gradients.par_chunks_mut(workspace.buffers.gradient_pitch()).enumerate().with_min_len(CHUNK);
    rows.for_each(|(index, row)| {
        if workspace.lists(index) && added.lists(index) {
            row.iter_mut().zip(added.buffers.gradient(index)).for_each(|(sum, by)| *sum += weight * by);
        }
    });
    workspace.buffers.gradients = gradients;
}

/// Writes one Gaussian's gradient, from what its entries received, into `row`, and returns its
/// contribution to the statistic.
#[inline(always)]
fn gradient(
    tiles: &Tiles,
    eye: &Eye,
    received: Received,
    splat: &Splat,
    parameters: &[f32],
    scale: f32,
    row: &mut [f32],
) -> Share {
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
    let by_color = eye.color_vjp(parameters, v_color, row[SH..].as_chunks_mut().0);
    let v = eye.perspective.project_vjp(&splats::ellipsoid(parameters), &upstream);
    (v.mean + by_color).write_to_slice(&mut row[MEAN]);
    v.log_scale.write_to_slice(&mut row[LOG_SCALE]);
    row[ROTATION].copy_from_slice(&v.rotation);
    row[OPACITY] = v.opacity_logit;
    let mean_gradient = || (v_mean * tiles.half_size()).length();
    match tiles.settings.effects.statistics {
        Statistics::None => Share::default(),
        Statistics::MeanGradient => Share::once(mean_gradient()),
        Statistics::AbsoluteGradient => {
            Share::once((Vec2::from_array(received.collected) * scale * tiles.half_size()).length())
        }
        Statistics::PixelGradient => {
            let near = tiles.settings.statistic_weight(eye.perspective.depth(splats::mean(parameters)));
            Share::weighted(near * mean_gradient(), received.collected[0])
        }
        // The pixel errors do not depend on the loss, so `scale` does not apply.
        Statistics::PixelError => Share::once(received.collected[0]),
    }
}
