//! The commands that say what rendering and training cost. All of them choose a subject with the same
//! flags, ask [`gs_lab::price`], and print its table.

pub(crate) mod effects;
pub(crate) mod frontier;
pub(crate) mod popping;
pub(crate) mod profile;

use std::path::{Path, PathBuf};

use clap::Args;
use glam::Vec3;
use gs_backend::Chosen;
use gs_core::{Camera, Canvas, RenderSettings, Scene, Scene2d, Scene3d, counted, view::Orbit};
use gs_io::{AnyScene, File3d, dataset::Dataset};
use gs_train::train::Views;
use serde::Serialize;

use crate::{
    failure::Failure,
    files::scene,
    flags::{
        backend::BackendArgs,
        cameras::{Home, sampled},
        dataset::ReadingArgs,
        render_args::RenderArgs3d,
        values::{Size, ViewName, axis, canvas},
    },
    memory,
};

/// The flags of all these commands.
#[derive(Debug, Clone, Args)]
pub(crate) struct SeenArgs {
    /// Size of the pictures [default: that of the image, the scene or the view; otherwise 800x600]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Up direction, around which cameras are placed: x, y, z, -x, -y or -z [default: -y]
    #[arg(long, value_name = "AXIS", value_parser = axis, allow_hyphen_values = true)]
    up: Option<Vec3>,
    #[command(flatten)]
    render: RenderArgs3d,
    #[command(flatten)]
    backend: BackendArgs,
}

/// The flags of the commands that take a scene of any kind.
#[derive(Debug, Clone, Args)]
pub(crate) struct SubjectArgs {
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    seen: SeenArgs,
}

