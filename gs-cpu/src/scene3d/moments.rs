//! Adam moments of 3D splats, by index. Those of a row's first vector, which every step moves, are
//! apart from those of the SH after it.

use std::ops::Range;

use fearless_simd::{Simd, prelude::*, u32x16};
use gs_core::{
    MomentFormat,
    math::packed_moments::{UPPER, packed, unpacked},
};
use rayon::prelude::*;

use super::splats::pitch_of;
use crate::{
    lanes::{LANES, Whole},
    rows::Moves,
};

/// First and second moments.
#[derive(Debug)]
pub(crate) struct Moments {
    /// Of the first vector of each row, `[N, 16]` each.
    pub(crate) first_vector: [Vec<f32>; 2],
    pub(crate) rest: Rest,
}

/// First and second moments of the numbers after a row's first vector, `[N, pitch − 16]` each.
#[derive(Debug)]
pub(crate) enum Rest {
    F32([Vec<f32>; 2]),
    /// Both in one number, as [`packed`] has them.
    Bf16(Vec<u32>),
}

/// [`unpacked`] of 16 numbers.
#[inline(always)]
pub(crate) fn unpack<S: Simd>(simd: S, both: &[u32]) -> [Whole<S>; 2] {
    let both = u32x16::from_slice(simd, both);
    [Whole::<S>::from_bits(both & UPPER), Whole::<S>::from_bits(both << 16)]
}

/// Rounds moments up or down at random, with the probability that makes the mean exact, and packs
/// them. `random` has 32 random bits per lane.
#[inline(always)]
pub(crate) fn pack<S: Simd>([first, second]: [Whole<S>; 2], random: u32x16<S>, both: &mut [u32]) {
    let first = first.to_bits() + (random >> 16);
    let second = second.to_bits() + (random & !UPPER);
    ((first & UPPER) | (second >> 16)).store_slice(both);
}

/// [`random_bits`](gs_core::math::packed_moments::random_bits) of the 16 numbers from `at` on, a
/// multiple of 16.
#[inline(always)]
pub(crate) fn random<S: Simd>(simd: S, index: u32, steps: u32, at: usize) -> u32x16<S> {
    const LANE: [u32; LANES] = {
        let mut lane = [0; LANES];
        let mut k = 0;
        while k < LANES {
            lane[k] = (k as u32).wrapping_mul(0x9E37_79B9);
            k += 1;
        }
        lane
    };
    let row = (index.wrapping_mul(0x85EB_CA6B) ^ steps.wrapping_mul(0xC2B2_AE35)).wrapping_add(at as u32);
    let bits = u32x16::from_slice(simd, &LANE) + row.wrapping_mul(0x27D4_EB2F);
    let bits = (bits ^ (bits >> 16)) * 0x21F0_AAAD;
    let bits = (bits ^ (bits >> 15)) * 0x735A_2D97;
    bits ^ (bits >> 15)
}

impl Moments {
    pub(crate) fn zeros(n: usize, sh_degree: u8) -> Self {
        let rest = n * (pitch_of(sh_degree) - LANES);
        Self {
            first_vector: [vec![0.0; n * LANES], vec![0.0; n * LANES]],
            rest: Rest::F32([vec![0.0; rest], vec![0.0; rest]]),
        }
    }

    /// Changes the format of the rest. Moments that were not in 16 bits are rounded towards zero.
    pub(crate) fn convert(&mut self, format: MomentFormat) {
        match (&mut self.rest, format) {
            (Rest::F32([first, second]), MomentFormat::Bf16) => {
                let first = std::mem::take(first);
                let pairs = first.par_iter().zip(std::mem::take(second));
                self.rest = Rest::Bf16(pairs.map(|(&first, second)| packed(first, second)).collect());
            }
            (Rest::Bf16(both), MomentFormat::F32) => {
                let both = std::mem::take(both);
                let of = |which: usize| both.par_iter().map(|&both| unpacked(both)[which]).collect();
                self.rest = Rest::F32([of(0), of(1)]);
            }
            (Rest::F32(_), MomentFormat::F32) | (Rest::Bf16(_), MomentFormat::Bf16) => {}
        }
    }

    /// Rebuilds the moments after an edit: each Gaussian gets the moments of its heir, or 0.
    pub(crate) fn rearrange(&mut self, heirs: &Moves, pitch: usize) {
        self.first_vector.iter_mut().for_each(|moments| heirs.apply(moments, LANES));
        match &mut self.rest {
            Rest::F32(both) => both.iter_mut().for_each(|moments| heirs.apply(moments, pitch - LANES)),
            Rest::Bf16(both) => heirs.apply(both, pitch - LANES),
        }
    }

    /// Sets the moments of one number of each row's first vector to 0.
    pub(crate) fn zero(&mut self, at: usize) {
        for moments in &mut self.first_vector {
            moments.chunks_exact_mut(LANES).for_each(|row| row[at] = 0.0);
        }
    }

    /// Passes the bits of the first (0) or second (1) moments, in `f32`, of the places of each row,
    /// row by row.
    pub(crate) fn pass(&self, which: usize, places: &[Range<usize>], pitch: usize, to: &mut dyn FnMut(&[u32])) {
        let of_rest = |at: usize| match &self.rest {
            Rest::F32(both) => both[which][at],
            Rest::Bf16(both) => unpacked(both[at])[which],
        };
        let of_row = |i: usize, at: usize| match at.checked_sub(LANES) {
            None => self.first_vector[which][i * LANES + at],
            Some(at) => of_rest(i * (pitch - LANES) + at),
        };
        let mut row = Vec::with_capacity(pitch);
        for i in 0..self.first_vector[which].len() / LANES {
            row.clear();
            row.extend(places.iter().cloned().flatten().map(|at| of_row(i, at).to_bits()));
            to(&row);
        }
    }

