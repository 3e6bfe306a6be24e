//! D-SSIM (1 − SSIM) and its gradient, for stage `loss`. Parallel over image rows.
//!
//! SSIM = (2 μx μy + C1)(2 σxy + C2) / ((μx² + μy² + C1)(σx² + σy² + C2)) at every pixel and channel (Wang et al. 2004), with an 11×11
//! Gaussian window and borders padded with zeros (3DGS). With b(·) the blur by the window, which is its own adjoint, and x the
//! image, S depends on x through b(x), b(x²) and b(x y); so v_x = b(∂S/∂b(x)) + 2x·b(∂S/∂b(x²)) + y·b(∂S/∂b(xy)).

use fearless_simd::{Level, Simd, dispatch};
use gs_core::constants::{SSIM_C1, SSIM_C2, SSIM_SIGMA, SSIM_WINDOW};
use rayon::prelude::*;

use crate::{
    lanes::LANES,
    layout::{Cuts, Grid, Row, TileBuffers, for_each_tile},
    loss::PlanarTarget,
    workspace::Workspace,
};

const RADIUS: usize = SSIM_WINDOW / 2;

/// Columns that the vertical blur handles at once, in registers and on the stack.
const BLOCK: usize = 64;

/// Three channels, row by row, one after the other: row y of channel k is row 3y + k. Each row has [`RADIUS`] zeros before and
/// after it.
#[derive(Debug, Default)]
struct Plane {
    pitch: usize,
    values: Vec<f32>,
}

impl Plane {
    fn resize(&mut self, grid: &Grid) {
        let pitch = grid.width + 2 * RADIUS;
        let len = pitch * 3 * grid.height;
        if self.pitch != pitch || self.values.len() != len {
            self.pitch = pitch;
            self.values.clear();
            self.values.resize(len, 0.0);
        }
    }

    fn fill_from(&mut self, grid: &Grid, rows: &[Row]) {
        self.resize(grid);
        self.values.par_chunks_mut(3 * self.pitch).enumerate().for_each(|(y, lines)| {
            for (k, line) in lines.chunks_mut(self.pitch).enumerate() {
                for (strip, columns) in line[RADIUS..][..grid.width].chunks_mut(LANES).enumerate() {
                    columns.copy_from_slice(&rows[strip * grid.height + y].0[k][..columns.len()]);
                }
            }
        });
    }
}

/// b(y) and b(y²) of a target y, and y itself.
#[derive(Debug)]
pub(crate) struct BlurredTarget {
    y: Plane,
    mean: Plane,
    square: Plane,
}

/// Buffers of [`add`], kept between iterations.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    x: Plane,
    /// Horizontally blurred, three kinds.
    across: [Plane; 3],
    /// Derivatives by b(x), b(x²), b(xy).
    by: [Plane; 3],
    /// The gradient.
    v: Plane,
    /// SSIM summed over each image row.
    row_sums: Vec<f64>,
}

fn window() -> [f32; SSIM_WINDOW] {
    let raw: [f64; SSIM_WINDOW] = std::array::from_fn(|i| {
        let d = i as f64 - RADIUS as f64;
        (-d * d / (2.0 * f64::from(SSIM_SIGMA).powi(2))).exp()
    });
    let sum: f64 = raw.iter().sum();
    raw.map(|v| (v / sum) as f32)
}

/// Blurs along rows: `out[c] = f(window sums of the products of inputs)`.
#[inline(always)]
fn blur_row<const N: usize>(inputs: [&[f32]; N], outputs: [&mut [f32]; N], width: usize, kernel: &[f32; SSIM_WINDOW]) {
    for (input, output) in inputs.into_iter().zip(outputs) {
        let (input, output) = (&input[..width + 2 * RADIUS], &mut output[RADIUS..RADIUS + width]);
        for (x, out) in output.iter_mut().enumerate() {
            let taps = &input[x..x + SSIM_WINDOW];
            let mut sum = 0.0;
            for j in 0..SSIM_WINDOW {
                sum += kernel[j] * taps[j];
            }
            *out = sum;
        }
    }
}

/// Blurs x, x² and x·y along a row.
#[inline(always)]
fn blur_products(x: &[f32], y: &[f32], out: [&mut [f32]; 3], width: usize, kernel: &[f32; SSIM_WINDOW]) {
    let (x, y) = (&x[..width + 2 * RADIUS], &y[..width + 2 * RADIUS]);
    let [mean, square, product] = out.map(|o| &mut o[RADIUS..RADIUS + width]);
    for i in 0..width {
        let (xs, ys) = (&x[i..i + SSIM_WINDOW], &y[i..i + SSIM_WINDOW]);
        let mut sums = [0.0f32; 3];
        for j in 0..SSIM_WINDOW {
            let kx = kernel[j] * xs[j];
            sums[0] += kx;
            sums[1] += kx * xs[j];
            sums[2] += kx * ys[j];
        }
        (mean[i], square[i], product[i]) = (sums[0], sums[1], sums[2]);
    }
}

