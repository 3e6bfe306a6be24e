//! `gs render` of a 3D scene: its cameras, and a picture from each.

use std::{fs, path::Path};

use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::{
    Camera, Culled, Image, Parameterization, Rasterizer as _, RenderSettings, Scene as _, Scene3d, counted,
    effects::RequiredEffects,
    view::{CameraPath, Orbit},
};
use gs_io::{
    Animation, File3d, FolderClaim, PngExtras, StoredImage, dataset::Dataset, draw_with_alpha, write_animation,
    write_grey_png, write_png_with, write_tiff, write_world_file,
};
use gs_train::parse_json;

use super::{
    CameraArgs, RenderArgs, panorama,
    plan::{self, Plan},
};
use crate::{
    failure::Failure,
    files::{
        lod::Lod,
        output_folder::{self, OutputFolder},
        text_file::read_text,
    },
    flags::{
        cameras::Home,
        effects_args,
        render_args::{self, why_empty},
        values::{Behind, Size},
    },
    memory,
    terminal::output,
};

/// Renders a scene from each camera: `file`, or the levels of `lod` that the cameras need.
pub(super) fn run(args: &RenderArgs, file: &File3d, lod: Option<&Lod>) -> Result<(), Failure> {
    if args.region.is_some() {
        let message = "--region is for 2D scenes, but this is a 3D scene";
        return Err(Failure::usage(message).at(args.scene.display()).hint("leave it out"));
    }
    let (cameras, dataset) = cameras(&args.cameras, args.size, file)?;
    for camera in &cameras {
        camera.validate().map_err(|error| Failure::usage(error).at("--camera, --path or --size"))?;
    }
    let CameraArgs { ortho, epsg, .. } = args.cameras;
    let plan = ortho.map(|scale| Plan::of(&cameras[0], scale, file.trained_with.frame, epsg)).transpose()?;
    let faces = |camera: &Camera| match args.cameras.panorama {
        true => panorama::cameras(camera, camera.width).to_vec(),
        false => vec![*camera],
    };
    let drawn: Vec<Camera> = cameras.iter().flat_map(faces).collect();
    let needed = lod.map(|lod| lod.read(&drawn)).transpose()?;
    let file = needed.as_ref().unwrap_or(file);
    let scene = &file.scene;
    let is_transparent = args.render.background == Some(Behind::None);
    if is_transparent && matches!(Output::of(args, cameras.len())?, Output::Animation) {
        let message = "--background none: animated PNGs are written without alpha";
        return Err(Failure::usage(message).hint("name a folder, which gets a PNG with alpha for each frame"));
    }
    let is_special = args.depth.is_some() || args.cameras.panorama;
    if is_special && (is_transparent || matches!(Output::of(args, cameras.len())?, Output::Animation)) {
        let message = "--depth and --panorama write PNGs without alpha, one for each frame";
        return Err(Failure::usage(message).hint("name a PNG or a folder, and leave out --background none"));
    }
    let claim = claim(args, cameras.len(), dataset.as_ref())?;
    let Camera { width, height, .. } = cameras[0];
    // The faces of a panorama have about three times its pixels.
    let height = if args.cameras.panorama { height.saturating_mul(4) } else { height };
    memory::check_picture(args.scene.display(), (width, height))?;
    let render = args.with_accuracy(args.render.settings(file, dataset.as_ref()))?;
    let backend = args.backend.open()?;
    let RequiredEffects { settings, decisions } = args.effects.choice().choose(scene, &drawn, &render)?;
    render_frames(args, &backend.rasterizer, scene, (&cameras, plan), &settings, claim)?;
    args.render.note_guess(file);
    if let Some(effects) = effects_args::describe(&decisions).filter(|_| args.verbose) {
        output::note(effects);
    }
    Ok(())
}

/// What is written, according to the name of the output and the cameras. A film may have a single
/// frame.
enum Output {
    Picture,
    Animation,
    /// Frame by frame.
    Folder,
}

impl Output {
    fn of(args: &RenderArgs, frames: usize) -> Result<Self, Failure> {
        let path = &args.output;
        let is_film = args.cameras.path.is_some() || args.cameras.orbit.is_some();
        match path.extension().and_then(|ending| ending.to_str()) {
            Some("apng") => Ok(Self::Animation),
            Some("png") if frames == 1 => Ok(Self::Picture),
            _ if !is_film => Ok(Self::Picture),
            Some("png") => {
                let message = format!("--output {}: one PNG cannot hold {frames} frames", path.display());
                Err(Failure::usage(message).hint("name a folder, or an animated PNG that ends in .apng"))
            }
            _ => Ok(Self::Folder),
        }
    }
}

