//! A fit of an image that the page watches, pauses and steps through.

use gs_backend::AnyRasterizer;
use gs_core::{Image, Scene as _, Scene2d, edit::EditCounts, sigmoid, to_8_bits};
use gs_io::{File2d, decode_checkpoint, encode_2d, encode_checkpoint, png_bytes};
use gs_train::{
    EncodeSettings, EncodeTarget, FitSettings, Progress, SettingsFile as _, Trainer, encode, parse_settings,
};
use serde::{Deserialize, Serialize};
use wasm_bindgen::prelude::*;
use web_time::Instant;

use crate::{engine::Engine, failure, parsed, pixels, settings::Choices};

/// Memory that a fit may take, bytes; the engine has 4 GiB of address space in all.
const MOST_BYTES: u64 = 3 << 30;

/// How much stronger differences are in the map of errors.
const ERROR_GAIN: f32 = 6.0;

/// Numbers of an ellipse: x, y, two standard deviations, angle, red, green, blue, opacity.
const ELLIPSE: usize = 9;

/// How far [`Fit::advance`] goes.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Until {
    /// A number of milliseconds.
    Time(f64),
    /// A number of steps.
    Steps(u32),
    /// The end of the next round of density control, or of the fit.
    Round,
}

/// A fit in progress.
#[wasm_bindgen]
pub struct Fit {
    trainer: Trainer<'static, AnyRasterizer>,
    engine: Engine,
}

impl std::fmt::Debug for Fit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.trainer.fmt(f)
    }
}

/// What [`Fit::advance`] returns.
#[derive(Default, Serialize)]
struct Report {
    step: u32,
    iterations: u32,
    seconds: f64,
    count: u32,
    finished: bool,
    /// Points of the curves, one for each step: step, number of Gaussians, loss, PSNR by the loss.
    curve: Vec<(u32, u32, f32, Option<f32>)>,
    /// Rounds of density control.
    rounds: Vec<Round>,
    /// PSNR of the 8-bit image, dB, where it was measured: at the end of a fit.
    psnr: Option<f64>,
}

/// A round of density control.
#[derive(Serialize)]
struct Round {
    step: u32,
    cloned: u32,
    split: u32,
    seeded: u32,
    pruned: u32,
    /// Whether the fit had diverged and started again.
    restarted: bool,
}

impl Report {
    fn add(&mut self, progress: &Progress) {
        self.curve.push((progress.step, progress.count, progress.loss, progress.psnr_estimate));
        let restarted = progress.fresh_start.is_some();
        if let Some(counts) = progress.edits.or(restarted.then(EditCounts::default)) {
            let EditCounts { cloned, split, seeded, .. } = counts;
            self.rounds.push(Round { step: progress.step, cloned, split, seeded, pruned: counts.pruned(), restarted });
        }
    }
}

#[wasm_bindgen]
impl Engine {
    /// Starts a fit of an image of RGBA bytes. `choices` is JSON with any of `preset`, `gaussians`,
    /// `iterations`, `policy`, `blend` and `seed`.
    pub async fn fit(&self, rgba: Vec<u8>, width: u32, height: u32, choices: String) -> Result<Fit, JsError> {
        let target = image_of(&rgba, width, height)?;
        drop(rgba);
        let settings = parsed::<Choices>(&choices)?.settings(&target)?;
        Fit::of(*self, &target, settings).await
    }

    /// Starts a fit with the settings of a file, as `gs fit --settings` does.
    #[wasm_bindgen(js_name = fitWith)]
    pub async fn fit_with(&self, rgba: Vec<u8>, width: u32, height: u32, settings: String) -> Result<Fit, JsError> {
        let target = image_of(&rgba, width, height)?;
        let settings: FitSettings = parse_settings(&settings, "settings".as_ref()).map_err(failure)?;
        Fit::of(*self, &target, settings).await
    }

    /// Goes on with a fit of the same image from a checkpoint ([`Fit::checkpoint`]), which may have
    /// been made by another backend.
    #[wasm_bindgen(js_name = resumeFit)]
    pub fn resume_fit(&self, rgba: Vec<u8>, width: u32, height: u32, checkpoint: Vec<u8>) -> Result<Fit, JsError> {
        let target = image_of(&rgba, width, height)?;
        let checkpoint = decode_checkpoint(&checkpoint, "checkpoint".as_ref()).map_err(failure)?;
        let trainer = Trainer::<_, Scene2d>::resume(self.on, &target, checkpoint).map_err(failure)?;
        check_memory(trainer.settings(), &target)?;
        Ok(Fit { trainer, engine: *self })
    }
}

/// Fails where a fit takes more memory than the page has.
fn check_memory(settings: &FitSettings, target: &Image) -> Result<(), JsError> {
    let bytes = settings.peak_bytes(target.size());
    if bytes <= MOST_BYTES {
        return Ok(());
    }
    let (width, height) = target.size();
    Err(JsError::new(&format!(
        "fitting {width}x{height} px with {} Gaussians takes about {} MiB of memory, more than the {} MiB of this page; \
         scale the image, or use fewer Gaussians",
        settings.gaussians,
        bytes >> 20,
        MOST_BYTES >> 20
    )))
}

