//! L1 + D-SSIM and its gradient, for stage `loss`. D-SSIM is 1 − SSIM.
//!
//! SSIM = (2 μx μy + C1)(2 σxy + C2) / ((μx² + μy² + C1)(σx² + σy² + C2)) at every pixel and
//! channel (Wang et al. 2004), with an 11×11 Gaussian window and borders padded with zeros (3DGS).
//! With b(·) the blur by the window, which is its own adjoint, and x the image, S depends on x
//! through b(x), b(x²) and b(x y); so v_x = b(∂S/∂b(x)) + 2x·b(∂S/∂b(x²)) + y·b(∂S/∂b(xy)).
//!
//! Parallel over bands of rows. A band goes down its rows once for each channel. It keeps the
//! blurred lines that the blur down the columns still needs, which stay in the second-level cache;
//! only the gradient is written to memory. A band computes the lines that it needs beyond its rows
//! by the same operations as its neighbours do, so the bits do not depend on where bands end.

mod blur;

use fearless_simd::{Simd, prelude::*};
use gs_core::{
    Error,
    constants::{SSIM_C1, SSIM_C2, SSIM_MAX},
    memory,
};
use rayon::prelude::*;

use crate::{
    lanes::{LANES, Whole, iota, load, splat, store},
    layout::{Grid, Row, ScalarRow},
    level::{Level, dispatch},
    pointwise::Pointwise,
    target::{BlurredTarget, Target},
};
use blur::{Line, RADIUS, Ring, Window, window};

/// Fewest rows of a band. Smaller bands would mostly repeat their neighbours' work.
const LEAST_BAND_ROWS: usize = 32;

/// Buffers of [`loss`], kept between iterations.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    bands: Vec<BandScratch>,
    /// Partial sums of each line.
    sums: Vec<Sums>,
    /// Empty between calls: only the memory of a list is kept.
    gradients: Vec<&'static mut [Row]>,
    /// The memory of a target's blurred parts that are computed in each pass.
    spare: BlurredTarget,
}

/// The sums over the pixels of a line.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    ssim: f64,
    l1: f64,
}

/// The lines that a band keeps.
#[derive(Debug, Default)]
struct BandScratch {
    /// A line of the image, and of the target.
    pair: [Line; 2],
    /// b(x), b(x²) and b(xy), blurred along lines only.
    products: Ring,
    /// The derivatives of a line's SSIM by these.
    by: [Line; 3],
    /// The derivatives, blurred along lines.
    derivatives: Ring,
}

impl BandScratch {
    fn fit(&mut self, strips: usize) {
        self.pair.iter_mut().for_each(|line| line.fit(strips));
        self.products.fit(strips);
        self.by.iter_mut().for_each(|line| line.fit(strips));
        self.derivatives.fit(strips);
    }

    /// Sets line `number` of the products to that of image row `row`, or 0 beyond the image.
    #[inline(always)]
    fn put_products<S: Simd>(&mut self, simd: S, pair: Pair<'_>, number: usize, row: Option<usize>, window: &Window) {
        match row.filter(|&row| row < pair.grid.height) {
            Some(row) => {
                pair.lines(simd, row, &mut self.pair);
                self.products.put_products(simd, number, &self.pair, window);
            }
            None => self.products.put_nothing(number),
        }
    }
}

/// A channel of an image, in strips, and of a target.
#[derive(Clone, Copy)]
struct Pair<'a> {
    grid: &'a Grid,
    image: &'a [Row],
    target: &'a BlurredTarget,
    channel: usize,
}

