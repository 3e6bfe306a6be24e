//! One picture of a file: a fit, whose Gaussians are quantized in turns.
//!
//! A quick fit shows how many Gaussians the target takes and how many bits one costs; the standard
//! fit of that number is then quantized, once or a few times, until the target is met.

use glam::Vec2;
use gs_codec::{Extent, Layer, LayerHead, Picture, Quantizer, decode};
use gs_core::{
    Blend, Image, Optimizer, RenderSettings, Scene as _, Scene2d,
    metrics::{l1_and_psnr, mse_of_psnr, psnr_of_mse},
};

use super::{
    bands::{Band, bands},
    forecast::Forecast,
    layers::FirstLayer,
    progress::{EncodeWork, Report},
    sequence,
    settings::{EncodeSettings, EncodeTarget},
};
use crate::{
    error::Error,
    fit::{FitSettings, FitTarget, Preset, fit},
    memory::WEIGHT,
};

/// A picture as it is in a file.
pub(super) struct Part {
    /// The picture alone.
    pub(super) picture: Picture,
    /// Length of the file that has it alone, bytes.
    pub(super) bytes: u64,
    pub(super) gaussians: usize,
    /// PSNR of the decoded 8-bit picture, dB.
    pub(super) psnr: f64,
}

/// A file that may be the result.
pub(super) struct Attempt {
    pub(super) bytes: Vec<u8>,
    gaussians: usize,
    psnr: f64,
    /// What it decodes to.
    scene: Scene2d,
    /// The layers that it adds to those that are done.
    layers: Vec<Layer>,
}

/// Bits of a Gaussian before anything is known about the image.
const USUAL_BITS: f64 = 32.0;

/// Bits of a Gaussian of a standard fit relative to one of a quick fit at the same step: colours of
/// later steps are stronger.
const LATER_BITS: f64 = 1.12;

/// Bytes of a file besides the Gaussians.
const HEAD_BYTES: f64 = 32.0;

/// Gaussians per cell, about.
const PER_CELL: f64 = 0.6;

/// Share of Gaussians that rounding leaves, at least.
const SURE: f64 = 0.5;

/// Gaussians per stripe of a layer, at least. Stripes are decoded side by side; each costs about 300
/// bytes, as its probabilities are learned again.
const PER_STRIPE: usize = 8192;

/// Layers of a file at most, stripes included.
const MOST_LAYERS: usize = 255;

/// Bits of a Gaussian that a halved step costs.
const BITS_PER_OCTAVE: f64 = 7.0;

/// Share of a byte target that is enough.
const FULL: f64 = 0.985;

/// Finest step that is tried, in units of the step that goes with a fit.
const FINEST: f64 = 0.1;

/// Surplus of PSNR over its target, dB, that is small enough.
const SURPLUS_DB: f64 = 0.06;

/// Quantizations of a fit at most.
const ATTEMPTS: usize = 4;

/// Standard fits at most where the first has the wrong number of Gaussians, and where none is good
/// enough: those of a few Gaussians are hard to forecast.
const FITS: usize = 3;
const MOST_FITS: usize = 6;

/// Encodes one picture.
pub(super) struct Encoder<'a, R> {
    on: &'a R,
    image: &'a Image,
    background: [u8; 3],
    /// How much each pixel counts; `None` where all count 1.
    weights: Option<Vec<f32>>,
    seed: u32,
    bands: Vec<Band>,
    /// Layers that are done, and their Gaussians.
    layers: Vec<Layer>,
    done: Scene2d,
    forecast: Forecast,
    report: &'a Report<'a>,
}

/// A fit: a scene of each band, in coordinates of the whole image.
struct Fitted {
    parts: Vec<BandFit>,
    psnr: f64,
}

/// The fit of a band.
struct BandFit {
    scene: Scene2d,
    /// What the fit drew for the next band, which draws that again.
    beyond: Scene2d,
    settings: FitSettings,
}

impl Fitted {
    /// Number of Gaussians.
    fn len(&self) -> usize {
        self.parts.iter().map(|part| part.scene.len()).sum()
    }
}

/// The mean of squared errors of parts of an image.
#[derive(Default)]
struct MeanError {
    sum: f64,
    pixels: f64,
}

impl MeanError {
    /// Adds a part of which this was drawn.
    fn add(&mut self, drawn: &Image, part: &Image) -> Result<(), Error> {
        let (_, psnr) = l1_and_psnr(drawn, part)?;
        let pixels = part.pixels().len() as f64;
        self.sum += pixels * mse_of_psnr(psnr);
        self.pixels += pixels;
        Ok(())
    }

    fn psnr(&self) -> f64 {
        psnr_of_mse(self.sum / self.pixels)
    }
}

