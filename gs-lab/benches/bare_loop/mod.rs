//! The inner loops of blending under `Sum` alone: the same arithmetic per pixel–Gaussian pair, on
//! 16 rows that stay in the first-level cache. The share of their rate that a whole stage reaches
//! shows what lists, memory, exponentials and threads cost.
//!
//! Per row of 16 pixels, forward: two fused multiply-adds and a masking for the next weight,
//! compare and select at the cut, three fused multiply-adds with load and store. Backward: the same
//! weights, three loads, five fused multiply-adds and a multiplication for colours and v_w, two
//! multiplications and an addition for the first moment, and a fused multiply-add for the second.

use std::hint::black_box;

use fearless_simd::{Level, Select, Simd, dispatch, f32x16, prelude::*};
use gs_cpu::SimdLevel;

/// Pixels in a row.
const LANES: usize = 16;

/// Rows that one Gaussian touches.
pub(crate) const ROWS: usize = 16;

/// Pixel–Gaussian pairs of one Gaussian.
pub(crate) const PAIRS: usize = LANES * ROWS;

/// Three channels of a row, in cache lines of their own.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Row([[f32; LANES]; 3]);

/// A strip that fits into the first-level cache, with a Gaussian on it.
#[derive(Debug)]
pub(crate) struct BareLoop {
    rows: [Row; ROWS],
    /// Weights in the first row, their growth to the next row minus 1, and the change of that
    /// growth.
    weight: [f32; LANES],
    growth: [f32; LANES],
    ratio: f32,
    minus_fall: f32,
    /// All ones, as bits.
    mask: f32,
    cut: f32,
    color: [f32; 3],
}

impl BareLoop {
    /// A Gaussian of σ 5 px in the middle of the strip.
    pub(crate) fn new() -> Self {
        let c = 1.0f32 / 25.0;
        let dx = |lane: usize| lane as f32 + 0.5 - LANES as f32 / 2.0;
        let u = 0.5 - ROWS as f32 / 2.0;
        Self {
            rows: [Row([[0.25; LANES]; 3]); ROWS],
            weight: std::array::from_fn(|lane| (-0.5 * c * (dx(lane) * dx(lane) + u * u)).exp()),
            growth: [(-c * (u + 0.5)).exp_m1(); LANES],
            ratio: (-c).exp(),
            minus_fall: (-c).exp_m1(),
            mask: f32::from_bits(u32::MAX),
            cut: 1.0 / 255.0,
            color: [1e-6, -1e-6, 2e-6],
        }
    }

    /// Blends the Gaussian `gaussians` times.
    pub(crate) fn forward(&mut self, level: Level, gaussians: usize) -> f32 {
        dispatch!(level, simd => forward(simd, self, gaussians));
        self.rows[0].0[0][0]
    }

    /// Differentiates the Gaussian `gaussians` times.
    pub(crate) fn backward(&self, level: Level, gaussians: usize) -> f32 {
        dispatch!(level, simd => backward(simd, self, gaussians))
    }
}

/// A row is one vector or several, as in the kernel.
#[inline(always)]
fn forward<S: Simd>(simd: S, bare: &mut BareLoop, gaussians: usize) {
    let load = |values: &[f32; LANES]| f32x16::from_slice(simd, values);
    let (zero, cut, ratio) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, bare.cut), f32x16::splat(simd, bare.ratio));
    let (minus_fall, mask) = (f32x16::splat(simd, bare.minus_fall), f32x16::splat(simd, bare.mask));
    let [red, green, blue] = bare.color;
    let color = [f32x16::splat(simd, red), f32x16::splat(simd, green), f32x16::splat(simd, blue)];
    for _ in 0..gaussians {
        // The compiler must not hoist computations out of the loop over Gaussians.
        let bare = black_box(&mut *bare);
        let (mut weight, mut growth) = (load(&bare.weight), load(&bare.growth));
        for Row(pixels) in &mut bare.rows {
            let w = weight.simd_ge(cut).select(weight, zero);
            for k in 0..3 {
                w.mul_add(color[k], load(&pixels[k])).store_slice(&mut pixels[k]);
            }
            weight = weight.mul_add(growth, f32x16::from_bits(weight.to_bits() & mask.to_bits()));
            growth = growth.mul_add(ratio, minus_fall);
        }
    }
}

/// Vectors of the level's own length, one part of the rows after another, as in the kernel.
#[inline(always)]
fn backward<S: Simd>(simd: S, bare: &BareLoop, gaussians: usize) -> f32 {
    let mut total = S::f32s::splat(simd, 0.0);
    for lane in (0..LANES).step_by(S::f32s::LEN) {
        total += backward_part(simd, bare, gaussians, lane);
    }
    total.as_slice()[0]
}

#[inline(always)]
fn backward_part<S: Simd>(simd: S, bare: &BareLoop, gaussians: usize, lane: usize) -> S::f32s {
    let load = |values: &[f32; LANES]| S::f32s::from_slice(simd, &values[lane..lane + S::f32s::LEN]);
    let splat = |value: f32| S::f32s::splat(simd, value);
    let (zero, cut, ratio) = (splat(0.0), splat(bare.cut), splat(bare.ratio));
    let (minus_fall, mask) = (splat(bare.minus_fall), splat(bare.mask));
    let color = [splat(bare.color[0]), splat(bare.color[1]), splat(bare.color[2])];
    let (mut v_color, mut s_u, mut s_uu) = ([zero; 3], zero, zero);
    for _ in 0..gaussians {
        let bare = black_box(bare);
        let (mut weight, mut growth) = (load(&bare.weight), load(&bare.growth));
        let mut u = splat(0.5 - ROWS as f32 / 2.0);
        for Row(v) in &bare.rows {
            let w = weight.simd_ge(cut).select(weight, zero);
            let v = [load(&v[0]), load(&v[1]), load(&v[2])];
            for k in 0..3 {
                v_color[k] = w.mul_add(v[k], v_color[k]);
            }
            let v_w = v[2].mul_add(color[2], v[1].mul_add(color[1], v[0] * color[0]));
            let t_u = w * v_w * u;
            s_u += t_u;
            s_uu = t_u.mul_add(u, s_uu);
            u += 1.0;
            weight = weight.mul_add(growth, S::f32s::from_bits(weight.to_bits() & mask.to_bits()));
            growth = growth.mul_add(ratio, minus_fall);
        }
    }
    v_color[0] + v_color[1] + v_color[2] + s_u + s_uu
}

/// The instructions of a level, if this machine supports them.
pub(crate) fn instructions(level: SimdLevel) -> Option<Level> {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    match level {
        SimdLevel::Sse42 => return Level::new().as_sse4_2().map(Level::Sse4_2),
        SimdLevel::Avx2 => return Level::new().as_avx2().map(Level::Avx2),
        SimdLevel::Avx512 => return Level::new().as_avx512().map(Level::Avx512),
        _ => {}
    }
    match level {
        SimdLevel::Scalar => Some(Level::fallback()),
        SimdLevel::Native => Some(Level::new()),
        _ => None,
    }
}
