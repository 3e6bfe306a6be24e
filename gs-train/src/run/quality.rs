//! Quality of images against their targets. L1 and PSNR alone, which observers of a training want
//! often, are computed by [`metrics::l1_and_psnr`].
//!
//! A figure of a rendering is that of its 8-bit image ([`Image::rounded_to_8_bits`]) against the
//! target, as read from its file or, where a program has made it, in floats. So a comparison of the
//! PNG with an image file gives the same figures. Losses, which steer a training, are computed from
//! floats.

use gs_core::{
    Error, Image,
    metrics::{self, Comparison},
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
        Ok(metrics::compare(a, b, false)?.into())
    }

    /// Compares a rendering, rounded to 8 bits, with its target.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] where the images differ in size.
    pub fn as_written(rendered: &Image, target: &Image) -> Result<Self, Error> {
        Ok(metrics::compare(rendered, target, true)?.into())
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

/// JSON has no infinity and writes `null`.
pub(crate) fn infinite_where_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_of_different_sizes_are_refused() {
        let [wide, tall] = [(12, 2), (2, 12)].map(|(w, h)| Image::filled(w, h, [0.5; 3]).unwrap());
        let expected = Error::SizesDiffer { left_width: 12, left_height: 2, right_width: 2, right_height: 12 };
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
