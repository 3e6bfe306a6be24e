//! What differs between runs on images and runs on 3D scenes: the trainer's beginning, and how its
//! end is measured. Together with their settings, that is all that differs.

mod image;
mod scene;
mod shapes;
mod start;

pub(crate) use scene::PICTURED_VIEWS;

use gs_core::{Error as CoreError, Image, Optimizer, RenderSettings, Scene2d, Scene3d};
use gs_io::Checkpoint;
use gs_train::{Error as TrainError, Trainer};

use super::record::Finished;
use crate::study::{Arm, ArmSettings, Clock, Column, Measure, Planned, StudyTarget};

/// A backend that conducts studies of both kinds. All backends of this project do.
pub(crate) trait StudyBackend: Optimizer<Scene2d> + Optimizer<Scene3d> {}

impl<R: Optimizer<Scene2d> + Optimizer<Scene3d>> StudyBackend for R {}

/// The kind of scene of a run, as far as doing the run needs it.
pub(crate) trait StudyTask: Planned {
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

    /// Resumes a run of an arm with a seed from its checkpoint.
    fn resume<'r, R: Optimizer<Self>>(
        rasterizer: &'r R,
        target: &StudyTarget,
        of: (&Arm, u32),
        checkpoint: Checkpoint,
    ) -> Result<Trainer<'r, R, Self>, TrainError>;

    /// Measures a finished run: sets the quality, the loss, what was culled, and held-out views, whose curves
    /// are added later. Returns the rendering of the image, or of the views that are shown. `align_poses` is
    /// the study's.
    fn measure<R: Optimizer<Self>>(
        trainer: &Trainer<'_, R, Self>,
        align_poses: bool,
        finished: &mut Finished,
    ) -> Result<Vec<Image>, TrainError>;

    /// What a study measures of a finished run besides the usual; `scene` is its end.
    fn further<R: Optimizer<Self>>(
        measure: Measure,
        rasterizer: &R,
        target: &StudyTarget,
        settings: &Self::Settings,
        scene: &Self,
    ) -> Result<Vec<(Column, f64)>, TrainError>;

    /// Draws one Gaussian on one pixel, to find out what a backend supports.
    fn draw_one<R: Optimizer<Self>>(rasterizer: &R, render: &RenderSettings) -> Result<(), CoreError>;

    /// Digest of the scene.
    fn digest(&self) -> String;

    /// Bytes of all parameters as 32-bit floats.
    fn bytes(&self) -> u64;
}

impl ArmSettings {
    /// Draws one Gaussian on one pixel with other settings of rendering, to find out what a backend
    /// supports.
    pub(crate) fn draw_one<R: StudyBackend>(&self, rasterizer: &R, render: &RenderSettings) -> Result<(), CoreError> {
        match self {
            Self::Image(_) => Scene2d::draw_one(rasterizer, render),
            Self::Scene(_) => Scene3d::draw_one(rasterizer, render),
        }
    }
}
