//! The cost and the gain of the corrections that only a training has: those of exposure and of poses.

use std::fmt;

use gs_backend::FutureExt as _;
use gs_core::{Optimizer, RenderSettings, Scene, Scene3d, counted};
use gs_density::Policy;
use gs_train::{
    TrainPreset, TrainSettings, Trainer3d,
    train::{Exposure, RefinePoses, Start, Views},
};
use serde::Serialize;

use crate::{
    error::Error,
    report::{Cell, Table},
};

/// The corrections of a training that views allow, and what each costs and gains.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrainingPrices {
    /// Steps of each training.
    pub(super) steps: u32,
    /// A price for each correction.
    pub(super) prices: Vec<TrainingPrice>,
}

/// The cost of an effect of a training, and what it gains on the held-out views.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct TrainingPrice {
    effect: TrainingEffect,
    /// The training with all effects.
    with: TrainingOutcome,
    /// The same training without this effect.
    without: TrainingOutcome,
}

gs_core::choices! {
    /// An effect of a training.
    pub(super) enum TrainingEffect {
        /// A colour map for each training view: [`Exposure::Affine`].
        Exposure = "exposure",
        /// Cameras that move along with the scene: [`RefinePoses::On`].
        Poses = "poses",
    }
}

/// Cost and quality of a short training.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct TrainingOutcome {
    /// Mean time of a step, ms.
    milliseconds: f64,
    /// Mean PSNR over the held-out views, dB.
    psnr: f64,
    /// The same with matched colours ([`gs_train::train::ColorMatched`]); `None` where no view allows
    /// that.
    color_matched: Option<f64>,
    /// The same at aligned poses ([`gs_train::train::PoseMatched`]); `None` where no training refines poses.
    pose_matched: Option<f64>,
}

impl TrainingEffect {
    /// Whether views allow this effect in so many steps: at least two views, or cameras of their own and
    /// enough steps for each.
    fn is_possible(self, views: &Views, steps: u32) -> bool {
        match self {
            Self::Exposure => views.train.len() > 1,
            Self::Poses => {
                let is_shared = views.train.iter().any(|view| view.source.is_face());
                !is_shared && steps >= RefinePoses::least_steps(views.train.len())
            }
        }
    }

    fn off(self, settings: &mut TrainSettings) {
        match self {
            Self::Exposure => settings.exposure = Exposure::Off,
            Self::Poses => settings.refine_poses = RefinePoses::Off,
        }
    }
}

/// Trains a scene for this many steps on views, with all effects of a training that the views allow,
/// and without each of them. The number of Gaussians stays. `render` draws the scene.
///
/// # Errors
/// Those of training and of reading an image.
pub fn training_prices<R: Optimizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    views: impl Fn() -> Views,
    render: &RenderSettings,
    steps: u32,
) -> Result<TrainingPrices, Error> {
    let first = views();
    let mut settings = TrainPreset::Quick.settings(Some(steps)).with(|s| {
        s.gaussians = scene.len() as u32;
        s.policy = Policy::None;
        s.render = *render;
        s.render.effects.sh_degree = scene.sh_degree;
        s.sh_degree_every = 0;
        s.exposure = Exposure::Affine;
        s.refine_poses = RefinePoses::On;
    });
    let mut effects = Vec::new();
    for effect in TrainingEffect::ALL {
        match effect.is_possible(&first, steps) {
            true => effects.push(effect),
            false => effect.off(&mut settings),
        }
    }
    if effects.is_empty() {
        return Ok(TrainingPrices { steps, prices: Vec::new() });
    }
    let trained = |settings: TrainSettings| -> Result<TrainingOutcome, Error> {
        let start = Start::Scene(scene.clone());
        let mut trainer = Trainer3d::from_views(on, views(), start, settings).block_on()?;
        let before = trainer.seconds();
        trainer.run(&mut ()).block_on()?;
        let milliseconds = 1e3 * (trainer.seconds() - before) / f64::from(steps.max(1));
        let evaluation = match effects.contains(&TrainingEffect::Poses) {
            true => trainer.evaluate_aligned(&|_, _, _| Ok(())).block_on()?,
            false => trainer.evaluate(&|_, _, _| Ok(())).block_on()?,
        };
        let color_matched = evaluation.color_matched.map(|matched| matched.psnr);
        let pose_matched = evaluation.pose_matched.map(|matched| matched.psnr);
        Ok(TrainingOutcome { milliseconds, psnr: evaluation.psnr, color_matched, pose_matched })
    };
    let with = trained(settings.clone())?;
    let price = |effect: TrainingEffect| {
        let mut settings = settings.clone();
        effect.off(&mut settings);
        Ok(TrainingPrice { effect, with, without: trained(settings)? })
    };
    Ok(TrainingPrices { steps, prices: effects.iter().copied().map(price).collect::<Result<_, Error>>()? })
}

impl TrainingPrices {
    /// A row for each effect, with it and without it.
    fn table(&self) -> Table {
        let row = |TrainingPrice { effect, with, without }: &TrainingPrice| {
            let both = |of: fn(&TrainingOutcome) -> Option<f64>| {
                [with, without].map(|outcome| of(outcome).map_or(Cell::Empty, |value| Cell::Fixed(value, 2)))
            };
            let cells = [
                both(|o| Some(o.milliseconds)),
                both(|o| Some(o.psnr)),
                both(|o| o.color_matched),
                both(|o| o.pose_matched),
            ];
            std::iter::once(effect.name().into()).chain(cells.into_iter().flatten()).collect()
        };
        let measured = ["a step, ms", "PSNR, dB", "colours matched, dB", "poses matched, dB"];
        let columns: Vec<&str> =
            std::iter::once("correction").chain(measured.into_iter().flat_map(|name| [name, "without"])).collect();
        Table::new("training", "", &columns, self.prices.iter().map(row).collect())
    }
}

/// The table with its title.
impl fmt::Display for TrainingPrices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let steps = counted(self.steps, "step");
        match self.prices.as_slice() {
            [] => write!(f, "training of {steps}: the views allow no correction to compare"),
            _ => write!(f, "training of {steps}, with and without each correction\n{}", self.table().text().trim_end()),
        }
    }
}
