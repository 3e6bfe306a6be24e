//! What is measured: a scene, its render settings, the views of the search, and others to verify
//! its results.

use std::path::Path;

use gs_core::{Camera, Canvas, Effects, RenderSettings, Scene, Scene2d, Scene3d, view::Orbit};
use gs_io::{AnyScene, File2d, File3d};
use gs_lab::price::{
    effects::sampled,
    frontier::{FrontierEffects, unseen_cameras, unseen_canvases},
};

use super::FrontierArgs;
use crate::{
    cameras,
    failure::Failure,
    image_fit::{self, FitSettingsArgs, SettingsFile, Target},
    scene,
    values::Size,
};

/// A scene of either kind.
pub(crate) enum Subject {
    TwoD(Seen<Scene2d>),
    ThreeD(Seen<Scene3d>),
}

/// A scene and its views.
pub(crate) struct Seen<S: Scene> {
    /// The name for messages.
    pub(crate) name: String,
    pub(crate) scene: S,
    pub(crate) render: RenderSettings,
    /// The views of the search, at least one, all of one size.
    pub(crate) views: Vec<S::View>,
    /// Views that the search does not use, to verify its results.
    pub(crate) unseen: Vec<S::View>,
    /// The effects that can be chosen for this kind of scene.
    pub(crate) effects: fn(&Effects) -> Option<FrontierEffects>,
}

impl Subject {
    /// Reads the input; fits an image.
    pub(crate) fn load(args: &FrontierArgs) -> Result<Self, Failure> {
        let path = &args.input;
        let scene_2d = match scene::read_if_any(path)? {
            Some(AnyScene::ThreeD(file)) => return scene_3d(args, *file).map(Self::ThreeD),
            Some(AnyScene::TwoD(file)) => Some(*file),
            None => None,
        };
        if args.dataset.is_some() || args.up.is_some() || args.render.is_some() {
            let message = "is an image or a 2D scene, which has no data set, order or background to choose";
            return Err(Failure::usage(message).at(path.display()).hint("leave out the flags for 3D scenes"));
        }
        let (scene, render, size) = match scene_2d {
            Some(File2d { scene, settings, width, height, .. }) => {
                if args.gaussians.is_some() {
                    let message = "--gaussians is for images, which are fitted first, but this is a scene";
                    return Err(Failure::usage(message).at(path.display()).hint("leave it out"));
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
            render,
            views: vec![canvas],
            unseen: unseen_canvases(canvas),
            effects: |_| None,
        }))
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// Gaussians fitted to the image with default settings.
fn fitted(args: &FrontierArgs) -> Result<(Scene2d, RenderSettings, (u32, u32)), Failure> {
    let target = Target::read_to_fit_first(Some(&args.input))?;
    let flags = FitSettingsArgs { gaussians: args.gaussians, ..FitSettingsArgs::default() };
    let settings = image_fit::settings(&flags, &SettingsFile::None, &target)?;
    let (render, size) = (settings.render, target.image.size());
    let backend = args.backend.open_to_render_2d(&render)?;
    Ok((image_fit::fit_first(&backend.rasterizer, &target, settings)?, render, size))
}

fn scene_3d(args: &FrontierArgs, file: File3d) -> Result<Seen<Scene3d>, Failure> {
    if args.gaussians.is_some() {
        let message = "--gaussians is for images, which are fitted first, but this is a scene";
        return Err(Failure::usage(message).at(args.input.display()).hint("leave it out"));
    }
    let count = args.views as usize;
    let (all, render): (Vec<Camera>, RenderSettings) = match &args.dataset {
        Some(path) => {
            let dataset = args.reading.read_for(&file, path)?;
            let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
            let even = sampled(&cameras, 2 * count).into_iter();
            let sized =
                |camera: Camera| args.size.map_or(camera, |Size { width, height }| camera.resized(width, height));
            (even.map(sized).collect(), args.render.settings(&file, Some(&dataset)))
        }
        None => {
            let bulk = cameras::bulk_of(&file.scene)?;
            let axis = args.up.map_or(cameras::UP, |axis| axis.0);
            let first = cameras::overview(&bulk, args.size, axis)?;
            let orbit = Orbit { center: bulk.center, axis, frames: 2 * args.views };
            (orbit.cameras(&first), args.render.settings(&file, None))
        }
    };
    for camera in &all {
        camera.validate().map_err(|error| Failure::usage(error).at("--dataset or --size"))?;
    }
    let (views, unseen) = unseen_cameras(&all);
    if views.is_empty() {
        return Err(Failure::failed("the data set has no view").hint("name another with --dataset"));
    }
    args.render.note_guess(&file);
    Ok(Seen {
        name: name_of(&args.input),
        scene: file.scene,
        render,
        views,
        unseen,
        effects: |effects| Some(FrontierEffects::of(effects)),
    })
}
