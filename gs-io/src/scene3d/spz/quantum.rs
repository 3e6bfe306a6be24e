//! Quantisation of the numbers in SPZ.
//!
//! | parameter | bytes | stored |
//! |---|---|---|
//! | mean | 3 × 3 | signed fixed point; how many bits are the fraction, the head says |
//! | opacity | 1 | 0 to 255 for 0 to 1; see `quantity` for the ends |
//! | colour | 3 | 255 (½ + 0.15 c) of the coefficient c of degree 0, so that colours may lie somewhat outside 0..1 |
//! | scale | 3 | 16 (logarithm + 10) |
//! | rotation | 4 | the number of the largest of x, y, z, w in 2 bits; sign and 9 bits of each other's magnitude, over √½ |
//! | | 3 | in version 2: x, y, z as 127.5 (v + 1), w ≥ 0 |
//! | sh | 1 each | 128 + 128 c, rounded to multiples when written |

use std::f32::consts::FRAC_1_SQRT_2;

use glam::Vec3;
use gs_core::Scene3d;

use crate::scene3d::{
    conversion_loss::{Clamp, ConversionLoss},
    range::farthest,
    values::{UnitRotations, largest_of, with_largest},
};

/// Factor of coefficients of degree 0; for colours it would be 0.282.
const COLOR_SCALE: f32 = 0.15;

/// Largest magnitude of the nine bits of a quaternion's component.
const PART_MAX: u32 = 511;

/// Number of fractional bits of a mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FractionalBits(u8);

impl FractionalBits {
    /// The number that other writers always use: steps of a quarter of a millimetre if units are
    /// metres.
    pub(super) const USUAL: u8 = 12;

    /// The largest number.
    pub(super) const MOST: u8 = 23;

    /// The number in a file; `None` if there are not this many bits.
    pub(super) fn new(bits: u8) -> Option<Self> {
        (bits <= Self::MOST).then_some(Self(bits))
    }

    /// The largest number, at most `most`, that leaves room for these means, which are in the range of SPZ.
    pub(super) fn for_means(means: &[Vec3], most: u8) -> Self {
        let farthest = means.iter().fold(0.0, |far: f32, m| far.max(m.abs().max_element()));
        let fits = |bits: u8| (f64::from(farthest) * f64::from(1_u32 << bits)).round() <= f64::from((1 << 23) - 1);
        Self((0..=most).rev().find(|&bits| fits(bits)).unwrap_or(0))
    }

    /// The number of bits.
    pub(super) fn get(self) -> u8 {
        self.0
    }

    fn per_unit(self) -> f32 {
        (1_u32 << self.0) as f32
    }
}

pub(super) fn position(bytes: &[u8; 9], fraction: FractionalBits) -> Vec3 {
    let value = |k: usize| {
        // The top byte of four has the sign.
        let bits = i32::from_le_bytes([0, bytes[k], bytes[k + 1], bytes[k + 2]]) >> 8;
        bits as f32 / fraction.per_unit()
    };
    Vec3::new(value(0), value(3), value(6))
}

pub(super) fn log_scale(byte: u8) -> f32 {
    f32::from(byte) / 16.0 - 10.0
}

pub(super) fn color(byte: u8) -> f32 {
    (f32::from(byte) / 255.0 - 0.5) / COLOR_SCALE
}

pub(super) fn sh_of_byte(byte: u8) -> f32 {
    (f32::from(byte) - 128.0) / 128.0
}

/// (w, x, y, z) of version 2.
pub(super) fn rotation_of_three(bytes: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = bytes.map(|byte| f32::from(byte) / 127.5 - 1.0);
    [(1.0 - (x * x + y * y + z * z)).max(0.0).sqrt(), x, y, z]
}

/// (w, x, y, z) of versions 3 and 4.
pub(super) fn rotation_of_smallest(bytes: [u8; 4]) -> [f32; 4] {
    let mut bits = u32::from_le_bytes(bytes);
    let largest = (bits >> 30) as usize;
    let mut others = [0.0_f32; 3];
    for other in others.iter_mut().rev() {
        let magnitude = (bits & PART_MAX) as f32 / PART_MAX as f32 * FRAC_1_SQRT_2;
        *other = if bits >> 9 & 1 == 1 { -magnitude } else { magnitude };
        bits >>= 10;
    }
    let [x, y, z, w] = with_largest(largest, others);
    [w, x, y, z]
}

