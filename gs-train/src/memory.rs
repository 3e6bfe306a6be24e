//! Estimates of peak memory, in bytes, before work begins.
//!
//! They estimate the host's memory where gs-cpu computes, without a GPU's own memory. They follow
//! from the sizes of arrays and are rather too high than too low: tests compare them with measured
//! runs.

mod parts;

use gs_core::{Blend, Loss, RenderSettings, Scene3d, effects::Statistics};
use gs_density::DensityPolicy;

use self::parts::{BASE, COMPACT, ENCODED, EVALUATED, IMAGE, PLANE, pixels};
pub(crate) use self::parts::{READ_AHEAD, TRANSPARENT, WEIGHT, encoding_at_once, evaluated_at_once, is_compact};
use crate::{
    encode::{EncodeSettings, LEAST_FITTED_ROWS},
    fit::{FitSettings, Tune},
    train::TrainSettings,
};

/// A part of an image that is drawn in parts.
const PART: u64 = 32 << 20;

/// Freed memory that the allocator keeps at most: pieces larger than 32 MiB go back to the system. On a busy machine,
/// more threads have some of it at the same time.
const MOST_KEPT: u64 = 110_000_000;

/// A pair of a Gaussian and a tile that it touches: its entry in the lists and its gradient.
const ENTRY: u64 = 64;

/// A 2D Gaussian: parameters, moments, gradient, projection, and the copies on the host in a round
/// of density control.
const GAUSSIAN_2D: u64 = 700;

/// A 3D Gaussian of degree 0, with the usual number of entries.
const GAUSSIAN_3D: u64 = 750;

/// A further parameter of a 3D Gaussian, with its moments and the host's copy in a round.
const PARAMETER_3D: u64 = 16;

/// Memory for reading an image of this size, the image included, bytes.
pub fn reading((width, height): (u32, u32)) -> u64 {
    pixels(width, height) * (2 * IMAGE + PLANE)
}

/// Peak memory of encoding an image of this size in about `most` bytes, the image included, bytes. It
/// is more only where the image itself, or the least band, takes that much.
pub fn encoding((width, height): (u32, u32), transparent: bool, settings: &EncodeSettings) -> u64 {
    let all = pixels(width, height);
    let weights = if settings.tune == Tune::Psnr { 0 } else { WEIGHT };
    let waiting = all * if transparent { TRANSPARENT + weights } else { weights };
    let most = settings.memory;
    let least = pixels(width, height.min(LEAST_FITTED_ROWS));
    let band = encoding_at_once((width, height), most.saturating_sub(waiting)).max(least);
    (BASE + all * IMAGE + waiting + band * ENCODED).max(reading((width, height)))
}

/// Memory that training on images of this many pixels takes in any case.
fn overhead(pixels: u64) -> u64 {
    BASE + (pixels * IMAGE).min(PART) + (5 * pixels * IMAGE).min(MOST_KEPT)
}

impl FitSettings {
    /// Peak memory of a fit to an image of this size (columns, rows), the image and its results
    /// included, bytes.
    pub fn peak_bytes(&self, (width, height): (u32, u32)) -> u64 {
        let pixels = pixels(width, height);
        let target = 2 * IMAGE + of_target(self.loss);
        let needs = self.policy.needs();
        let step = of_step(&self.render, self.loss, needs.statistics);
        // A policy uses the rendering, weights of all pixels, and their order. Results are two
        // renderings, one of them with ellipses, and what encodes them.
        let residual = if needs.residual { 2 * PLANE } else { 0 };
        // Weights are kept for the policy and for the backend, beside what they are made from.
        let weights = if self.tune == Tune::Psnr { 0 } else { 3 * WEIGHT };
        overhead(pixels) + pixels * (target + step + 3 * IMAGE + residual + weights) + self.of_gaussians(pixels)
    }

    /// Memory of all Gaussians. Evenly spread over the image, each touches as many tiles of 16
    /// columns as it is broad.
    fn of_gaussians(&self, pixels: u64) -> u64 {
        let count = u64::from(self.gaussians);
        let apart = (pixels as f64 / count.max(1) as f64).sqrt();
        let tiles = 2 + (3.0 * apart / 16.0) as u64;
        count * (GAUSSIAN_2D + tiles * ENTRY)
    }
}

