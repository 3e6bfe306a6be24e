//! `gs profile` of a 3D scene.

use std::path::Path;

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::{Camera, Loss, Parameterization, Rasterizer as _, RenderSettings, Scene3d};
use gs_io::File3d;

use super::{
    ProfileArgs,
    measure::{Subject, Target},
    report::SceneKind,
    scene2d::{check_is_not_fitted, read_target},
};
use crate::{
    cameras::{self, Home},
    failure::Failure,
    values::Size,
};

/// A 3D scene, before a backend has it.
pub(super) struct Input3d {
    /// The file.
    pub(super) name: String,
    scene: Scene3d,
    pub(super) camera: Camera,
    render: RenderSettings,
    loss: Loss,
    pub(super) parameterization: Parameterization,
    /// `None` is the scene's own rendering.
    target: Option<Target>,
}

impl Input3d {
    /// Takes a scene, seen from the view that the flags name or from the default camera.
    pub(super) fn of_scene(path: &Path, file: File3d, args: &ProfileArgs) -> Result<Self, Failure> {
        let name = path.display().to_string();
        check_is_not_fitted(args, &name)?;
        let (camera, mut render) = match &args.camera {
            Some(view) => {
                let dataset = args.reading.read_for(&file, &view.dataset)?;
                let camera = cameras::of_view(&dataset, view)?;
                let sized = |Size { width, height }: Size| camera.resized(width, height);
                (args.size.map_or(camera, sized), args.render.settings(&file, Some(&dataset)))
            }
            None => (Home::of(&file, args.size, None)?.camera, args.render.settings(&file, None)),
        };
        camera.validate().map_err(|error| Failure::usage(error).at("--camera or --size"))?;
        args.render.note_guess(&file);
        render.effects.blend = args.blend.unwrap_or(render.effects.blend);
        let target =
            args.image.as_deref().map(|image| read_target(image, (camera.width, camera.height))).transpose()?;
        let loss = args.loss.unwrap_or(Loss::PAPER);
        let parameterization = args.parameterization.unwrap_or_default();
        parameterization.check_3d()?;
        Ok(Self { name, scene: file.scene, camera, render, loss, parameterization, target })
    }

    /// Renders the target, if necessary.
    pub(super) fn prepare(self, rasterizer: &AnyRasterizer) -> Result<Subject<Scene3d>, Failure> {
        let Self { name, scene, camera, render, loss, parameterization, target } = self;
        let target = match target {
            Some(target) => target,
            None => Target::own(rasterizer.render(&scene, &camera, &render).block_on()?),
        };
        let (kind, input, view, fitted_steps) = (SceneKind::ThreeD, Some(name.clone()), camera, None);
        Ok(Subject { kind, input, name, scene, view, target, render, loss, parameterization, fitted_steps })
    }
}
