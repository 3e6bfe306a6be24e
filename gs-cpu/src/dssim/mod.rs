//! D-SSIM (1 − SSIM) and its gradient, for stage `loss`. Parallel over image rows.
//!
//! SSIM = (2 μx μy + C1)(2 σxy + C2) / ((μx² + μy² + C1)(σx² + σy² + C2)) at every pixel and channel (Wang et al. 2004), with an 11×11
//! Gaussian window and borders padded with zeros (3DGS). With b(·) the blur by the window, which is its own adjoint, and x the
//! image, S depends on x through b(x), b(x²) and b(x y); so v_x = b(∂S/∂b(x)) + 2x·b(∂S/∂b(x²)) + y·b(∂S/∂b(xy)).

use fearless_simd::{Level, Simd, dispatch, prelude::*};
use gs_core::{
    constants::{SSIM_C1, SSIM_C2, SSIM_MAX, SSIM_SIGMA, SSIM_WINDOW},
    guards::Guard,
    profile::Traffic,
};
use rayon::prelude::*;

use crate::{
    lanes::{LANES, fma, iota, load, splat, store},
    layout::{Cuts, Grid, Row, TileBuffers, for_each_tile},
    loss::Target,
    tiles::Tiles,
};

const RADIUS: usize = SSIM_WINDOW / 2;

type Window = [f32; SSIM_WINDOW];

/// Three channels, row by row, one after the other: row y of channel k is line 3y + k. A line holds whole strips, 0 beyond the
/// image, with [`RADIUS`] zeros before and after them.
#[derive(Debug, Default)]
struct Plane {
    pitch: usize,
    values: Vec<f32>,
}

impl Plane {
    fn pitch(grid: &Grid) -> usize {
        grid.strips() * LANES + 2 * RADIUS
    }

    fn len(grid: &Grid) -> usize {
        Self::pitch(grid) * 3 * grid.height
    }

    fn resize(&mut self, grid: &Grid) {
        let (pitch, len) = (Self::pitch(grid), Self::len(grid));
        if self.pitch != pitch || self.values.len() != len {
            self.pitch = pitch;
            self.values.clear();
            self.values.resize(len, 0.0);
        }
    }

