//! `gs profile` of a 2D scene, or of an image that is fitted first.

use std::path::Path;

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::{Canvas, Loss, Parameterization, Rasterizer as _, RenderSettings, Scene2d};
use gs_io::File2d;
use gs_train::FitSettings;

use super::{
    ProfileArgs,
    measure::{Subject, Target},
    report::SceneKind,
};
use crate::{
    failure::Failure,
    image_fit::{self, FitSettingsArgs, SettingsFile},
    values::canvas,
};

/// Steps to fit an image: enough that the Gaussians are as many, as large and as crowded as those
/// of a whole fit.
const ITERATIONS: u32 = 100;

/// What is profiled, before a backend has it.
pub(super) struct Input2d {
    pub(super) name: String,
    /// The file; `None` is the paper's circle and square.
    file: Option<String>,
    pub(super) canvas: Canvas,
    pub(super) render: RenderSettings,
    loss: Loss,
    parameterization: Parameterization,
    source: Source,
    /// `None` is the scene's own rendering.
    target: Option<Target>,
}

enum Source {
    Scene(Scene2d),
    /// An image to fit first.
    Fit {
        target: image_fit::Target,
        settings: Box<FitSettings>,
    },
}

impl Input2d {
    /// Takes a scene.
    pub(super) fn of_scene(path: &Path, file: File2d, args: &ProfileArgs) -> Result<Self, Failure> {
        check_is_2d(args)?;
        let name = path.display().to_string();
        check_is_not_fitted(args, &name)?;
        let canvas = canvas((file.width, file.height), args.size)?;
        let target =
            args.image.as_deref().map(|image| read_target(image, (canvas.width, canvas.height))).transpose()?;
        let mut render = file.settings;
        render.effects.blend = args.blend.unwrap_or(render.effects.blend);
        Ok(Self {
            name: name.clone(),
            file: Some(name),
            canvas,
            render,
            loss: args.loss.unwrap_or(Loss::L2),
            parameterization: args.parameterization.unwrap_or(Parameterization::CovarianceFactor),
            source: Source::Scene(file.scene),
            target,
        })
    }

    /// Reads an image, or takes the paper's.
    pub(super) fn of_image(path: Option<&Path>, args: &ProfileArgs) -> Result<Self, Failure> {
        check_is_2d(args)?;
        if args.image.is_some() {
            let message = "--image is the target of a scene, but there is no scene: an image is its own target";
            return Err(Failure::usage(message).hint("leave it out"));
        }
        let image = image_fit::Target::read_to_fit_first(path)?;
        let flags = FitSettingsArgs {
            gaussians: args.gaussians,
            iterations: Some(args.iterations.unwrap_or(ITERATIONS)),
            loss: args.loss,
            blend: args.blend,
            parameterization: args.parameterization,
            ..FitSettingsArgs::default()
        };
        let settings = image_fit::settings(&flags, &SettingsFile::None, &image)?;
        let canvas = canvas(image.image.size(), args.size)?;
        let same_size = (canvas.width, canvas.height) == image.image.size();
        Ok(Self {
            name: image.name(),
            file: image.file.as_ref().map(|file| file.display().to_string()),
            canvas,
            render: settings.render,
            loss: settings.loss,
            parameterization: settings.parameterization,
            target: same_size.then(|| Target { image: image.image.clone(), name: image.name() }),
            source: Source::Fit { target: image, settings: Box::new(settings) },
        })
    }

    /// Fits the image and renders the target, if necessary.
    pub(super) fn prepare(self, rasterizer: &AnyRasterizer) -> Result<Subject<Scene2d>, Failure> {
        let Self { name, file, canvas, render, loss, parameterization, source, target } = self;
        let (scene, fitted_steps) = match source {
            Source::Scene(scene) => (scene, None),
            Source::Fit { target, settings } => {
                let iterations = settings.iterations;
                (image_fit::fit_first(rasterizer, &target, *settings)?, Some(iterations))
            }
        };
        let target = match target {
            Some(target) => target,
            None => Target::own(rasterizer.render(&scene, &canvas, &render).block_on()?),
        };
        let (kind, input, view) = (SceneKind::TwoD, file, canvas);
        Ok(Subject { kind, input, name, scene, view, target, render, loss, parameterization, fitted_steps })
    }
}

/// Refuses flags for 3D scenes.
fn check_is_2d(args: &ProfileArgs) -> Result<(), Failure> {
    if args.render.is_some() || args.camera.is_some() {
        let message = "--camera, --background, --sh-degree, --order and --antialias are for 3D scenes";
        return Err(Failure::usage(message).hint("leave them out"));
    }
    Ok(())
}

/// Refuses flags for fitting an image.
pub(super) fn check_is_not_fitted(args: &ProfileArgs, name: &str) -> Result<(), Failure> {
    for (flag, given) in [("--gaussians", args.gaussians), ("--iterations", args.iterations)] {
        if given.is_some() {
            let message = format_args!("{flag} is for images, which are fitted first, but {name} is a scene");
            return Err(Failure::usage(message).hint("leave it out"));
        }
    }
    Ok(())
}

/// Reads the target of a scene, which must have the size of the canvas.
pub(super) fn read_target(path: &Path, (width, height): (u32, u32)) -> Result<Target, Failure> {
    let image = image_fit::Target::read(Some(path), None)?.image;
    let name = path.display().to_string();
    if image.size() != (width, height) {
        let size = format!("{}x{}", image.width(), image.height());
        let message = format_args!("--image {name} is {size} px, but the canvas is {width}x{height} px");
        return Err(Failure::usage(message).hint(format_args!("give --size {size}")));
    }
    Ok(Target { image, name })
}
