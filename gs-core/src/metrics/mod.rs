//! Measures of how close two images are: mean absolute error, PSNR, SSIM, MS-SSIM.

mod ms_ssim;
mod ssim;

pub use ms_ssim::ms_ssim;
pub use ssim::ssim;

use std::borrow::Borrow;

use crate::{
    error::Error,
    image::{Image, rounded_to_8_bits},
};

/// The mean of values, such as PSNR over images; NaN of none.
pub fn mean(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0usize), |(sum, n), value| (sum + value.borrow(), n + 1));
    sum / count as f64
}

/// The median: the mean of the two middle values of an even number, NaN of none.
pub fn median(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().map(|value| *value.borrow()).collect();
    values.sort_unstable_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => (values[n / 2 - 1] + values[n / 2]) / 2.0,
    }
}

/// Mean |a − b| over pixels and channels.
///
/// # Errors
/// [`Error::SizesDiffer`] where the images differ in size.
pub fn mean_absolute_error(a: &Image, b: &Image) -> Result<f64, Error> {
    a.same_size(b)?;
    let sum: f64 = differences(a, b).map(f64::abs).sum();
    Ok(sum / (3 * a.pixels().len()) as f64)
}

/// Peak signal-to-noise ratio, dB: 10 log₁₀(1 / mean (a − b)²), with peak 1; ∞ for equal images.
/// Clamp both images first ([`Image::clamped`]) for the figure that the field reports.
///
/// # Errors
/// [`Error::SizesDiffer`].
pub fn psnr(a: &Image, b: &Image) -> Result<f64, Error> {
    a.same_size(b)?;
    let sum: f64 = differences(a, b).map(|d| d * d).sum();
    Ok(psnr_of_mse(sum / (3 * a.pixels().len()) as f64))
}

/// The PSNR of a mean squared error, dB, with peak 1: −10 log₁₀ of it; ∞ of 0.
pub fn psnr_of_mse(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

/// The mean squared error of a PSNR in dB: the inverse of [`psnr_of_mse`].
pub fn mse_of_psnr(psnr: f64) -> f64 {
    10f64.powf(-psnr / 10.0)
}

/// All measures of how close two images are.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Comparison {
    /// [`mean_absolute_error`].
    pub l1: f64,
    /// [`psnr`], dB.
    pub psnr: f64,
    /// [`ssim()`].
    pub ssim: f64,
    /// [`ms_ssim()`].
    pub ms_ssim: Option<f64>,
}

/// All measures of two images in one pass over their rows.
///
/// Values are clamped to 0..=1 first, and those of `a` rounded to 8 bits if `rounded`, without a
/// copy of the images.
///
/// # Errors
/// [`Error::SizesDiffer`] where the images differ in size.
pub fn compare(a: &Image, b: &Image, rounded: bool) -> Result<Comparison, Error> {
    a.same_size(b)?;
    Ok(if rounded { compare_by(a, rounded_to_8_bits, b) } else { compare_by(a, clamped, b) })
}

fn clamped(value: f32) -> f32 {
    value.clamp(0.0, 1.0)
}

fn compare_by(a: &Image, value_of_a: impl Fn(f32) -> f32, b: &Image) -> Comparison {
    let mut scales = ms_ssim::Scale::all(a.width() as usize, a.height() as usize);
    let (mut absolute, mut squared) = (0.0, 0.0);
    let (mut row_a, mut row_b) = (vec![[0.0; 3]; a.width() as usize], vec![[0.0; 3]; a.width() as usize]);
    for y in 0..a.height() {
        set_values(&mut row_a, a.row(y), &value_of_a);
        set_values(&mut row_b, b.row(y), clamped);
        for (&a, &b) in row_a.as_flattened().iter().zip(row_b.as_flattened()) {
            let difference = f64::from(a) - f64::from(b);
            absolute += difference.abs();
            squared += difference * difference;
        }
        scales.push(&row_a, &row_b);
    }
    let values = (3 * a.pixels().len()) as f64;
    Comparison {
        l1: absolute / values,
        psnr: psnr_of_mse(squared / values),
        ssim: scales.finest().mean_ssim(),
        ms_ssim: scales.has_coarser().then(|| scales.ms_ssim()),
    }
}

