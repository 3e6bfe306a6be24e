//! Where experiments are made: fits on one backend before the eyes of whoever waits for them, with every loss and count kept.

use gs_core::{Canvas, Image, Optimizer, RenderSettings, Scene2d, counted};
use pollster::FutureExt as _;

use super::findings::Picture;
use gs_train::{Control, Error, Fit, FitSettings, FitSummary, Observer, Progress, Recovery, Trainer};

/// How much is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Extent {
    /// Several seeds and all cases.
    #[default]
    Full,
    /// One or two seeds and the cases that decide, in less than half a minute.
    Quick,
}

impl Extent {
    /// The one or the other.
    pub(crate) fn choose<T>(self, full: T, quick: T) -> T {
        match self {
            Self::Full => full,
            Self::Quick => quick,
        }
    }

    /// So many seeds, from 0.
    pub(crate) fn seeds(self, full: u32, quick: u32) -> std::ops::Range<u32> {
        0..self.choose(full, quick)
    }
}

/// Someone who waits for the experiments. `()` does not mind.
pub trait Watch {
    /// A fit begins, or a flight around a scene.
    fn on_fit(&mut self, label: &str) {
        let _ = label;
    }

    /// A step of it is done.
    fn on_step(&mut self, progress: &Progress) {
        let _ = progress;
    }
}

impl Watch for () {}

/// A backend to experiment with.
pub struct Laboratory<'a, R> {
    rasterizer: &'a R,
    extent: Extent,
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
    pub fn new(rasterizer: &'a R, extent: Extent, watch: &'a mut dyn Watch) -> Self {
        Self { rasterizer, extent, watch }
    }

    /// How much is to be measured.
    pub fn extent(&self) -> Extent {
        self.extent
    }

    /// The backend.
    pub(crate) fn rasterizer(&self) -> &'a R {
        self.rasterizer
    }

    /// Who waits.
    pub(crate) fn watch(&mut self) -> &mut dyn Watch {
        self.watch
    }
}

impl<R: Optimizer<Scene2d>> Laboratory<'_, R> {
    /// A fit from its settings, but one that fails is left alone: failures are what is looked at.
    pub(crate) fn fit(&mut self, label: &str, target: &Image, settings: FitSettings) -> Result<Run, Error> {
        let settings = FitSettings { recovery: Recovery::Never, ..settings };
        let mut trainer = Trainer::new(self.rasterizer, target, settings).block_on()?;
        self.watch.on_fit(label);
        let mut record = Record { losses: Vec::new(), counts: Vec::new(), watch: self.watch };
        let outcome = trainer.run(&mut record).block_on()?;
        let Record { losses, counts, .. } = record;
        let (image, culled) = trainer.render().block_on()?;
        let summary = FitSummary::new(&trainer, &image, culled).block_on()?;
        Ok(Run { fit: Fit { scene: trainer.scene().block_on()?, image, summary, outcome }, losses, counts })
    }

    /// A picture of a scene made for a square of `side` px, enlarged to about 512 px, with its Gaussians drawn in it.
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
    /// The image the scene was made for: (columns, rows).
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
    /// PSNR at the end, dB: of the picture as it is written in 8 bits, against the target in floats.
    pub(crate) fn psnr(&self) -> f64 {
        self.fit.summary.psnr
    }

    /// Gaussians at the end.
    pub(crate) fn count(&self) -> u32 {
        self.fit.summary.gaussians
    }

    /// The last loss.
    pub(crate) fn last_loss(&self) -> f64 {
        self.losses.last().map_or(f64::NAN, |&loss| loss.into())
    }

    /// Count over steps, as stairs: the points at which it changes, before and after, and the ends.
    pub(crate) fn count_curve(&self) -> Vec<(f64, f64)> {
        let numbered = (1..).zip(&self.counts).map(|(step, &count)| (f64::from(step), f64::from(count)));
        let points: Vec<(f64, f64)> = numbered.collect();
        let changes = points.windows(2).filter(|pair| pair[0].1 != pair[1].1);
        let stairs = changes.flat_map(|pair| [(pair[1].0, pair[0].1), pair[1]]);
        points.first().copied().into_iter().chain(stairs).chain(points.last().copied()).collect()
    }

    /// Loss over steps, thinned to every tenth.
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

/// Steps over which a loss is averaged where its noise would decide.
pub(crate) const SMOOTHED_STEPS: usize = 10;

/// "1 seed", "3 seeds".
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
