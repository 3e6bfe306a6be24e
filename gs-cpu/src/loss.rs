//! Stage `loss`: the loss of an image, and its gradient, which replaces nothing and is written beside it. Parallel over tiles.

use std::sync::OnceLock;

use fearless_simd::{Level, dispatch};
use gs_core::{Error, Image, Loss, constants::MAX_RESIDUAL, guards::Guard};

use crate::{
    dssim::{self, BlurredTarget},
    lanes::LANES,
    layout::{Cuts, Grid, Row, ScalarRow, TileBuffers, for_each_tile},
    tiles::Tiles,
};

/// An image to compare with, as strips.
#[derive(Debug)]
pub struct Target {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) rows: Vec<Row>,
    /// What D-SSIM needs of the target alone, made when first needed.
    pub(crate) blurred: OnceLock<BlurredTarget>,
}

impl Target {
    pub(crate) fn new(image: &Image) -> Self {
        let (width, height) = image.size();
        let rows = Grid::new((width, height), 1).strips_of(image);
        Self { width, height, rows, blurred: OnceLock::new() }
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
pub(crate) fn loss(tiles: &mut Tiles, target: &Target, loss: &Loss, level: Level) -> f64 {
    if tiles.collects_errors() {
        errors(tiles, target);
    }
    let count = 3.0 * f64::from(target.width) * f64::from(target.height);
    match *loss {
        Loss::L2 => pointwise(tiles, target, level, Pointwise::Square { scale: (2.0 / count) as f32 }) / count,
        Loss::L1 => pointwise(tiles, target, level, Pointwise::Absolute { scale: (1.0 / count) as f32 }) / count,
        Loss::L1Dssim { lambda } => {
            let scale = ((1.0 - f64::from(lambda)) / count) as f32;
            let l1 = pointwise(tiles, target, level, Pointwise::Absolute { scale }) / count;
            let dssim = dssim::add(tiles, target, level, lambda);
            (1.0 - f64::from(lambda)) * l1 + f64::from(lambda) * dssim
        }
    }
}

/// C − Y as L2 is differentiated by it: within ±[`MAX_RESIDUAL`].
#[inline(always)]
pub(crate) fn bounded_residual(residual: f32) -> f32 {
    if Guard::MaxResidual.is_on() { residual.clamp(-MAX_RESIDUAL, MAX_RESIDUAL) } else { residual }
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
enum Pointwise {
    Square { scale: f32 },
    Absolute { scale: f32 },
}

/// The sum of a pointwise loss, unscaled; its scaled gradient into `v_rows`.
fn pointwise(tiles: &mut Tiles, target: &Target, level: Level, kind: Pointwise) -> f64 {
    let grid = tiles.grid;
    tiles.v_rows.resize(grid.rows(), Row::ZERO);
    let (image, bins) = (&tiles.rows, &tiles.bins);
    let cuts = Cuts { grid: &grid, tile_start: &bins.tile_start, stride: 0 };
    let buffers = TileBuffers { rows: &mut tiles.v_rows, scalars: &mut [], slots: &mut [], sums: &mut tiles.sums };
    for_each_tile(0..grid.tiles(), buffers, cuts, &|tile, buffers| {
        let first = grid.first_row(tile);
        let image = &image[first..first + buffers.rows.len()];
        let target = &target.rows[first..first + buffers.rows.len()];
        let inside = grid.lanes_inside(tile);
        buffers.sums[0] = dispatch!(level, _simd => match kind {
            Pointwise::Square { scale } => {
                each(image, target, buffers.rows, inside, |d| (d * d, bounded_residual(d) * scale))
            }
            Pointwise::Absolute { scale } => {
                each(image, target, buffers.rows, inside, |d| {
                    (d.abs(), if d > 0.0 { scale } else if d < 0.0 { -scale } else { 0.0 })
                })
            }
        });
    });
    tiles.sums.iter().sum()
}

/// Applies `(loss, gradient) = f(C − Y)` to a tile; returns the sum of the losses.
#[inline(always)]
fn each(image: &[Row], target: &[Row], v_rows: &mut [Row], inside: usize, f: impl Fn(f32) -> (f32, f32) + Copy) -> f64 {
    let mut total = 0.0;
    for ((Row(c), Row(y)), Row(v)) in image.iter().zip(target).zip(v_rows) {
        let mut sum = [0.0f32; LANES];
        for k in 0..3 {
            for i in 0..LANES {
                let (loss, gradient) = f(c[k][i] - y[k][i]);
                sum[i] += loss;
                v[k][i] = gradient;
            }
            v[k][inside..].fill(0.0);
        }
        total += f64::from(sum[..inside].iter().sum::<f32>());
    }
    total
}