/// The nearest whole number, away from 0 from the middle between two, without the call that `round`
/// is on most machines. The sum is exact in 64 bits.
#[inline]
fn rounded(value: f32) -> i32 {
    let value = f64::from(value);
    (value + 0.5_f64.copysign(value)) as i32
}

/// Bits of SH coefficients of degree 1, and of higher degrees, that are written. *Source:* Niantic's library.
const DEGREE_1_BITS: u8 = 5;
const HIGHER_DEGREE_BITS: u8 = 4;

/// Quantises numbers, and counts what does not fit.
#[derive(Debug)]
pub(super) struct Packing {
    fraction: FractionalBits,
    colors: Clamp,
    log_scales: Clamp,
    sh: Clamp,
}

impl Packing {
    pub(super) fn new(fraction: FractionalBits) -> Self {
        let color_end = 0.5 / COLOR_SCALE;
        Self {
            fraction,
            colors: Clamp::new("coefficients of degree 0", -color_end, color_end, 0.5 / 255.0 / COLOR_SCALE),
            log_scales: Clamp::new("log-scales", -10.0, 255.0 / 16.0 - 10.0, 0.5 / 16.0),
            sh: Clamp::new("coefficients above degree 0", -1.0, 1.0, 0.0),
        }
    }

    pub(super) fn position(&mut self, mean: Vec3) -> [u8; 9] {
        let per_unit = f64::from(self.fraction.per_unit());
        let [x, y, z] = mean.to_array().map(|v| ((f64::from(v) * per_unit).round() as i32).to_le_bytes());
        [x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]]
    }

    pub(super) fn log_scale(&mut self, log: Vec3) -> [u8; 3] {
        log.to_array().map(|v| rounded((self.log_scales.apply(v) + 10.0) * 16.0) as u8)
    }

    pub(super) fn color(&mut self, dc: Vec3) -> [u8; 3] {
        dc.to_array().map(|v| rounded((self.colors.apply(v) * COLOR_SCALE + 0.5) * 255.0) as u8)
    }

    /// SH coefficient `k` ≥ 1, rounded to the nearest multiple of the step; 128 stands for 0.
    pub(super) fn sh(&mut self, k: usize, c: Vec3) -> [u8; 3] {
        let bits = if k < 4 { DEGREE_1_BITS } else { HIGHER_DEGREE_BITS };
        let step = (1_u32 << (8 - bits)) as f32;
        let mut bytes = [0; 3];
        // A loop, because most of a file are these bytes, and `map` would call a function for each.
        for (byte, v) in bytes.iter_mut().zip(c.to_array()) {
            // The cast saturates: what rounds up to 256 becomes 255.
            *byte = (rounded(self.sh.apply(v) * 128.0 / step) as f32 * step + 128.0) as u8;
        }
        bytes
    }

    /// A unit quaternion (w, x, y, z). q and −q are the same rotation: the largest component
    /// becomes positive.
    pub(super) fn rotation(&self, [w, x, y, z]: [f32; 4]) -> [u8; 4] {
        let xyzw = [x, y, z, w];
        let largest = largest_of(xyzw);
        let mut bits = largest as u32;
        for k in (0..4).filter(|&k| k != largest) {
            let negative = (xyzw[k] < 0.0) != (xyzw[largest] < 0.0);
            let magnitude = rounded(xyzw[k].abs() / FRAC_1_SQRT_2 * PART_MAX as f32) as u32;
            bits = bits << 10 | u32::from(negative) << 9 | magnitude.min(PART_MAX);
        }
        bits.to_le_bytes()
    }

    pub(super) fn losses(&self, scene: &Scene3d, rotations: &UnitRotations<'_>) -> Vec<ConversionLoss> {
        let degree = scene.sh_degree;
        let why = farthest(scene).filter(|_| self.fraction.0 < FractionalBits::USUAL);
        let why = why.map_or_else(String::new, |(i, place)| format!(", because Gaussian {i} is at ±{place:.0}"));
        let rounded = |what, to: String| ConversionLoss::Rounded { what, to };
        let mut losses = vec![
            rounded("means", format!("{} units{why}", 1.0 / self.fraction.per_unit())),
            rounded("log-scales", "sixteenths".to_owned()),
            rounded("colours and opacities", "8 bits".to_owned()),
            rounded("the parts of quaternions", "10 bits".to_owned()),
        ];
        if degree > 0 {
            losses.push(rounded("coefficients of degree 1", format!("{DEGREE_1_BITS} bits")));
        }
        if degree > 1 {
            losses.push(rounded("coefficients of higher degrees", format!("{HIGHER_DEGREE_BITS} bits")));
        }
        losses.extend([&self.log_scales, &self.colors, &self.sh].into_iter().filter_map(Clamp::loss));
        losses.extend(rotations.loss());
        losses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packing(means: &[Vec3]) -> Packing {
        Packing::new(FractionalBits::for_means(means, FractionalBits::USUAL))
    }

    #[test]
    fn numbers_come_back_to_half_a_step() {
        let mean = Vec3::new(-1.23456, 1999.9, 0.000_01);
        let mut packing = packing(&[mean]);
        assert!(
            (position(&packing.position(mean), packing.fraction) - mean).abs().max_element() <= 0.5 / 4096.0 + 1e-4
        );
        for v in [-10.0, -3.21, 0.0, 5.9375] {
            assert!((log_scale(packing.log_scale(Vec3::splat(v))[0]) - v).abs() <= 0.5 / 16.0);
        }
        for v in [-3.3, -0.4, 0.0, 1.7, 3.3] {
            assert!((color(packing.color(Vec3::splat(v))[1]) - v).abs() <= 0.501 / 255.0 / COLOR_SCALE);
        }
        for (k, step) in [(1, 8.0), (3, 8.0), (4, 16.0), (15, 16.0)] {
            for v in [-1.0, -0.61, 0.0, 0.03, 0.9] {
                assert!((sh_of_byte(packing.sh(k, Vec3::splat(v))[2]) - v).abs() <= 0.5 * step / 128.0, "{k} {v}");
            }
        }
        assert_eq!(
            packing
                .losses(
                    &Scene3d { sh_degree: 3, ..Default::default() },
                    &UnitRotations::new(&Default::default(), "".as_ref()).unwrap()
                )
                .len(),
            6
        );
    }

    #[test]
    fn rotations_come_back_up_to_their_sign() {
        let half = [0.5_f32, -0.5, 0.5, -0.5];
        for q in [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.6, -0.8], half, [-0.8, 0.36, 0.48, 0.0]] {
            let back = rotation_of_smallest(packing(&[]).rotation(q));
            let cosine: f32 = q.iter().zip(back).map(|(a, b)| a * b).sum();
            assert!(cosine.abs() > 0.999_99, "{q:?} {back:?}");
        }
        let half_turn = rotation_of_three([255, 128, 127]);
        assert!(half_turn[1] == 1.0 && half_turn[0] < 0.01, "{half_turn:?}");
    }

    #[test]
    fn large_scenes_get_fewer_fractional_bits() {
        let bits = |x| FractionalBits::for_means(&[Vec3::X * x], FractionalBits::USUAL).get();
        assert_eq!([bits(2047.9), bits(2048.0), bits(8e6), bits(8_388_607.0)], [12, 11, 0, 0]);
        assert_eq!(FractionalBits::new(24), None);
    }

    #[test]
    fn values_out_of_range_are_counted_as_clamped() {
        let mut packing = packing(&[]);
        packing.log_scale(Vec3::new(-11.0, 0.0, 7.0));
        packing.color(Vec3::new(4.0, 0.0, 0.0));
        let losses =
            packing.losses(&Default::default(), &UnitRotations::new(&Default::default(), "".as_ref()).unwrap());
        let clamped =
            |values| losses.iter().any(|l| matches!(l, ConversionLoss::Clamped { values: v, .. } if *v == values));
        assert!(clamped(2) && clamped(1), "{losses:?}");
    }
}