impl<'a, R: Optimizer<Scene2d>> Encoder<'a, R> {
    pub(super) fn new(
        on: &'a R,
        image: &'a Image,
        background: [u8; 3],
        weights: Option<Vec<f32>>,
        settings: &EncodeSettings,
        report: &'a Report<'a>,
    ) -> Result<Self, Error> {
        let of_weights = weights.as_ref().map_or(0, |weights| weights.len() as u64 * WEIGHT);
        let bands = bands(image, settings.memory.saturating_sub(of_weights))?;
        let (forecast, layers, done) = (Forecast::new(image), Vec::new(), Scene2d::default());
        Ok(Self { on, image, background, weights, seed: settings.seed, bands, layers, done, forecast, report })
    }

    /// The weights of the pixels that a band is fitted to.
    fn weights_of(&self, band: &Band) -> Option<&[f32]> {
        self.weights.as_deref().map(|weights| band.numbers_of(weights))
    }

    /// Encodes the picture; the target is that of the file that has it alone.
    pub(super) async fn encode(mut self, target: EncodeTarget, first: Option<FirstLayer>) -> Result<Part, Error> {
        if let Some(first) = first {
            self.add_first_layer(first, target).await?;
        }
        let Attempt { bytes, gaussians, psnr, layers, .. } = self.reach(target).await?;
        self.layers.extend(layers);
        Ok(Part { picture: self.picture(&[]), bytes: bytes.len() as u64, gaussians, psnr })
    }

    async fn fit(&mut self, preset: Preset, count: u32) -> Result<Fitted, Error> {
        let (mut parts, mut above, mut error) = (Vec::new(), self.done.clone(), MeanError::default());
        let mut stage = self.report.begin(EncodeWork::Fit, count as usize, self.bands.len());
        for band in &self.bands {
            let drawn = self.drawn(band, &above).await?;
            let target = sequence::difference(&band.with_overlap(self.image)?, &drawn)?;
            let mut settings = preset.settings(band.count(count), target.size());
            settings.seed = self.seed;
            let target = FitTarget { image: &target, weights: self.weights_of(band) };
            let fit = fit(self.on, target, settings.clone(), &mut stage).await?;
            stage.end_band();
            let drawn = band.without_overlap(&sequence::sum(&drawn, &fit.image)?)?;
            error.add(&drawn, &band.part_of(self.image)?)?;
            let (scene, beyond) = band.split(&fit.scene);
            above = above.iter().chain(scene.iter()).collect();
            parts.push(BandFit { scene, beyond, settings });
        }
        let psnr = error.psnr();
        match preset {
            Preset::Quick => self.forecast.add_quick(count, psnr),
            _ => self.forecast.add(count, psnr),
        }
        Ok(Fitted { parts, psnr })
    }

    /// What a scene on the background draws around a band.
    async fn drawn(&self, band: &Band, scene: &Scene2d) -> Result<Image, Error> {
        let background = self.background.map(|level| f32::from(level) / 255.0);
        let settings = RenderSettings::blended(Blend::Sum).on(background);
        Ok(self.on.render(scene, &band.canvas(), &settings).await?)
    }

    /// Adds the layers of a file to those that are done.
    pub(super) fn keep(&mut self, Attempt { layers, scene, .. }: Attempt) {
        self.layers.extend(layers);
        self.done = scene;
        self.forecast = Forecast::new(self.image);
    }

    /// The layers that are done and those of `more`.
    fn picture(&self, more: &[Layer]) -> Picture {
        let (width, height) = self.image.size();
        let most = (MOST_LAYERS / (self.layers.len() + more.len()).max(1)).max(1);
        let stripes = |layer: &Layer| layer.stripes((layer.codes.len() / PER_STRIPE).clamp(1, most));
        let layers = self.layers.iter().chain(more).flat_map(stripes).collect();
        Picture { width, height, background: self.background, layers, alpha: None, profile: Vec::new() }
    }

    pub(super) async fn reach(&mut self, target: EncodeTarget) -> Result<Attempt, Error> {
        match target {
            EncodeTarget::Bytes(bytes) => self.within_bytes(bytes).await,
            EncodeTarget::Psnr(psnr) => self.at_psnr(psnr).await,
            EncodeTarget::Quality(quality) => self.at_quality(quality).await,
        }
    }

    /// A quantizer with this step for the Gaussians of a band.
    fn quantizer(&self, step: f64, band: &Band, scene: &Scene2d) -> Quantizer {
        let cell = (PER_CELL * band.pixels() / scene.len().max(1) as f64).sqrt().round().clamp(1.0, 255.0);
        let size = Vec2::new(self.image.width() as f32, self.image.height() as f32);
        // Large Gaussians may have their means far outside. A mean that no cell holds is moved, which
        // changes the picture much.
        let outside = |&mean: &Vec2| (-mean).max(mean - size).max_element();
        let farthest = scene.means.iter().map(outside).fold(0.0, f32::max);
        let most = LayerHead::most_margin(cell as u8, self.image.size(), (SURE * scene.len() as f64) as usize);
        let margin = (f64::from(farthest) / cell).ceil().min(most.into());
        let most_step = f64::from(LayerHead::MOST_STEP);
        let head = LayerHead {
            step: (step.log2() * 128.0).round().clamp(-most_step, most_step) as i16,
            cell: cell as u8,
            margin: margin as u8,
            mean_ratio: 32,
            shape_ratio: 32,
            turn_ratio: 32,
        };
        Quantizer::new(head, self.image.size())
    }

