//! Solves for the colours that fit a target best under `Sum`, with all else fixed: least squares by
//! preconditioned conjugate gradients.
//!
//! The image is A c, with one column of A per Gaussian: what it adds to each pixel. With the pixels'
//! weights W, every iteration is one pass over the tiles that forms A p and AᵀW(A p). The
//! preconditioner is the diagonal of AᵀA, which is Σ a² ≈ π √det Σ′; that of AᵀWA makes no
//! difference. The three channels are three systems with the same matrix.

use gs_core::Error;
use rayon::prelude::*;

use super::{buffers::Buffers2d, splats::Splats2d};
use crate::{
    blend_sum::{self, COLOR_STRIDE},
    layout::{Row, TileBuffers, for_each_tile},
    level::{Level, dispatch},
    pointwise,
    splat::CHUNK,
    target::Target,
    tiles::Tiles,
    workspace::Workspace,
};

/// Improves the colours of `splats` by `iterations` steps; `workspace` has been prepared for it.
///
/// # Errors
/// [`Error::Memory`].
pub(crate) fn solve(
    workspace: &mut Workspace<Buffers2d>,
    splats: &mut Splats2d,
    target: &Target,
    level: Level,
    iterations: u32,
) -> Result<(), Error> {
    let Workspace { tiles, buffers, .. } = workspace;
    let n = buffers.order.len();
    let background = tiles.settings.background_color();
    let diagonal: Vec<f32> =
        (tiles.projected.iter()).map(|s| std::f32::consts::PI / (s.inverse_xx * s.c).sqrt()).collect();
    let mut solution: Vec<[f32; 3]> = tiles.projected.iter().map(|s| s.color).collect();

    // r = AᵀW(y − A c); the pass computes AᵀW(A c − (y − background)).
    let mut residual = vec![[0.0f32; 3]; n];
    normal_product(tiles, level, target, Some(background), &mut residual)?;
    residual.par_iter_mut().for_each(|r| *r = r.map(|v| -v));
    let preconditioned =
        |r: &[[f32; 3]]| -> Vec<[f32; 3]> { r.iter().zip(&diagonal).map(|(r, d)| r.map(|v| v / d)).collect() };
    let mut z = preconditioned(&residual);
    let mut direction = z.clone();
    let mut rz = dot(&residual, &z);
    let mut product = vec![[0.0f32; 3]; n];
    for _ in 0..iterations {
        for (splat, d) in tiles.projected.iter_mut().zip(&direction) {
            splat.color = *d;
        }
        normal_product(tiles, level, target, None, &mut product)?;
        let curvature = dot(&direction, &product);
        let step = [0, 1, 2].map(|k| if curvature[k] > 0.0 { (rz[k] / curvature[k]) as f32 } else { 0.0 });
        for i in 0..n {
            for k in 0..3 {
                solution[i][k] += step[k] * direction[i][k];
                residual[i][k] -= step[k] * product[i][k];
            }
        }
        z = preconditioned(&residual);
        let next = dot(&residual, &z);
        let keep = [0, 1, 2].map(|k| if rz[k] > 0.0 { (next[k] / rz[k]) as f32 } else { 0.0 });
        for (d, z) in direction.iter_mut().zip(&z) {
            *d = [0, 1, 2].map(|k| z[k] + keep[k] * d[k]);
        }
        rz = next;
    }
    for (rank, &index) in buffers.order.iter().enumerate() {
        let splat = &mut tiles.projected[rank];
        if !splat.is_culled() && solution[rank].iter().all(|v| v.is_finite()) {
            splats.colors[index as usize] = solution[rank];
        }
    }
    Ok(())
}

/// Per channel, the dot product of two vectors of colours.
fn dot(a: &[[f32; 3]], b: &[[f32; 3]]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (a, b) in a.iter().zip(b) {
        for k in 0..3 {
            sums[k] += f64::from(a[k]) * f64::from(b[k]);
        }
    }
    sums
}

/// AᵀW(A c − y) by rank, with the splats' colours c, the target's weights W, and y = target −
/// background, or 0 without a background.
fn normal_product(
    tiles: &mut Tiles,
    level: Level,
    target: &Target,
    background: Option<[f32; 3]>,
    out: &mut [[f32; 3]],
) -> Result<(), Error> {
    tiles.fit_slots(COLOR_STRIDE)?;
    let Tiles { projected, bins, grid, tile_rows, slots, .. } = tiles;
    let slots = &*slots;
    let buffers = TileBuffers { rows: &mut [], scalars: &mut [], sums: &mut [] };
    for_each_tile(0..grid.tiles(), buffers, grid, &|tile, _| {
        let entries = bins.of(tile);
        let (column, place) = grid.place(tile);
        let of_tile = grid.first_row(tile)..grid.first_row(tile) + place.len();
        let inside = grid.lanes_inside(tile);
        tile_rows.with(|rows| {
            rows.resize(place.len(), Row::ZERO);
            dispatch!(level, simd => {
                match background {
                    None => rows.fill(Row::ZERO),
                    Some(background) => blend_sum::start(simd, background, &target.rows[of_tile.clone()], rows),
                }
                blend_sum::forward(simd, entries, projected, column, place.start, rows);
                pointwise::weigh(simd, rows, target.weights_of(of_tile.clone()));
                if inside < 16 {
                    for Row(pixels) in rows.iter_mut() {
                        pixels.iter_mut().for_each(|channel| channel[inside..].fill(0.0));
                    }
                }
                blend_sum::backward_colors(simd, entries, projected, column, place.start, rows, slots);
            });
        });
    });
    out.par_iter_mut().with_min_len(CHUNK).enumerate().for_each(|(rank, sum)| {
        *sum = slots.sums(bins.slots_of(rank), COLOR_STRIDE);
    });
    Ok(())
}
