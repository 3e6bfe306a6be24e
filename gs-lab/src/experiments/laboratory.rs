//! Runs the fits of experiments on one backend, and keeps every loss and count.

use gs_backend::FutureExt as _;
use gs_core::{Canvas, Image, Optimizer, RenderSettings, Scene2d, counted};

use super::findings::Picture;
use crate::report::figure::{Axis, Figure, Marks, Series};
use gs_train::{Control, Error, Fit, FitSettings, FitSummary, Observer, Progress, Recovery, Trainer};

/// The PSNR from which on a reconstruction of the paper's target counts as sharp, dB. Its root mean
/// square error is then 1.8 % of the range; that of 20 Gaussians without growth is 8 %.
pub(crate) const SHARP_DB: f64 = 35.0;

/// How much of an experiment runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum ExperimentSize {
    /// A full run: several seeds and all cases.
    #[default]
    Full,
    /// A quick run: one or two seeds and the decisive cases, in less than half a minute.
    Quick,
}

impl ExperimentSize {
    /// Returns `full` or `quick`, according to the size.
    pub(crate) fn choose<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }

    /// A range of seeds, from 0.
    pub(crate) fn seeds(self, full: u32, quick: u32) -> std::ops::Range<u32> {
        0..self.choose(full, quick)
    }
}

/// Receives the progress of experiments. `()` ignores it.
pub trait Watch {
    /// A fit, or a camera flight, begins.
    fn on_fit(&mut self, label: &str) {
        let _ = label;
    }

    /// A step of a fit is done.
    fn on_step(&mut self, progress: &Progress) {
        let _ = progress;
    }
}

impl Watch for () {}

/// A backend to run experiments on, with the extent and an observer.
pub struct Laboratory<'a, R> {
    rasterizer: &'a R,
    extent: ExperimentSize,
    watch: &'a mut dyn Watch,
}

impl<R> std::fmt::Debug for Laboratory<'_, R> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Laboratory").field("extent", &self.extent).finish_non_exhaustive()
    }
}

/// A fit with its history.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Run {
    pub(crate) fit: Fit,
    /// The loss before each step.
    pub(crate) losses: Vec<f32>,
    /// Gaussians after each step.
    pub(crate) counts: Vec<u32>,
}

impl<'a, R> Laboratory<'a, R> {
    /// A laboratory on this backend.
    pub fn new(rasterizer: &'a R, extent: ExperimentSize, watch: &'a mut dyn Watch) -> Self {
        Self { rasterizer, extent, watch }
    }

    pub(crate) fn extent(&self) -> ExperimentSize {
        self.extent
    }

    pub(crate) fn rasterizer(&self) -> &'a R {
        self.rasterizer
    }

    pub(crate) fn watch(&mut self) -> &mut dyn Watch {
        self.watch
    }
}

impl<R: Optimizer<Scene2d>> Laboratory<'_, R> {
    /// Runs a fit. A diverging fit fails instead of recovering, because failures are a part of the
    /// results.
    pub(crate) fn fit(&mut self, label: &str, target: &Image, settings: FitSettings) -> Result<Run, Error> {
        let settings = settings.with(|s| s.recovery = Recovery::Never);
        let mut trainer = Trainer::new(self.rasterizer, target, settings).block_on()?;
        self.watch.on_fit(label);
        let mut record = Record { losses: Vec::new(), counts: Vec::new(), watch: self.watch };
        let outcome = trainer.run(&mut record).block_on()?;
        let Record { losses, counts, .. } = record;
        let (image, culled) = trainer.render().block_on()?;
        let summary = FitSummary::new(&trainer, &image, culled).block_on()?;
        Ok(Run { fit: Fit { scene: trainer.scene().block_on()?, image, summary, outcome }, losses, counts })
    }

    /// A picture of a scene, enlarged to about 512 px.
    pub(crate) fn picture(
        &self,
        name: &'static str,
        caption: impl Into<String>,
        scene: &Scene2d,
        shown: Shown<'_>,
    ) -> Result<Picture, Error> {
        let (width, height) = shown.size;
        let factor = (PICTURE_PX / width.max(height).max(1)).max(1);
        let canvas = Canvas::new(width, height).resized(width * factor, height * factor);
        let image = self.rasterizer.render(scene, &canvas, shown.render).block_on()?;
        let ellipses = (shown.ellipses == Ellipses::Drawn).then(|| (scene.clone(), canvas));
        Ok(Picture { name, caption: caption.into(), image, ellipses })
    }
}

