//! `gs render` of a scene in space: the cameras that are asked for, and a picture from each.

use std::path::Path;

use gs_core::{Camera, Image, Rasterizer, RenderSettings, SpatialScene, effects::CalledFor};
use gs_io::{
    Animation,
    dataset::{Dataset, DatasetSettings, read_dataset},
    read_spatial, write_animation, write_png,
};
use gs_train::spatial::{CameraPath, Orbit, resized};

use super::{CameraArgs, RenderArgs};
use crate::{
    backend::{Backend, SpatialTask},
    cameras,
    effects::choice::told,
    failure::Failure,
    fit::folder::OutputFolder,
    output,
    text_file::read_text,
    values::Size,
};

/// Renders a scene from each camera.
///
/// # Errors
/// Where the scene, the data set or the path cannot be read, there is no such view, or a picture cannot be written.
pub(super) fn run(args: &RenderArgs) -> Result<(), Failure> {
    if args.region.is_some() {
        let message = "--region is for the scene of an image, but this is one in space";
        return Err(Failure::usage(message).at(args.scene.display()).mend("leave it out"));
    }
    let scene = read_spatial(&args.scene).map_err(Failure::of_scene)?.scene;
    let cameras = cameras(&args.cameras, args.size, &scene)?;
    for camera in &cameras {
        camera.validate().map_err(|error| Failure::usage(error).at("--camera, --path or --size"))?;
    }
    let backend = Backend::start(&args.backend)?;
    let CalledFor { settings, verdicts } = args.effects.choose(&scene, &cameras, &args.shown.settings(&scene));
    backend.run_spatial(Frames { args, scene: &scene, cameras: &cameras, render: &settings })?;
    output::note(told(&verdicts));
    Ok(())
}

/// The cameras, at least one.
fn cameras(args: &CameraArgs, size: Option<Size>, scene: &SpatialScene) -> Result<Vec<Camera>, Failure> {
    if let Some(file) = &args.path {
        return read_path(file)?.cameras().map_err(|error| Failure::usage(error).at(file.display()));
    }
    let sized = |camera: Camera| size.map_or(camera, |Size { width, height }| resized(&camera, width, height));
    if let Some(name) = &args.camera {
        let dataset = read_dataset(&name.dataset, &DatasetSettings::default())?;
        let camera = sized(cameras::of_view(&dataset, name)?);
        return Ok(match args.orbit {
            None => vec![camera],
            Some(frames) => around(&dataset, args, frames, &camera),
        });
    }
    let bulk = cameras::bulk_of(scene)?;
    let up = args.up.map_or(cameras::UP, |axis| axis.0);
    let camera = cameras::overview(&bulk, size, up)?;
    Ok(match args.orbit {
        None => vec![camera],
        Some(frames) => Orbit { center: bulk.center, axis: up, frames }.cameras(&camera),
    })
}

/// The camera taken around what the cameras of its data set look at.
fn around(dataset: &Dataset, args: &CameraArgs, frames: u32, camera: &Camera) -> Vec<Camera> {
    let axis = args.up.map_or_else(|| cameras::up_of(dataset), |axis| axis.0);
    Orbit { center: cameras::looked_at(dataset, camera), axis, frames }.cameras(camera)
}

fn read_path(file: &Path) -> Result<CameraPath, Failure> {
    let text = read_text(file, "name a path with --path")?;
    serde_json::from_str(&text)
        .map_err(|error| Failure::usage(error).at(file.display()).mend("gs render --help shows one"))
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