impl Pair<'_> {
    /// The index of a strip's row in the target's lists.
    #[inline(always)]
    fn at(&self, strip: usize, row: usize) -> usize {
        (self.channel * self.grid.height + row) * self.grid.strips() + strip
    }

    /// A strip's row of image and target.
    #[inline(always)]
    fn strip<S: Simd>(&self, simd: S, strip: usize, row: usize) -> [Whole<S>; 2] {
        let x = &self.image[strip * self.grid.height + row].0[self.channel];
        let y = &self.target.y[self.at(strip, row)].0;
        [load(simd, x, 0), load(simd, y, 0)]
    }

    /// A row of image and target as lines, with clamped values.
    #[inline(always)]
    fn lines<S: Simd>(&self, simd: S, row: usize, [x_line, y_line]: &mut [Line; 2]) {
        let zero: Whole<S> = splat(simd, 0.0);
        for (strip, (x_out, y_out)) in x_line.strips_mut().zip(y_line.strips_mut()).enumerate() {
            let [x, y] = self.strip(simd, strip, row);
            let beyond = self.beyond(simd, strip);
            store(beyond.select(zero, bounded(simd, x)), x_out, 0);
            store(beyond.select(zero, bounded(simd, y)), y_out, 0);
        }
    }

    /// A mask of a strip's lanes that are beyond the image.
    #[inline(always)]
    fn beyond<S: Simd>(&self, simd: S, strip: usize) -> <Whole<S> as SimdBase<S>>::Mask {
        let columns: Whole<S> = splat(simd, (self.grid.width - strip * LANES) as f32);
        iota::<S, Whole<S>>(simd, 0).simd_ge(columns)
    }
}

/// Clamps values to ±[`SSIM_MAX`]; NaN stays.
#[inline(always)]
fn bounded<S: Simd>(simd: S, values: Whole<S>) -> Whole<S> {
    let most: Whole<S> = splat(simd, SSIM_MAX);
    values.abs().simd_gt(most).select(most.copysign(values), values)
}

/// Number of rows of a band: at least two bands per thread, if the image is high enough.
fn band_rows(grid: &Grid) -> usize {
    grid.height.div_ceil(2 * rayon::current_num_threads()).max(LEAST_BAND_ROWS)
}

/// An empty list in the memory of another.
fn emptied<'a>(mut list: Vec<&mut [Row]>) -> Vec<&'a mut [Row]> {
    list.clear();
    list.into_iter().map(|_| -> &mut [Row] { unreachable!("the list is empty") }).collect()
}

/// (1 − λ) L1 + λ (1 − SSIM) of `image`, with the gradient in `v_rows`, 0 in lanes beyond the
/// image.
///
/// # Errors
/// [`Error::Memory`].
pub(crate) fn loss(
    (grid, image): (Grid, &[Row]),
    target: &Target,
    level: Level,
    lambda: f32,
    scratch: &mut Scratch,
    v_rows: &mut [Row],
) -> Result<f64, Error> {
    let window = window();
    let mut of_this_pass = None;
    let blurred = match target.blurred.get() {
        Some(blurred) => blurred,
        None => {
            let blurred = blur_target(&grid, &target.rows, level, &window, scratch)?;
            match target.keeps_blurred {
                true => target.blurred.get_or_init(|| blurred),
                false => of_this_pass.insert(blurred),
            }
        }
    };
    let count = (3 * grid.width * grid.height) as f64;
    let lambda = f64::from(lambda);
    let l1 = Pointwise::Absolute { scale: ((1.0 - lambda) / count) as f32 };
    let scale = (-lambda / count) as f32;
    let (strips, rows) = (grid.strips(), band_rows(&grid));
    let bands = grid.height.div_ceil(rows);

    let Scratch { bands: scratches, sums, gradients: memory, spare } = scratch;
    scratches.resize_with(bands.max(scratches.len()), BandScratch::default);
    sums.resize(3 * grid.height, Sums::default());
    // For every band, its rows of every strip of the gradient.
    let mut gradients = emptied(std::mem::take(memory));
    gradients.resize_with(bands * strips, Default::default);
    for (strip, of_strip) in v_rows.chunks_mut(grid.height).enumerate() {
        for (band, of_band) in of_strip.chunks_mut(rows).enumerate() {
            gradients[band * strips + strip] = of_band;
        }
    }
    let outputs = gradients.par_chunks_mut(strips).zip(sums.par_chunks_mut(3 * rows));
    outputs.zip(&mut scratches[..bands]).enumerate().for_each(|(index, ((gradient, sums), scratch))| {
        scratch.fit(strips);
        let band = Band { first: index * rows, l1, scale, window: &window };
        let pair = Pair { grid: &grid, image, target: blurred, channel: 0 };
        dispatch!(level, simd => band.run(simd, pair, scratch, Output { gradient, sums }));
    });
    *memory = emptied(gradients);
    if let Some(blurred) = of_this_pass {
        *spare = blurred;
    }
    let mean = |of: fn(&Sums) -> f64| sums.iter().map(of).sum::<f64>() / count;
    Ok((1.0 - lambda) * mean(|line| line.l1) + lambda * (1.0 - mean(|line| line.ssim)))
}

