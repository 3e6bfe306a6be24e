//! Arithmetic on vectors of pixels that the SIMD library lacks: exp, and eight sums at once.
//!
//! Kernels work on the widest vector of their level ([`Simd::f32s`]). One to four of them make a
//! row of a strip. Wider vectors, made of several registers, would cause register spills.

use std::ops::{BitAnd, Shl};

use fearless_simd::{Select, Simd, f32x16, prelude::*};
use gs_core::constants::MAX_DERIVATIVE;

/// Columns in a strip, and the largest number of pixels in a vector.
pub(crate) const LANES: usize = 16;

/// Calls `$part::<S, S::f32s, $kind>($args, lane)` for the first lane of every vector of a row.
///
/// For one or two vectors, the lane is a constant of each call, so that loads need no bounds
/// checks. For four vectors, a loop keeps the compiled code small.
macro_rules! each_part {
    ($simd:ty $(, $kind:ty)?; $part:ident($($arg:expr),* $(,)?)) => {{
        match <$simd as fearless_simd::Simd>::f32s::LEN {
            4 => {
                for lane in [0, 4, 8, 12] {
                    $part::<$simd, <$simd as fearless_simd::Simd>::f32s $(, $kind)?>($($arg,)* lane);
                }
            }
            8 => {
                $part::<$simd, <$simd as fearless_simd::Simd>::f32s $(, $kind)?>($($arg,)* 0);
                $part::<$simd, <$simd as fearless_simd::Simd>::f32s $(, $kind)?>($($arg,)* 8);
            }
            _ => $part::<$simd, <$simd as fearless_simd::Simd>::f32s $(, $kind)?>($($arg,)* 0),
        }
    }};
}
pub(crate) use each_part;

/// A vector of `f32` of any width.
pub(crate) trait Floats<S: Simd>:
    SimdFloat<S, Element = f32, Mask: Select<Self> + Copy, Bits: Shl<u32> + BitAnd + Copy> + Copy
{
}

impl<S: Simd, V> Floats<S> for V where
    V: SimdFloat<S, Element = f32, Mask: Select<Self> + Copy, Bits: Shl<u32> + BitAnd + Copy> + Copy
{
}

/// A whole row of a strip: one register or several.
pub(crate) type Whole<S> = f32x16<S>;

/// Returns a vector with the same number in every lane.
#[inline(always)]
pub(crate) fn splat<S: Simd, V: Floats<S>>(simd: S, value: f32) -> V {
    V::splat(simd, value)
}

/// a·b + c, rounded once where the level can.
#[inline(always)]
pub(crate) fn fma<S: Simd, V: Floats<S>>(a: V, b: V, c: V) -> V {
    a.mul_add(b, c)
}

/// Three numbers, each in every lane.
// A closure for `map` would not be compiled for the SIMD level.
#[inline(always)]
pub(crate) fn splat3<S: Simd, V: Floats<S>>(simd: S, [a, b, c]: [f32; 3]) -> [V; 3] {
    [splat(simd, a), splat(simd, b), splat(simd, c)]
}

/// The vector that begins at lane `lane` of a row's values.
#[inline(always)]
pub(crate) fn load<S: Simd, V: Floats<S>>(simd: S, values: &[f32], lane: usize) -> V {
    V::from_slice(simd, &values[lane..lane + V::LEN])
}

/// The vectors that begin at lane `lane` of the three channels of a row.
#[inline(always)]
pub(crate) fn load3<S: Simd, V: Floats<S>>(simd: S, [a, b, c]: &[[f32; LANES]; 3], lane: usize) -> [V; 3] {
    [load(simd, a, lane), load(simd, b, lane), load(simd, c, lane)]
}

/// Stores a vector where [`load`] reads it.
#[inline(always)]
pub(crate) fn store<S: Simd, V: Floats<S>>(vector: V, values: &mut [f32], lane: usize) {
    vector.store_slice(&mut values[lane..lane + V::LEN]);
}

/// `first`, `first` + 1, … up to 15.
#[inline(always)]
pub(crate) fn iota<S: Simd, V: Floats<S>>(simd: S, first: usize) -> V {
    const COUNT: [f32; LANES] = [0., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 13., 14., 15.];
    load(simd, &COUNT, first)
}

/// eˣ = 2ⁿ eʳ: returns 2ⁿ, and eʳ − 1 without cancellation. Valid for |x| ≤ 87.
///
/// Range reduction x = n ln 2 + r, |r| ≤ ½ ln 2, with ln 2 in two parts; eʳ by a minimax polynomial
/// of degree 5 (Cephes' `expf`).
#[inline(always)]
fn exp_parts<S: Simd, V: Floats<S>>(simd: S, x: V) -> (V, V) {
    // Adding 1.5·2²³ + 127 rounds to an integer and leaves it in the low bits as an exponent.
    const ROUND: f32 = 12_582_912.0 + 127.0;
    let constant = |value: f32| V::splat(simd, value);
    let shifted = x.mul_add(constant(std::f32::consts::LOG2_E), constant(ROUND));
    let n = shifted - ROUND;
    let r = n.mul_add(constant(-0.693_359_4), x);
    let r = n.mul_add(constant(2.121_944_4e-4), r);
    let p = constant(1.987_569_1e-4);
    let p = p.mul_add(r, constant(1.398_199_9e-3));
    let p = p.mul_add(r, constant(8.333_452e-3));
    let p = p.mul_add(r, constant(4.166_579_6e-2));
    let p = p.mul_add(r, constant(1.666_666_5e-1));
    let p = p.mul_add(r, constant(0.5));
    (V::from_bits(shifted.to_bits() << 23), p.mul_add(r * r, r))
}

