//! `gs view`: a scene in space in a window, drawn by the chosen backend while one moves through it.
//!
//! Movement ([`navigation`]), what goes on ([`session`]) and what is said ([`overlay`]) know no window; [`window`] is all that does. Frames
//! are drawn on a thread of their own ([`painter`]), one at a time, and always the newest that is wanted.

mod keys;
mod navigation;
mod overlay;
mod pace;
mod painter;
mod pixels;
mod session;
mod text;
mod window;

use std::path::PathBuf;

use clap::Args;
use glam::Vec3;
use gs_core::{Camera, Rasterizer, RenderSettings, Scene, SpatialScene, effects::CalledFor, image::check_size};
use gs_io::{SpatialFile, TrainedWith, read_spatial};
use gs_train::spatial::Bulk;

use crate::{
    backend::{Backend, BackendArgs, SpatialTask},
    cameras,
    dataset::ReadingArgs,
    effects::choice::{EffectsArgs, told},
    failure::Failure,
    memory, output,
    shown::ShownArgs,
    values::{Axis, Size, ViewName},
    view::{navigation::Navigator, overlay::Subject, session::Session, window::Desktop},
};

/// A window that nobody asked for in this size is no larger, px: photographs are larger than screens.
const LARGEST: Size = Size { width: 1280, height: 800 };

const AFTER_HELP: &str = "\
In the window:
  drag           turn around the point looked at; in flight, look around
  shift+drag     pan; so does the right button
  wheel          zoom; in flight, slower and faster
  F              orbit or fly: W A S D forward, left, back, right; Q E down, up; shift four times as fast
  arrow keys     turn
  R              back to the first camera
  O, or 1 2      order of blending: by tile depth, by pixel depth
  A, or 3 4 5 6  antialiasing: none, dilate, mip, compensated (in flight, A is a direction)
  H              hide the text
  Esc            close

If frames take longer than 50 ms, they are drawn in fewer pixels while the picture moves, and whole again at rest; the text says so.

Without a display, gs render SCENE -o turn.apng --orbit 60 shows the same.";

/// The flags of `gs view`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct ViewArgs {
    /// The scene in space (PLY, .splat, SPZ, glTF), such as the scene.ply of a training
    scene: PathBuf,
    /// Size of the picture [default: 800x600, or the proportions of the view]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Begin where a photograph of a data set was taken
    #[arg(long, value_name = "DATASET:VIEW", help_heading = "Camera")]
    camera: Option<ViewName>,
    /// What turns go around and what is up: x, y, z, or -x, -y, -z [default: -y, or that of the data set]
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true, help_heading = "Camera")]
    up: Option<Axis>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    effects: EffectsArgs,
    #[command(flatten)]
    shown: ShownArgs,
    #[command(flatten)]
    backend: BackendArgs,
}

/// Where it begins.
struct Start {
    camera: Camera,
    /// The point that turns go around, world units.
    target: Vec3,
    up: Vec3,
    settings: RenderSettings,
}

/// Shows a scene until its window is closed.
///
/// # Errors
/// Where the scene or the data set cannot be read, there is no display, or the backend fails.
pub(crate) fn run(args: &ViewArgs) -> Result<(), Failure> {
    let SpatialFile { scene, trained_with, .. } = read(args)?;
    let bulk = cameras::bulk_of(&scene)?;
    let start = start(args, &scene, trained_with, &bulk)?;
    start.camera.validate().map_err(|error| Failure::usage(error).at("--camera or --size"))?;
    let size = args.size.unwrap_or_else(|| usual_size(&start.camera));
    check_size(size.width, size.height).map_err(|error| Failure::usage(error).at("--size"))?;
    let desktop = Desktop::connect()?;
    let backend = Backend::start(&args.backend)?;
    // What turns go around has to be ahead; a point beside the axis is taken at its depth.
    let depth = start.camera.to_camera(start.target).z;
    let distance = if depth > 0.0 { depth } else { bulk.radius };
    // One may move to wherever one likes.
    let CalledFor { settings, verdicts } = args.effects.choose(&scene, &[], &start.settings)?;
    args.shown.note_guess(trained_with);
    if let Some(told) = told(&verdicts) {
        output::note(told);
    }
    let session = Session::new(Navigator::new(&start.camera, distance, start.up, bulk), settings);
    let subject = Subject {
        name: args.scene.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        gaussians: scene.len(),
        sh_degree: scene.sh_degree,
        machine: backend.run_spatial(Describe),
    };
    desktop.show(&backend, &scene, subject, session, size)
}

/// The size of a window for the picture of this camera.
fn usual_size(camera: &Camera) -> Size {
    let (width, height) = (camera.width as f32, camera.height as f32);
    let scale = (LARGEST.width as f32 / width).min(LARGEST.height as f32 / height).min(1.0);
    let scaled = |side: f32| ((side * scale).round() as u32).max(1);
    Size { width: scaled(width), height: scaled(height) }
}

/// Asks a backend what it is.
struct Describe;

impl SpatialTask for Describe {
    type Output = String;

    fn run<R: Rasterizer<SpatialScene>>(self, rasterizer: &R) -> String {
        rasterizer.describe()
    }
}

/// The scene, which must be one in space.
fn read(args: &ViewArgs) -> Result<SpatialFile, Failure> {
    if gs_io::spatial_format(&args.scene)?.is_some() {
        memory::check_spatial(&args.scene)?;
        return read_spatial(&args.scene).map_err(Failure::of_scene);
    }
    gs_io::read_scene(&args.scene)?;
    let message = "is the scene of an image, which has no depth to move through";
    let mend = format_args!("gs render {} -o picture.png draws it", args.scene.display());
    Err(Failure::usage(message).at(args.scene.display()).mend(mend))
}

fn start(args: &ViewArgs, scene: &SpatialScene, trained_with: TrainedWith, bulk: &Bulk) -> Result<Start, Failure> {
    let up = args.up.map(|axis| axis.0);
    let Some(name) = &args.camera else {
        let up = up.unwrap_or(cameras::UP);
        let camera = cameras::overview(bulk, args.size, up).map_err(cameras::or_name_one)?;
        return Ok(Start { camera, target: bulk.center, up, settings: args.shown.settings(scene, trained_with) });
    };
    let dataset = args.reading.read(&name.dataset)?;
    let camera = cameras::of_view(&dataset, name)?;
    Ok(Start {
        camera,
        target: cameras::looked_at(&dataset, &camera),
        up: up.unwrap_or_else(|| cameras::up_of(&dataset)),
        settings: args.shown.settings_beside(scene, trained_with, &dataset),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_that_nobody_sized_fits_the_screen_and_the_picture() {
        let size = |width, height| usual_size(&Camera::looking_forward(width, height, 1.0));
        assert_eq!(size(800, 600), Size { width: 800, height: 600 });
        assert_eq!(size(1296, 1936), Size { width: 536, height: 800 });
        assert_eq!(size(16_000, 1), Size { width: 1280, height: 1 });
    }
}
