//! What the quality of a fit is judged by.

use gs_core::Image;
use gs_density::seed::Plane;

gs_core::choices! {
    /// The measure that a 2D fit or an encoded image is tuned for.
    #[derive(Default)]
    pub enum Tune {
        /// PSNR: every pixel counts the same.
        #[default]
        Psnr = "psnr": "PSNR: every pixel counts the same",
        /// SSIM and MS-SSIM: a pixel counts more where there is little contrast around it, because errors
        /// are easier to see there.
        ///
        /// Its weight is proportional to b(1/(2v + C₂))^0.6, where v is the variance of luminance around
        /// each pixel, b and the variance use a Gaussian window of 2.4 px (one standard deviation), and C₂ is
        /// the constant of SSIM. The mean weight is 1. The policies `residual` and `image-gs` place
        /// Gaussians by it, too; with other policies only the loss is tuned. Needs the loss L2 or L1.
        ///
        /// Near the image, 1 − SSIM is about a sum of squared errors over 2v + C₂. The exponent 1, which
        /// follows from that, costs more PSNR than it gains of either measure.
        Ssim = "ssim": "SSIM and MS-SSIM: pixels count more where there is little contrast",
    }
}

/// Passes of the binomial kernel over the contrast: σ = √(passes/2) px.
const PASSES: u32 = 12;

/// Largest magnitude of a luminance, so that its square is finite.
const MOST: f32 = 1e6;

/// Exponent of the smoothed inverse.
const EXPONENT: f32 = 0.6;

/// SSIM's C₂ for values from 0 to 1, (0.03)².
const C2: f32 = 9e-4;

/// Rec. 601's shares of the channels in luminance.
const LUMINANCE: [f32; 3] = [0.299, 0.587, 0.114];

impl Tune {
    /// How much each pixel of this image counts, `[height · width]`, row-major; `None` where all
    /// count 1.
    pub(crate) fn weights(self, image: &Image) -> Option<Vec<f32>> {
        match self {
            Self::Psnr => None,
            Self::Ssim => Some(by_contrast(image)),
        }
    }

    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

fn by_contrast(image: &Image) -> Vec<f32> {
    let (width, height) = image.size();
    let smoothed = |power: i32| {
        let mut plane = Plane::from_rows(width, height, |y, row| {
            for (value, pixel) in row.iter_mut().zip(&image.pixels()[y * width as usize..]) {
                *value = pixel
                    .iter()
                    .zip(LUMINANCE)
                    .map(|(channel, share)| channel * share)
                    .sum::<f32>()
                    .clamp(-MOST, MOST)
                    .powi(power);
            }
        });
        plane.smooth(PASSES);
        plane
    };
    let (mean, square) = (smoothed(1), smoothed(2));
    let mut inverse = Plane::from_rows(width, height, |y, row| {
        let from = y * width as usize;
        for ((value, mean), square) in row.iter_mut().zip(&mean.values()[from..]).zip(&square.values()[from..]) {
            *value = 1.0 / (2.0 * (square - mean * mean).max(0.0) + C2);
        }
    });
    inverse.smooth(PASSES);
    let mut weights: Vec<f32> = inverse.values().iter().map(|inverse| inverse.powf(EXPONENT)).collect();
    let sum: f64 = weights.iter().map(|&weight| f64::from(weight)).sum();
    let scale = (weights.len() as f64 / sum) as f32;
    weights.iter_mut().for_each(|weight| *weight *= scale);
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_count_more_where_there_is_less_contrast() {
        // Left a flat half, right stripes.
        let image = Image::from_fn(64, 32, |x, _| [if x < 32 || x % 4 < 2 { 0.5 } else { 1.0 }; 3]).unwrap();
        assert_eq!(Tune::Psnr.weights(&image), None);
        let weights = Tune::Ssim.weights(&image).unwrap();
        let mean = weights.iter().sum::<f32>() / weights.len() as f32;
        assert!((mean - 1.0).abs() < 1e-4, "{mean}");
        let [flat, striped] = [8, 56].map(|x| weights[16 * 64 + x]);
        // σ² = 0.0625 among the stripes: (2 σ² + C₂) / C₂ to the power of 0.6.
        let expected = ((0.125 + C2) / C2).powf(0.6);
        assert!((flat / striped / expected - 1.0).abs() < 0.1, "{flat} {striped} {expected}");
    }

    #[test]
    fn a_flat_image_has_equal_weights() {
        let image = Image::filled(9, 5, [0.25, 0.5, 1.0]).unwrap();
        assert!(Tune::Ssim.weights(&image).unwrap().iter().all(|weight| (weight - 1.0).abs() < 1e-3));
    }
}
