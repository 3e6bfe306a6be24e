//! `gs render` of a scene in space: the cameras that are asked for, and a picture from each.

use std::{fs, path::Path};

use glam::Vec3;
use gs_core::{Camera, Image, Rasterizer, RenderSettings, SpatialScene};
use gs_io::{
    Animation,
    dataset::{Dataset, DatasetSettings, read_dataset},
    read_spatial, write_animation, write_png,
};
use gs_train::spatial::{Bulk, CameraPath, Focus, Orbit, resized};

use super::{CameraArgs, RenderArgs};
use crate::{
    backend::{Backend, SpatialTask},
    failure::Failure,
    fit::folder::OutputFolder,
    output,
    values::{Axis, Size, ViewName},
};

/// Size of the picture where nothing says another.
const SIZE: Size = Size { width: 800, height: 600 };

/// Field of view across where no data set says another, rad.
const FIELD_OF_VIEW: f32 = 0.9;

/// Renders a scene from each camera.
///
/// # Errors
/// Where the scene, the data set or the path cannot be read, there is no such view, or a picture cannot be written.
pub(super) fn run(args: &RenderArgs) -> Result<(), Failure> {
    if args.region.is_some() {
        let message = "--region is for the scene of an image, but this is one in space";
        return Err(Failure::usage(message).at(args.scene.display()).mend("leave it out"));
    }
    let scene = read_spatial(&args.scene)?.scene;
    let cameras = cameras(&args.cameras, args.size, &scene)?;
    for camera in &cameras {
        camera.validate().map_err(|error| Failure::usage(error).at("--camera, --path or --size"))?;
    }
    let backend = Backend::start(&args.backend)?;
    let render = args.shown.settings(&scene);
    backend.run_spatial(Frames { args, scene: &scene, cameras: &cameras, render: &render })
}

/// The cameras, at least one.
fn cameras(args: &CameraArgs, size: Option<Size>, scene: &SpatialScene) -> Result<Vec<Camera>, Failure> {
    if let Some(file) = &args.path {
        return read_path(file)?.cameras().map_err(|error| Failure::usage(error).at(file.display()));
    }
    let sized = |camera: Camera| size.map_or(camera, |Size { width, height }| resized(&camera, width, height));
    if let Some(name) = &args.camera {
        let dataset = read_dataset(&name.dataset, &DatasetSettings::default())?;
        let camera = sized(view(&dataset, name)?);
        return Ok(match args.orbit {
            None => vec![camera],
            Some(frames) => around(&dataset, args, frames, &camera),
        });
    }
    let (orbit, camera) = overview(scene, size, args.up, args.orbit.unwrap_or(1))?;
    Ok(orbit.cameras(&camera))
}

/// An orbit of so many frames around the bulk of a scene, and its first camera, from a little above.
///
/// # Errors
/// Where nothing of the scene could be seen.
pub(crate) fn overview(
    scene: &SpatialScene,
    size: Option<Size>,
    up: Option<Axis>,
    frames: u32,
) -> Result<(Orbit, Camera), Failure> {
    let Some(bulk) = Bulk::of(scene) else {
        return Err(Failure::failed("the scene has no Gaussian that could be seen"));
    };
    let up = up.map_or(Vec3::NEG_Y, |axis| axis.0);
    let Size { width, height } = size.unwrap_or(SIZE);
    let Some(camera) = bulk.overview(width, height, FIELD_OF_VIEW, up) else {
        return Err(Failure::failed("the scene's extent is not finite").mend("gs info tells what is in it"));
    };
    Ok((Orbit { center: bulk.center, axis: up, frames }, camera))
}

/// The camera taken around what the cameras of its data set look at; where they look nowhere in common, around what is ahead of it.
fn around(dataset: &Dataset, args: &CameraArgs, frames: u32, camera: &Camera) -> Vec<Camera> {
    let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    let center = Focus::of(&cameras).map_or_else(
        || {
            let extent = gs_train::spatial::extent_of(&cameras, None);
            camera.position() + camera.rotation.row(2) * extent
        },
        |focus| focus.point,
    );
    // What is up for most photographers is up.
    let up: Vec3 = cameras.iter().map(|camera| -camera.rotation.row(1)).sum();
    Orbit { center, axis: args.up.map_or(up, |axis| axis.0), frames }.cameras(camera)
}

fn view(dataset: &Dataset, name: &ViewName) -> Result<Camera, Failure> {
    let stem = |text: &str| Path::new(text).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let exact = dataset.views.iter().find(|view| view.name == name.view);
    // A view may be called by its file alone, if that says which.
    let mut alike = dataset.views.iter().filter(|view| stem(&view.name) == stem(&name.view));
    match exact.or_else(|| alike.next().filter(|_| alike.next().is_none())) {
        Some(view) => Ok(view.camera),
        None => {
            let names: Vec<&str> = dataset.views.iter().take(5).map(|view| view.name.as_str()).collect();
            let more = if dataset.views.len() > 5 { ", ..." } else { "" };
            let what = format_args!("{}: has no view `{}`, or several", name.dataset.display(), name.view);
            Err(Failure::usage(what).mend(format_args!("its views are {}{more}", names.join(", "))))
        }
    }
}

fn read_path(file: &Path) -> Result<CameraPath, Failure> {
    let at = |failure: Failure| failure.at(file.display());
    let text = fs::read_to_string(file).map_err(|error| {
        at(Failure::failed(format_args!("cannot be read: {error}")).mend("name a path with --path"))
    })?;
    serde_json::from_str(&text).map_err(|error| at(Failure::usage(error).mend("gs render --help shows one")))
}

struct Frames<'a> {
    args: &'a RenderArgs,
    scene: &'a SpatialScene,
    cameras: &'a [Camera],
    render: &'a RenderSettings,
}

impl SpatialTask for Frames<'_> {
    type Output = Result<(), Failure>;

    fn run<R: Rasterizer<SpatialScene>>(self, rasterizer: &R) -> Result<(), Failure> {
        let Self { args, scene, cameras, render } = self;
        let cloud = rasterizer.upload(scene, gs_core::Chart::ScaleRotation)?;
        let frame = |camera: &Camera| -> Result<Image, Failure> {
            Ok(rasterizer.image(&rasterizer.forward(&cloud, camera, render)?)?)
        };
        let (output, ending) = (&args.output, args.output.extension().and_then(|ending| ending.to_str()));
        let Camera { width, height, .. } = cameras[0];
        let written = match (ending, cameras) {
            (Some("apng"), _) => {
                let animation = Animation { width, height, frames: cameras.len() as u32, fps: args.cameras.fps };
                write_animation(output, animation, |number| frame(&cameras[number as usize]))?;
                format!("{} frames of {width}x{height} px", cameras.len())
            }
            (_, [camera]) => {
                write_png(output, &frame(camera)?)?;
                format!("{width}x{height} px")
            }
            (Some("png"), _) => {
                let message = format!("--output {}: one PNG cannot hold {} frames", output.display(), cameras.len());
                return Err(Failure::usage(message).mend("name a folder, or an animated PNG that ends in .apng"));
            }
            _ => {
                let folder = OutputFolder::prepare(output, "--output")?;
                for (number, camera) in cameras.iter().enumerate() {
                    write_png(folder.file(&format!("frame-{number:05}.png")), &frame(camera)?)?;
                }
                format!("{} frames of {width}x{height} px", cameras.len())
            }
        };
        output::note(format_args!("wrote {}, {written}", output.display()));
        Ok(())
    }
}