/// The target's own terms, in the memory of `scratch.spare`. One task per channel.
fn blur_target(
    grid: &Grid,
    target: &[Row],
    level: Level,
    window: &Window,
    scratch: &mut Scratch,
) -> Result<BlurredTarget, Error> {
    let of_channel = grid.height * grid.strips();
    let mut blurred = std::mem::take(&mut scratch.spare);
    for list in [&mut blurred.y, &mut blurred.mean, &mut blurred.square] {
        memory::resize(list, 3 * of_channel, ScalarRow([0.0; LANES]), "what D-SSIM needs of a target")?;
    }
    for (at, ScalarRow(y)) in blurred.y.iter_mut().enumerate() {
        let (line, strip) = (at / grid.strips(), at % grid.strips());
        *y = target[strip * grid.height + line % grid.height].0[line / grid.height];
    }
    scratch.bands.resize_with(scratch.bands.len().max(3), BandScratch::default);
    let (mut mean, mut square) = (std::mem::take(&mut blurred.mean), std::mem::take(&mut blurred.square));
    let outputs = mean.par_chunks_mut(of_channel).zip(square.par_chunks_mut(of_channel));
    outputs.zip(&mut scratch.bands[..3]).enumerate().for_each(|(channel, (outputs, scratch))| {
        scratch.fit(grid.strips());
        let pair = Pair { grid, image: target, target: &blurred, channel };
        dispatch!(level, simd => blur_target_channel(simd, pair, scratch, outputs, window));
    });
    Ok(BlurredTarget { mean, square, ..blurred })
}

/// A channel of [`blur_target`].
#[inline(always)]
fn blur_target_channel<S: Simd>(
    simd: S,
    pair: Pair<'_>,
    scratch: &mut BandScratch,
    (means, squares): (&mut [ScalarRow], &mut [ScalarRow]),
    window: &Window,
) {
    let strips = pair.grid.strips();
    // Numbered as the image's products are, so that equal images have equal bits.
    for number in RADIUS..pair.grid.height + 3 * RADIUS {
        scratch.put_products(simd, pair, number, number.checked_sub(2 * RADIUS), window);
        let Some(row) = number.checked_sub(3 * RADIUS) else { continue };
        let weights = Ring::weights(row + RADIUS, window);
        for strip in 0..strips {
            let [mean, square, _] = scratch.products.down(simd, strip, &weights);
            store(mean, &mut means[row * strips + strip].0, 0);
            store(square, &mut squares[row * strips + strip].0, 0);
        }
    }
}

/// What a band writes: its rows of every strip of the gradient, and the sums over its lines.
struct Output<'a, 'g> {
    gradient: &'a mut [&'g mut [Row]],
    sums: &'a mut [Sums],
}

/// A part of the image's rows, and the parameters of the loss.
struct Band<'a> {
    /// The part's first row.
    first: usize,
    l1: Pointwise,
    /// The factor of ∂SSIM/∂C.
    scale: f32,
    window: &'a Window,
}

