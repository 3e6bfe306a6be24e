//! Size over quality of files of one image in one format, and the mean difference of two such
//! curves.

use std::ops::RangeInclusive;

/// Steps of the integral over a range of quality.
const STEPS: u32 = 400;

/// Size over quality, through files: a monotone cubic curve of the logarithm of bits per pixel.
/// *Source:* Fritsch and Carlson 1980, as in the usual programs for Bjøntegaard rates.
#[derive(Debug, Clone)]
pub(crate) struct RateCurve {
    /// (quality, ln of bits per pixel), both rising.
    pub(crate) points: Vec<(f64, f64)>,
    /// d ln(bits) / d quality at the points.
    slopes: Vec<f64>,
}

impl RateCurve {
    /// The curve through files of (bits per pixel, quality), in any order. A file that is not better
    /// than a smaller one, or not finite, is left out; `None` where fewer than two are left.
    pub(crate) fn new(files: impl IntoIterator<Item = (f64, f64)>) -> Option<Self> {
        let mut files: Vec<(f64, f64)> = files.into_iter().filter(|(bpp, q)| *bpp > 0.0 && q.is_finite()).collect();
        files.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut points: Vec<(f64, f64)> = Vec::new();
        for (bpp, quality) in files {
            if points.last().is_none_or(|&(best, rate)| quality > best && bpp.ln() > rate) {
                points.push((quality, bpp.ln()));
            }
        }
        (points.len() >= 2).then(|| Self { slopes: slopes(&points), points })
    }

    /// The quality of the smallest and of the best file.
    pub(crate) fn range(&self) -> (f64, f64) {
        (self.points[0].0, self.points[self.points.len() - 1].0)
    }

    /// Bits per pixel of a file of this quality; `None` outside the range.
    pub(crate) fn bpp_at(&self, quality: f64) -> Option<f64> {
        let (low, high) = self.range();
        (low..=high).contains(&quality).then(|| self.rate(quality).exp())
    }

    /// Quality of a file of this size, bits per pixel; `None` outside the sizes of the files.
    pub(crate) fn quality_at(&self, bpp: f64) -> Option<f64> {
        let (smallest, largest) = (self.points[0].1, self.points[self.points.len() - 1].1);
        let rate = bpp.ln();
        if !(smallest..=largest).contains(&rate) {
            return None;
        }
        let (mut low, mut high) = self.range();
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.rate(middle) < rate { low = middle } else { high = middle }
        }
        Some(high)
    }

    /// The Bjøntegaard rate: mean over the common range of quality of ln(size) less that of
    /// `reference`, as a ratio less 1: −0.25 is a quarter less at equal quality. Only the qualities
    /// count at which both files have a size in `bpp`, bits per pixel; `None` where there are none.
    pub(crate) fn bd_rate(&self, reference: &Self, bpp: RangeInclusive<f64>) -> Option<f64> {
        let ranges = [self, reference].map(|curve| curve.range_within(&bpp));
        let low = ranges.iter().map(|range| range.0).fold(f64::NEG_INFINITY, f64::max);
        let high = ranges.iter().map(|range| range.1).fold(f64::INFINITY, f64::min);
        let quality = |k: u32| low + (high - low) * (f64::from(k) + 0.5) / f64::from(STEPS);
        let difference = |k: u32| self.rate(quality(k)) - reference.rate(quality(k));
        (high > low).then(|| ((0..STEPS).map(difference).sum::<f64>() / f64::from(STEPS)).exp_m1())
    }

    /// The qualities at which the size is in `bpp`.
    fn range_within(&self, bpp: &RangeInclusive<f64>) -> (f64, f64) {
        let (low, high) = self.range();
        let above = |limit: f64| self.points[0].1 > limit.ln();
        match (self.quality_at(*bpp.start()), self.quality_at(*bpp.end())) {
            (from, to) if from.is_some() || to.is_some() || above(*bpp.start()) && !above(*bpp.end()) => {
                (from.unwrap_or(low), to.unwrap_or(high))
            }
            _ => (high, low),
        }
    }

    /// ln of bits per pixel at a quality in the range.
    fn rate(&self, quality: f64) -> f64 {
        let after = self.points.partition_point(|&(known, _)| known < quality).clamp(1, self.points.len() - 1);
        let [(from, start), (to, end)] = [self.points[after - 1], self.points[after]];
        let (width, t) = (to - from, (quality - from) / (to - from));
        let (t2, t3) = (t * t, t * t * t);
        (2.0 * t3 - 3.0 * t2 + 1.0) * start
            + (t3 - 2.0 * t2 + t) * width * self.slopes[after - 1]
            + (3.0 * t2 - 2.0 * t3) * end
            + (t3 - t2) * width * self.slopes[after]
    }
}

/// Slopes that keep a cubic curve through rising points rising: the weighted harmonic mean of those
/// of the two segments, and at the ends that of the only one.
fn slopes(points: &[(f64, f64)]) -> Vec<f64> {
    let widths: Vec<f64> = points.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
    let secants: Vec<f64> = points.windows(2).zip(&widths).map(|(pair, w)| (pair[1].1 - pair[0].1) / w).collect();
    let at = |place: usize| {
        let Some((before, after)) = place.checked_sub(1).zip((place < secants.len()).then_some(place)) else {
            return secants[place.min(secants.len() - 1)];
        };
        let (first, second) = (2.0 * widths[after] + widths[before], widths[after] + 2.0 * widths[before]);
        (first + second) / (first / secants[before] + second / secants[after])
    };
    (0..points.len()).map(at).collect()
}

/// MS-SSIM in dB, −10·log₁₀(1 − MS-SSIM), in which equal steps are about equally visible.
pub(crate) fn ms_ssim_decibels(ms_ssim: f64) -> f64 {
    -10.0 * (1.0 - ms_ssim).log10()
}