    /// Bits of a fit that is rounded at once.
    fn bits(&self, fitted: &Fitted, step: f64) -> f64 {
        let of_band = |(band, part): (&Band, &BandFit)| {
            let quantizer = self.quantizer(step, band, &part.scene);
            let codes = part.scene.iter().filter_map(|g| quantizer.quantize(&g)).collect();
            Layer { head: *quantizer.head(), codes }.bits(self.image.size())
        };
        self.bands.iter().zip(&fitted.parts).map(of_band).sum()
    }

    /// Quantizes a fit in turns, as the last layers.
    async fn quantized(&self, fitted: &Fitted, step: f64) -> Result<Attempt, Error> {
        let (mut layers, mut above) = (Vec::new(), self.done.clone());
        let mut stage = self.report.begin(EncodeWork::Rounding, fitted.len(), self.bands.len());
        for (band, BandFit { scene, beyond, settings }) in self.bands.iter().zip(&fitted.parts) {
            let all = self.quantizer(step, band, scene);
            let kept: Scene2d = scene.iter().filter(|g| all.quantize(g).is_some()).collect();
            let quantizer = self.quantizer(step, band, &kept);
            let others: Scene2d = above.iter().chain(beyond.iter()).collect();
            let target = sequence::difference(&band.with_overlap(self.image)?, &self.drawn(band, &others).await?)?;
            let target = FitTarget { image: &target, weights: self.weights_of(band) };
            let codes =
                sequence::quantize(self.on, (target, &band.canvas()), &kept, &quantizer, settings, &stage).await?;
            stage.end_band();
            above = above.iter().chain(codes.iter().map(|code| quantizer.reconstruct(code))).collect();
            layers.push(Layer { head: *quantizer.head(), codes });
        }
        let bytes = self.picture(&layers).encode()?;
        // The picture is that of the file: the order of a sum decides about its last bits.
        let scene = decode(&bytes, Extent::Whole)?.scene;
        let mut error = MeanError::default();
        for band in &self.bands {
            error.add(&band.without_overlap(&self.drawn(band, &scene).await?)?, &band.part_of(self.image)?)?;
        }
        Ok(Attempt { bytes, gaussians: scene.len(), psnr: error.psnr(), scene, layers })
    }

    pub(super) async fn within_bytes(&mut self, bytes: u64) -> Result<Attempt, Error> {
        let bits = self.bits_within(bytes)?;
        let count = self.count_of(bits).await?;
        let fitted = self.fit(Preset::Standard, count).await?;
        self.filled(&fitted, bytes).await
    }

    /// Bits that a file of this size has for the Gaussians of its last layer.
    fn bits_within(&self, bytes: u64) -> Result<f64, Error> {
        let before = if self.layers.is_empty() { 0 } else { self.picture(&[]).encode()?.len() };
        Ok((bytes as f64 - before as f64 - HEAD_BYTES) * 8.0)
    }

    /// The number of Gaussians of a standard fit that take so many bits, by a quick fit.
    async fn count_of(&mut self, bits: f64) -> Result<u32, Error> {
        let count = |each: f64, most: f64| (bits / each).clamp(1.0, most).round() as u32;
        let first = count(USUAL_BITS, self.forecast.most());
        let quick = self.fit(Preset::Quick, first).await?;
        let step = self.forecast.step(first.into(), self.forecast.psnr(first.into()));
        let each = self.bits(&quick, step) / quick.len().max(1) as f64 * LATER_BITS;
        Ok(count(each, self.forecast.most()))
    }

    /// A fit as the last layer of a file of at most this many bytes.
    async fn filled(&self, fitted: &Fitted, bytes: u64) -> Result<Attempt, Error> {
        let bits = self.bits_within(bytes)?;
        let gaussians = fitted.len().max(1) as f64;
        let mut step = self.forecast.step(gaussians, fitted.psnr);
        // A finer step changes nothing that can be seen: small images do not need all of the bytes.
        let finest = FINEST * step;
        let mut share = FULL + 0.01;
        let mut best: Option<Attempt> = None;
        for _ in 0..4 {
            step *= ((self.bits(fitted, step) - share * bits) / gaussians / BITS_PER_OCTAVE).exp2();
            step = step.max(finest);
        }
        for _ in 0..ATTEMPTS {
            let attempt = self.quantized(fitted, step).await?;
            let used = attempt.bytes.len() as f64;
            let fits = attempt.bytes.len() as u64 <= bytes;
            if fits && best.as_ref().is_none_or(|best| attempt.psnr > best.psnr) {
                best = Some(attempt);
            }
            if fits && (used >= FULL * bytes as f64 || step <= finest) {
                break;
            }
            share = if fits { FULL + 0.01 } else { FULL };
            step *= ((used * 8.0 - share * bytes as f64 * 8.0) / gaussians / BITS_PER_OCTAVE).exp2();
            step = step.max(finest);
        }
        best.ok_or_else(|| EncodeTarget::Bytes(bytes).unreachable())
    }

