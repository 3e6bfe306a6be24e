//! Stage `project_bwd`: computes the gradient of a Gaussian's parameters from those of its entries.
//! Parallel over Gaussians, a lane for each of those that some tile lists.
//!
//! With Σ′⁻¹ d = A (dx, u) and t = o·w·v_(o·w): v_μ′ = Σ t Σ′⁻¹ d and v_Σ′ = ½ Σ t (Σ′⁻¹ d)(Σ′⁻¹
//! d)ᵀ, both linear in the kernels' sums.

use std::ops::Range;

use fearless_simd::Simd;
use glam::{Mat2, Vec2, Vec3};
use gs_core::{Output, effects::Statistics, math::perspective::ProjectionGradient};
use rayon::prelude::*;

use super::{
    buffers::Buffers3d,
    camera_sum::CameraSum,
    lanes_project::Columns,
    lanes_vjp::{self, CameraLanes, Lanes},
    project::Eye,
    splats::{self, LOG_SCALE, MEAN, MOST_NUMBERS, OPACITY, ROTATION, SH, Splats3d},
};
use crate::{
    lanes::{LANES, load, splat, store, transpose},
    level::{Level, dispatch},
    splat::{CHUNK, Received, Share, Splat},
    tiles::Tiles,
    workspace::Workspace,
};

/// Listed Gaussians whose gradients are computed at a time, a lane for each.
pub(crate) const BLOCK: usize = LANES;

/// The gradients of up to [`BLOCK`] neighbouring Gaussians that some tile lists.
pub(crate) struct Block {
    /// The Gaussians, by their places in a chunk.
    pub(crate) members: [usize; BLOCK],
    /// How many there are.
    pub(crate) len: usize,
    /// Rows, laid out as the splats' parameters, up to the evaluated SH.
    pub(crate) rows: [[f32; MOST_NUMBERS]; BLOCK],
    /// Contributions to the statistic.
    pub(crate) shares: [Share; BLOCK],
    /// The gradient by the camera of this block and of those before it, if it is asked for.
    pub(crate) camera: CameraSum,
}

impl Block {
    pub(crate) const EMPTY: Self = Self {
        members: [0; BLOCK],
        len: 0,
        rows: [[0.0; MOST_NUMBERS]; BLOCK],
        shares: [Share { signal: 0.0, weight: 0 }; BLOCK],
        camera: CameraSum::ZERO,
    };

    /// Finds the next listed Gaussians among these places of a chunk, which begins with the Gaussian
    /// `first`. Returns the place up to which it came.
    pub(crate) fn find(&mut self, tiles: &Tiles, first: usize, places: Range<usize>) -> usize {
        self.len = 0;
        for place in places.clone() {
            if tiles.lists(first + place) {
                self.members[self.len] = place;
                self.len += 1;
                if self.len == BLOCK {
                    return place + 1;
                }
            }
        }
        places.end
    }
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

    /// Computes the gradients of the next listed Gaussians of a chunk, which begins with the Gaussian
    /// `first` and has these parameters, from place `from` on. Returns the place up to which it came.
    pub(crate) fn block(
        &self,
        level: Level,
        (first, from): (usize, usize),
        parameters: &[f32],
        block: &mut Block,
    ) -> usize {
        let end = block.find(self.tiles, first, from..parameters.len() / self.pitch);
        if block.len > 0 {
            match self.tiles.settings.camera_gradient {
                false => dispatch!(level, simd => self.compute::<_, false>(simd, first, parameters, block)),
                true => dispatch!(level, simd => self.compute::<_, true>(simd, first, parameters, block)),
            }
        }
        end
    }

    #[inline(always)]
    fn compute<S: Simd, const CAMERA: bool>(&self, simd: S, first: usize, parameters: &[f32], block: &mut Block) {
        let mut received = [Received::default(); BLOCK];
        for (received, place) in received.iter_mut().zip(&block.members[..block.len]) {
            *received = self.tiles.received(first + place).unwrap_or_default();
        }
        let width = self.buffers.gradient_pitch();
        let mut lanes = Lanes::ZERO;
        for (lane, (received, place)) in received[..block.len].iter().zip(block.members).enumerate() {
            let splat = &self.tiles.projected[first + place];
            put(&mut lanes.ridge, lane, [splat.inverse_xx, splat.slope, splat.c]);
            put(&mut lanes.color, lane, received.color);
            put(&mut lanes.first, lane, received.first.to_array());
            put(&mut lanes.second, lane, received.second);
            put(&mut lanes.zeroth, lane, [received.zeroth]);
        }
        let (mut given, mut out): (Columns, Columns) = ([[0.0; LANES]; MOST_NUMBERS], [[0.0; LANES]; MOST_NUMBERS]);
        for at in (0..width.min(self.pitch)).step_by(LANES) {
            let mut rows = [splat(simd, 0.0); LANES];
            for lane in 0..block.len {
                rows[lane] = load(simd, &parameters[block.members[lane] * self.pitch..], at);
            }
            transpose::<S>(&mut rows);
            for (column, row) in given[at..at + LANES].iter_mut().zip(rows) {
                store(row, column, 0);
            }
        }
        let mut camera: CameraLanes = [[0.0; LANES]; 10];
        let extreme = match self.eye.output {
            Output::Color => {
                let eye = (&self.eye, self.scale);
                lanes_vjp::gradients::<S, CAMERA>(simd, eye, &given, &mut lanes, &mut out, &mut camera)
            }
            Output::InverseDepth | Output::Alpha => u64::MAX,
        };
        for at in (0..width).step_by(LANES) {
            let mut columns = [splat(simd, 0.0); LANES];
            for (column, from) in columns.iter_mut().zip(&out[at..]) {
                *column = load(simd, from, 0);
            }
            transpose::<S>(&mut columns);
            for lane in 0..block.len {
                store(columns[lane], &mut block.rows[lane], at);
            }
        }
        for lane in 0..block.len {
            let place = block.members[lane];
            let row = &parameters[place * self.pitch..][..self.pitch];
            let mut v_mean = Vec2::new(lanes.v_mean[0][lane], lanes.v_mean[1][lane]);
            if extreme >> lane & 1 == 1 {
                let splat = &self.tiles.projected[first + place];
                let upstream = upstream(&received[lane], splat, self.scale);
                v_mean = upstream.mean;
                let by_color =
                    gradient(&self.eye, received[lane], &upstream, row, self.scale, &mut block.rows[lane][..width]);
                if CAMERA {
                    put(&mut camera, lane, self.eye.camera_vjp(row, &upstream, by_color).to_array());
                }
            }
            block.shares[lane] = self.share(&received[lane], v_mean, row);
        }
        if CAMERA {
            block.camera.add(&camera, block.len);
        }
    }