fn set_values(row: &mut [[f32; 3]], of: &[[f32; 3]], value: impl Fn(f32) -> f32) {
    row.as_flattened_mut().iter_mut().zip(of.as_flattened()).for_each(|(out, &number)| *out = value(number));
}

/// L1 (0 to 1) and PSNR (dB) of a rendering, rounded to 8 bits, against `target`.
///
/// The same as [`compare`] finds, without the other measures, so that observing a training stays
/// cheap.
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
    Ok((absolute / values, psnr_of_mse(squared / values)))
}

fn differences<'a>(a: &'a Image, b: &'a Image) -> impl Iterator<Item = f64> + 'a {
    let (a, b) = (a.pixels().as_flattened(), b.pixels().as_flattened());
    a.iter().zip(b).map(|(&a, &b)| f64::from(a) - f64::from(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_in_the_middle() {
        assert_eq!(median([3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median([4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median([0.0; 0]).is_nan());
    }

    #[test]
    fn one_pass_finds_what_each_measure_finds_by_itself() {
        for (width, height) in [(40, 30), (161, 165)] {
            let (a, noisy) = test_images::clean_and_noisy(width, height);
            let b = Image::from_fn(width, height, |x, y| noisy.pixel(x, y).map(|v| 1.5 * v - 0.25)).unwrap();
            let clamped = b.clamped();
            let expected = Comparison {
                l1: mean_absolute_error(&a, &clamped).unwrap(),
                psnr: psnr(&a, &clamped).unwrap(),
                ssim: ssim(&a, &clamped).unwrap(),
                ms_ssim: ms_ssim(&a, &clamped).unwrap(),
            };
            let found = compare(&a, &b, false).unwrap();
            assert_eq!(found, expected, "{width}x{height}");
            assert_ne!(compare(&a, &b, true).unwrap(), expected);
        }
    }

    fn wave(phase: f32) -> Image {
        let value = |x: u32, y: u32| [0.0, 0.7, 1.3].map(|c| (x as f32 * 0.7 + y as f32 + c + phase).sin());
        Image::from_fn(37, 21, value).unwrap()
    }

    #[test]
    fn the_quick_figures_are_those_of_the_slow_ones() {
        let (a, b) = (wave(0.0), wave(0.1));
        let (l1, psnr) = l1_and_psnr(&a, &b).unwrap();
        let slow = compare(&a, &b, true).unwrap();
        assert!((l1 - slow.l1).abs() < 1e-7 && (psnr - slow.psnr).abs() < 1e-4, "{l1} {psnr} {slow:?}");
        assert!(psnr > 10.0 && psnr < 60.0, "{psnr}");
        let written = a.rounded_to_8_bits();
        assert_eq!(l1_and_psnr(&a, &written), Ok((0.0, f64::INFINITY)));
    }

    #[test]
    fn psnr_and_mean_squared_error_are_inverse() {
        assert_eq!([1.0, 0.01, 0.0].map(psnr_of_mse), [0.0, 20.0, f64::INFINITY]);
        assert_eq!([0.0, 20.0, f64::INFINITY].map(mse_of_psnr), [1.0, 0.01, 0.0]);
    }
}

#[cfg(test)]
mod test_images {
    use crate::image::Image;

    /// A pattern of edges and ramps, and the same under a quarter of noise, from integer formulas
    /// that any language repeats.
    pub(super) fn clean_and_noisy(width: u32, height: u32) -> (Image, Image) {
        let clean = Image::from_fn(width, height, |x, y| {
            [0, 1, 2_u32].map(|c| {
                let ramp = f64::from((x * x + 3 * y * (c + 1) + x * y) % 257) / 256.0;
                let blocks = f64::from((x / 16 + y / 12 + c) % 3) / 2.0;
                (ramp * 0.25 + blocks * 0.75) as f32
            })
        })
        .unwrap();
        let noisy = Image::from_fn(width, height, |x, y| {
            [0, 1, 2_u32].map(|c| {
                let noise =
                    (u64::from(x) * 7919 + u64::from(y) * 104_729 + u64::from(c) * 15_485_863 + u64::from(x * y) * 31)
                        % 1021;
                0.75 * clean.pixel(x, y)[c as usize] + 0.25 * (noise as f64 / 1020.0) as f32
            })
        })
        .unwrap();
        (clean, noisy)
    }
}