/// The vertical blur of `plane` at row `y`, channel `k`, columns `x..x + n` (without padding).
#[inline(always)]
fn blur_column(
    plane: &Plane,
    (y, k): (usize, usize),
    height: usize,
    x: usize,
    n: usize,
    kernel: &[f32; SSIM_WINDOW],
) -> [f32; BLOCK] {
    let mut out = [0.0; BLOCK];
    for j in 0..SSIM_WINDOW {
        let Some(row) = (y + j).checked_sub(RADIUS).filter(|&row| row < height) else { continue };
        let line = &plane.values[(3 * row + k) * plane.pitch + RADIUS + x..][..n];
        for (out, &value) in out.iter_mut().zip(line) {
            *out += kernel[j] * value;
        }
    }
    out
}

fn blur_target(grid: &Grid, target: &PlanarTarget, level: Level) -> BlurredTarget {
    let kernel = window();
    let mut blurred = BlurredTarget { y: Plane::default(), mean: Plane::default(), square: Plane::default() };
    blurred.y.fill_from(grid, &target.rows);
    let mut across = [Plane::default(), Plane::default(), Plane::default()];
    horizontal_products(grid, &blurred.y, &blurred.y, &mut across, level, &kernel);
    for (out, across) in [(&mut blurred.mean, &across[0]), (&mut blurred.square, &across[1])] {
        out.resize(grid);
        let pitch = out.pitch;
        out.values.par_chunks_mut(3 * pitch).enumerate().for_each(|(y, lines)| {
            for (k, line) in lines.chunks_mut(pitch).enumerate() {
                for x in (0..grid.width).step_by(BLOCK) {
                    let n = BLOCK.min(grid.width - x);
                    let block = blur_column(across, (y, k), grid.height, x, n, &kernel);
                    line[RADIUS + x..][..n].copy_from_slice(&block[..n]);
                }
            }
        });
    }
    blurred
}

fn horizontal_products(
    grid: &Grid,
    x: &Plane,
    y: &Plane,
    out: &mut [Plane; 3],
    level: Level,
    kernel: &[f32; SSIM_WINDOW],
) {
    out.iter_mut().for_each(|plane| plane.resize(grid));
    let pitch = x.pitch;
    let [a, b, c] = out.each_mut().map(|plane| plane.values.par_chunks_mut(pitch));
    a.zip(b).zip(c).with_min_len(8).enumerate().for_each(|(line, ((a, b), c))| {
        let (x, y) = (&x.values[line * pitch..][..pitch], &y.values[line * pitch..][..pitch]);
        dispatch!(level, _simd => blur_products(x, y, [a, b, c], grid.width, kernel));
    });
}

/// Adds λ·∂(1 − SSIM)/∂C to `workspace.v_rows`; returns 1 − SSIM.
pub(crate) fn add(workspace: &mut Workspace, target: &PlanarTarget, level: Level, lambda: f32) -> f64 {
    let kernel = window();
    let grid = workspace.grid;
    let count = (3 * grid.width * grid.height) as f64;
    let blurred = target.blurred.get_or_init(|| blur_target(&grid, target, level));
    let mut scratch = std::mem::take(&mut workspace.dssim);
    scratch.x.fill_from(&grid, &workspace.rows);
    horizontal_products(&grid, &scratch.x, &blurred.y, &mut scratch.across, level, &kernel);
    let ssim = derivatives(&grid, blurred, &mut scratch, level, &kernel) / count;

    horizontal(&grid, &scratch.by, &mut scratch.across, level, &kernel);
    let scale = (-f64::from(lambda) / count) as f32;
    gradient(&grid, blurred, &mut scratch, level, scale, &kernel);

    let v = &scratch.v;
    let cuts = Cuts { grid: &grid, tile_start: &workspace.bins.tile_start, stride: 0 };
    let buffers = TileBuffers { rows: &mut workspace.v_rows, transmittance: &mut [], slots: &mut [], sums: &mut [] };
    for_each_tile(0..grid.tiles(), buffers, cuts, &|tile, buffers| {
        let (column, rows) = grid.place(tile);
        let inside = grid.lanes_inside(tile);
        for (Row(out), y) in buffers.rows.iter_mut().zip(rows) {
            for k in 0..3 {
                let line = &v.values[(3 * y + k) * v.pitch + RADIUS + column..][..inside];
                for (out, &v) in out[k].iter_mut().zip(line) {
                    *out += v;
                }
            }
        }
    });
    workspace.dssim = scratch;
    1.0 - ssim
}

