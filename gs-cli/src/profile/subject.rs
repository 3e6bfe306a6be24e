//! What is profiled: Gaussians on a canvas, from a scene or fitted to an image, and what they are compared with.

use std::path::Path;

use gs_core::{Canvas, Chart, Image, Loss, PlanarScene, Rasterizer, RenderSettings};
use gs_io::PlanarFile;
use gs_train::{FitSettings, Trainer};

use crate::{
    failure::Failure,
    fit::{arguments::SettingsArgs, settings, target::Target},
    output,
    profile::ProfileArgs,
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
    pub(crate) chart: Chart,
    source: Source,
    /// What it is compared with; none is its own rendering.
    target: Option<Compared>,
}

enum Source {
    Scene(PlanarScene),
    /// An image that Gaussians are fitted to first.
    Fit {
        image: Image,
        settings: Box<FitSettings>,
    },
}

/// An image, and its name for people.
struct Compared {
    image: Image,
    name: String,
}

/// The Gaussians and the image that they are compared with.
pub(crate) struct Ready {
    pub(crate) scene: PlanarScene,
    pub(crate) target: Image,
    /// The target's name for people.
    pub(crate) target_name: String,
    /// Steps in which they were fitted.
    pub(crate) fitted_steps: Option<u32>,
}

impl Subject {
    /// Reads what the flags name.
    ///
    /// # Errors
    /// Where a file cannot be read, or a flag does not go with what it holds.
    pub(crate) fn load(args: &ProfileArgs) -> Result<Self, Failure> {
        let Some(path) = &args.input else { return Self::of_image(None, args) };
        match gs_io::read_scene(path) {
            Ok(file) => Self::of_scene(path, file, args),
            // Whatever is called one is meant to be a scene.
            Err(error) if path.extension().is_some_and(|extension| extension == "safetensors") => Err(error.into()),
            Err(_) => Self::of_image(Some(path), args),
        }
    }

    fn of_scene(path: &Path, file: PlanarFile, args: &ProfileArgs) -> Result<Self, Failure> {
        let name = path.display().to_string();
        for (flag, given) in [("--gaussians", args.gaussians), ("--iterations", args.iterations)] {
            if given.is_some() {
                let message = format_args!("{flag} is for images, which are fitted first, but {name} is a scene");
                return Err(Failure::usage(message).mend("leave it out"));
            }
        }
        let canvas = canvas((file.width, file.height), args)?;
        let target = args.image.as_deref().map(|image| compared(image, canvas)).transpose()?;
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
            chart: args.chart.map_or(Chart::LocalFrame, Chart::from),
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
        if let Some(remark) = &image.remark {
            output::note(remark);
        }
        let flags = SettingsArgs {
            gaussians: args.gaussians,
            iterations: Some(args.iterations.unwrap_or(ITERATIONS)),
            loss: args.loss,
            blend: args.blend,
            chart: args.chart,
            ..SettingsArgs::default()
        };
        let settings = settings::resolve(&flags, &image)?;
        let canvas = canvas(image.image.size(), args)?;
        let name = image.name();
        let same_size = (canvas.width, canvas.height) == image.image.size();
        Ok(Self {
            file: image.file.as_ref().map(|file| file.display().to_string()),
            canvas,
            render: settings.render,
            loss: settings.loss,
            chart: settings.chart,
            target: same_size.then(|| Compared { image: image.image.clone(), name: name.clone() }),
            source: Source::Fit { image: image.image, settings: Box::new(settings) },
            name,
        })
    }

    /// Fits and renders what is not there yet.
    ///
    /// # Errors
    /// Where the fit diverges or the backend fails.
    pub(crate) fn prepare<R: Rasterizer<PlanarScene>>(&mut self, rasterizer: &R) -> Result<Ready, Failure> {
        let (scene, fitted_steps) = match &mut self.source {
            Source::Scene(scene) => (std::mem::take(scene), None),
            Source::Fit { image, settings } => {
                output::note(format_args!(
                    "fitting {} ({}x{} px) with at most {} Gaussians in {} steps first",
                    self.name,
                    image.width(),
                    image.height(),
                    settings.gaussians,
                    settings.iterations
                ));
                let mut trainer = Trainer::new(rasterizer, image, settings.as_ref().clone())?;
                trainer.run(&mut ())?;
                (trainer.scene()?, Some(settings.iterations))
            }
        };
        let (target, target_name) = match self.target.take() {
            Some(Compared { image, name }) => (image, name),
            None => {
                let rendering = rasterizer.render(&scene, &self.canvas, &self.render)?;
                (rendering, "its own rendering".to_owned())
            }
        };
        Ok(Ready { scene, target, target_name, fitted_steps })
    }
}

/// The whole of a plane of this size, in as many pixels or as the flag says.
fn canvas((width, height): (u32, u32), args: &ProfileArgs) -> Result<Canvas, Failure> {
    let whole = Canvas::new(width, height);
    let Some(size) = args.size else { return Ok(whole) };
    let canvas = whole.resized(size.width, size.height);
    canvas.validate().map_err(|error| Failure::usage(error).at("--size"))?;
    Ok(canvas)
}

/// An image to compare with, which must have the canvas' size.
fn compared(path: &Path, canvas: Canvas) -> Result<Compared, Failure> {
    let image = Target::load(Some(path), None)?.image;
    let name = path.display().to_string();
    if image.size() != (canvas.width, canvas.height) {
        let message = format!(
            "--image {name} is {}x{} px, but the canvas is {}x{} px",
            image.width(),
            image.height(),
            canvas.width,
            canvas.height
        );
        return Err(Failure::usage(message).mend(format_args!("give --size {}x{}", image.width(), image.height())));
    }
    Ok(Compared { image, name })
}