    fn fill_from(&mut self, grid: &Grid, rows: &[Row]) {
        self.resize(grid);
        let most = if Guard::SsimMax.is_on() { SSIM_MAX } else { f32::INFINITY };
        self.values.par_chunks_mut(3 * self.pitch).enumerate().for_each(|(y, lines)| {
            for (k, line) in lines.chunks_mut(self.pitch).enumerate() {
                for (strip, columns) in line[RADIUS..][..grid.width].chunks_mut(LANES).enumerate() {
                    for (out, value) in columns.iter_mut().zip(&rows[strip * grid.height + y].0[k]) {
                        *out = value.clamp(-most, most);
                    }
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

fn window() -> Window {
    let raw: [f64; SSIM_WINDOW] = std::array::from_fn(|i| {
        let d = i as f64 - RADIUS as f64;
        (-d * d / (2.0 * f64::from(SSIM_SIGMA).powi(2))).exp()
    });
    let sum: f64 = raw.iter().sum();
    raw.map(|v| (v / sum) as f32)
}

/// Blurs three lines, each along itself.
#[inline(always)]
fn blur_lines<S: Simd>(simd: S, inputs: [&[f32]; 3], outputs: [&mut [f32]; 3], window: &Window) {
    for (input, output) in inputs.into_iter().zip(outputs) {
        for x in (0..input.len() - 2 * RADIUS).step_by(S::f32s::LEN) {
            let mut sum: S::f32s = splat(simd, 0.0);
            for j in 0..SSIM_WINDOW {
                sum = fma(load(simd, input, x + j), splat(simd, window[j]), sum);
            }
            store(sum, output, RADIUS + x);
        }
    }
}

/// Blurs x, x² and x·y along a line.
#[inline(always)]
fn blur_products<S: Simd>(simd: S, x: &[f32], y: &[f32], outputs: [&mut [f32]; 3], window: &Window) {
    let [mean, square, product] = outputs;
    for i in (0..x.len() - 2 * RADIUS).step_by(S::f32s::LEN) {
        let mut sums: [S::f32s; 3] = [splat(simd, 0.0); 3];
        for j in 0..SSIM_WINDOW {
            let (x, y): (S::f32s, S::f32s) = (load(simd, x, i + j), load(simd, y, i + j));
            let weighted = x * window[j];
            sums[0] += weighted;
            sums[1] = fma(weighted, x, sums[1]);
            sums[2] = fma(weighted, y, sums[2]);
        }
        store(sums[0], mean, RADIUS + i);
        store(sums[1], square, RADIUS + i);
        store(sums[2], product, RADIUS + i);
    }
}

/// The vertical blurs of three planes.
#[inline(always)]
fn blur_columns<S: Simd>(
    simd: S,
    [a, b, c]: &[Plane; 3],
    place: (usize, usize),
    height: usize,
    x: usize,
    window: &Window,
) -> [S::f32s; 3] {
    [
        blur_column(simd, a, place, height, x, window),
        blur_column(simd, b, place, height, x, window),
        blur_column(simd, c, place, height, x, window),
    ]
}

/// The vertical blur of `plane` at row `y`, channel `k`, and the sixteen columns from `x` on.
#[inline(always)]
fn blur_column<S: Simd>(
    simd: S,
    plane: &Plane,
    (y, k): (usize, usize),
    height: usize,
    x: usize,
    window: &Window,
) -> S::f32s {
    let mut sum: S::f32s = splat(simd, 0.0);
    let first = y.saturating_sub(RADIUS);
    for row in first..(y + RADIUS + 1).min(height) {
        let at = (3 * row + k) * plane.pitch + RADIUS + x;
        sum = fma(load(simd, &plane.values, at), splat(simd, window[row + RADIUS - y]), sum);
    }
    sum
}

/// The vertical blur of a whole line of a plane.
#[inline(always)]
fn blur_down<S: Simd>(simd: S, grid: &Grid, plane: &Plane, line: usize, out: &mut [f32], window: &Window) {
    for x in (0..plane.pitch - 2 * RADIUS).step_by(S::f32s::LEN) {
        store(blur_column(simd, plane, (line / 3, line % 3), grid.height, x, window), out, RADIUS + x);
    }
}

fn blur_target(grid: &Grid, target: &Target, level: Level) -> BlurredTarget {
    let window = window();
    let mut blurred = BlurredTarget { y: Plane::default(), mean: Plane::default(), square: Plane::default() };
    blurred.y.fill_from(grid, &target.rows);
    let mut across = [Plane::default(), Plane::default(), Plane::default()];
    horizontal_products(grid, &blurred.y, &blurred.y, &mut across, level, &window);
    for (out, across) in [(&mut blurred.mean, &across[0]), (&mut blurred.square, &across[1])] {
        out.resize(grid);
        let pitch = out.pitch;
        out.values.par_chunks_mut(pitch).enumerate().for_each(|(line, out)| {
            dispatch!(level, simd => blur_down(simd, grid, across, line, out, &window));
        });
    }
    blurred
}

fn horizontal_products(grid: &Grid, x: &Plane, y: &Plane, out: &mut [Plane; 3], level: Level, window: &Window) {
    out.iter_mut().for_each(|plane| plane.resize(grid));
    let pitch = x.pitch;
    let [a, b, c] = out.each_mut().map(|plane| plane.values.par_chunks_mut(pitch));
    a.zip(b).zip(c).with_min_len(8).enumerate().for_each(|(line, ((a, b), c))| {
        let (x, y) = (&x.values[line * pitch..][..pitch], &y.values[line * pitch..][..pitch]);
        dispatch!(level, simd => blur_products(simd, x, y, [a, b, c], window));
    });
}

/// What [`add`] moves at least, once the target's part is there.
pub(crate) fn traffic(grid: &Grid) -> Traffic {
    let (image, plane) = (grid.rows() * size_of::<Row>(), Plane::len(grid) * size_of::<f32>());
    // Image to lines; products blurred along lines; down, and the derivatives; those along lines; down, and the gradient; to strips.
    let read = image + 2 * plane + (3 + 2) * plane + 3 * plane + (3 + 2) * plane + (plane + image);
    let written = plane + 3 * plane + 3 * plane + 3 * plane + plane + image;
    Traffic { read: read as u64, written: written as u64 }
}

/// Adds λ·∂(1 − SSIM)/∂C to `tiles.v_rows`; returns 1 − SSIM.
pub(crate) fn add(tiles: &mut Tiles, target: &Target, level: Level, lambda: f32) -> f64 {
    let window = window();
    let grid = tiles.grid;
    let count = (3 * grid.width * grid.height) as f64;
    let blurred = target.blurred.get_or_init(|| blur_target(&grid, target, level));
    let mut scratch = std::mem::take(&mut tiles.dssim);
    scratch.x.fill_from(&grid, &tiles.rows);
    horizontal_products(&grid, &scratch.x, &blurred.y, &mut scratch.across, level, &window);
    let ssim = derivatives(&grid, blurred, &mut scratch, level, &window) / count;

    horizontal(&grid, &scratch.by, &mut scratch.across, level, &window);
    let scale = (-f64::from(lambda) / count) as f32;
    gradient(&grid, blurred, &mut scratch, level, scale, &window);

    let v = &scratch.v;
    let cuts = Cuts { grid: &grid, tile_start: &tiles.bins.tile_start, stride: 0 };
    let buffers = TileBuffers { rows: &mut tiles.v_rows, scalars: &mut [], slots: &mut [], sums: &mut [] };
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
    tiles.dssim = scratch;
    1.0 - ssim
}

/// Blurs vertically, and writes ∂SSIM/∂b(x), ∂b(x²), ∂b(xy) of every pixel; returns Σ SSIM.
fn derivatives(grid: &Grid, blurred: &BlurredTarget, scratch: &mut Scratch, level: Level, window: &Window) -> f64 {
    let Scratch { across, by, row_sums, .. } = scratch;
    by.iter_mut().for_each(|plane| plane.resize(grid));
    row_sums.resize(grid.height, 0.0);
    let pitch = blurred.mean.pitch;
    let [a, b, c] = by.each_mut().map(|plane| plane.values.par_chunks_mut(3 * pitch));
    a.zip(b).zip(c).zip(row_sums.par_iter_mut()).enumerate().for_each(|(y, (((a, b), c), sum))| {
        *sum = dispatch!(level, simd => derivative_lines(simd, grid, blurred, across, y, [a, b, c], window));
    });
    row_sums.iter().sum()
}

#[inline(always)]
fn derivative_lines<S: Simd>(
    simd: S,
    grid: &Grid,
    blurred: &BlurredTarget,
    across: &[Plane; 3],
    y: usize,
    out: [&mut [f32]; 3],
    window: &Window,
) -> f64 {
    let pitch = blurred.mean.pitch;
    let (zero, one): (S::f32s, S::f32s) = (splat(simd, 0.0), splat(simd, 1.0));
    let mut total = 0.0;
    for k in 0..3 {
        let line = (3 * y + k) * pitch + RADIUS;
        let mut sum = zero;
        for x in (0..grid.width).step_by(S::f32s::LEN) {
            let [mx, square, product] = blur_columns(simd, across, (y, k), grid.height, x, window);
            let my: S::f32s = load(simd, &blurred.mean.values, line + x);
            let square_y: S::f32s = load(simd, &blurred.square.values, line + x);
            let (xx, yy, xy) = (mx * mx, my * my, mx * my);
            let a1 = xy * 2.0 + SSIM_C1;
            let b1 = xx + yy + SSIM_C1;
            // σx² + σy² and 2 σxy of a window that is nearly constant are what rounding leaves of large numbers: more than C2 where colours are
            // beyond 100. So bounded, as they are by their definition, SSIM stays within ±1.
            let (variances, covariance) = (square - xx + square_y - yy, (product - xy) * 2.0);
            let (variances, covariance) = if Guard::SsimVariances.is_on() {
                let variances = variances.max(zero);
                (variances, covariance.max(zero - variances).min(variances))
            } else {
                (variances, covariance)
            };
            let a2 = covariance + SSIM_C2;
            let b2 = variances + SSIM_C2;
            // Lanes beyond the image: 0.
            let beyond = iota::<S, S::f32s>(simd, 0).simd_ge(splat::<S, S::f32s>(simd, (grid.width - x) as f32));
            let inverse = beyond.select(zero, one / (b1 * b2));
            let s = a1 * a2 * inverse;
            sum += s;
            let by_mean = my * 2.0 * (a2 - a1) * inverse - mx * 2.0 * s * (one / b1 - one / b2);
            let at = k * pitch + RADIUS + x;
            store(by_mean, out[0], at);
            store(-s / b2, out[1], at);
            store(a1 * 2.0 * inverse, out[2], at);
        }
        total += f64::from(sum.reduce_sum());
    }
    total
}

fn horizontal(grid: &Grid, input: &[Plane; 3], out: &mut [Plane; 3], level: Level, window: &Window) {
    let pitch = input[0].pitch;
    out.iter_mut().for_each(|plane| plane.resize(grid));
    let [a, b, c] = out.each_mut().map(|plane| plane.values.par_chunks_mut(pitch));
    a.zip(b).zip(c).with_min_len(8).enumerate().for_each(|(line, ((a, b), c))| {
        let input = input.each_ref().map(|plane| &plane.values[line * pitch..][..pitch]);
        dispatch!(level, simd => blur_lines(simd, input, [a, b, c], window));
    });
}

/// scale · (b(∂b(x)) + 2x b(∂b(x²)) + y b(∂b(xy))), into `scratch.v`.
fn gradient(grid: &Grid, blurred: &BlurredTarget, scratch: &mut Scratch, level: Level, scale: f32, window: &Window) {
    let Scratch { across, x: image, v, .. } = scratch;
    v.resize(grid);
    let pitch = v.pitch;
    v.values.par_chunks_mut(pitch).enumerate().for_each(|(line, out)| {
        dispatch!(level, simd => gradient_line(simd, grid, [image, &blurred.y], across, line, scale, out, window));
    });
}

/// One line of [`gradient`].
#[expect(clippy::too_many_arguments, reason = "a kernel's inputs are slices of different owners")]
#[inline(always)]
fn gradient_line<S: Simd>(
    simd: S,
    grid: &Grid,
    [image, target]: [&Plane; 2],
    across: &[Plane; 3],
    line: usize,
    scale: f32,
    out: &mut [f32],
    window: &Window,
) {
    for x in (0..grid.width).step_by(S::f32s::LEN) {
        let [a, b, c] = blur_columns(simd, across, (line / 3, line % 3), grid.height, x, window);
        let at = line * image.pitch + RADIUS + x;
        let (xs, ys): (S::f32s, S::f32s) = (load(simd, &image.values, at), load(simd, &target.values, at));
        store((a + xs * 2.0 * b + ys * c) * scale, out, RADIUS + x);
    }
}
