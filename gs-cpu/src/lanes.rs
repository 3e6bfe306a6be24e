//! Arithmetic on sixteen lanes that the SIMD library does not bring: exp, and eight sums at once.

use fearless_simd::{Simd, f32x16, i32x16, prelude::*};

/// Pixels in a vector, and columns in a strip.
pub(crate) const LANES: usize = 16;

/// Sixteen pixels side by side.
pub(crate) type Lanes<S> = f32x16<S>;

/// The same number in every lane.
#[inline(always)]
pub(crate) fn splat<S: Simd>(simd: S, value: f32) -> Lanes<S> {
    Lanes::splat(simd, value)
}

/// Three numbers, each in every lane. (A closure given to `map` would not be compiled for the SIMD level.)
#[inline(always)]
pub(crate) fn splat3<S: Simd>(simd: S, [a, b, c]: [f32; 3]) -> [Lanes<S>; 3] {
    [splat(simd, a), splat(simd, b), splat(simd, c)]
}

/// The three channels of a row.
#[inline(always)]
pub(crate) fn load3<S: Simd>(simd: S, [a, b, c]: &[[f32; LANES]; 3]) -> [Lanes<S>; 3] {
    [Lanes::load_array_ref(simd, a), Lanes::load_array_ref(simd, b), Lanes::load_array_ref(simd, c)]
}

/// 0, 1, …, 15.
#[inline(always)]
pub(crate) fn iota<S: Simd>(simd: S) -> Lanes<S> {
    const COUNT: [f32; LANES] = [0., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 13., 14., 15.];
    Lanes::load_array(simd, COUNT)
}

/// eˣ for −87.3 ≤ x ≤ 88, relative error below 2 ulp; 0 below that range, e⁸⁸ above it.
///
/// Range reduction x = n ln 2 + r, |r| ≤ ½ ln 2, with ln 2 in two parts; eʳ by a minimax polynomial of degree 5 (Cephes' `expf`);
/// 2ⁿ by adding n to the exponent bits.
#[inline(always)]
pub(crate) fn exp<S: Simd>(simd: S, x: Lanes<S>) -> Lanes<S> {
    // Adding 1.5·2²³ rounds to an integer and leaves it in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let lowest = splat(simd, -87.3);
    let clamped = x.max(lowest).min(splat(simd, 88.0));
    let shifted = clamped.mul_add(splat(simd, std::f32::consts::LOG2_E), splat(simd, ROUND));
    let n = shifted - ROUND;
    let r = n.mul_add(splat(simd, -0.693_359_4), clamped);
    let r = n.mul_add(splat(simd, 2.121_944_4e-4), r);
    let p = splat(simd, 1.987_569_1e-4);
    let p = p.mul_add(r, splat(simd, 1.398_199_9e-3));
    let p = p.mul_add(r, splat(simd, 8.333_452e-3));
    let p = p.mul_add(r, splat(simd, 4.166_579_6e-2));
    let p = p.mul_add(r, splat(simd, 1.666_666_5e-1));
    let p = p.mul_add(r, splat(simd, 0.5));
    let e = p.mul_add(r * r, r + 1.0);
    let bits: i32x16<S> = e.bitcast();
    let n_bits: i32x16<S> = shifted.bitcast();
    let scaled: Lanes<S> = (bits + (n_bits << 23)).bitcast();
    x.simd_ge(lowest).select(scaled, splat(simd, 0.0))
}

/// The sums over lanes of eight vectors, by a tree in which every addition works on full registers.
#[inline(always)]
pub(crate) fn sums<S: Simd>(v: [Lanes<S>; 8]) -> [f32; 8] {
    #[inline(always)]
    fn pairs<S: Simd>(a: Lanes<S>, b: Lanes<S>) -> Lanes<S> {
        a.unzip_low(b) + a.unzip_high(b)
    }
    let [a, b, c, d, e, f, g, h] = v;
    let quads = pairs(pairs(a, b), pairs(c, d));
    let more = pairs(pairs(e, f), pairs(g, h));
    // Lanes 2i and 2i + 1 hold the halves of sum i.
    let halves = pairs(quads, more);
    let all = pairs(halves, halves);
    let array: [f32; 16] = all.into();
    let [a, b, c, d, e, f, g, h, ..] = array;
    [a, b, c, d, e, f, g, h]
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;

    use super::*;
    use crate::SimdLevel;

    #[test]
    fn exp_is_exact_to_two_ulp_at_every_level() {
        for level in SimdLevel::available() {
            let mut worst = 0.0f64;
            for i in 0..20_000 {
                let x = -87.2 + i as f32 * (175.0 / 20_000.0);
                let token = level.token().unwrap();
                let got: [f32; 16] = dispatch!(token, simd => exp(simd, splat(simd, x)).into());
                let exact = f64::from(x).exp();
                worst = worst.max(((f64::from(got[3]) - exact) / exact).abs());
            }
            assert!(worst < 2.4e-7, "{level}: {worst:e}");
        }
    }

    #[test]
    fn exp_vanishes_below_its_range_and_stays_finite_above() {
        let token = SimdLevel::best().token().unwrap();
        let values = [f32::NEG_INFINITY, -1e30, -88.0, 0.0, 89.0, 1e30];
        let got = values.map(|x| {
            let lanes: [f32; 16] = dispatch!(token, simd => exp(simd, splat(simd, x)).into());
            lanes[0]
        });
        assert_eq!(&got[..4], &[0.0, 0.0, 0.0, 1.0]);
        assert!(got[4].is_finite() && got[5].is_finite());
    }

    #[test]
    fn eight_sums_at_once() {
        for level in SimdLevel::available() {
            let token = level.token().unwrap();
            let got = dispatch!(token, simd => sums(std::array::from_fn(|k| {
                Lanes::from_fn(simd, |i| (100 * k + i) as f32)
            })));
            assert_eq!(got, std::array::from_fn(|k| (1600 * k + 120) as f32), "{level}");
        }
    }
}
