//! Structural similarity (SSIM), and the per-channel means of its factors that MS-SSIM is made of.
//!
//! Each map needs five windowed means: of a, b, a², b² and ab. With s = a + b and d = a − b four
//! are enough, because ab = (s² − d²)/4 and a² + b² = (s² + d²)/2. Rows stay interleaved (R G B R G
//! B …), so that every loop runs over contiguous floats whatever the window: taps are one row apart
//! in the vertical pass, three floats apart in the horizontal.

use crate::{
    constants::{SSIM_C1, SSIM_C2, SSIM_SIGMA, SSIM_WINDOW},
    error::Error,
    image::Image,
};

/// Structural similarity of two images, at most 1; 1 for equal ones. Clamp both images first
/// ([`Image::clamped`]) for the figure that the field reports.
///
/// The mean over channels and over all positions at which an 11×11 Gaussian window of σ 1.5 lies
/// inside the image, with a data range of 1. Where the image's smaller side is shorter than 11 px,
/// the window shrinks to the largest odd side that fits, σ unchanged. NaN where a pixel is NaN.
///
/// *Source:* Wang, Bovik, Sheikh & Simoncelli 2004, eq. 13, per colour channel.
///
/// # Errors
/// [`Error::SizesDiffer`].
pub fn ssim(a: &Image, b: &Image) -> Result<f64, Error> {
    a.same_size(b)?;
    let mut running = RunningSsim::new(a.width() as usize, a.height() as usize);
    (0..a.height()).for_each(|y| running.push(a.row(y), b.row(y)));
    Ok(running.means().mean_ssim())
}

/// Means over the image, per channel.
pub(super) struct ChannelMeans {
    /// Mean of the whole index, luminance · contrast · structure.
    pub(super) ssim: [f64; 3],
    /// Mean of contrast · structure alone, `cs` in MS-SSIM.
    pub(super) contrast_structure: [f64; 3],
}

/// SSIM at one scale of two images whose rows are pushed one by one from the top. As many rows as
/// the window has are in memory.
pub(super) struct RunningSsim {
    height: usize,
    window: Vec<f32>,
    /// The last rows, as many as the window has; row y is at index y modulo their count.
    recent: Vec<Moments>,
    vertical: Moments,
    windowed: Moments,
    /// Sums of each column, in f64: the rows of a large image add up without losing the last ones.
    sums: (Vec<f64>, Vec<f64>),
    /// Number of rows pushed.
    rows: usize,
}

impl RunningSsim {
    /// Starts the SSIM of images of this size, neither side 0.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let window = window(width.min(height));
        let (side, columns) = (window.len(), 3 * (width + 1 - window.len()));
        Self {
            height,
            window,
            recent: (0..side).map(|_| Moments::zeros(3 * width)).collect(),
            vertical: Moments::zeros(3 * width),
            windowed: Moments::zeros(columns),
            sums: (vec![0.0; columns], vec![0.0; columns]),
            rows: 0,
        }
    }

    /// Pushes the next row of each image.
    pub(super) fn push(&mut self, a: &[[f32; 3]], b: &[[f32; 3]]) {
        let Self { window, recent, vertical, windowed, sums, .. } = self;
        let (side, columns, y) = (window.len(), sums.0.len(), self.rows);
        self.rows += 1;
        recent[y % side].set((a.as_flattened(), b.as_flattened()));
        if self.rows < side {
            return;
        }
        for map in 0..Moments::COUNT {
            // The window is symmetric, so it does not matter at which row the ring starts; but each
            // weight must meet its row.
            let rows: Vec<&[f32]> = (0..side).map(|k| &*recent[(y + 1 + k) % side].0[map]).collect();
            weigh_rows(&mut vertical.0[map], &rows, window);
            let taps: Vec<&[f32]> = (0..side).map(|k| &vertical.0[map][3 * k..][..columns]).collect();
            weigh_rows(&mut windowed.0[map], &taps, window);
        }
        add_similarities(sums, windowed);
    }

    /// The means, once all rows are pushed.
    pub(super) fn means(&self) -> ChannelMeans {
        let positions = (self.sums.0.len() / 3 * (self.height + 1 - self.window.len())) as f64;
        let mean = |sums: &[f64]| {
            let mut total = [0.0; 3];
            for pixel in sums.as_chunks::<3>().0 {
                (0..3).for_each(|c| total[c] += pixel[c]);
            }
            total.map(|t| t / positions)
        };
        ChannelMeans { ssim: mean(&self.sums.0), contrast_structure: mean(&self.sums.1) }
    }
}

impl ChannelMeans {
    /// The mean index over the channels.
    pub(super) fn mean_ssim(&self) -> f64 {
        self.ssim.iter().sum::<f64>() / 3.0
    }
}

/// The normalised Gaussian window, as long as [`SSIM_WINDOW`] or, if that does not fit, the largest
/// odd number ≤ `fit`.
fn window(fit: usize) -> Vec<f32> {
    let side = SSIM_WINDOW.min(fit - (fit + 1) % 2);
    let weight = |k: usize| (-0.5 * ((k as f64 - (side / 2) as f64) / f64::from(SSIM_SIGMA)).powi(2)).exp();
    let sum: f64 = (0..side).map(weight).sum();
    (0..side).map(|k| (weight(k) / sum) as f32).collect()
}