/// eˣ for x ≤ 0, relative error below 2 ulp; 0 where x < −87.
#[inline(always)]
pub(crate) fn exp<S: Simd, V: Floats<S>>(simd: S, x: V) -> V {
    let (power, rest) = exp_parts(simd, x);
    let least = -87.0;
    x.simd_ge(splat::<S, V>(simd, least)).select(power.mul_add(rest, power), splat(simd, 0.0))
}

/// eˣ − `base` for |x| ≤ 87 and a base of 0 or 1, to 2 ulp of eˣ − base.
#[inline(always)]
pub(crate) fn exp_less<S: Simd, V: Floats<S>>(simd: S, x: V, base: f32) -> V {
    let (power, rest) = exp_parts(simd, x);
    power.mul_add(rest, power - base)
}

/// ln x for x ≥ 1, to 2 ulp: ln m + e ln 2 with x = m 2ᵉ, √½ ≤ m < √2 (Cephes' `logf`).
#[inline(always)]
pub(crate) fn ln<S: Simd, V: Floats<S>>(simd: S, x: V) -> V {
    // As the low bits of this, an integer is a number.
    const INTEGER: f32 = 8_388_608.0;
    let constant = |value: f32| V::splat(simd, value);
    let bits = x.to_bits();
    let exponent = V::from_bits((bits >> 23) | constant(INTEGER).to_bits()) - (INTEGER + 127.0);
    let m = V::from_bits((bits & constant(f32::from_bits(0x007F_FFFF)).to_bits()) | constant(1.0).to_bits());
    let upper = m.simd_gt(constant(std::f32::consts::SQRT_2));
    let f = upper.select(m * 0.5, m) - 1.0;
    let e = upper.select(exponent + 1.0, exponent);
    let p = constant(7.037_684e-2).mul_add(f, constant(-1.151_461e-1));
    let p = p.mul_add(f, constant(1.167_7e-1));
    let p = p.mul_add(f, constant(-1.242_014_1e-1));
    let p = p.mul_add(f, constant(1.424_932_3e-1));
    let p = p.mul_add(f, constant(-1.666_805_8e-1));
    let p = p.mul_add(f, constant(2.000_071_5e-1));
    let p = p.mul_add(f, constant(-2.499_999_4e-1));
    let p = p.mul_add(f, constant(3.333_333e-1));
    let square = f * f;
    let rest = e.mul_add(constant(-2.121_944_4e-4), p * f * square);
    e.mul_add(constant(0.693_359_4), square.mul_add(constant(-0.5), rest) + f)
}

/// Clamps a derivative to ±[`MAX_DERIVATIVE`] for Adam. NaN stays, so that the Gaussian is pruned.
#[inline(always)]
pub(crate) fn bounded_derivative<S: Simd, V: Floats<S>>(simd: S, g: V) -> V {
    let most: V = splat(simd, MAX_DERIVATIVE);
    g.abs().simd_gt(most).select(most.copysign(g), g)
}

/// Keeps ln-scales within their bounds. NaN stays, so that the Gaussian is pruned.
#[inline(always)]
pub(crate) fn bound_scales(log_scales: &mut [f32], [floor, ceiling]: [f32; 2]) {
    for scale in log_scales {
        if *scale < floor {
            *scale = floor;
        } else if *scale > ceiling {
            *scale = ceiling;
        }
    }
}

/// The vector where the bits of `mask` are set, else 0.
#[inline(always)]
pub(crate) fn masked<S: Simd, V: Floats<S>>(vector: V, mask: V) -> V {
    V::from_bits(vector.to_bits() & mask.to_bits())
}

/// Transposes 16 rows of 16 numbers: each round interleaves rows that are half the number apart.
#[inline(always)]
pub(crate) fn transpose<S: Simd>(rows: &mut [Whole<S>; LANES]) {
    for _ in 0..LANES.ilog2() {
        let before = *rows;
        for k in 0..LANES / 2 {
            rows[2 * k] = before[k].zip_low(before[k + LANES / 2]);
            rows[2 * k + 1] = before[k].zip_high(before[k + LANES / 2]);
        }
    }
}