/// The views of a 3D scene.
#[derive(Debug, Clone, Copy)]
enum Cameras<'a> {
    /// The test views of a data set, or all of them if none is held out, but at most so many.
    Dataset(&'a Path, u32),
    /// A view of a data set.
    View(&'a ViewName),
    /// So many cameras around it.
    Around(u32),
}

/// What is measured, as reports name it.
#[derive(Debug, Clone, Serialize)]
struct Facts {
    /// The file.
    input: PathBuf,
    gaussians: usize,
    /// The views.
    seen: String,
    width: u32,
    height: u32,
    /// The backend, where there is only one.
    #[serde(flatten)]
    backend: Option<BackendFacts>,
}

/// A backend, as reports name it.
#[derive(Debug, Clone, Serialize)]
struct BackendFacts {
    backend: &'static str,
    adapter: Option<String>,
    threads: usize,
    simd: Option<String>,
    /// The backend, and why it is this one.
    reason: String,
}

impl Facts {
    /// The facts in a line, and the backend in another.
    fn text(&self) -> String {
        let Self { input, gaussians, seen, width, height, .. } = self;
        let name = input.file_name().map_or_else(|| input.to_string_lossy(), |name| name.to_string_lossy());
        let reason = self.backend.as_ref().map_or_else(String::new, |backend| format!("\n{}", backend.reason));
        format!("{name}: {}, seen from {seen}, {width}x{height} px{reason}", counted(*gaussians, "Gaussian"))
    }
}

/// A scene with views of it, at least one.
enum Seen {
    TwoD(Scene2d, [Canvas; 1]),
    ThreeD(Scene3d, Vec<Camera>, Option<Dataset>),
}

/// What is measured.
struct Subject {
    seen: Seen,
    render: RenderSettings,
    facts: Facts,
}

impl Subject {
    /// Reads a scene.
    fn load(input: &Path, args: &SubjectArgs, cameras: Cameras<'_>) -> Result<Self, Failure> {
        let facts = |seen: &str, (width, height), gaussians| Facts {
            input: input.to_owned(),
            gaussians,
            seen: seen.to_owned(),
            width,
            height,
            backend: None,
        };
        match scene::read_any(input)? {
            AnyScene::ThreeD(file) => {
                let (views, dataset, seen) = of_3d(&file, args, cameras)?;
                args.seen.render.note_guess(&file);
                let render = args.seen.render.settings(&file, dataset.as_ref());
                let facts = facts(&seen, (views[0].width, views[0].height), file.scene.len());
                Ok(Self { seen: Seen::ThreeD(file.scene, views, dataset), render, facts })
            }
            AnyScene::TwoD(_)
                if !matches!(cameras, Cameras::Around(_)) || args.seen.up.is_some() || args.seen.render.is_some() =>
            {
                let message = "is not a 3D scene; only those have cameras, an order and a background to choose";
                Err(Failure::usage(message).at(input.display()).hint("leave out the flags for 3D scenes"))
            }
            AnyScene::TwoD(file) => {
                let canvas = canvas((file.width, file.height), args.seen.size)?;
                let facts = facts("its canvas", (canvas.width, canvas.height), file.scene.len());
                Ok(Self { seen: Seen::TwoD(file.scene, [canvas]), render: file.settings, facts })
            }
        }
    }

    /// Fails where measuring pictures of this subject takes too much memory; `bytes` are for their size.
    fn check_work(&self, work: &str, bytes: impl Fn((u32, u32)) -> u64) -> Result<(), Failure> {
        let Facts { input, width, height, .. } = &self.facts;
        memory::check_work(work, input.display(), (*width, *height), bytes((*width, *height)))
    }

    /// Opens the backend for this subject.
    fn open(&mut self, args: &SubjectArgs) -> Result<Chosen, Failure> {
        let flags = &args.seen.backend;
        let chosen = match self.seen {
            Seen::TwoD(..) => flags.open_to_render_2d(&self.render)?,
            Seen::ThreeD(..) => flags.open()?,
        };
        self.facts.backend = Some(BackendFacts {
            backend: chosen.rasterizer.name(),
            adapter: chosen.rasterizer.adapter().map(str::to_owned),
            threads: chosen.threads,
            simd: chosen.rasterizer.simd_level(),
            reason: chosen.reason.clone(),
        });
        Ok(chosen)
    }
}

/// The cameras of a 3D scene, their data set, and what they are.
fn of_3d(
    file: &File3d,
    args: &SubjectArgs,
    cameras: Cameras<'_>,
) -> Result<(Vec<Camera>, Option<Dataset>, String), Failure> {
    let size = args.seen.size;
    let (all, dataset, seen) = match cameras {
        Cameras::Around(count) => {
            let (orbit, first) = around(file, &args.seen, count)?;
            (orbit.cameras(&first), None, format!("{} around it", counted(count, "camera")))
        }
        Cameras::View(name) => {
            let (home, dataset) = Home::named(Some(name), &args.reading, file, size, None)?;
            (vec![home.camera], dataset, format!("view {} of {}", name.view, name.dataset.display()))
        }
        Cameras::Dataset(path, most) => {
            let dataset = args.reading.read_for(file, path)?;
            let views = Views::of_dataset(&dataset);
            let which = if views.test.is_empty() { "view" } else { "test view" };
            let all: Vec<Camera> = views.test_or_train().iter().map(|view| view.camera).collect();
            let sized = |camera: Camera| size.map_or(camera, |Size { width, height }| camera.resized(width, height));
            let cameras: Vec<Camera> = sampled(&all, most as usize).into_iter().map(sized).collect();
            let seen = format!("{} of {} of {}", cameras.len(), counted(all.len(), which), path.display());
            (cameras, Some(dataset), seen)
        }
    };
    if all.is_empty() {
        return Err(Failure::failed("the data set has no view").hint("name another one"));
    }
    for camera in &all {
        camera.validate().map_err(|error| Failure::usage(error).at("the camera of --size or the data set"))?;
    }
    Ok((all, dataset, seen))
}

/// An orbit of so many frames around a 3D scene, with its first camera.
fn around(file: &File3d, args: &SeenArgs, frames: u32) -> Result<(Orbit, Camera), Failure> {
    let Home { camera, target, up } = Home::of(&file.scene, args.size, args.up)?;
    camera.validate().map_err(|error| Failure::usage(error).at("--size"))?;
    Ok((Orbit { center: target, axis: up, frames }, camera))
}