impl Band<'_> {
    /// Computes the band's gradient in three steps per row that follow each other down the image.
    ///
    /// The derivatives of a row need the products of [`RADIUS`] more rows, and the gradient needs
    /// as many more derivatives. Lines are numbered from the first that row 0 of the gradient
    /// needs.
    #[inline(always)]
    fn run<S: Simd>(&self, simd: S, pair: Pair<'_>, scratch: &mut BandScratch, output: Output<'_, '_>) {
        let (first, rows) = (self.first, output.sums.len() / 3);
        for channel in 0..3 {
            let pair = Pair { channel, ..pair };
            for number in first..first + rows + 4 * RADIUS {
                let row = number.checked_sub(2 * RADIUS);
                scratch.put_products(simd, pair, number, row, self.window);

                let Some(number) = row.filter(|&number| number >= first) else { continue };
                match number.checked_sub(RADIUS).filter(|&row| row < pair.grid.height) {
                    Some(row) => {
                        let ssim = self.derivatives(simd, pair, number, row, scratch);
                        let inside = row.checked_sub(first).and_then(|row| output.sums.get_mut(3 * row + channel));
                        inside.into_iter().for_each(|sums| sums.ssim = ssim);
                    }
                    None => scratch.derivatives.put_nothing(number),
                }

                if let Some(row) = number.checked_sub(first + 2 * RADIUS) {
                    output.sums[3 * row + channel].l1 = self.gradient(simd, pair, row, scratch, output.gradient);
                }
            }
        }
    }

    /// Sets line `number` of the derivatives to that of image row `row`; returns Σ SSIM of the row.
    #[inline(always)]
    fn derivatives<S: Simd>(
        &self,
        simd: S,
        pair: Pair<'_>,
        number: usize,
        row: usize,
        scratch: &mut BandScratch,
    ) -> f64 {
        let weights = Ring::weights(number, self.window);
        let mut total: Whole<S> = splat(simd, 0.0);
        let [means, squares, products] = scratch.by.each_mut().map(Line::strips_mut);
        for (strip, ((by_mean, by_square), by_product)) in means.zip(squares).zip(products).enumerate() {
            let blurred = scratch.products.down(simd, strip, &weights);
            let (ssim, by) = derivatives(simd, blurred, pair, strip, row);
            total += ssim;
            store(by[0], by_mean, 0);
            store(by[1], by_square, 0);
            store(by[2], by_product, 0);
        }
        scratch.derivatives.put_lines(simd, number, &scratch.by, self.window);
        f64::from(total.reduce_sum())
    }

    /// Writes row `row` of the band's gradient: that of L1, and scale · (b(∂b(x)) + 2x b(∂b(x²)) +
    /// y b(∂b(xy))). Returns Σ |x − y| of the row.
    #[inline(always)]
    fn gradient<S: Simd>(
        &self,
        simd: S,
        pair: Pair<'_>,
        row: usize,
        scratch: &BandScratch,
        gradient: &mut [&mut [Row]],
    ) -> f64 {
        let weights = Ring::weights(self.first + row, self.window);
        let zero: Whole<S> = splat(simd, 0.0);
        let mut total = zero;
        for (strip, rows) in gradient.iter_mut().enumerate() {
            let [a, b, c] = scratch.derivatives.down(simd, strip, &weights);
            let [x, y] = pair.strip(simd, strip, self.first + row);
            let beyond = pair.beyond(simd, strip);
            let (losses, l1) = self.l1.of(simd, beyond.select(zero, x - y));
            total += losses;
            let dssim = (a + bounded(simd, x) * 2.0 * b + bounded(simd, y) * c) * self.scale;
            store(beyond.select(zero, l1 + dssim), &mut rows[row].0[pair.channel], 0);
        }
        f64::from(total.reduce_sum())
    }
}

/// SSIM of a strip's row, and its derivatives by b(x), b(x²) and b(xy); 0 in lanes beyond the
/// image.
#[inline(always)]
fn derivatives<S: Simd>(
    simd: S,
    [mx, square, product]: [Whole<S>; 3],
    pair: Pair<'_>,
    strip: usize,
    row: usize,
) -> (Whole<S>, [Whole<S>; 3]) {
    let (zero, one): (Whole<S>, Whole<S>) = (splat(simd, 0.0), splat(simd, 1.0));
    let my: Whole<S> = load(simd, &pair.target.mean[pair.at(strip, row)].0, 0);
    let square_y: Whole<S> = load(simd, &pair.target.square[pair.at(strip, row)].0, 0);
    let (xx, yy, xy) = (mx * mx, my * my, mx * my);
    let a1 = xy * 2.0 + SSIM_C1;
    let b1 = xx + yy + SSIM_C1;
    // In a window that is nearly constant, σx² + σy² and 2 σxy are the rounding errors of large
    // numbers, which exceed C2 for colours beyond 100. The exact values satisfy these bounds, and
    // with them SSIM stays within ±1.
    let (variances, covariance) = (square - xx + square_y - yy, (product - xy) * 2.0);
    let variances = variances.max(zero);
    let covariance = covariance.max(zero - variances).min(variances);
    let a2 = covariance + SSIM_C2;
    let b2 = variances + SSIM_C2;
    let inverse = pair.beyond(simd, strip).select(zero, one / (b1 * b2));
    let s = a1 * a2 * inverse;
    // 1/b1 − 1/b2 and 1/b2 by the same division.
    let by_mean = (my * (a2 - a1) - mx * s * (b2 - b1)) * inverse * 2.0;
    (s, [by_mean, zero - s * b1 * inverse, a1 * 2.0 * inverse])
}
