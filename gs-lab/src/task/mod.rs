//! What differs between runs on images and runs on 3D scenes: settings, the trainer's beginning, and
//! how its end is measured. Everything else of a study is the same for both.

mod image;
mod scene;

pub(crate) use scene::PICTURED_VIEWS;

use gs_core::{
    Culled, Error as CoreError, Image, Optimizer, Parameterization, RenderSettings, Scene2d, Scene3d,
    effects::Statistics,
};
use gs_io::{Checkpoint, WorldFrame};
use gs_train::{Error as TrainError, FitSettings, ForeignPolicy, TrainSettings, Trainable, Trainer};
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    arm::{AnyPolicy, Arm},
    clock::Clock,
    record::ViewResult,
    study::Study,
    target::StudyTarget,
};

/// A backend that conducts studies of both kinds. All backends of this project do.
pub trait StudyBackend: Optimizer<Scene2d> + Optimizer<Scene3d> {}

impl<R: Optimizer<Scene2d> + Optimizer<Scene3d>> StudyBackend for R {}

/// What an arm asks for besides its settings.
pub(crate) struct Asked<'a> {
    pub(crate) study: &'a Study,
    pub(crate) arm: &'a Arm,
    pub(crate) budget: u32,
}

impl Asked<'_> {
    pub(crate) fn preset(&self) -> &str {
        self.arm.preset.as_ref().unwrap_or(&self.study.preset)
    }

    pub(crate) fn iterations(&self) -> Option<u32> {
        self.arm.iterations.or(self.study.iterations)
    }
}

/// A key of an arm whose value is not possible, and why.
#[derive(Debug)]
pub(crate) struct WrongKey {
    pub(crate) key: &'static str,
    pub(crate) message: String,
}

impl WrongKey {
    pub(crate) fn new(key: &'static str, message: impl ToString) -> Self {
        Self { key, message: message.to_string() }
    }
}

/// How a run ended, measured on its image or on its held-out views.
pub(crate) struct Measured {
    pub(crate) psnr: f64,
    pub(crate) ssim: f64,
    pub(crate) ms_ssim: Option<f64>,
    pub(crate) l1: f64,
    pub(crate) loss: Option<f32>,
    pub(crate) culled: Culled,
    /// Each held-out view; none for an image. Curves are added later.
    pub(crate) views: Vec<ViewResult>,
    /// The rendering of the image, or of the views that are shown.
    pub(crate) pictures: Vec<Image>,
    pub(crate) render: RenderSettings,
    /// The frame of a 3D scene.
    pub(crate) frame: WorldFrame,
}

/// The kind of scene of a run.
pub(crate) trait StudyTask: Trainable<Settings: Serialize + DeserializeOwned> {
    /// Whether this is the kind of scenes, for messages.
    const IS_3D: bool;

    /// The settings of an arm before its table of settings, without the seed.
    fn start_settings(asked: &Asked<'_>, target: &StudyTarget) -> Result<Self::Settings, WrongKey>;

    /// The settings with the seed, and with numbers that depend on others.
    fn completed(settings: Self::Settings, seed: u32) -> Self::Settings;

    /// The settings under which a diverging run fails, so that the study shows it.
    fn without_recovery(settings: &Self::Settings) -> Self::Settings;

    /// Begins a run, whose training time `clock` measures.
    fn begin<'r, R: Optimizer<Self>>(
        rasterizer: &'r R,
        target: &StudyTarget,
        arm: &Arm,
        settings: Self::Settings,
        clock: Clock,
    ) -> Result<Trainer<'r, R, Self>, TrainError>;