/// Side of an enlarged picture, px.
const PICTURE_PX: u32 = 512;

/// How a scene is shown.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shown<'a> {
    /// Size of the image that the scene was made for: (columns, rows).
    pub(crate) size: (u32, u32),
    pub(crate) render: &'a RenderSettings,
    pub(crate) ellipses: Ellipses,
}

/// Whether Gaussians are drawn over their rendering.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ellipses {
    Drawn,
    LeftOut,
}

impl Run {
    /// Final PSNR of the 8-bit image, dB.
    pub(crate) fn psnr(&self) -> f64 {
        self.fit.summary.psnr
    }

    /// Final number of Gaussians.
    pub(crate) fn count(&self) -> u32 {
        self.fit.summary.gaussians
    }

    pub(crate) fn last_loss(&self) -> f64 {
        self.losses.last().map_or(f64::NAN, |&loss| loss.into())
    }

    /// Count over steps as a step function: the points before and after each change, and both ends.
    pub(crate) fn count_curve(&self) -> Vec<(f64, f64)> {
        let numbered = (1..).zip(&self.counts).map(|(step, &count)| (f64::from(step), f64::from(count)));
        let points: Vec<(f64, f64)> = numbered.collect();
        let changes = points.windows(2).filter(|pair| pair[0].1 != pair[1].1);
        let stairs = changes.flat_map(|pair| [(pair[1].0, pair[0].1), pair[1]]);
        points.first().copied().into_iter().chain(stairs).chain(points.last().copied()).collect()
    }

    /// Loss over steps, reduced to every tenth.
    pub(crate) fn loss_curve(&self) -> Vec<(f64, f64)> {
        let numbered = (1..).zip(&self.losses).map(|(step, &loss)| (f64::from(step), f64::from(loss)));
        numbered.filter(|&(step, _)| step == 1.0 || step % 10.0 == 0.0).collect()
    }

    /// The first step at which the loss, averaged over [`SMOOTHED_STEPS`], is at most `level`.
    pub(crate) fn first_step_below(&self, level: f64) -> Option<u32> {
        let windows = self.losses.windows(SMOOTHED_STEPS);
        let mut means = windows.map(|w| w.iter().map(|&loss| f64::from(loss)).sum::<f64>() / SMOOTHED_STEPS as f64);
        means.position(|mean| mean <= level).map(|start| (start + SMOOTHED_STEPS) as u32)
    }

    /// The loss averaged over the [`SMOOTHED_STEPS`] steps up to `step`, counted from 1.
    pub(crate) fn smoothed_loss(&self, step: usize) -> f64 {
        let end = step.min(self.losses.len());
        let from = end.saturating_sub(SMOOTHED_STEPS);
        self.losses[from..end].iter().map(|&loss| f64::from(loss)).sum::<f64>() / (end - from).max(1) as f64
    }
}

/// Charts of count and loss over the steps of seed 0.
pub(crate) fn curve_charts([counts, losses]: &[Vec<Series>; 2]) -> [Figure; 2] {
    let chart = |name: &str, title: &str, y: Axis, series: &Vec<Series>| Figure {
        name: name.to_owned(),
        title: title.to_owned(),
        x: Axis::linear("step"),
        y,
        marks: Marks::lines(series.clone()),
    };
    [
        chart("count", "Gaussians over steps, seed 0", Axis::linear("Gaussians"), counts),
        chart("loss", "Loss over steps, seed 0", Axis::logarithmic("loss (L1 + D-SSIM)"), losses),
    ]
}

/// Steps over which a noisy loss is averaged.
pub(crate) const SMOOTHED_STEPS: usize = 10;

pub(crate) fn seeds_in_words(seeds: u32) -> String {
    counted(seeds, "seed")
}

struct Record<'a> {
    losses: Vec<f32>,
    counts: Vec<u32>,
    watch: &'a mut dyn Watch,
}

impl Observer for Record<'_> {
    fn on_step(&mut self, progress: &Progress) -> Control {
        self.counts.push(progress.count);
        self.watch.on_step(progress);
        Control::Continue
    }

    fn on_losses(&mut self, _: u32, losses: &[f32]) {
        self.losses.extend(losses);
    }
}