/// The name of a frame's file.
fn frame_name(number: usize) -> String {
    format!("frame-{number:05}.png")
}

/// Refuses an output that cannot hold the frames, or that must not be replaced. For a folder, the
/// claim is to the frames and to those of a longer film, which would be played after them.
fn claim(args: &RenderArgs, frames: usize, dataset: Option<&Dataset>) -> Result<Option<FolderClaim>, Failure> {
    let inputs = args.inputs().chain(dataset.into_iter().flat_map(Dataset::files));
    if !matches!(Output::of(args, frames)?, Output::Folder) {
        output_folder::check_file(&args.output, inputs)?;
        return Ok(None);
    }
    let there = fs::read_dir(&args.output).into_iter().flatten().flatten();
    let there = there.filter_map(|entry| entry.file_name().into_string().ok());
    let names: Vec<String> = (0..frames).map(frame_name).chain(frames_after(frames, there)).collect();
    let claim = args.overwrite.claim(&args.output, names.iter().map(String::as_str), inputs.collect());
    output_folder::check(&claim)?;
    Ok(Some(claim))
}

/// The names of frames that a film of `frames` would not replace.
fn frames_after(frames: usize, names: impl IntoIterator<Item = String>) -> Vec<String> {
    let number = |name: &str| name.strip_prefix("frame-")?.strip_suffix(".png")?.parse::<usize>().ok();
    let is_after = |name: &String| number(name).is_some_and(|n| n >= frames && *name == frame_name(n));
    let mut after: Vec<String> = names.into_iter().filter(is_after).collect();
    after.sort();
    after
}

/// The cameras, at least one, and their data set, if they have one.
fn cameras(args: &CameraArgs, size: Option<Size>, file: &File3d) -> Result<(Vec<Camera>, Option<Dataset>), Failure> {
    if let Some(file) = &args.path {
        let cameras = read_path(file)?.cameras().map_err(|error| Failure::usage(error).at(file.display()))?;
        return Ok((cameras, None));
    }
    if let Some(scale) = args.ortho {
        let up = plan::up(args, &file.trained_with.frame);
        return Ok((vec![plan::camera(&file.scene, scale, size, up)?], None));
    }
    let (Home { camera, target, up }, dataset) = Home::named(args.camera.as_ref(), &args.reading, file, size, args.up)?;
    let camera = match size.unwrap_or(PANORAMA) {
        Size { width, height } if args.panorama => Camera { width, height, ..camera },
        _ => camera,
    };
    let cameras = match args.orbit {
        None => vec![camera],
        Some(frames) => Orbit { center: target, axis: up, frames }.cameras(&camera),
    };
    Ok((cameras, dataset))
}

/// Default size of a panorama.
const PANORAMA: Size = Size { width: 2000, height: 1000 };

/// Depths in steps of a part of the unit, `[height · width]`; 0 where less than half of a pixel is covered, or beyond
/// 65,535 steps. The depth of a pixel is the harmonic mean over its Gaussians.
fn depths(inverse: &Image, alpha: &[f32], step: f32) -> Vec<u16> {
    let depth = |(inverse, &alpha): (&[f32; 3], &f32)| match (alpha / inverse[0] / step).round() {
        steps if alpha >= 0.5 && steps <= f32::from(u16::MAX) => steps as u16,
        _ => 0,
    };
    inverse.pixels().iter().zip(alpha).map(depth).collect()
}

fn read_path(file: &Path) -> Result<CameraPath, Failure> {
    let text = read_text(file, "name a path with --path")?;
    parse_json(&text, file).map_err(|error| Failure::usage(error).hint("gs render --help shows one"))
}

