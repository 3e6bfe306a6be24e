//! Multi-scale structural similarity (MS-SSIM): SSIM's contrast and structure at five scales, its luminance at the coarsest.

use std::borrow::Cow;

use super::ssim::channel_means;
use crate::{constants::SSIM_WINDOW, error::Error, image::Image};

/// The exponent of each scale, finest first. *Source:* Wang, Simoncelli & Bovik 2003, §3.2.
const SCALE_WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];

/// The shorter side must be longer than this for the window to fit at the coarsest scale. Unit: px.
const TOO_SHORT_PX: u32 = (SSIM_WINDOW as u32 - 1) << (SCALE_WEIGHTS.len() - 1);

/// Multi-scale structural similarity of two images, 0 to 1; 1 for equal ones. `None` where it is not defined: the shorter
/// side is 160 px or less, so that the window does not fit at the fifth scale. Clamp both images first ([`Image::clamped`])
/// for the figure that the field reports.
///
/// The mean over channels of Π cs₍ⱼ₎^w₍ⱼ₎ · ssim₍₅₎^w₍₅₎, j = 1 to 4, where each factor is a mean over its scale as in
/// [`ssim`](super::ssim()), raised to 0 where it is negative. Scales are halved by averaging 2×2 pixels; an odd side is
/// first padded with zeros at both ends, as average pooling with padding does in the deep-learning frameworks whose MS-SSIM the
/// literature on image fitting reports. NaN where a pixel is NaN.
///
/// *Source:* Wang, Simoncelli & Bovik 2003, eq. 7, per colour channel.
///
/// # Errors
/// [`Error::SizesDiffer`].
pub fn ms_ssim(a: &Image, b: &Image) -> Result<Option<f64>, Error> {
    a.same_size(b)?;
    if a.width().min(a.height()) <= TOO_SHORT_PX {
        return Ok(None);
    }
    let mut width = a.width() as usize;
    let (mut a, mut b) = (Cow::Borrowed(a.pixels()), Cow::Borrowed(b.pixels()));
    let mut product = [1.0; 3];
    for (scale, weight) in SCALE_WEIGHTS.into_iter().enumerate() {
        let means = channel_means(width, &a, &b);
        let is_coarsest = scale + 1 == SCALE_WEIGHTS.len();
        let factors = if is_coarsest { means.ssim } else { means.contrast_structure };
        for (product, factor) in product.iter_mut().zip(factors) {
            // Not `max`, which would turn NaN into 0.
            *product *= if factor < 0.0 { 0.0 } else { factor.powf(weight) };
        }
        if !is_coarsest {
            (a, b) = (Cow::Owned(halved(width, &a)), Cow::Owned(halved(width, &b)));
            width = width.div_ceil(2);
        }
    }
    Ok(Some(product.iter().sum::<f64>() / 3.0))
}

/// The image `[H, width, 3]` at half its size, rounded up: means of 2×2 pixels. Along an odd side the
/// pairs start one pixel early, at a zero.
fn halved(width: usize, pixels: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let height = pixels.len() / width;
    let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
    let mut half = vec![[0.0; 3]; half_width * half_height];
    for y in 0..height {
        let row = &pixels[y * width..][..width];
        let out = &mut half[(y + height % 2) / 2 * half_width..][..half_width];
        let (first, pairs) = row.split_at(width % 2);
        let (out_first, out_pairs) = out.split_at_mut(width % 2);
        for (out, pixel) in out_first.iter_mut().zip(first) {
            (0..3).for_each(|c| out[c] += 0.25 * pixel[c]);
        }
        for (out, [left, right]) in out_pairs.iter_mut().zip(pairs.as_chunks::<2>().0) {
            (0..3).for_each(|c| out[c] += 0.25 * (left[c] + right[c]));
        }
    }
    half
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::test_images::clean_and_noisy;

    /// Expected values: direct 11×11 convolutions and padded 2×2 means in NumPy, in f64, written apart from this file.
    #[test]
    #[cfg_attr(miri, ignore = "minutes: images of 160 px and more")]
    fn values_agree_with_an_independent_computation() {
        for (width, height, expected) in
            [(192, 176, 0.945_792_533_227), (175, 163, 0.943_897_668_680), (161, 165, 0.944_491_308_393)]
        {
            let (clean, noisy) = clean_and_noisy(width, height);
            let found = ms_ssim(&clean, &noisy).unwrap().unwrap();
            assert!((found - expected).abs() < 2e-6, "{width}x{height}: {found}, expected {expected}");
        }
    }

    #[test]
    #[cfg_attr(miri, ignore = "minutes: images of 160 px and more")]
    fn equal_images_score_one_and_a_negative_scores_zero() {
        let (image, _) = clean_and_noisy(192, 176);
        assert_eq!(ms_ssim(&image, &image).unwrap(), Some(1.0));
        let negative = Image::from_fn(192, 176, |x, y| image.pixel(x, y).map(|v| 1.0 - v)).unwrap();
        assert_eq!(ms_ssim(&image, &negative).unwrap(), Some(0.0));
    }

    #[test]
    #[cfg_attr(miri, ignore = "minutes: images of 160 px and more")]
    fn it_is_defined_from_161_px_on() {
        for (width, height) in [(160, 300), (300, 160), (1, 1)] {
            let (image, _) = clean_and_noisy(width, height);
            assert_eq!(ms_ssim(&image, &image).unwrap(), None, "{width}x{height}");
        }
    }

    #[test]
    #[cfg_attr(miri, ignore = "minutes: images of 160 px and more")]
    fn a_pixel_that_is_not_a_number_is_not_hidden() {
        let (clean, mut noisy) = clean_and_noisy(176, 176);
        noisy.pixels_mut()[5000][2] = f32::NAN;
        assert!(ms_ssim(&clean, &noisy).unwrap().unwrap().is_nan());
    }

    #[test]
    fn halving_pads_odd_sides_with_zeros_in_front() {
        let pixels = [[4.0; 3], [8.0; 3], [12.0; 3], [16.0; 3], [20.0; 3], [24.0; 3]];
        assert_eq!(halved(3, &pixels), [[5.0; 3], [16.0; 3]]); // rows 4 8 12 and 16 20 24
        assert_eq!(halved(2, &pixels), [[3.0; 3], [18.0; 3]]); // rows 4 8, 12 16 and 20 24
    }
}