    /// What a Gaussian contributes to the statistic.
    #[inline(always)]
    fn share(&self, received: &Received, v_mean: Vec2, row: &[f32]) -> Share {
        let Self { tiles, eye, scale, .. } = self;
        let mean_gradient = || (v_mean * tiles.half_size()).length();
        match tiles.settings.effects.statistics {
            Statistics::None => Share::default(),
            Statistics::MeanGradient => Share::once(mean_gradient()),
            Statistics::AbsoluteGradient => {
                Share::once((Vec2::from_array(received.collected) * *scale * tiles.half_size()).length())
            }
            Statistics::PixelGradient => {
                let near = tiles.settings.statistic_weight(eye.perspective.depth(splats::mean(row)));
                Share::weighted(near * mean_gradient(), received.collected[0])
            }
            // The pixel errors do not depend on the loss, so `scale` does not apply.
            Statistics::PixelError => Share::once(received.collected[0]),
        }
    }
}

/// Writes numbers into a lane.
#[inline(always)]
fn put<const N: usize>(rows: &mut [[f32; LANES]; N], lane: usize, numbers: [f32; N]) {
    for k in 0..N {
        rows[k][lane] = numbers[k];
    }
}

/// Writes the gradients of all listed Gaussians, times `scale`, into `own.gradients` and
/// `own.shares`.
pub(crate) fn all(workspace: &mut Workspace<Buffers3d>, splats: &Splats3d, level: Level, scale: f32) {
    let buffers = &mut workspace.buffers;
    let (mut gradients, mut shares) = (std::mem::take(&mut buffers.gradients), std::mem::take(&mut buffers.shares));
    let mut sums = std::mem::take(&mut buffers.camera_sums);
    let (width, pitch) = (buffers.gradient_pitch(), splats.pitch());
    gradients.resize(splats.len() * width, 0.0);
    shares.resize(splats.len(), Share::default());
    sums.resize(splats.len().div_ceil(CHUNK), CameraSum::ZERO);
    if let Some(backward) = Backward::new(workspace, splats, scale) {
        let out = gradients.par_chunks_mut(CHUNK * width).zip(shares.par_chunks_mut(CHUNK)).zip(&mut sums);
        let chunks = out.zip(splats.parameters.par_chunks(CHUNK * pitch)).enumerate();
        chunks.for_each(|(number, (((gradients, shares), sum), parameters))| {
            let mut block = Block::EMPTY;
            let mut from = 0;
            while from < shares.len() {
                from = backward.block(level, (number * CHUNK, from), parameters, &mut block);
                for (lane, &place) in block.members[..block.len].iter().enumerate() {
                    gradients[place * width..][..width].copy_from_slice(&block.rows[lane][..width]);
                    shares[place] = block.shares[lane];
                }
            }
            *sum = block.camera;
        });
        let total = sums.iter().fold(CameraSum::ZERO, |sum, &after| sum.plus(after));
        workspace.set_camera_gradient(total);
    }
    (workspace.buffers.gradients, workspace.buffers.shares) = (gradients, shares);
    workspace.buffers.camera_sums = sums;
}

/// ∂L/∂ the projection of a Gaussian, from what its entries received.
#[cold]
#[inline(never)]
fn upstream(received: &Received, splat: &Splat, scale: f32) -> ProjectionGradient {
    let conic = splat.conic_of_ridge();
    let [xx, xu, uu] = received.second.map(|v| 0.5 * scale * v);
    let v_covariance = conic * Mat2::from_cols_array(&[xx, xu, xu, uu]) * conic.transpose();
    ProjectionGradient {
        mean: conic * received.first * scale,
        covariance: [v_covariance.x_axis.x, v_covariance.x_axis.y, v_covariance.y_axis.y],
        log_opacity: received.zeroth * scale,
    }
}

/// Writes one Gaussian's gradient into `row`, and returns that by its mean through its colour: for
/// extreme numbers, and outputs other than colours.
#[cold]
#[inline(never)]
fn gradient(
    eye: &Eye,
    received: Received,
    upstream: &ProjectionGradient,
    parameters: &[f32],
    scale: f32,
    row: &mut [f32],
) -> Vec3 {
    let v_color = received.color.map(|v| v * scale);
    row[SH..].fill(0.0);
    let by_color = eye.color_vjp(parameters, v_color, row[SH..].as_chunks_mut().0);
    let v = eye.perspective.project_vjp(&splats::ellipsoid(parameters), upstream);
    (v.mean + by_color).write_to_slice(&mut row[MEAN]);
    v.log_scale.write_to_slice(&mut row[LOG_SCALE]);
    row[ROTATION].copy_from_slice(&v.rotation);
    row[OPACITY] = v.opacity_logit;
    by_color
}