    async fn at_psnr(&mut self, psnr: f64) -> Result<Attempt, Error> {
        // Quantization costs 10 log₁₀(1 + the share of its error).
        let before = psnr + QUANTIZATION_DB;
        let mut count = (self.forecast.most() / 130.0).max(1.0) as u32;
        for _ in 0..2 {
            self.fit(Preset::Quick, count).await?;
            count = self.count_for(before);
        }
        let mut best: Option<Attempt> = None;
        for fits in 1..=MOST_FITS {
            let fitted = self.fit(Preset::Standard, count).await?;
            best = self.steps_to_psnr(&fitted, psnr, best).await?;
            let off = fitted.psnr - before;
            if best.is_some() && (off < MOST_SPARE_DB || fits >= FITS) {
                break;
            }
            count = match self.count_for(before) {
                same if same == count => count + count / 8 + 1,
                other => other,
            };
            if f64::from(count) > self.forecast.most() {
                break;
            }
        }
        best.ok_or_else(|| EncodeTarget::Psnr(psnr).unreachable())
    }

    /// The number of Gaussians with which a standard fit has this PSNR.
    fn count_for(&self, psnr: f64) -> u32 {
        self.forecast.count_where(psnr, |count| self.forecast.psnr(count))
    }

    /// The smallest file of this fit, or `best`, that reaches a PSNR; `None` where neither does.
    async fn steps_to_psnr(
        &self,
        fitted: &Fitted,
        psnr: f64,
        mut best: Option<Attempt>,
    ) -> Result<Option<Attempt>, Error> {
        let spare = mse_of_psnr(psnr) - mse_of_psnr(fitted.psnr);
        if spare < 0.02 * mse_of_psnr(psnr) {
            return Ok(best);
        }
        let gaussians = fitted.len() as f64;
        // The rounding of all parameters at once would have the squared step times this.
        let rounding = 7.0 * gaussians / (36.0 * self.forecast.most());
        let mut step = (spare / (rounding * 0.6)).sqrt();
        // The coarsest step that reached the PSNR, and the finest that did not.
        let (mut enough, mut too_coarse) = (0.0, f64::INFINITY);
        for _ in 0..=ATTEMPTS {
            let attempt = self.quantized(fitted, step).await?;
            let found = attempt.psnr;
            if found >= psnr {
                enough = step.max(enough);
                if best.as_ref().is_none_or(|best| attempt.bytes.len() < best.bytes.len()) {
                    best = Some(attempt);
                }
                if found < psnr + SURPLUS_DB {
                    break;
                }
            } else {
                too_coarse = step.min(too_coarse);
            }
            let share = spare / (mse_of_psnr(found) - mse_of_psnr(fitted.psnr)).max(0.1 * spare);
            step *= (share * 0.99).sqrt().clamp(0.5, 2.0);
            if enough > 0.0 && too_coarse < f64::INFINITY && !(enough..too_coarse).contains(&step) {
                step = (enough * too_coarse).sqrt();
            }
        }
        Ok(best)
    }

    async fn at_quality(&mut self, quality: u8) -> Result<Attempt, Error> {
        let step = COARSEST_STEP * (-f64::from(quality - 1) / 99.0 * STEP_OCTAVES).exp2();
        let mut count = (self.forecast.most() / 130.0).max(1.0) as u32;
        for _ in 0..2 {
            self.fit(Preset::Quick, count).await?;
            let forecast = &self.forecast;
            count = forecast.count_where(-step, |count| -forecast.step(count, forecast.psnr(count)));
        }
        let fitted = self.fit(Preset::Standard, count).await?;
        self.quantized(&fitted, step).await
    }
}

/// Loss of PSNR by quantization where a file is smallest for its quality, dB.
const QUANTIZATION_DB: f64 = 0.65;

/// PSNR of a fit above what it needs, dB, from which a fit of fewer Gaussians is tried.
const MOST_SPARE_DB: f64 = 1.0;

/// Step of quality 1, colour values · px, and octaves from there to quality 100.
const COARSEST_STEP: f64 = 2.5;
const STEP_OCTAVES: f64 = 7.0;
