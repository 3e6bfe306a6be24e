//! Stage `loss`: the loss of an image, and its gradient, which replaces nothing and is written beside it. Parallel over tiles.

use std::sync::OnceLock;

use fearless_simd::{Level, Simd, dispatch, prelude::*};
use gs_core::{Error, Loss, TargetImage, constants::MAX_RESIDUAL, memory, target};
use rayon::prelude::*;

use crate::{
    dssim::{self, BlurredTarget},
    lanes::{LANES, Whole, fma, iota, load, splat, splat3, store},
    layout::{Cuts, Grid, Row, ScalarRow, TileBuffers, for_each_tile},
    tiles::Tiles,
};

/// An image to compare with, as strips.
#[derive(Debug, Default)]
pub struct Target {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) rows: Vec<Row>,
    /// What [`TargetImage::coverage`] says of each pixel, and 1 in lanes beyond the image; empty where the rows are complete.
    coverage: Vec<ScalarRow>,
    /// What D-SSIM needs of the target alone, made when first needed.
    pub(crate) blurred: OnceLock<BlurredTarget>,
}

impl Target {
    pub(crate) fn new(target: &TargetImage<'_>) -> Result<Self, Error> {
        target.validate()?;
        let (width, height) = target.image.size();
        let grid = Grid::new((width, height), 1);
        let mut coverage = Vec::new();
        if let Some(of_pixels) = target.coverage() {
            memory::resize(&mut coverage, grid.rows(), ScalarRow([1.0; LANES]), "a target's alpha and mask")?;
            for (line, of_line) in of_pixels.chunks_exact(width as usize).enumerate() {
                for (strip, values) in of_line.chunks(LANES).enumerate() {
                    coverage[strip * grid.height + line].0[..values.len()].copy_from_slice(values);
                }
            }
        }
        Ok(Self { width, height, rows: grid.strips_of(target.image)?, coverage, blurred: OnceLock::new() })
    }

    /// Whether the colours depend neither on the background nor on the rendering.
    pub(crate) fn is_complete(&self) -> bool {
        self.coverage.is_empty()
    }

    /// Puts the colours before a background, and those of pixels that do not count to what is rendered, into `completed`.
    fn complete(&self, background: [f32; 3], rendered: &[Row], completed: &mut Self) -> Result<(), Error> {
        (completed.width, completed.height) = (self.width, self.height);
        memory::resize(&mut completed.rows, self.rows.len(), Row::ZERO, "a target")?;
        completed.blurred.take();
        let inputs = self.rows.par_iter().zip(&self.coverage).zip(rendered);
        (completed.rows.par_iter_mut().zip(inputs)).for_each(|(Row(out), ((Row(y), ScalarRow(coverage)), Row(c)))| {
            for k in 0..3 {
                out[k] = std::array::from_fn(|i| target::completed(y[k][i], coverage[i], background[k], c[k][i]));
            }
        });
        Ok(())
    }

    /// Fails unless the target has this size.
    pub(crate) fn check_size(&self, (width, height): (u32, u32)) -> Result<(), Error> {
        if (self.width, self.height) == (width, height) {
            return Ok(());
        }
        Err(Error::SizesDiffer {
            left_width: width,
            left_height: height,
            right_width: self.width,
            right_height: self.height,
        })
    }
}

/// The loss of `tiles.rows`, its gradient into `tiles.v_rows` (0 in lanes beyond the image); where they are asked for, the pixels'
/// errors.
///
/// # Errors
/// [`Error::Memory`].
pub(crate) fn loss(tiles: &mut Tiles, target: &Target, loss: &Loss, level: Level) -> Result<f64, Error> {
    if target.is_complete() {
        return loss_of_complete(tiles, target, loss, level);
    }
    let mut completed = std::mem::take(&mut tiles.completed);
    target.complete(tiles.settings.background_color(), &tiles.rows, &mut completed)?;
    let value = loss_of_complete(tiles, &completed, loss, level);
    tiles.completed = completed;
    value
}

fn loss_of_complete(tiles: &mut Tiles, target: &Target, loss: &Loss, level: Level) -> Result<f64, Error> {
    let pixels = if tiles.collects_errors() { tiles.grid.rows() } else { 0 };
    memory::resize(&mut tiles.errors, pixels, ScalarRow([0.0; LANES]), "the pixels' errors")?;
    if tiles.collects_errors() {
        errors(tiles, target);
    }
    memory::resize(&mut tiles.v_rows, tiles.grid.rows(), Row::ZERO, "the gradient of an image")?;
    let count = 3.0 * f64::from(target.width) * f64::from(target.height);
    Ok(match *loss {
        Loss::L2 => pointwise(tiles, target, level, Pointwise::Square { scale: (2.0 / count) as f32 }) / count,
        Loss::L1 => pointwise(tiles, target, level, Pointwise::Absolute { scale: (1.0 / count) as f32 }) / count,
        Loss::L1Dssim { lambda } => dssim::loss(tiles, target, level, lambda)?,
    })
}

