//! What is measured: a scene, how it is shown, the views of the search, and others to verify what it finds.

use pollster::FutureExt as _;
use std::path::Path;

use glam::Vec2;
use gs_core::{Camera, Canvas, Effects, RenderSettings, Scene, Scene2d, Scene3d, counted, view::Orbit};
use gs_io::File2d;
use gs_lab::effects::sampled;
use gs_train::{Trainer, is_scene};

use crate::{
    backend::{Backend, Task},
    cameras,
    chosen::ChosenEffects,
    failure::Failure,
    fit::{
        arguments::SettingsArgs,
        settings::{self, Given},
        target::Target,
    },
    frontier::FrontierArgs,
    opened::{self, Opened3d},
    output,
    values::Size,
};

/// A scene of either kind.
pub(crate) enum Subject {
    TwoD(Seen<Scene2d>),
    ThreeD(Seen<Scene3d>),
}

/// A scene and its views.
pub(crate) struct Seen<S: Scene> {
    /// Its name for people.
    pub(crate) name: String,
    pub(crate) scene: S,
    /// How it is shown.
    pub(crate) shown: RenderSettings,
    /// Of the search, at least one, all of one size.
    pub(crate) views: Vec<S::View>,
    /// Others.
    pub(crate) unseen: Vec<S::View>,
    /// The effects that there are to choose for its kind.
    pub(crate) chooses: fn(&Effects) -> Option<ChosenEffects>,
}

impl Subject {
    /// Reads what the flags name; fits an image.
    ///
    /// # Errors
    /// Where a file cannot be read, a flag does not go with what it holds, or a fit fails.
    pub(crate) fn load(args: &FrontierArgs) -> Result<Self, Failure> {
        let path = &args.input;
        let scene_2d = match is_scene(path)?.then(|| opened::scene(path)).transpose()? {
            Some(opened::Scene::ThreeD(scene)) => return scene_3d(args, scene).map(Self::ThreeD),
            Some(opened::Scene::TwoD(file)) => Some(file),
            None => None,
        };
        if args.dataset.is_some() || args.up.is_some() || args.shown.is_some() {
            let message = "is an image or the scene of one, which has no data set, order or background to choose";
            return Err(Failure::usage(message).at(path.display()).mend("leave the flags for 3D scenes out"));
        }
        let (scene, shown, size) = match scene_2d {
            Some(File2d { scene, settings, width, height, .. }) => {
                if args.gaussians.is_some() {
                    let message = "--gaussians is for images, which are fitted first, but this is a scene";
                    return Err(Failure::usage(message).at(path.display()).mend("leave it out"));
                }
                (scene, settings, (width, height))
            }
            None => fitted(args)?,
        };
        let own = Canvas::new(size.0, size.1);
        let canvas = args.size.map_or(own, |Size { width, height }| own.resized(width, height));
        canvas.validate().map_err(|error| Failure::usage(error).at("--size"))?;
        Ok(Self::TwoD(Seen {
            name: name_of(path),
            scene,
            shown,
            views: vec![canvas],
            unseen: other_canvases(canvas),
            chooses: |_| None,
        }))
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// The same at half the size, and two parts of it at twice: another grid of pixels each time.
fn other_canvases(canvas: Canvas) -> Vec<Canvas> {
    let Canvas { width, height, origin, extent } = canvas;
    let part = |at: Vec2| canvas.showing(origin + at * extent, 0.5 * extent);
    let half = canvas.resized(width.div_ceil(2), height.div_ceil(2));
    vec![half, part(Vec2::splat(0.25)), part(Vec2::new(0.47, 0.03))]
}

/// Gaussians fitted to an image by the usual settings.
fn fitted(args: &FrontierArgs) -> Result<(Scene2d, RenderSettings, (u32, u32)), Failure> {
    let target = Target::load(Some(&args.input), None).map_err(|error| match error {
        gs_io::Error::NotAnImage { .. } => Failure::from(error).mend("or name a scene that a fit has written"),
        error => error.into(),
    })?;
    target.remarks.iter().for_each(output::note);
    let flags = SettingsArgs { gaussians: args.gaussians, ..SettingsArgs::default() };
    let fit = settings::resolve(&flags, &Given::Nothing, &target)?;
    output::note(format_args!(
        "fitting {} with at most {} in {} first",
        target.name(),
        counted(fit.gaussians, "Gaussian"),
        counted(fit.iterations, "step")
    ));
    let (shown, size) = (fit.render, target.image.size());
    let scene = Backend::start_for_image(&args.backend, &shown)?.run(Fit { target: &target, settings: fit })?;
    Ok((scene, shown, size))
}

struct Fit<'a> {
    target: &'a Target,
    settings: gs_train::FitSettings,
}

impl Task for Fit<'_> {
    type Output = Result<Scene2d, Failure>;

    fn run<R: gs_core::Optimizer<Scene2d>>(self, rasterizer: &R) -> Self::Output {
        let mut trainer = Trainer::new(rasterizer, &self.target.image, self.settings).block_on()?;
        trainer.run(&mut ()).block_on()?;
        Ok(trainer.scene().block_on()?)
    }
}

/// All effects of a 3D scene that have a choice.
fn chooses(&Effects { order, antialias, sh_degree, .. }: &Effects) -> Option<ChosenEffects> {
    Some(ChosenEffects { order, antialias, sh_degree })
}

fn scene_3d(args: &FrontierArgs, opened: Opened3d) -> Result<Seen<Scene3d>, Failure> {
    if args.gaussians.is_some() {
        let message = "--gaussians is for images, which are fitted first, but this is a scene";
        return Err(Failure::usage(message).at(args.input.display()).mend("leave it out"));
    }
    let scene = &opened.file.scene;
    let count = args.views as usize;
    let (all, shown): (Vec<Camera>, RenderSettings) = match &args.dataset {
        Some(path) => {
            let dataset = args.reading.read(path)?;
            let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
            let even = sampled(&cameras, 2 * count).into_iter();
            let sized =
                |camera: Camera| args.size.map_or(camera, |Size { width, height }| camera.resized(width, height));
            (even.map(sized).collect(), opened.settings(&args.shown, Some(&dataset)))
        }
        None => {
            let bulk = cameras::bulk_of(scene)?;
            let axis = args.up.map_or(cameras::UP, |axis| axis.0);
            let first = cameras::overview(&bulk, args.size, axis)?;
            let orbit = Orbit { center: bulk.center, axis, frames: 2 * args.views };
            (orbit.cameras(&first), opened.settings(&args.shown, None))
        }
    };
    for camera in &all {
        camera.validate().map_err(|error| Failure::usage(error).at("--dataset or --size"))?;
    }
    let every_second = |first: usize| all.iter().copied().skip(first).step_by(2).collect::<Vec<_>>();
    let (views, mut unseen) = (every_second(0), every_second(1));
    if views.is_empty() {
        return Err(Failure::failed("the data set has no view").mend("name another with --dataset"));
    }
    if unseen.is_empty() {
        // There is one view: its pixels at half the size are others.
        let Camera { width, height, .. } = views[0];
        unseen.push(views[0].resized(width.div_ceil(2), height.div_ceil(2)));
    }
    opened.note_guess(&args.shown);
    Ok(Seen { name: name_of(&args.input), scene: opened.file.scene, shown, views, unseen, chooses })
}