/// The sums over lanes of eight vectors. Every addition works on full registers.
#[inline(always)]
pub(crate) fn sums<S: Simd, V: Floats<S>>([a, b, c, d, e, f, g, h]: [V; 8]) -> [f32; 8] {
    #[inline(always)]
    fn pairs<S: Simd, V: Floats<S>>(a: V, b: V) -> V {
        a.unzip_low(b) + a.unzip_high(b)
    }
    let (ab, cd, ef, gh) = (pairs(a, b), pairs(c, d), pairs(e, f), pairs(g, h));
    let (abcd, efgh) = (pairs(ab, cd), pairs(ef, gh));
    let mut out = [0.0; 8];
    match V::LEN {
        4 => {
            out[..4].copy_from_slice(&abcd.as_slice()[..4]);
            out[4..].copy_from_slice(&efgh.as_slice()[..4]);
        }
        8 => out.copy_from_slice(&pairs(abcd, efgh).as_slice()[..8]),
        _ => {
            // Lanes 2i and 2i + 1 hold the halves of sum i.
            let halves = pairs(abcd, efgh);
            out.copy_from_slice(&pairs(halves, halves).as_slice()[..8]);
        }
    }
    out
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::level::{SimdLevel, dispatch};

    #[test]
    fn exp_is_exact_to_two_ulp_at_every_level() {
        let worst_of = |level: SimdLevel, base: f32, numbers: &[f32]| {
            let token = level.instructions().unwrap();
            let relative = |x: f32| {
                let got = dispatch!(token, simd => exp_less(simd, Whole::splat(simd, x), base).as_slice()[3]);
                let exact = if base == 0.0 { f64::from(x).exp() } else { f64::from(x).exp_m1() };
                ((f64::from(got) - exact) / exact).abs()
            };
            numbers.iter().map(|&x| relative(x)).fold(0.0, f64::max)
        };
        let wide: Vec<f32> = (0..20_000).map(|i| -87.0 + i as f32 * (174.0 / 20_000.0)).collect();
        let near_zero: Vec<f32> = (1..2_000).map(|i| -0.34 * i as f32 / 2_000.0).collect();
        for level in SimdLevel::available() {
            for (base, numbers) in [(0.0, &wide), (1.0, &near_zero)] {
                let worst = worst_of(level, base, numbers);
                assert!(worst < 2.4e-7, "{level}, less {base}: {worst:e}");
            }
        }
    }

    #[test]
    fn ln_is_exact_to_two_ulp_at_every_level() {
        let near_one = (0..2_000).map(|i| 1.0 + i as f32 * 3e-4);
        let numbers: Vec<f32> = near_one.chain((0..2_000).map(|i| 1.02f32.powi(i))).collect();
        for level in SimdLevel::available() {
            let token = level.instructions().unwrap();
            for x in &numbers {
                let got = dispatch!(token, simd => ln(simd, Whole::splat(simd, *x)).as_slice()[3]);
                let exact = f64::from(*x).ln();
                assert!((f64::from(got) - exact).abs() <= 2.4e-7 * exact, "{level}, {x}: {got} instead of {exact}");
            }
        }
    }

    #[test]
    fn exp_vanishes_below_its_range() {
        let token = SimdLevel::best().instructions().unwrap();
        let values = [f32::NEG_INFINITY, -1e30, -88.0, f32::NAN, 0.0];
        let got = values.map(|x| dispatch!(token, simd => exp(simd, Whole::splat(simd, x)).as_slice()[0]));
        assert_eq!(got, [0.0, 0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn rows_become_columns() {
        for level in SimdLevel::available() {
            let token = level.instructions().unwrap();
            let columns = dispatch!(token, simd => transposed(simd));
            for (k, column) in columns.iter().enumerate() {
                assert_eq!(*column, std::array::from_fn(|row| (100 * row + k) as f32), "{level}");
            }
        }
    }

    /// The columns of 0, 1, …, 15; 100, 101, …, 115; …
    #[inline(always)]
    fn transposed<S: Simd>(simd: S) -> [[f32; LANES]; LANES] {
        let mut rows = [splat::<S, Whole<S>>(simd, 0.0); LANES];
        for (k, row) in rows.iter_mut().enumerate() {
            *row = iota::<S, Whole<S>>(simd, 0) + (100 * k) as f32;
        }
        transpose::<S>(&mut rows);
        let mut columns = [[0.0; LANES]; LANES];
        rows.iter().zip(&mut columns).for_each(|(row, column)| store(*row, column, 0));
        columns
    }

    #[test]
    fn eight_sums_at_once() {
        for level in SimdLevel::available() {
            let token = level.instructions().unwrap();
            let (got, lanes) = dispatch!(token, simd => sums_of_tens(simd));
            assert_eq!(got, std::array::from_fn(|k| (lanes * (100 * k) + lanes * (lanes - 1) / 2) as f32), "{level}");
        }
    }

    /// The sums of 100 k, 100 k + 1, …, and how many lanes there are.
    #[inline(always)]
    fn sums_of_tens<S: Simd>(simd: S) -> ([f32; 8], usize) {
        let vector = |k: usize| iota::<S, S::f32s>(simd, 0) + (100 * k) as f32;
        (sums(std::array::from_fn(vector)), S::f32s::LEN)
    }
}
