//! A forecast of a fit's quality by its number of Gaussians, from quick fits.

use gs_core::Image;

/// Error of a fit, mean squared, below which nothing is gained: 70 dB.
const LEAST_ERROR: f64 = 1e-7;

/// dB of PSNR per e-fold of Gaussians where a single quick fit is known: mean over the Kodak images.
const USUAL_SLOPE: f64 = 3.8;

/// Squared step of amplitudes in units of that at which rounding, all parameters at once, would
/// double the error of a fit. Where the file is smallest for its error, a part of the error is that
/// of rounding: a finer step costs more bits than more Gaussians do.
const STEP_SHARE: f64 = 0.4;

/// The forecast for one image.
#[derive(Debug, Clone)]
pub(super) struct Forecast {
    pixels: f64,
    /// (ln of the number of Gaussians, PSNR of the standard fit in dB) by ln.
    known: Vec<(f64, f64)>,
}

impl Forecast {
    pub(super) fn new(target: &Image) -> Self {
        Self { pixels: target.pixels().len() as f64, known: Vec::new() }
    }

    /// Adds the PSNR of a quick fit. A standard fit is better by an amount that depends on the
    /// density of Gaussians: 1.3 dB with 1,000, 3.4 dB with 20,000 on 768x512 px
    /// (`benchmarks/2026-11-22-xeon-2-cores/kodak.md`).
    pub(super) fn add_quick(&mut self, count: u32, psnr: f64) {
        let density = (f64::from(count) / self.pixels * 393.216).ln().clamp(-2.0, 5.0);
        self.add(count, psnr + 1.33 + 0.45 * density + 0.085 * density * density);
    }

    /// Adds the PSNR of a standard fit.
    pub(super) fn add(&mut self, count: u32, psnr: f64) {
        let at = f64::from(count).ln();
        self.known.retain(|&(known, _)| (known - at).abs() > 0.05);
        self.known.push((at, psnr.min(90.0)));
        self.known.sort_by(|a, b| a.0.total_cmp(&b.0));
    }

    /// PSNR of a standard fit with this many Gaussians: along the line through the two nearest
    /// known.
    pub(super) fn psnr(&self, count: f64) -> f64 {
        let at = count.max(1.0).ln();
        let after = self.known.partition_point(|&(known, _)| known < at).clamp(1, self.known.len().max(2) - 1);
        match (self.known.get(after - 1), self.known.get(after)) {
            (Some(a), Some(b)) => a.1 + ((b.1 - a.1) / (b.0 - a.0)).max(1.0) * (at - a.0),
            (Some(a), None) => a.1 + USUAL_SLOPE * (at - a.0),
            _ => 30.0,
        }
    }

    /// The step of amplitudes, colour values · px, that goes with a fit of this PSNR.
    pub(super) fn step(&self, count: f64, psnr: f64) -> f64 {
        let error = gs_core::metrics::mse_of_psnr(psnr).max(LEAST_ERROR);
        (STEP_SHARE * error * self.pixels * 36.0 / (7.0 * count.max(1.0))).sqrt()
    }

    /// The number of Gaussians at which `value` of it, which rises with it, reaches `goal`.
    pub(super) fn count_where(&self, goal: f64, value: impl Fn(f64) -> f64) -> u32 {
        let (mut low, mut high) = (0.0, self.most().ln());
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if value(f64::exp(middle)) < goal { low = middle } else { high = middle }
        }
        high.exp().round() as u32
    }

    /// Largest useful number of Gaussians.
    pub(super) fn most(&self) -> f64 {
        self.pixels.max(2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_forecast_follows_the_line_through_the_nearest_fits() {
        let mut forecast = Forecast::new(&Image::filled(100, 100, [0.5; 3]).unwrap());
        forecast.add(100, 25.0);
        assert!((forecast.psnr(200.0) - 25.0 - USUAL_SLOPE * 2f64.ln()).abs() < 1e-9);
        forecast.add(400, 29.0);
        assert!((forecast.psnr(200.0) - 27.0).abs() < 1e-9 && (forecast.psnr(800.0) - 31.0).abs() < 1e-9);
        assert_eq!(forecast.count_where(31.0, |count| forecast.psnr(count)), 800);
        // A better fit of more Gaussians has a finer step.
        assert!(forecast.step(800.0, 31.0) < 0.6 * forecast.step(400.0, 29.0));
        assert!(forecast.step(1.0, f64::INFINITY) > 0.0);
    }
}
