//! What is profiled of images: Gaussians on a canvas, from a scene or fitted to an image, and what they are compared with.

use pollster::FutureExt as _;
use std::path::Path;

use gs_core::{Canvas, Image, Loss, Optimizer, Parameterization, RenderSettings, Scene2d, counted};
use gs_io::File2d;
use gs_train::{FitSettings, Trainer};

use crate::{
    failure::Failure,
    fit::{
        arguments::SettingsArgs,
        settings::{self, Given},
        target::Target,
    },
    output,
    profile::{ProfileArgs, measure::Ready},
    values::canvas,
};

/// Steps in which an image is fitted: enough that the Gaussians are as many, as large and as crowded as those of a whole fit.
const ITERATIONS: u32 = 100;

/// What is profiled, before a backend has it.
pub(crate) struct Subject {
    /// Its name for people.
    pub(crate) name: String,
    /// Its file; none is the paper's circle and square.
    pub(crate) file: Option<String>,
    pub(crate) canvas: Canvas,
    pub(crate) render: RenderSettings,
    pub(crate) loss: Loss,
    pub(crate) parameterization: Parameterization,
    source: Source,
    /// What it is compared with; none is its own rendering.
    target: Option<Compared>,
}

enum Source {
    Scene(Scene2d),
    /// An image that Gaussians are fitted to first.
    Fit {
        image: Image,
        settings: Box<FitSettings>,
    },
}

/// An image, and its name for people.
pub(super) struct Compared {
    pub(super) image: Image,
    pub(super) name: String,
}

impl Subject {
    /// Takes the scene of the input, or reads the image that it is.
    ///
    /// # Errors
    /// Where a file cannot be read, or a flag does not go with what it holds.
    pub(crate) fn load(scene: Option<File2d>, args: &ProfileArgs) -> Result<Self, Failure> {
        if args.shown.is_some() || args.camera.is_some() {
            let message = "--camera, --background, --sh-degree, --order and --antialias are for 3D scenes";
            return Err(Failure::usage(message).mend("leave them out"));
        }
        let Some(path) = &args.input else { return Self::of_image(None, args) };
        match scene {
            Some(file) => Self::of_scene(path, file, args),
            None => Self::of_image(Some(path), args),
        }
    }

    fn of_scene(path: &Path, file: File2d, args: &ProfileArgs) -> Result<Self, Failure> {
        let name = path.display().to_string();
        check_is_not_fitted(args, &name)?;
        let canvas = canvas((file.width, file.height), args.size)?;
        let target = args.image.as_deref().map(|image| compared(image, (canvas.width, canvas.height))).transpose()?;
        let mut render = file.settings;
        if let Some(blend) = args.blend {
            render.effects.blend = blend.into();
        }
        Ok(Self {
            name: name.clone(),
            file: Some(name),
            canvas,
            render,
            loss: args.loss.map_or(Loss::L2, Loss::from),
            parameterization: args.parameterization.map_or(Parameterization::CovarianceFactor, Parameterization::from),
            source: Source::Scene(file.scene),
            target,
        })
    }

    fn of_image(path: Option<&Path>, args: &ProfileArgs) -> Result<Self, Failure> {
        if args.image.is_some() {
            let message =
                "--image is what a scene is compared with, but there is no scene: an image is compared with itself";
            return Err(Failure::usage(message).mend("leave it out"));
        }
        let image = Target::load(path, None).map_err(|error| match error {
            gs_io::Error::NotAnImage { .. } => Failure::from(error).mend("or name a scene that a fit has written"),
            error => error.into(),
        })?;
        image.remarks.iter().for_each(output::note);
        let flags = SettingsArgs {
            gaussians: args.gaussians,
            iterations: Some(args.iterations.unwrap_or(ITERATIONS)),
            loss: args.loss,
            blend: args.blend,
            parameterization: args.parameterization,
            ..SettingsArgs::default()
        };
        let settings = settings::resolve(&flags, &Given::Nothing, &image)?;
        let canvas = canvas(image.image.size(), args.size)?;
        let name = image.name();
        let same_size = (canvas.width, canvas.height) == image.image.size();
        Ok(Self {
            file: image.file.as_ref().map(|file| file.display().to_string()),
            canvas,
            render: settings.render,
            loss: settings.loss,
            parameterization: settings.parameterization,
            target: same_size.then(|| Compared { image: image.image.clone(), name: name.clone() }),
            source: Source::Fit { image: image.image, settings: Box::new(settings) },
            name,
        })
    }

    /// Fits and renders what is not there yet.
    ///
    /// # Errors
    /// Where the fit diverges or the backend fails.
    pub(crate) fn prepare<R: Optimizer<Scene2d>>(self, rasterizer: &R) -> Result<Ready<Scene2d>, Failure> {
        let Self { name, canvas, render, loss, parameterization, source, target, .. } = self;
        let (scene, fitted_steps) = match source {
            Source::Scene(scene) => (scene, None),
            Source::Fit { image, settings } => {
                output::note(format_args!(
                    "fitting {} ({}x{} px) with at most {} in {} first",
                    name,
                    image.width(),
                    image.height(),
                    counted(settings.gaussians, "Gaussian"),
                    counted(settings.iterations, "step")
                ));
                let iterations = settings.iterations;
                let mut trainer = Trainer::new(rasterizer, &image, *settings).block_on()?;
                trainer.run(&mut ()).block_on()?;
                (trainer.scene().block_on()?, Some(iterations))
            }
        };
        let target = match target {
            Some(target) => target,
            None => Compared::own(rasterizer.render(&scene, &canvas, &render).block_on()?),
        };
        Ok(Ready { scene, view: canvas, target, render, loss, parameterization, fitted_steps })
    }
}

impl Compared {
    /// What a scene is compared with where no image is named.
    pub(super) fn own(rendering: Image) -> Self {
        Self { image: rendering, name: "its own rendering".to_owned() }
    }
}

/// Refuses flags that say how an image is fitted, for a scene.
pub(super) fn check_is_not_fitted(args: &ProfileArgs, name: &str) -> Result<(), Failure> {
    for (flag, given) in [("--gaussians", args.gaussians), ("--iterations", args.iterations)] {
        if given.is_some() {
            let message = format_args!("{flag} is for images, which are fitted first, but {name} is a scene");
            return Err(Failure::usage(message).mend("leave it out"));
        }
    }
    Ok(())
}

/// An image to compare with, which must have the size of what is rendered.
pub(super) fn compared(path: &Path, (width, height): (u32, u32)) -> Result<Compared, Failure> {
    let image = Target::load(Some(path), None)?.image;
    let name = path.display().to_string();
    if image.size() != (width, height) {
        let message = format!(
            "--image {name} is {}x{} px, but the canvas is {width}x{height} px",
            image.width(),
            image.height(),
        );
        return Err(Failure::usage(message).mend(format_args!("give --size {}x{}", image.width(), image.height())));
    }
    Ok(Compared { image, name })
}
