//! The blur by SSIM's window: along lines padded with zeros, then down the columns of a ring of
//! lines.

use fearless_simd::Simd;
use gs_core::constants::{SSIM_SIGMA, SSIM_WINDOW};

use crate::{
    lanes::{LANES, Whole, fma, load, load3, splat, splat3, store},
    layout::Row,
};

pub(super) const RADIUS: usize = SSIM_WINDOW / 2;

/// Columns that a strip's blur reads.
const REACH: usize = LANES + 2 * RADIUS;

/// The window's weights, of sum 1.
pub(super) type Window = [f32; SSIM_WINDOW];

pub(super) fn window() -> Window {
    let raw: [f64; SSIM_WINDOW] = std::array::from_fn(|i| {
        let d = i as f64 - RADIUS as f64;
        (-d * d / (2.0 * f64::from(SSIM_SIGMA).powi(2))).exp()
    });
    let sum: f64 = raw.iter().sum();
    raw.map(|v| (v / sum) as f32)
}

/// A channel of an image row in whole strips, with [`RADIUS`] zeros before and after.
///
/// Columns beyond the image must be 0, too.
#[derive(Debug, Default)]
pub(super) struct Line(Vec<f32>);

impl Line {
    pub(super) fn fit(&mut self, strips: usize) {
        // With fewer strips than before, the padding may hold old values.
        self.0.clear();
        self.0.resize(strips * LANES + 2 * RADIUS, 0.0);
    }

    /// The columns that the blur of strip `strip` reads.
    #[inline(always)]
    fn around(&self, strip: usize) -> &[f32; REACH] {
        self.0[strip * LANES..].first_chunk().expect("a line is padded beyond its strips")
    }

    /// The strips.
    #[inline(always)]
    pub(super) fn strips_mut(&mut self) -> impl Iterator<Item = &mut [f32; LANES]> {
        self.0[RADIUS..].as_chunks_mut().0.iter_mut()
    }
}

/// The last [`SSIM_WINDOW`] lines of three quantities, blurred along the line, strip by strip.
///
/// Lines are numbered down the image, and line n is in place n mod [`SSIM_WINDOW`]. The order of
/// the blur's sum therefore depends on the row and not on where a band begins.
#[derive(Debug, Default)]
pub(super) struct Ring(Vec<[Row; SSIM_WINDOW]>);

impl Ring {
    pub(super) fn fit(&mut self, strips: usize) {
        self.0.resize(strips, [Row::ZERO; SSIM_WINDOW]);
    }

    /// The places of line `number`.
    #[inline(always)]
    fn line_mut(&mut self, number: usize) -> impl Iterator<Item = &mut Row> {
        let place = number % SSIM_WINDOW;
        self.0.iter_mut().map(move |lines| &mut lines[place])
    }

    /// Sets line `number`, which is beyond the image, to 0.
    #[inline(always)]
    pub(super) fn put_nothing(&mut self, number: usize) {
        self.line_mut(number).for_each(|line| *line = Row::ZERO);
    }

    /// Sets line `number` to three lines, blurred.
    #[inline(always)]
    pub(super) fn put_lines<S: Simd>(&mut self, simd: S, number: usize, inputs: &[Line; 3], window: &Window) {
        for (strip, Row(outputs)) in self.line_mut(number).enumerate() {
            for (input, output) in inputs.iter().zip(outputs) {
                let around = input.around(strip);
                let mut sum: Whole<S> = splat(simd, 0.0);
                for j in 0..SSIM_WINDOW {
                    sum = fma(load(simd, around, j), splat(simd, window[j]), sum);
                }
                store(sum, output, 0);
            }
        }
    }

    /// Sets line `number` to x, x² and x·y, blurred.
    #[inline(always)]
    pub(super) fn put_products<S: Simd>(&mut self, simd: S, number: usize, [x, y]: &[Line; 2], window: &Window) {
        for (strip, Row([mean, square, product])) in self.line_mut(number).enumerate() {
            let (x, y) = (x.around(strip), y.around(strip));
            let mut sums: [Whole<S>; 3] = splat3(simd, [0.0; 3]);
            for j in 0..SSIM_WINDOW {
                let (x, y): (Whole<S>, Whole<S>) = (load(simd, x, j), load(simd, y, j));
                let weighted = x * window[j];
                sums[0] += weighted;
                sums[1] = fma(weighted, x, sums[1]);
                sums[2] = fma(weighted, y, sums[2]);
            }
            store(sums[0], mean, 0);
            store(sums[1], square, 0);
            store(sums[2], product, 0);
        }
    }

    /// The weights by place, for the blur down the lines from number `first` on.
    #[inline(always)]
    pub(super) fn weights(first: usize, window: &Window) -> Window {
        std::array::from_fn(|place| window[(place + SSIM_WINDOW - first % SSIM_WINDOW) % SSIM_WINDOW])
    }

    /// The blur down a strip.
    #[inline(always)]
    pub(super) fn down<S: Simd>(&self, simd: S, strip: usize, weights: &Window) -> [Whole<S>; 3] {
        let mut sums: [Whole<S>; 3] = splat3(simd, [0.0; 3]);
        for (line, &weight) in self.0[strip].iter().zip(weights) {
            let weight: Whole<S> = splat(simd, weight);
            let [a, b, c] = load3(simd, &line.0, 0);
            sums = [fma(a, weight, sums[0]), fma(b, weight, sums[1]), fma(c, weight, sums[2])];
        }
        sums
    }
}