impl TrainSettings {
    /// Peak memory of training this many Gaussians from views of these sizes, whose images and targets
    /// are kept up to `keep_bytes`, bytes.
    pub fn peak_bytes(&self, views: impl IntoIterator<Item = (u32, u32)>, keep_bytes: u64, gaussians: u64) -> u64 {
        let (mut all, mut largest, mut count) = (0, 0, 0);
        for (width, height) in views {
            count += 1;
            all += pixels(width, height);
            largest = largest.max(pixels(width, height));
        }
        let images = (all * COMPACT).min(keep_bytes);
        // Kept targets are counted without what D-SSIM adds to them.
        let beside = if is_compact(all) { 0 } else { of_target(self.loss) };
        let kept = images + all.min((keep_bytes - images) / IMAGE) * (IMAGE + beside);
        let step = of_step(&self.render, self.loss, self.policy.needs().statistics);
        // An image on its way to the backend, a rendering, the target of the step, and images that are
        // read ahead.
        let passing = 4 * IMAGE + of_target(self.loss) + step + READ_AHEAD * COMPACT;
        // Views are evaluated when the last step is over.
        let evaluated = largest * EVALUATED * evaluated_at_once(largest) as u64;
        let numbers = 3 * ((u64::from(self.render.effects.sh_degree) + 1).pow(2) - 1);
        // The sum of several scenes has each of a Gaussian's numbers, too.
        let sum = if self.average_last > 0.0 { (14 + numbers) * PLANE } else { 0 };
        let gaussian = GAUSSIAN_3D + numbers * PARAMETER_3D + sum;
        let of_evidence = self.of_evidence(count, gaussian);
        overhead(largest) + kept + (largest * passing).max(evaluated) + gaussians * (gaussian + of_evidence)
    }

    /// Memory of the evidence in the round that needs most, for each Gaussian: the evidence itself,
    /// and copies of the scene of which it is gathered; `gaussian` is that of a Gaussian of the
    /// scene.
    fn of_evidence(&self, views: u64, gaussian: u64) -> u64 {
        let policy: &dyn DensityPolicy<Scene3d> = &self.policy;
        if !self.policy.needs().evidence {
            return 0;
        }
        let of_round = |step: u32| {
            let request = policy.evidence(step - 1, self.rounds.progress(step, self.iterations)?)?;
            let copies = GAUSSIAN_3D + if request.splitting { gaussian } else { 0 };
            Some(request.bytes_per_gaussian(views) + copies)
        };
        (1..=self.iterations).filter_map(of_round).max().unwrap_or_default()
    }
}

/// Bytes per pixel that a loss adds to each target.
fn of_target(loss: Loss) -> u64 {
    match loss {
        Loss::L1 | Loss::L2 => 0,
        Loss::L1Dssim { .. } => 3 * IMAGE,
    }
}

/// Bytes per pixel of a training step: the image, its gradient, the transmittance and the errors of
/// pixels; none where tiles are processed one by one.
fn of_step(render: &RenderSettings, loss: Loss, statistics: Statistics) -> u64 {
    let over = render.effects.blend == Blend::Over;
    if !over && loss == Loss::L2 && statistics == Statistics::None {
        return 0;
    }
    let transmittance = if over { PLANE } else { 0 };
    let errors = if statistics == Statistics::PixelError { PLANE } else { 0 };
    2 * IMAGE + transmittance + errors
}

#[cfg(test)]
mod tests {
    use gs_density::Policy;

    use super::*;
    use crate::train::TrainPreset;

    #[test]
    fn evidence_is_counted_where_a_round_gathers_it() {
        let plain = TrainPreset::ThreeDgs.settings(Some(7_000));
        let bytes = |settings: &TrainSettings, views: usize| {
            settings.peak_bytes(vec![(64, 64); views], 0, 1_000) - plain.peak_bytes(vec![(64, 64); views], 0, 1_000)
        };
        let mut taming = plain.clone();
        taming.policy = Policy::from_name("taming").unwrap();
        // Eight numbers in each of ten views, and a copy of the scene.
        let of_taming = |views: u64| 1_000 * (views.min(10) * 32 + GAUSSIAN_3D);
        assert_eq!([bytes(&taming, 4), bytes(&taming, 500)], [4, 500].map(of_taming));
    }
}
