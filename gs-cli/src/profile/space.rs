//! What is profiled of scenes in space: the Gaussians as they are, from a camera, and what they are compared with.

use std::path::Path;

use gs_core::{Camera, Chart, Loss, Rasterizer, RenderSettings, SpatialScene};
use gs_io::{SpatialFile, read_spatial};
use gs_train::spatial::resized;

use crate::{
    cameras,
    failure::Failure,
    profile::{
        ProfileArgs,
        measure::Ready,
        subject::{Compared, check_is_not_fitted, compared},
    },
    values::Size,
};

/// A scene in space, before a backend has it.
pub(crate) struct SpatialSubject {
    /// Its file.
    pub(crate) name: String,
    scene: SpatialScene,
    camera: Camera,
    render: RenderSettings,
    loss: Loss,
    /// In which it is trained.
    pub(crate) chart: Chart,
    /// What it is compared with; none is its own rendering.
    target: Option<Compared>,
}

impl SpatialSubject {
    /// Reads what the flags name; without a camera the scene is seen whole, from a little above.
    ///
    /// # Errors
    /// Where a file cannot be read, there is no such view, or a flag does not go with scenes in space.
    pub(crate) fn load(path: &Path, args: &ProfileArgs) -> Result<Self, Failure> {
        let name = path.display().to_string();
        check_is_not_fitted(args, &name)?;
        let SpatialFile { scene, trained_with, .. } = read_spatial(path).map_err(Failure::of_scene)?;
        let (camera, mut render) = match &args.camera {
            Some(view) => {
                let dataset = args.reading.read(&view.dataset)?;
                let camera = cameras::of_view(&dataset, view)?;
                let sized = |Size { width, height }: Size| resized(&camera, width, height);
                (args.size.map_or(camera, sized), args.shown.settings_beside(&scene, trained_with, &dataset))
            }
            None => {
                let overview = cameras::overview(&cameras::bulk_of(&scene)?, args.size, cameras::UP);
                (overview.map_err(cameras::or_name_one)?, args.shown.settings(&scene, trained_with))
            }
        };
        camera.validate().map_err(|error| Failure::usage(error).at("--camera or --size"))?;
        args.shown.note_guess(trained_with);
        if let Some(blend) = args.blend {
            render.effects.blend = blend.into();
        }
        let size = (camera.width, camera.height);
        let target = args.image.as_deref().map(|image| compared(image, size)).transpose()?;
        let loss = args.loss.map_or(Loss::PAPER, Loss::from);
        let chart = args.chart.map_or(Chart::ScaleRotation, Chart::from);
        Ok(Self { name, scene, camera, render, loss, chart, target })
    }

    /// Renders what it is compared with, if no image is.
    ///
    /// # Errors
    /// Where the backend fails.
    pub(crate) fn prepare<R: Rasterizer<SpatialScene>>(self, rasterizer: &R) -> Result<Ready<SpatialScene>, Failure> {
        let Self { scene, camera, render, loss, chart, target, .. } = self;
        let target = match target {
            Some(target) => target,
            None => Compared::own(rasterizer.render(&scene, &camera, &render)?),
        };
        Ok(Ready { scene, view: camera, target, render, loss, chart, fitted_steps: None })
    }
}
