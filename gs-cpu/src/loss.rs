//! Stage `loss`: the loss of an image, and its gradient, which is written next to the image.
//! Parallel over tiles.

use gs_core::{Error, Image, Loss, memory};

use crate::{
    dssim,
    lanes::LANES,
    layout::{Row, ScalarRow, TileBuffers, for_each_tile},
    level::{Level, dispatch},
    pointwise::{self, Compared, Pointwise},
    target::Target,
    tiles::Tiles,
};

/// The loss of `tiles.rows`. Writes its gradient into `tiles.v_rows`, 0 in lanes beyond the image.
///
/// Also writes `tiles.errors`, if the statistics need them.
///
/// # Errors
/// [`Error::Memory`].
pub(crate) fn loss(tiles: &mut Tiles, target: &Target, loss: &Loss, level: Level) -> Result<f64, Error> {
    if target.is_complete() {
        return loss_of_complete(tiles, target, target, loss, level);
    }
    let mut completed = std::mem::take(&mut tiles.completed);
    target.complete(tiles.settings.background_color(), &tiles.rows, &mut completed)?;
    let value = loss_of_complete(tiles, &completed, target, loss, level);
    tiles.completed = completed;
    value
}

/// The loss of a complete target, with the weights of another.
fn loss_of_complete(
    tiles: &mut Tiles,
    target: &Target,
    weights: &Target,
    loss: &Loss,
    level: Level,
) -> Result<f64, Error> {
    let pixels = if tiles.collects_errors() { tiles.grid.rows() } else { 0 };
    memory::resize(&mut tiles.errors, pixels, ScalarRow([0.0; LANES]), "the pixels' errors")?;
    if tiles.collects_errors() {
        errors(tiles, target);
    }
    memory::resize(&mut tiles.v_rows, tiles.grid.rows(), Row::ZERO, "the gradient of an image")?;
    let count = 3.0 * f64::from(target.width) * f64::from(target.height);
    Ok(match *loss {
        Loss::L2 => {
            let kind = Pointwise::Square { scale: (2.0 / count) as f32 };
            pointwise(tiles, target, weights, level, kind) / count
        }
        Loss::L1 => {
            let kind = Pointwise::Absolute { scale: (1.0 / count) as f32 };
            pointwise(tiles, target, weights, level, kind) / count
        }
        Loss::L1Dssim { lambda } => {
            let Tiles { grid, rows, v_rows, dssim: scratch, .. } = tiles;
            dssim::loss((*grid, rows), target, level, lambda, scratch, v_rows)?
        }
    })
}

/// Takes the gradient of a loss of the caller's own, of the pass's size, as `tiles.v_rows`.
///
/// # Errors
/// [`Error::Memory`].
pub(crate) fn take(tiles: &mut Tiles, v_image: &Image) -> Result<(), Error> {
    let pixels = if tiles.collects_errors() { tiles.grid.rows() } else { 0 };
    memory::resize(&mut tiles.errors, pixels, ScalarRow([0.0; LANES]), "the pixels' errors")?;
    tiles.errors.fill(ScalarRow([0.0; LANES]));
    tiles.grid.put_strips(v_image, &mut tiles.v_rows, "the gradient of an image")
}

/// Writes the errors of `tiles.rows` into `tiles.errors`.
fn errors(tiles: &mut Tiles, target: &Target) {
    let grid = tiles.grid;
    let image = &tiles.rows;
    let buffers = TileBuffers { rows: &mut [], scalars: &mut tiles.errors, sums: &mut tiles.sums };
    for_each_tile(0..grid.tiles(), buffers, &grid, &|tile, buffers| {
        let first = grid.first_row(tile);
        let pairs = image[first..].iter().zip(&target.rows[first..]);
        for (ScalarRow(error), (Row(c), Row(y))) in buffers.scalars.iter_mut().zip(pairs) {
            let residual = std::array::from_fn(|k| std::array::from_fn(|i| c[k][i] - y[k][i]));
            *error = mean_magnitude(&residual);
            error[grid.lanes_inside(tile)..].fill(0.0);
        }
    });
}

/// The mean magnitude of the three channels.
#[inline(always)]
fn mean_magnitude([r, g, b]: &[[f32; LANES]; 3]) -> [f32; LANES] {
    std::array::from_fn(|i| (r[i].abs() + g[i].abs() + b[i].abs()) * (1.0 / 3.0))
}

/// The sum of a pointwise loss, unscaled. Writes its scaled gradient into `v_rows`.
fn pointwise(tiles: &mut Tiles, target: &Target, weights: &Target, level: Level, kind: Pointwise) -> f64 {
    let grid = tiles.grid;
    let image = &tiles.rows;
    let buffers = TileBuffers { rows: &mut tiles.v_rows, scalars: &mut [], sums: &mut tiles.sums };
    for_each_tile(0..grid.tiles(), buffers, &grid, &|tile, buffers| {
        let first = grid.first_row(tile);
        let of_tile = first..first + buffers.rows.len();
        let (image, target, weights) =
            (&image[of_tile.clone()], &target.rows[of_tile.clone()], weights.weights_of(of_tile));
        let compared = Compared { target, weights, inside: grid.lanes_inside(tile) };
        buffers.sums[0] = dispatch!(level, simd => pointwise::each(simd, image, compared, buffers.rows, kind));
    });
    tiles.sums.iter().sum()
}