fn render_frames(
    args: &RenderArgs,
    rasterizer: &AnyRasterizer,
    scene: &Scene3d,
    (cameras, plan): (&[Camera], Option<Plan>),
    render: &RenderSettings,
    claim: Option<FolderClaim>,
) -> Result<(), Failure> {
    let rasterizer = rasterizer.for_3d();
    let splats = rasterizer.upload(scene, Parameterization::ScaleRotation)?;
    let mut culled = Culled::default();
    let is_transparent = args.render.background == Some(Behind::None);
    let mut frame = |camera: &Camera| -> Result<(Image, Option<Vec<f32>>), Failure> {
        if args.cameras.panorama {
            let faces = panorama::cameras(camera, camera.width);
            let faces: Vec<_> =
                faces.iter().map(|face| rasterizer.draw(&splats, face, render).block_on()).collect::<Result<_, _>>()?;
            let faces: Vec<Image> = faces
                .into_iter()
                .map(|(image, left_out)| {
                    culled = culled.plus(left_out);
                    image
                })
                .collect();
            return Ok((panorama::join(&faces, camera.width, camera.height)?, None));
        }
        if args.depth.is_some() {
            let covered = render.of_alpha();
            let inverse = covered.with(|s| s.output = gs_core::Output::InverseDepth);
            let (image, left_out) = rasterizer.draw(&splats, camera, &inverse).block_on()?;
            let (alpha, _) = rasterizer.draw(&splats, camera, &covered).block_on()?;
            culled = culled.plus(left_out);
            return Ok((image, Some(alpha.pixels().iter().map(|pixel| pixel[0]).collect())));
        }
        let (image, alpha, left_out) = match is_transparent {
            false => {
                let (image, left_out) = rasterizer.draw(&splats, camera, render).block_on()?;
                (image, None, left_out)
            }
            true => {
                let (StoredImage { image, alpha, .. }, left_out) =
                    draw_with_alpha(rasterizer, &splats, camera, render).block_on()?;
                (image, alpha, left_out)
            }
        };
        culled = culled.plus(left_out);
        Ok((image, alpha))
    };
    let place = plan.and_then(|plan| plan.place);
    let write = |path: &Path, (image, alpha): (Image, Option<Vec<f32>>)| match (args.depth, &alpha) {
        (Some(step), Some(alpha)) => write_grey_png(path, image.size(), &depths(&image, alpha, step)),
        _ if plan::is_tiff(path) => write_tiff(path, &image, alpha.as_deref(), place.as_ref()),
        _ => write_png_with(path, &image, PngExtras { alpha: alpha.as_deref(), profile: None }),
    };
    let Camera { width, height, .. } = cameras[0];
    let output = &args.output;
    match (claim, Output::of(args, cameras.len())?) {
        (None, Output::Animation) => {
            let animation = Animation { width, height, frames: cameras.len() as u32, fps: args.cameras.fps };
            write_animation(output, animation, |number| Ok::<_, Failure>(frame(&cameras[number as usize])?.0))?;
        }
        (None, _) => write(output, frame(&cameras[0])?)?,
        (Some(claim), _) => {
            let folder = OutputFolder::begin(claim)?;
            folder.leave_out(frames_after(cameras.len(), folder.claimed("frame-")))?;
            for (number, camera) in cameras.iter().enumerate() {
                write(&folder.file(&frame_name(number)), frame(camera)?)?;
            }
        }
    }
    let world_file = place.map(|place| write_world_file(output, &place)).transpose()?.flatten();
    let size = match cameras.len() {
        1 if matches!(Output::of(args, 1)?, Output::Picture) => format!("{width}x{height} px"),
        frames => format!("{} of {width}x{height} px", counted(frames, "frame")),
    };
    let how = match is_transparent {
        true => format!("{}, with alpha", render_args::describe_scene(render)),
        false => render_args::describe(render),
    };
    let how = args.depth.map_or(how, |step| format!("depths in steps of {step} of the scene's unit"));
    let size = plan.map_or(size.clone(), |plan| format!("{size}, {}", plan.describe()));
    let beside = world_file.map_or(String::new(), |path| format!(" and {}", path.display()));
    output::note(format_args!("wrote {}{beside}, {size}: {how}", output.display()));
    if let Some(why) = plan.and_then(|plan| plan.why_unplaced()).filter(|_| plan::is_tiff(output)) {
        output::note(format_args!("note: {} has no place on a map: {why}", output.display()));
    }
    if let Some(why) = why_empty(culled, scene.len(), cameras.len() * if args.cameras.panorama { 6 } else { 1 }) {
        output::note(format_args!("note: nothing of the scene is in sight: {why}"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_steps_of_a_unit_where_something_is() {
        let inverse = Image::from_pixels(4, 1, [0.5, 0.25, 0.1, 0.0].map(|value| [value; 3]).to_vec()).unwrap();
        assert_eq!(depths(&inverse, &[1.0, 0.5, 0.4, 0.0], 0.001), [2000, 2000, 0, 0]);
        assert_eq!(depths(&inverse, &[1.0; 4], 1e-5), [0; 4], "too far for 16 bits, or without end");
    }
}
