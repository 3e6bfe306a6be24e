//! `gs render` of a 3D scene: its cameras, and a picture from each.

use std::{fs, path::Path};

use glam::{Vec2, Vec3};
use gs_backend::{AnyRasterizer, FutureExt as _};
use gs_core::{
    Camera, Culled, Image, Parameterization, Rasterizer as _, RenderSettings, Scene as _, Scene3d,
    constants::MAX_SIDE_PX,
    counted,
    effects::RequiredEffects,
    view::{Bulk, CameraPath, Orbit},
};
use gs_io::{
    Animation, File3d, FolderClaim, PngExtras, StoredImage, dataset::Dataset, draw_with_alpha, write_animation,
    write_grey_png, write_png_with,
};
use gs_train::parse_json;

use super::{CameraArgs, RenderArgs, panorama};
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
    render_frames(args, &backend.rasterizer, scene, &cameras, &settings, claim)?;
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
        return Ok((vec![from_above(&file.scene, scale, size, args.up)?], None));
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

/// Distance of the camera of an orthographic picture in radii of the scene. What is a radius above or below the centre
/// moves by a 4000th of its distance from the middle of the picture: by 1/8 px at the border of 1000 px.
const FAR: f32 = 4000.0;

/// A camera so far above the scene that its rays are parallel, with this many pixels a unit.
fn from_above(scene: &Scene3d, scale: f32, size: Option<Size>, up: Option<Vec3>) -> Result<Camera, Failure> {
    let bulk = Bulk::of(scene).ok_or_else(|| Failure::failed("the scene has no Gaussian that could be seen"))?;
    let side = (2.0 * bulk.radius * scale).ceil().clamp(1.0, MAX_SIDE_PX as f32) as u32;
    let Size { width, height } = size.unwrap_or(Size { width: side, height: side });
    let (up, distance) = (up.unwrap_or(Vec3::NEG_Y), FAR * bulk.radius);
    let ahead = if up.z == 0.0 { Vec3::Z } else { Vec3::Y };
    let lens = Camera { focal: Vec2::splat(scale * distance), ..Camera::looking_forward(width, height, 1.0) };
    lens.looking_at(bulk.center + up * distance, bulk.center, ahead)
        .ok_or_else(|| Failure::failed("the scene is too large to be seen from outside; gs info shows its extent"))
}

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
    cameras: &[Camera],
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
    let write = |path: &Path, (image, alpha): (Image, Option<Vec<f32>>)| match (args.depth, &alpha) {
        (Some(step), Some(alpha)) => write_grey_png(path, image.size(), &depths(&image, alpha, step)),
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
    let size = match cameras.len() {
        1 if matches!(Output::of(args, 1)?, Output::Picture) => format!("{width}x{height} px"),
        frames => format!("{} of {width}x{height} px", counted(frames, "frame")),
    };
    let how = match is_transparent {
        true => format!("{}, with alpha", render_args::describe_scene(render)),
        false => render_args::describe(render),
    };
    let how = args.depth.map_or(how, |step| format!("depths in steps of {step} of the scene's unit"));
    output::note(format_args!("wrote {}, {size}: {how}", output.display()));
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

    #[test]
    fn a_picture_from_above_has_one_scale() {
        let gaussian = |x: f32, y: f32, z: f32| gs_core::Gaussian3d {
            mean: Vec3::new(x, y, z),
            log_scale: Vec3::splat(-5.0),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 2.0,
            sh: vec![Vec3::ZERO],
        };
        let place = |i| gaussian((i % 5) as f32 - 2.0, (i % 3) as f32 - 1.0, (i / 5) as f32);
        let scene: Scene3d = (0..20).map(place).collect();
        let camera = from_above(&scene, 100.0, None, None).unwrap();
        camera.validate().unwrap();
        let at = |x, y, z| camera.project(Vec3::new(x, y, z)).unwrap().0;
        for height in [-1.0, 1.0] {
            let right = at(1.0, height, 2.0) - at(0.0, height, 2.0);
            let ahead = at(0.0, height, 3.0) - at(0.0, height, 2.0);
            assert!(right.distance(Vec2::new(100.0, 0.0)) < 0.1, "{right}");
            assert!(ahead.distance(Vec2::new(0.0, -100.0)) < 0.1, "{ahead}");
        }
        assert!(at(2.0, 1.0, 2.0).distance(at(2.0, -1.0, 2.0)) < 0.2);
    }
}