    /// The inverse of [`Self::pass`], for moments in `f32`.
    pub(crate) fn paste(&mut self, which: usize, places: &[Range<usize>], pitch: usize, numbers: &[f32]) {
        let Rest::F32(rest) = &mut self.rest else { return };
        let width: usize = places.iter().map(ExactSizeIterator::len).sum();
        for (i, row) in numbers.chunks_exact(width).enumerate() {
            for (at, &value) in places.iter().cloned().flatten().zip(row) {
                match at.checked_sub(LANES) {
                    None => self.first_vector[which][i * LANES + at] = value,
                    Some(at) => rest[which][i * (pitch - LANES) + at] = value,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use gs_core::{edit::Source, math::packed_moments::random_bits};

    use super::*;
    use crate::{
        lanes::{load, splat},
        level::{SimdLevel, dispatch},
    };

    #[test]
    fn random_bits_are_those_of_gs_core() {
        for level in SimdLevel::available() {
            let token = level.instructions().unwrap();
            for (index, steps, at) in [(0, 0, 0), (1, 7, 16), (0xFFFF_0123, u32::MAX, 32)] {
                let mut found = [0; LANES];
                dispatch!(token, simd => random(simd, index, steps, at).store_slice(&mut found));
                let expected = std::array::from_fn(|k| random_bits(index, steps, (at + k) as u32));
                assert_eq!(found, expected, "{level}");
            }
        }
    }

    /// A second moment that decays by less than half of its last digit per step, and a first moment
    /// that stays.
    #[test]
    fn rounding_has_no_bias() {
        const STEPS: u32 = 4_000;
        for level in SimdLevel::available() {
            let token = level.instructions().unwrap();
            let (mut first, mut second) = (0.0, 0.0);
            for index in 0..64 {
                let mut both = [packed(-0.3, 1.0); LANES];
                for steps in 1..=STEPS {
                    dispatch!(token, simd => {
                        let [m, v] = unpack(simd, &both);
                        pack(decayed(simd, m, v), random(simd, index, steps, 0), &mut both);
                    });
                }
                let [of_first, of_second] = [0, 1].map(|which| both.map(|both| f64::from(unpacked(both)[which])));
                first += of_first.iter().sum::<f64>() / 1024.0;
                second += of_second.iter().sum::<f64>() / 1024.0;
            }
            let expected = 0.999f64.powi(STEPS as i32);
            assert!((second / expected - 1.0).abs() < 0.03, "{level}: {second} instead of {expected}");
            assert!((first / f64::from(unpacked(packed(-0.3, 0.0))[0]) - 1.0).abs() < 1e-6, "{level}: {first}");
        }
    }

    #[inline(always)]
    fn decayed<S: Simd>(simd: S, first: Whole<S>, second: Whole<S>) -> [Whole<S>; 2] {
        [first, second * splat::<S, Whole<S>>(simd, 0.999)]
    }

    /// All that [`Moments::pass`] passes of the first moments.
    fn firsts(moments: &Moments, places: &[Range<usize>], pitch: usize) -> Vec<f32> {
        let mut all = Vec::new();
        moments.pass(0, places, pitch, &mut |bits| all.extend(bits.iter().map(|&bits| f32::from_bits(bits))));
        all
    }

    #[test]
    fn formats_come_back() {
        let mut moments = Moments::zeros(3, 1);
        let pitch = pitch_of(1);
        let places = [0..3, 3..LANES + 5];
        let numbers: Vec<f32> = (0..3 * (LANES as u32 + 5)).map(|i| f32::from_bits((i + 0x3F00) << 16)).collect();
        moments.paste(0, &places, pitch, &numbers);
        for format in [MomentFormat::Bf16, MomentFormat::Bf16, MomentFormat::F32] {
            moments.convert(format);
            assert_eq!(firsts(&moments, &places, pitch), numbers, "{format:?}");
        }
        moments.convert(MomentFormat::Bf16);
        let sources = [Source::Kept(2), Source::Added(0)];
        let origin = |source: &Source| matches!(source, Source::Kept(_)).then_some(2);
        moments.rearrange(&Moves::new(&sources, origin), pitch);
        let width = LANES + 5;
        assert_eq!(firsts(&moments, &places, pitch)[..width], numbers[2 * width..]);
        assert!(firsts(&moments, &places, pitch)[width..].iter().all(|&m| m == 0.0));
    }

    #[test]
    fn infinities_and_nan_stay() {
        let token = SimdLevel::best().instructions().unwrap();
        let values: [f32; 4] = [f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 0.0];
        let wide: [f32; LANES] = std::array::from_fn(|k| values[k % 4]);
        let mut both = [0; LANES];
        dispatch!(token, simd => pack([load(simd, &wide, 0); 2], random(simd, 7, 9, 0), &mut both));
        for (packed, value) in both.into_iter().zip(wide) {
            for back in unpacked(packed) {
                assert!(back == value || back.is_nan() && value.is_nan(), "{value}: {back}");
            }
        }
    }
}