/// One row of s, d, s² and d², interleaved by channel.
struct Moments([Vec<f32>; Self::COUNT]);

impl Moments {
    const COUNT: usize = 4;

    fn zeros(len: usize) -> Self {
        Self([(); Self::COUNT].map(|()| vec![0.0; len]))
    }

    fn set(&mut self, (a, b): (&[f32], &[f32])) {
        let [sum, difference, sum2, difference2] = &mut self.0;
        for (i, (&a, &b)) in a.iter().zip(b).enumerate() {
            let (s, d) = (a + b, a - b);
            (sum[i], difference[i], sum2[i], difference2[i]) = (s, d, s * s, d * d);
        }
    }
}

/// `out` = Σ weights[k] · rows[k]; the weights are symmetric, and as many as rows, an odd number.
fn weigh_rows(out: &mut [f32], rows: &[&[f32]], weights: &[f32]) {
    if let (Ok(rows), Ok(weights)) = (rows.try_into(), weights.try_into()) {
        return weigh_full_window(out, rows, weights);
    }
    out.fill(0.0);
    for (row, &weight) in rows.iter().zip(weights) {
        out.iter_mut().zip(*row).for_each(|(o, &v)| *o += weight * v);
    }
}

/// [`weigh_rows`] for the usual window: its length known, the loop over columns has all taps in one
/// body and vectorises.
fn weigh_full_window(out: &mut [f32], rows: &[&[f32]; SSIM_WINDOW], weights: &[f32; SSIM_WINDOW]) {
    let len = out.len();
    let rows: [&[f32]; SSIM_WINDOW] = std::array::from_fn(|k| &rows[k][..len]);
    for i in 0..len {
        let mut sum = weights[SSIM_WINDOW / 2] * rows[SSIM_WINDOW / 2][i];
        for k in 0..SSIM_WINDOW / 2 {
            sum += weights[k] * (rows[k][i] + rows[SSIM_WINDOW - 1 - k][i]);
        }
        out[i] = sum;
    }
}

/// Adds one row of the two maps, SSIM and its contrast · structure part, to the sums of their
/// columns.
fn add_similarities(sums: &mut (Vec<f64>, Vec<f64>), windowed: &Moments) {
    let columns = sums.0.len();
    let [s, d, s2, d2] = windowed.0.each_ref().map(|row| &row[..columns]);
    let (ssim_sums, contrast_sums) = (&mut sums.0[..columns], &mut sums.1[..columns]);
    for i in 0..columns {
        let (mean_s2, mean_d2) = (s[i] * s[i], d[i] * d[i]);
        let (variance_s, variance_d) = (s2[i] - mean_s2, d2[i] - mean_d2);
        // 2 μa μb = (S² − D²)/2, μa² + μb² = (S² + D²)/2, and likewise 2 σab and σa² + σb².
        let luminance = (0.5 * (mean_s2 - mean_d2) + SSIM_C1) / (0.5 * (mean_s2 + mean_d2) + SSIM_C1);
        let contrast = (0.5 * (variance_s - variance_d) + SSIM_C2) / (0.5 * (variance_s + variance_d) + SSIM_C2);
        ssim_sums[i] += f64::from(luminance * contrast);
        contrast_sums[i] += f64::from(contrast);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::test_images::clean_and_noisy;

    /// Expected values: scikit-image 0.26
    /// `structural_similarity(gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1, channel_axis=2)`
    /// in f64; that of 6×9 px, where scikit-image has no window, a direct 5×5 convolution in NumPy.
    #[test]
    fn values_agree_with_scikit_image() {
        for (width, height, expected) in [
            (40, 30, 0.770_675_721_947),
            (11, 11, 0.239_911_604_829),
            (13, 29, 0.660_924_668_739),
            (6, 9, 0.161_501_014_132),
        ] {
            let (clean, noisy) = clean_and_noisy(width, height);
            let found = ssim(&clean, &noisy).unwrap();
            assert!((found - expected).abs() < 5e-6, "{width}x{height}: {found}, expected {expected}");
            assert_eq!(found, ssim(&noisy, &clean).unwrap(), "not symmetric at {width}x{height}");
        }
    }

    #[test]
    fn equal_images_score_one_at_every_size() {
        for (width, height) in [(1, 1), (2, 30), (10, 10), (12, 11), (64, 40)] {
            let (image, _) = clean_and_noisy(width, height);
            assert_eq!(ssim(&image, &image).unwrap(), 1.0, "{width}x{height}");
        }
    }

    #[test]
    fn a_pixel_that_is_not_a_number_is_not_hidden() {
        let (clean, mut noisy) = clean_and_noisy(16, 16);
        noisy.pixels_mut()[100][1] = f32::NAN;
        assert!(ssim(&clean, &noisy).unwrap().is_nan());
    }

    #[test]
    fn images_of_two_sizes_are_refused() {
        let (a, b) = (clean_and_noisy(16, 12).0, clean_and_noisy(12, 16).0);
        assert!(matches!(ssim(&a, &b), Err(Error::SizesDiffer { .. })));
    }

    #[test]
    fn the_window_is_normalised_and_shrinks_to_an_odd_side() {
        for (fit, side) in [(1, 1), (2, 1), (3, 3), (10, 9), (11, 11), (500, 11)] {
            let window = window(fit);
            assert_eq!(window.len(), side, "fit {fit}");
            assert!((window.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        }
    }
}
