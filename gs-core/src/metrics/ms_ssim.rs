//! Multi-scale structural similarity (MS-SSIM): SSIM's contrast and structure at five scales, its
//! luminance at the coarsest.

use super::ssim::{ChannelMeans, RunningSsim};
use crate::{constants::SSIM_WINDOW, error::Error, image::Image};

/// The exponent of each scale, finest first. *Source:* Wang, Simoncelli & Bovik 2003, §3.2.
const SCALE_WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];

/// The shorter side must be longer than this for the window to fit at the coarsest scale. Unit: px.
const TOO_SHORT_PX: u32 = (SSIM_WINDOW as u32 - 1) << (SCALE_WEIGHTS.len() - 1);

/// Multi-scale structural similarity of two images, 0 to 1; 1 for equal ones. `None` where it is
/// not defined: the shorter side is 160 px or less, so that the window does not fit at the fifth
/// scale. Clamp both images first ([`Image::clamped`]) for the figure that the field reports.
///
/// The mean over channels of Π cs₍ⱼ₎^w₍ⱼ₎ · ssim₍₅₎^w₍₅₎, j = 1 to 4, where each factor is a mean
/// over its scale as in [`ssim`](super::ssim()), raised to 0 where it is negative. Scales are
/// halved by averaging 2×2 pixels; an odd side is first padded with zeros at both ends, as average
/// pooling with padding does in the deep-learning frameworks whose MS-SSIM the literature on image
/// fitting reports. NaN where a pixel is NaN.
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
    let mut scales = Scale::all(a.width() as usize, a.height() as usize);
    (0..a.height()).for_each(|y| scales.push(a.row(y), b.row(y)));
    Ok(Some(scales.ms_ssim()))
}

/// A scale of two images whose rows are pushed one by one, and the coarser scales. A few rows of
/// each are in memory.
pub(super) struct Scale {
    ssim: RunningSsim,
    height: usize,
    /// Number of rows pushed.
    rows: usize,
    coarser: Option<Box<Coarser>>,
}

/// The next coarser scale, and the row of it that is being averaged, for each image.
struct Coarser {
    scale: Scale,
    half: [Vec<[f32; 3]>; 2],
}

impl Scale {
    /// All five scales for images of this size, or the finest alone where the window does not fit
    /// at the fifth.
    pub(super) fn all(width: usize, height: usize) -> Self {
        let is_defined = width.min(height) > TOO_SHORT_PX as usize;
        Self::of(width, height, if is_defined { SCALE_WEIGHTS.len() - 1 } else { 0 })
    }

    fn of(width: usize, height: usize, coarser: usize) -> Self {
        let coarser = coarser.checked_sub(1).map(|left| {
            let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
            let half = [(); 2].map(|()| vec![[0.0; 3]; half_width]);
            Box::new(Coarser { scale: Self::of(half_width, half_height, left), half })
        });
        Self { ssim: RunningSsim::new(width, height), height, rows: 0, coarser }
    }

    /// Pushes the next row of each image.
    pub(super) fn push(&mut self, a: &[[f32; 3]], b: &[[f32; 3]]) {
        self.ssim.push(a, b);
        let y = self.rows;
        self.rows += 1;
        let Some(Coarser { scale, half }) = self.coarser.as_deref_mut() else { return };
        half.iter_mut().zip([a, b]).for_each(|(half, row)| add_halved(row, half));
        // Along an odd side the pairs start one pixel early, at a row of zeros.
        if (y + self.height % 2) % 2 == 1 {
            scale.push(&half[0], &half[1]);
            half.iter_mut().for_each(|half| half.fill([0.0; 3]));
        }
    }

    /// Means of the finest scale, once all rows are pushed.
    pub(super) fn finest(&self) -> ChannelMeans {
        self.ssim.means()
    }

    /// Whether there are all five scales.
    pub(super) fn has_coarser(&self) -> bool {
        self.coarser.is_some()
    }

    /// The index over all scales, once all rows are pushed.
    pub(super) fn ms_ssim(&self) -> f64 {
        let mut product = [1.0; 3];
        let mut scale = Some(self);
        for weight in SCALE_WEIGHTS {
            let Some(Self { ssim, coarser, .. }) = scale else { break };
            let means = ssim.means();
            let factors = if coarser.is_some() { means.contrast_structure } else { means.ssim };
            for (product, factor) in product.iter_mut().zip(factors) {
                // Not `max`, which would turn NaN into 0.
                *product *= if factor < 0.0 { 0.0 } else { factor.powf(weight) };
            }
            scale = coarser.as_ref().map(|coarser| &coarser.scale);
        }
        product.iter().sum::<f64>() / 3.0
    }
}

/// Adds a quarter of each two neighbours of a row to a row of half its length, rounded up. Along an
/// odd side the pairs start one pixel early, at a zero.
fn add_halved(row: &[[f32; 3]], half: &mut [[f32; 3]]) {
    let (first, pairs) = row.split_at(row.len() % 2);
    let (out_first, out_pairs) = half.split_at_mut(row.len() % 2);
    for (out, pixel) in out_first.iter_mut().zip(first) {
        (0..3).for_each(|c| out[c] += 0.25 * pixel[c]);
    }
    for (out, [left, right]) in out_pairs.iter_mut().zip(pairs.as_chunks::<2>().0) {
        (0..3).for_each(|c| out[c] += 0.25 * (left[c] + right[c]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::test_images::clean_and_noisy;

    /// Expected values: direct 11×11 convolutions and padded 2×2 means in NumPy, in f64, written
    /// apart from this file.
    #[test]
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
    fn equal_images_score_one_and_a_negative_scores_zero() {
        let (image, _) = clean_and_noisy(192, 176);
        assert_eq!(ms_ssim(&image, &image).unwrap(), Some(1.0));
        let negative = Image::from_fn(192, 176, |x, y| image.pixel(x, y).map(|v| 1.0 - v)).unwrap();
        assert_eq!(ms_ssim(&image, &negative).unwrap(), Some(0.0));
    }

    #[test]
    fn it_is_defined_from_161_px_on() {
        for (width, height) in [(160, 300), (300, 160), (1, 1)] {
            let (image, _) = clean_and_noisy(width, height);
            assert_eq!(ms_ssim(&image, &image).unwrap(), None, "{width}x{height}");
        }
    }

    #[test]
    fn a_pixel_that_is_not_a_number_is_not_hidden() {
        let (clean, mut noisy) = clean_and_noisy(176, 176);
        noisy.pixels_mut()[5000][2] = f32::NAN;
        assert!(ms_ssim(&clean, &noisy).unwrap().unwrap().is_nan());
    }

    #[test]
    fn halving_pads_odd_sides_with_zeros_in_front() {
        let halved = |rows: &[&[[f32; 3]]]| {
            let mut half = vec![[0.0; 3]; rows[0].len().div_ceil(2)];
            rows.iter().for_each(|row| add_halved(row, &mut half));
            half
        };
        let pixels = [[4.0; 3], [8.0; 3], [12.0; 3], [16.0; 3], [20.0; 3], [24.0; 3]];
        assert_eq!(halved(&[&pixels[..3], &pixels[3..]]), [[5.0; 3], [16.0; 3]]); // rows 4 8 12 and 16 20 24
        assert_eq!(halved(&[&pixels[..2]]), [[3.0; 3]]); // row 4 8, with zeros above
    }
}