    /// Resumes a run from its checkpoint.
    fn resume<'r, R: Optimizer<Self>>(
        rasterizer: &'r R,
        target: &StudyTarget,
        checkpoint: Checkpoint,
    ) -> Result<Trainer<'r, R, Self>, TrainError>;

    /// Measures a finished run.
    fn measure<R: Optimizer<Self>>(trainer: &Trainer<'_, R, Self>) -> Result<Measured, TrainError>;

    /// Draws one Gaussian on one pixel, to find out what a backend supports.
    fn draw_one<R: Optimizer<Self>>(
        rasterizer: &R,
        render: &RenderSettings,
        parameterization: Parameterization,
    ) -> Result<(), CoreError>;

    /// The policy, where it is one for this kind of scene.
    fn own(policy: &AnyPolicy) -> Option<&ForeignPolicy<Self>>;

    /// Digest of the scene.
    fn digest(&self) -> String;

    /// Bytes of all parameters as 32-bit floats.
    fn bytes(&self) -> u64;

    /// The scene as one of either kind.
    fn wrapped(self) -> AnyScene;
}

/// A scene of either kind.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum AnyScene {
    /// The fit of an image.
    In2d(Scene2d),
    /// A trained scene.
    In3d(Scene3d),
}

/// The settings of a run.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum RunSettings {
    /// Those of the fit of an image.
    Image(Box<FitSettings>),
    /// Those of the training of a scene.
    Scene(Box<TrainSettings>),
}

/// Runs an expression on the settings of either kind.
macro_rules! of_either {
    ($settings:expr, $of:ident => $expression:expr) => {
        match $settings {
            RunSettings::Image($of) => $expression,
            RunSettings::Scene($of) => $expression,
        }
    };
}

impl RunSettings {
    /// The settings as the text of a TOML file, which `gs fit --settings` or `gs train --settings`
    /// reads.
    ///
    /// # Errors
    /// [`gs_train::Error::UnwritableSettings`] where TOML has no form for them.
    pub fn to_toml(&self) -> Result<String, TrainError> {
        of_either!(self, settings => settings.to_toml())
    }

    /// Largest number of Gaussians.
    pub fn gaussians(&self) -> u32 {
        of_either!(self, settings => settings.gaussians)
    }

    /// Number of steps.
    pub fn iterations(&self) -> u32 {
        of_either!(self, settings => settings.iterations)
    }

    /// Settings of renderings.
    pub fn render(&self) -> &RenderSettings {
        of_either!(self, settings => &settings.render)
    }

    /// Coordinates in which the optimizer moves.
    pub fn parameterization(&self) -> Parameterization {
        of_either!(self, settings => settings.parameterization)
    }

    /// The densification statistics that the policy needs.
    pub(crate) fn statistics(&self) -> Statistics {
        match self {
            Self::Image(settings) => gs_density::DensityPolicy::<Scene2d>::statistics(&settings.policy),
            Self::Scene(settings) => gs_density::DensityPolicy::<Scene3d>::statistics(&settings.policy),
        }
    }

    /// The settings of a fit; `None` for a training.
    pub fn of_image(&self) -> Option<&FitSettings> {
        match self {
            Self::Image(settings) => Some(settings),
            Self::Scene(_) => None,
        }
    }

    /// The settings of a training; `None` for a fit.
    pub fn of_scene(&self) -> Option<&TrainSettings> {
        match self {
            Self::Image(_) => None,
            Self::Scene(settings) => Some(settings),
        }
    }

    /// Draws one Gaussian on one pixel with other settings of rendering, to find out what a backend
    /// supports.
    pub(crate) fn draw_one<R: StudyBackend>(&self, rasterizer: &R, render: &RenderSettings) -> Result<(), CoreError> {
        match self {
            Self::Image(settings) => Scene2d::draw_one(rasterizer, render, settings.parameterization),
            Self::Scene(settings) => Scene3d::draw_one(rasterizer, render, settings.parameterization),
        }
    }
}

impl From<FitSettings> for RunSettings {
    fn from(settings: FitSettings) -> Self {
        Self::Image(settings.into())
    }
}

impl From<TrainSettings> for RunSettings {
    fn from(settings: TrainSettings) -> Self {
        Self::Scene(settings.into())
    }
}