impl Fit {
    async fn of(engine: Engine, target: &Image, settings: FitSettings) -> Result<Fit, JsError> {
        check_memory(&settings, target)?;
        Ok(Self { trainer: Trainer::new(engine.on, target, settings).await.map_err(failure)?, engine })
    }
}

#[wasm_bindgen]
impl Fit {
    /// Makes steps. `until` is JSON: `{"time": ms}`, `{"steps": n}` or `"round"`. Returns JSON.
    pub async fn advance(&mut self, until: String) -> Result<String, JsError> {
        let until: Until = parsed(&until)?;
        let started = Instant::now();
        let mut report = Report::default();
        while !self.trainer.is_finished() {
            let progress = self.trainer.step_once().await.map_err(failure)?;
            report.add(&progress);
            let done = match until {
                Until::Time(milliseconds) => started.elapsed().as_secs_f64() * 1e3 >= milliseconds,
                Until::Steps(steps) => report.curve.len() >= steps as usize,
                Until::Round => !report.rounds.is_empty(),
            };
            if done {
                break;
            }
        }
        report.step = self.trainer.step();
        report.iterations = self.trainer.iterations();
        report.seconds = self.trainer.seconds();
        report.count = self.trainer.count();
        report.finished = self.trainer.is_finished();
        if report.finished {
            report.psnr = Some(self.trainer.quality().await.map_err(failure)?.psnr);
        }
        serde_json::to_string(&report).map_err(failure)
    }

    /// Steps done.
    #[wasm_bindgen(getter)]
    pub fn step(&self) -> u32 {
        self.trainer.step()
    }

    /// The state of the fit as a file, or nothing after a step where a fit can't be resumed.
    pub async fn checkpoint(&mut self) -> Result<Option<Vec<u8>>, JsError> {
        if !self.trainer.can_checkpoint() {
            return Ok(None);
        }
        let mut bytes = Vec::new();
        encode_checkpoint(&mut bytes, &self.trainer.saved().await.map_err(failure)?).map_err(failure)?;
        Ok(Some(bytes))
    }

    /// Pixels of the current picture ("picture"), its differences from the target ("error"), or the
    /// target ("target").
    pub async fn pixels(&self, kind: String) -> Result<Vec<u8>, JsError> {
        let target = self.trainer.target();
        if kind == "target" {
            return Ok(pixels::rgba_of(target));
        }
        let (image, _) = self.trainer.render().await.map_err(failure)?;
        Ok(if kind == "error" { difference(&image, target) } else { pixels::rgba_of(&image) })
    }

    /// The Gaussians as ellipses, nine numbers each: x, y, two standard deviations, all in px, the
    /// angle of the first in rad, red, green, blue, opacity.
    pub async fn ellipses(&self) -> Result<Vec<f32>, JsError> {
        let scene = self.trainer.scene().await.map_err(failure)?;
        let mut numbers = Vec::with_capacity(ELLIPSE * scene.len());
        for gaussian in scene.iter() {
            let scale = gaussian.log_scale.exp();
            numbers.extend([gaussian.mean.x, gaussian.mean.y, scale.x, scale.y, gaussian.rotation]);
            numbers.extend(gaussian.color.to_array());
            numbers.push(sigmoid(gaussian.opacity_logit));
        }
        Ok(numbers)
    }

    /// The content of a file: "scene" (`.gs2d.safetensors`), "png", "target" (the image
    /// that is fitted, a PNG), "gsi" (runs a fit of its own) or "settings" (TOML).
    pub async fn file(&self, kind: String) -> Result<Vec<u8>, JsError> {
        let target = self.trainer.target();
        match kind.as_str() {
            "settings" => Ok(self.trainer.settings().to_toml().map_err(failure)?.into_bytes()),
            "target" => Ok(png_bytes(target)),
            "png" => Ok(png_bytes(&self.trainer.render().await.map_err(failure)?.0)),
            "scene" => {
                let (width, height) = target.size();
                let scene = self.trainer.scene().await.map_err(failure)?;
                let settings = self.trainer.shown();
                encode_2d(&File2d { scene, width, height, settings, profile: None }).map_err(failure)
            }
            "gsi" => {
                let settings = EncodeSettings::default().with(|s| s.target = EncodeTarget::Quality(50));
                Ok(encode(self.engine.on, target, &settings, &|_| {}).await.map_err(failure)?.bytes)
            }
            other => Err(JsError::new(&format!("`{other}` is no file of a fit"))),
        }
    }
}

/// The image of opaque RGBA pixels; alpha is not read.
fn image_of(rgba: &[u8], width: u32, height: u32) -> Result<Image, JsError> {
    let pixels = rgba.as_chunks::<4>().0.iter();
    let pixels = pixels.map(|&[r, g, b, _]| [r, g, b].map(|byte| f32::from(byte) / 255.0)).collect();
    Image::from_pixels(width, height, pixels).map_err(failure)
}

/// The difference of two images of one size, [`ERROR_GAIN`] times as strong.
fn difference(image: &Image, target: &Image) -> Vec<u8> {
    let pairs = image.pixels().iter().zip(target.pixels());
    pixels::opaque(pairs.map(|(a, b)| std::array::from_fn(|k| to_8_bits(ERROR_GAIN * (a[k] - b[k]).abs()))))
}
