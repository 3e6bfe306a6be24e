//! Quality of images against their targets. All figures of this project are computed here.
//!
//! A figure of a rendering is that of its 8-bit image ([`Image::rounded_to_8_bits`]) against the
//! target, as read from its file or, where a program has made it, in floats. So a comparison of the
//! PNG with an image file gives the same figures. Losses, which steer a training, are computed from
//! floats.

use gs_core::{
    Error, Image,
    metrics::{self, Comparison},
    rounded_to_8_bits,
};
use serde::{Deserialize, Deserializer, Serialize};

/// Measures of how close two images are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ImageQuality {
    /// Peak signal-to-noise ratio, dB; ∞ for equal images, which JSON writes as `null`.
    #[serde(deserialize_with = "infinite_where_null")]
    pub psnr: f64,
    /// Structural similarity.
    pub ssim: f64,
    /// Multi-scale structural similarity; `None` where a side is shorter than 161 px, too small for
    /// its five scales.
    pub ms_ssim: Option<f64>,
    /// Mean absolute difference.
    pub l1: f64,
}

impl ImageQuality {
    /// Compares two images, both clamped to 0..=1.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] where the images differ in size.
    pub fn between(a: &Image, b: &Image) -> Result<Self, Error> {
        Ok(metrics::compare((a, held), (b, held))?.into())
    }

    /// Compares a rendering, rounded to 8 bits, with its target.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] where the images differ in size.
    pub fn as_written(rendered: &Image, target: &Image) -> Result<Self, Error> {
        Ok(metrics::compare((rendered, rounded_to_8_bits), (target, held))?.into())
    }
}

impl From<Comparison> for ImageQuality {
    fn from(Comparison { psnr, ssim, ms_ssim, l1, .. }: Comparison) -> Self {
        Self { psnr, ssim, ms_ssim, l1 }
    }
}

/// A value clamped to 0..=1.
fn held(value: f32) -> f32 {
    value.clamp(0.0, 1.0)
}

/// PSNR of a rendering before it is rounded to 8 bits, dB, both clamped to 0..=1.
///
/// # Errors
/// [`Error::SizesDiffer`] where the images differ in size.
pub(crate) fn psnr_float(rendered: &Image, target: &Image) -> Result<f64, Error> {
    rendered.same_size(target)?;
    let pairs = rendered.pixels().as_flattened().iter().zip(target.pixels().as_flattened());
    let squared: f64 = pairs.map(|(&a, &b)| f64::from(held(a) - held(b)).powi(2)).sum();
    Ok(metrics::psnr_of_mse(squared / (3 * target.pixels().len()) as f64))
}

/// L1 (0 to 1) and PSNR (dB) of a rendering, rounded to 8 bits, against `target`.
///
/// The same as [`ImageQuality::as_written`] without the other measures, so that observing a
/// training stays cheap.
///
/// # Errors
/// [`Error::SizesDiffer`] where the images differ in size.
pub fn l1_and_psnr(rendered: &Image, target: &Image) -> Result<(f64, f64), Error> {
    rendered.same_size(target)?;
    let row = rendered.width() as usize * 3;
    let (rendered, wanted) = (rendered.pixels().as_flattened(), target.pixels().as_flattened());
    let (mut absolute, mut squared) = (0.0f64, 0.0f64);
    for (rendered, wanted) in rendered.chunks(row).zip(wanted.chunks(row)) {
        let (mut row_absolute, mut row_squared) = ([0.0f32; 8], [0.0f32; 8]);
        let mut add = |lane: usize, a: f32, b: f32| {
            let difference = rounded_to_8_bits(a) - b.clamp(0.0, 1.0);
            row_absolute[lane] += difference.abs();
            row_squared[lane] += difference * difference;
        };
        // Eight sums side by side, so that the compiler may use vectors.
        let (a, a_rest) = rendered.as_chunks::<8>();
        let (b, b_rest) = wanted.as_chunks::<8>();
        for (a, b) in a.iter().zip(b) {
            for lane in 0..8 {
                add(lane, a[lane], b[lane]);
            }
        }
        for (lane, (&a, &b)) in a_rest.iter().zip(b_rest).enumerate() {
            add(lane, a, b);
        }
        absolute += row_absolute.iter().map(|&v| f64::from(v)).sum::<f64>();
        squared += row_squared.iter().map(|&v| f64::from(v)).sum::<f64>();
    }
    let values = wanted.len() as f64;
    Ok((absolute / values, metrics::psnr_of_mse(squared / values)))
}

/// JSON has no infinity and writes `null`.
pub(crate) fn infinite_where_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(phase: f32) -> Image {
        let value = |x: u32, y: u32| [0.0, 0.7, 1.3].map(|c| (x as f32 * 0.7 + y as f32 + c + phase).sin());
        Image::from_fn(37, 21, value).unwrap()
    }

    #[test]
    fn the_quick_figures_are_those_of_the_slow_ones() {
        let (a, b) = (wave(0.0), wave(0.1));
        let (l1, psnr) = l1_and_psnr(&a, &b).unwrap();
        let slow = ImageQuality::as_written(&a, &b).unwrap();
        assert!((l1 - slow.l1).abs() < 1e-7 && (psnr - slow.psnr).abs() < 1e-4, "{l1} {psnr} {slow:?}");
        assert!(psnr > 10.0 && psnr < 60.0, "{psnr}");
        let written = a.rounded_to_8_bits();
        assert_eq!(l1_and_psnr(&a, &written), Ok((0.0, f64::INFINITY)));
    }

    #[test]
    fn images_of_different_sizes_are_refused() {
        let [wide, tall] = [(12, 2), (2, 12)].map(|(w, h)| Image::filled(w, h, [0.5; 3]).unwrap());
        let expected = Error::SizesDiffer { left_width: 12, left_height: 2, right_width: 2, right_height: 12 };
        assert_eq!(l1_and_psnr(&wide, &tall), Err(expected.clone()));
        assert_eq!(psnr_float(&wide, &tall), Err(expected.clone()));
        assert_eq!(ImageQuality::between(&wide, &tall), Err(expected));
    }

    #[test]
    fn a_rendering_is_judged_as_it_is_written() {
        let target = Image::filled(8, 8, [100.0 / 255.0; 3]).unwrap();
        let off = |levels: f32| Image::filled(8, 8, [(100.0 + levels) / 255.0; 3]).unwrap();
        let psnr = |rendered: &Image| ImageQuality::as_written(rendered, &target).unwrap().psnr;
        assert_eq!(psnr(&off(0.4)), f64::INFINITY);
        let one_level = 20.0 * 255f64.log10();
        assert!((psnr(&off(0.6)) - one_level).abs() < 1e-4, "{}", psnr(&off(0.6)));
        let float = psnr_float(&off(0.5), &target).unwrap();
        assert!((float - one_level - 20.0 * 2f64.log10()).abs() < 1e-2, "{float}");
    }
}
