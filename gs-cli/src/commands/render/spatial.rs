//! `gs render` of a scene in space: the cameras that are asked for, and a picture from each.

use std::path::Path;

use gs_core::{Camera, Image, Rasterizer, RenderSettings, Scene, SpatialScene, effects::CalledFor, statistics::Culled};
use gs_io::{
    Animation, SpatialFile,
    dataset::{Dataset, DatasetSettings, read_dataset},
    write_animation, write_png,
};
use gs_train::spatial::{CameraPath, Orbit, resized};

use super::{CameraArgs, RenderArgs};
use crate::{
    backend::{Backend, SpatialTask},
    cameras::{self, Home},
    chosen::ChosenSettings,
    effects::choice::told,
    failure::Failure,
    fit::folder::OutputFolder,
    opened::Spatial,
    output,
    shown::{effects, why_empty},
    text_file::read_text,
    values::Size,
};

/// Renders a scene from each camera.
///
/// # Errors
/// Where the data set or the path cannot be read, there is no such view, or a picture cannot be written.
pub(super) fn run(args: &RenderArgs, opened: &Spatial) -> Result<(), Failure> {
    if args.region.is_some() {
        let message = "--region is for the scene of an image, but this is one in space";
        return Err(Failure::usage(message).at(args.scene.display()).mend("leave it out"));
    }
    let scene = &opened.file.scene;
    let (cameras, dataset) = cameras(&args.cameras, args.size, &opened.file)?;
    for camera in &cameras {
        camera.validate().map_err(|error| Failure::usage(error).at("--camera, --path or --size"))?;
    }
    check_output(&args.output, cameras.len())?;
    let render = opened.settings(&args.shown, dataset.as_ref());
    let chosen = args.settings.as_deref().map(ChosenSettings::read).transpose()?;
    let backend = Backend::start(&args.backend.or_chosen(chosen.as_ref().map(|chosen| &chosen.machine)))?;
    let render = chosen.map_or(render, |chosen| args.shown.overriding(chosen.applied_to(render), &render));
    let CalledFor { settings, verdicts } = args.effects().choose(scene, &cameras, &render)?;
    backend.run_spatial(Frames { args, scene, cameras: &cameras, render: &settings })?;
    output::note(told(&verdicts));
    Ok(())
}

/// What is written, by the name of the output and the number of frames.
enum Output {
    Picture,
    Animation,
    /// Frame by frame.
    Folder,
}

impl Output {
    fn of(path: &Path, frames: usize) -> Result<Self, Failure> {
        match (path.extension().and_then(|ending| ending.to_str()), frames) {
            (Some("apng"), _) => Ok(Self::Animation),
            (_, 1) => Ok(Self::Picture),
            (Some("png"), _) => {
                let message = format!("--output {}: one PNG cannot hold {frames} frames", path.display());
                Err(Failure::usage(message).mend("name a folder, or an animated PNG that ends in .apng"))
            }
            _ => Ok(Self::Folder),
        }
    }
}

/// The name of a frame's file.
fn frame_name(number: usize) -> String {
    format!("frame-{number:05}.png")
}

/// Refuses, before anything is rendered, an output that cannot hold the frames, and a folder in which a longer film would go on after them:
/// whoever plays it would see the end of the other. Whose frames these are is not known, so they are not removed.
fn check_output(path: &Path, frames: usize) -> Result<(), Failure> {
    if !matches!(Output::of(path, frames)?, Output::Folder) || !path.join(frame_name(frames)).exists() {
        return Ok(());
    }
    let message = format_args!("holds {}, which would go on after these {frames} frames", frame_name(frames));
    Err(Failure::failed(message)
        .at(path.display())
        .mend("remove it and those after it, or name another folder with --output"))
}

/// The cameras, at least one, and the data set that they are from, if they are.
fn cameras(
    args: &CameraArgs,
    size: Option<Size>,
    file: &SpatialFile,
) -> Result<(Vec<Camera>, Option<Dataset>), Failure> {
    if let Some(file) = &args.path {
        let cameras = read_path(file)?.cameras().map_err(|error| Failure::usage(error).at(file.display()))?;
        return Ok((cameras, None));
    }
    let sized = |camera: Camera| size.map_or(camera, |Size { width, height }| resized(&camera, width, height));
    if let Some(name) = &args.camera {
        let dataset = read_dataset(&name.dataset, &DatasetSettings::default())?;
        let camera = sized(cameras::of_view(&dataset, name)?);
        let cameras = match args.orbit {
            None => vec![camera],
            Some(frames) => around(&dataset, args, frames, &camera),
        };
        return Ok((cameras, Some(dataset)));
    }
    let Home { camera, target, up } = Home::of(file, size, args.up.map(|axis| axis.0))?;
    let cameras = match args.orbit {
        None => vec![camera],
        Some(frames) => Orbit { center: target, axis: up, frames }.cameras(&camera),
    };
    Ok((cameras, None))
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
        let mut culled = Culled::default();
        let mut frame = |camera: &Camera| -> Result<Image, Failure> {
            let frame = rasterizer.forward(&cloud, camera, render)?;
            culled = culled.plus(rasterizer.culled(&frame)?);
            Ok(rasterizer.image(&frame)?)
        };
        let Camera { width, height, .. } = cameras[0];
        let output = &args.output;
        match Output::of(output, cameras.len())? {
            Output::Animation => {
                let animation = Animation { width, height, frames: cameras.len() as u32, fps: args.cameras.fps };
                write_animation(output, animation, |number| frame(&cameras[number as usize]))?;
            }
            Output::Picture => write_png(output, &frame(&cameras[0])?)?,
            Output::Folder => {
                let folder = OutputFolder::prepare(output, "--output")?;
                for (number, camera) in cameras.iter().enumerate() {
                    write_png(folder.file(&frame_name(number)), &frame(camera)?)?;
                }
            }
        }
        let size = match cameras.len() {
            1 => format!("{width}x{height} px"),
            frames => format!("{frames} frames of {width}x{height} px"),
        };
        output::note(format_args!("wrote {}, {size}: {}", output.display(), effects(render)));
        if let Some(why) = why_empty(culled, scene.len(), cameras.len()) {
            output::note(format_args!("note: nothing of the scene is to be seen: {why}"));
        }
        Ok(())
    }
}