/// Blurs vertically, and writes ∂SSIM/∂b(x), ∂b(x²), ∂b(xy) of every pixel; returns Σ SSIM.
fn derivatives(
    grid: &Grid,
    blurred: &BlurredTarget,
    scratch: &mut Scratch,
    level: Level,
    kernel: &[f32; SSIM_WINDOW],
) -> f64 {
    let Scratch { across, by, row_sums, .. } = scratch;
    by.iter_mut().for_each(|plane| plane.resize(grid));
    row_sums.resize(grid.height, 0.0);
    let pitch = blurred.mean.pitch;
    let [a, b, c] = by.each_mut().map(|plane| plane.values.par_chunks_mut(3 * pitch));
    a.zip(b).zip(c).zip(row_sums.par_iter_mut()).enumerate().for_each(|(y, (((a, b), c), sum))| {
        *sum = dispatch!(level, simd => {
            derivative_lines(simd, grid, blurred, across, y, [a, b, c], kernel)
        });
    });
    row_sums.iter().sum()
}

#[inline(always)]
fn derivative_lines<S: Simd>(
    _simd: S,
    grid: &Grid,
    blurred: &BlurredTarget,
    across: &[Plane; 3],
    y: usize,
    out: [&mut [f32]; 3],
    kernel: &[f32; SSIM_WINDOW],
) -> f64 {
    let pitch = blurred.mean.pitch;
    let mut total = 0.0;
    for k in 0..3 {
        let line = (3 * y + k) * pitch + RADIUS;
        for x in (0..grid.width).step_by(BLOCK) {
            let n = BLOCK.min(grid.width - x);
            let [mean, square, product] = [0, 1, 2].map(|i| blur_column(&across[i], (y, k), grid.height, x, n, kernel));
            let mean_y = &blurred.mean.values[line + x..][..n];
            let square_y = &blurred.square.values[line + x..][..n];
            let at = k * pitch + RADIUS + x;
            let mut sum = 0.0f32;
            for i in 0..n {
                let (mx, my) = (mean[i], mean_y[i]);
                let a1 = 2.0 * mx * my + SSIM_C1;
                let a2 = 2.0 * (product[i] - mx * my) + SSIM_C2;
                let b1 = mx * mx + my * my + SSIM_C1;
                let b2 = square[i] - mx * mx + square_y[i] - my * my + SSIM_C2;
                let inverse = 1.0 / (b1 * b2);
                let s = a1 * a2 * inverse;
                sum += s;
                out[0][at + i] = 2.0 * my * (a2 - a1) * inverse - 2.0 * mx * s * (1.0 / b1 - 1.0 / b2);
                out[1][at + i] = -s / b2;
                out[2][at + i] = 2.0 * a1 * inverse;
            }
            total += f64::from(sum);
        }
    }
    total
}

fn horizontal(grid: &Grid, input: &[Plane; 3], out: &mut [Plane; 3], level: Level, kernel: &[f32; SSIM_WINDOW]) {
    let pitch = input[0].pitch;
    let [a, b, c] = out.each_mut().map(|plane| plane.values.par_chunks_mut(pitch));
    a.zip(b).zip(c).with_min_len(8).enumerate().for_each(|(line, ((a, b), c))| {
        let input = input.each_ref().map(|plane| &plane.values[line * pitch..][..pitch]);
        dispatch!(level, _simd => blur_row(input, [a, b, c], grid.width, kernel));
    });
}

/// scale · (b(∂b(x)) + 2x b(∂b(x²)) + y b(∂b(xy))), into `scratch.v`.
fn gradient(
    grid: &Grid,
    blurred: &BlurredTarget,
    scratch: &mut Scratch,
    level: Level,
    scale: f32,
    kernel: &[f32; SSIM_WINDOW],
) {
    let Scratch { across, x: image, v, .. } = scratch;
    v.resize(grid);
    let pitch = v.pitch;
    v.values.par_chunks_mut(3 * pitch).enumerate().for_each(|(y, lines)| {
        dispatch!(level, _simd => {
            for k in 0..3 {
                let line = (3 * y + k) * pitch + RADIUS;
                for x in (0..grid.width).step_by(BLOCK) {
                    let n = BLOCK.min(grid.width - x);
                    let [a, b, c] = [0, 1, 2].map(|i| blur_column(&across[i], (y, k), grid.height, x, n, kernel));
                    let xs = &image.values[line + x..][..n];
                    let ys = &blurred.y.values[line + x..][..n];
                    let out = &mut lines[k * pitch + RADIUS + x..][..n];
                    for i in 0..n {
                        out[i] = scale * (a[i] + 2.0 * xs[i] * b[i] + ys[i] * c[i]);
                    }
                }
            }
        });
    });
}