/// The errors of `tiles.rows`, into `tiles.errors`.
fn errors(tiles: &mut Tiles, target: &Target) {
    let grid = tiles.grid;
    let (image, bins) = (&tiles.rows, &tiles.bins);
    let cuts = Cuts { grid: &grid, tile_start: &bins.tile_start, stride: 0 };
    let buffers = TileBuffers { rows: &mut [], scalars: &mut tiles.errors, slots: &mut [], sums: &mut tiles.sums };
    for_each_tile(0..grid.tiles(), buffers, cuts, &|tile, buffers| {
        let first = grid.first_row(tile);
        let pairs = image[first..].iter().zip(&target.rows[first..]);
        for (ScalarRow(error), (Row(c), Row(y))) in buffers.scalars.iter_mut().zip(pairs) {
            let residual = std::array::from_fn(|k| std::array::from_fn(|i| c[k][i] - y[k][i]));
            *error = mean_magnitude(&residual);
            error[grid.lanes_inside(tile)..].fill(0.0);
        }
    });
}

/// The mean of the three channels' magnitudes.
#[inline(always)]
fn mean_magnitude([r, g, b]: &[[f32; LANES]; 3]) -> [f32; LANES] {
    std::array::from_fn(|i| (r[i].abs() + g[i].abs() + b[i].abs()) * (1.0 / 3.0))
}

/// A loss that is a sum over pixels and channels; its gradient is scaled by `scale`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Pointwise {
    Square { scale: f32 },
    Absolute { scale: f32 },
}

/// The sum of a pointwise loss, unscaled; its scaled gradient into `v_rows`, which has its size.
fn pointwise(tiles: &mut Tiles, target: &Target, level: Level, kind: Pointwise) -> f64 {
    let grid = tiles.grid;
    let (image, bins) = (&tiles.rows, &tiles.bins);
    let cuts = Cuts { grid: &grid, tile_start: &bins.tile_start, stride: 0 };
    let buffers = TileBuffers { rows: &mut tiles.v_rows, scalars: &mut [], slots: &mut [], sums: &mut tiles.sums };
    for_each_tile(0..grid.tiles(), buffers, cuts, &|tile, buffers| {
        let first = grid.first_row(tile);
        let image = &image[first..first + buffers.rows.len()];
        let target = &target.rows[first..first + buffers.rows.len()];
        let inside = grid.lanes_inside(tile);
        buffers.sums[0] = dispatch!(level, simd => each(simd, image, target, buffers.rows, inside, kind));
    });
    tiles.sums.iter().sum()
}

impl Pointwise {
    /// The losses of residuals C − Y, and their gradients; both are 0 of 0.
    #[inline(always)]
    pub(crate) fn of<S: Simd>(self, simd: S, residual: Whole<S>) -> (Whole<S>, Whole<S>) {
        match self {
            Self::Square { scale } => (residual * residual, residual * scale),
            Self::Absolute { scale } => {
                let [zero, below, above] = splat3(simd, [0.0, -scale, scale]);
                let sign = residual.simd_lt(zero).select(below, zero);
                (residual.abs(), residual.simd_gt(zero).select(above, sign))
            }
        }
    }
}

/// C − Y of a channel of a row; 0 in lanes beyond the image.
#[inline(always)]
fn residual<S: Simd>(simd: S, c: &[f32; LANES], y: &[f32; LANES], inside: usize) -> Whole<S> {
    let [c, y]: [Whole<S>; 2] = [load(simd, c, 0), load(simd, y, 0)];
    let (column, columns): (Whole<S>, Whole<S>) = (iota(simd, 0), splat(simd, inside as f32));
    column.simd_lt(columns).select(c - y, splat(simd, 0.0))
}

/// Bounds `scale` times residuals as if these were within ±[`MAX_RESIDUAL`]; NaN stays. `squares` is the sum of the residuals' squares.
#[inline(always)]
fn bound_residuals(scaled: &mut [Row], scale: f32, squares: f64) {
    // No residual is larger than the root of the sum, so that nearly always none has to be looked at.
    let (bound, most) = (f64::from(MAX_RESIDUAL), MAX_RESIDUAL * scale);
    if !(squares <= bound * bound) {
        let values = scaled.iter_mut().flat_map(|Row(channels)| channels.as_flattened_mut());
        values.for_each(|value| *value = value.clamp(-most, most));
    }
}

/// Gradients of a tile into `v_rows`; returns the sum of the losses.
#[inline(always)]
fn each<S: Simd>(simd: S, image: &[Row], target: &[Row], v_rows: &mut [Row], inside: usize, kind: Pointwise) -> f64 {
    let mut total = 0.0;
    for ((Row(c), Row(y)), Row(v)) in image.iter().zip(target).zip(&mut *v_rows) {
        let mut losses: Whole<S> = splat(simd, 0.0);
        for k in 0..3 {
            let (loss, gradient) = kind.of(simd, residual(simd, &c[k], &y[k], inside));
            losses += loss;
            store(gradient, &mut v[k], 0);
        }
        total += f64::from(losses.reduce_sum());
    }
    if let Pointwise::Square { scale } = kind {
        bound_residuals(v_rows, scale, total);
    }
    total
}

/// Takes the target off a tile's values: Σ of the squares of what remains, which is then bounded as L2 bounds it.
#[inline(always)]
pub(crate) fn squares_in_place<S: Simd>(simd: S, rows: &mut [Row], target: &[Row], inside: usize) -> f64 {
    let mut total = 0.0;
    for (Row(c), Row(y)) in rows.iter_mut().zip(target) {
        let mut squares: Whole<S> = splat(simd, 0.0);
        for (c, y) in c.iter_mut().zip(y) {
            let residual = residual(simd, c, y, inside);
            squares = fma(residual, residual, squares);
            store(residual, c, 0);
        }
        total += f64::from(squares.reduce_sum());
    }
    bound_residuals(rows, 1.0, total);
    total
}
