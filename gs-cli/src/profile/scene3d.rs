//! What is profiled of 3D scenes: the Gaussians as they are, from a camera, and what they are compared with.

use pollster::FutureExt as _;
use std::path::Path;

use gs_core::{Camera, Loss, Optimizer, Parameterization, RenderSettings, Scene3d};

use crate::{
    cameras::{self, Home},
    failure::Failure,
    opened::Opened3d,
    profile::{
        ProfileArgs,
        measure::Ready,
        subject::{Compared, check_is_not_fitted, compared},
    },
    values::Size,
};

/// A 3D scene, before a backend has it.
pub(crate) struct Subject3d {
    /// Its file.
    pub(crate) name: String,
    scene: Scene3d,
    camera: Camera,
    render: RenderSettings,
    loss: Loss,
    /// In which it is trained.
    pub(crate) parameterization: Parameterization,
    /// What it is compared with; none is its own rendering.
    target: Option<Compared>,
}

impl Subject3d {
    /// Takes a scene and the view that the flags name; without one, a flat scene is seen from its front, any other from a little above.
    ///
    /// # Errors
    /// Where a data set cannot be read, there is no such view, or a flag does not go with 3D scenes.
    pub(crate) fn load(path: &Path, opened: Opened3d, args: &ProfileArgs) -> Result<Self, Failure> {
        let name = path.display().to_string();
        check_is_not_fitted(args, &name)?;
        let (camera, mut render) = match &args.camera {
            Some(view) => {
                let dataset = args.reading.read(&view.dataset)?;
                let camera = cameras::of_view(&dataset, view)?;
                let sized = |Size { width, height }: Size| camera.resized(width, height);
                (args.size.map_or(camera, sized), opened.settings(&args.shown, Some(&dataset)))
            }
            None => {
                let home = Home::of(&opened.file, args.size, None)?;
                (home.camera, opened.settings(&args.shown, None))
            }
        };
        camera.validate().map_err(|error| Failure::usage(error).at("--camera or --size"))?;
        opened.note_guess(&args.shown);
        if let Some(blend) = args.blend {
            render.effects.blend = blend.into();
        }
        let size = (camera.width, camera.height);
        let target = args.image.as_deref().map(|image| compared(image, size)).transpose()?;
        let loss = args.loss.map_or(Loss::PAPER, Loss::from);
        let parameterization = args.parameterization.map_or(Parameterization::ScaleRotation, Parameterization::from);
        Ok(Self { name, scene: opened.file.scene, camera, render, loss, parameterization, target })
    }

    /// Renders what it is compared with, if no image is.
    ///
    /// # Errors
    /// Where the backend fails.
    pub(crate) fn prepare<R: Optimizer<Scene3d>>(self, rasterizer: &R) -> Result<Ready<Scene3d>, Failure> {
        let Self { scene, camera, render, loss, parameterization, target, .. } = self;
        let target = match target {
            Some(target) => target,
            None => Compared::own(rasterizer.render(&scene, &camera, &render).block_on()?),
        };
        Ok(Ready { scene, view: camera, target, render, loss, parameterization, fitted_steps: None })
    }
}
