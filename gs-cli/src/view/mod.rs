//! `gs view`: a scene in a window, drawn by the chosen backend while one moves through a 3D scene or over a 2D scene.
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
use gs_core::{Camera, Optimizer, RenderSettings, Scene, Scene3d, check_size, effects::RequiredEffects};
use gs_io::File2d;

use crate::{
    backend::{Backend, BackendArgs, Task3d},
    cameras::{self, Home},
    dataset::ReadingArgs,
    effects::choice::EffectsArgs,
    failure::Failure,
    opened::{self, Opened3d},
    shown::ShownArgs,
    values::{Axis, Size, ViewName},
    view::{
        navigation::{Navigator, PlaneNavigator},
        overlay::Subject,
        session::Session,
        window::Desktop,
    },
};

/// A window that nobody asked for in this size is no larger, px: photographs are larger than screens.
const LARGEST: Size = Size { width: 1280, height: 800 };

const AFTER_HELP: &str = "\
In the window of a 3D scene:
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

In the window of a 2D scene:
  drag, arrows   pan
  wheel, + -     zoom; the Gaussians are drawn anew at each zoom
  R, H, Esc      back to the whole picture; hide the text; close

If frames take longer than 50 ms, they are drawn in fewer pixels while the picture moves, and whole again at rest; the text says so.

Without a display, gs render SCENE -o turn.apng --orbit 60 shows the same.";

/// The flags of `gs view`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct ViewArgs {
    /// The scene: a file of any kind, a checkpoint, or the output folder of gs fit or gs train
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
    match opened::scene(&args.scene)? {
        opened::Scene::TwoD(file) => run_2d(args, &file),
        opened::Scene::ThreeD(scene_3d) => run_3d(args, &scene_3d),
    }
}

fn run_2d(args: &ViewArgs, file: &File2d) -> Result<(), Failure> {
    if args.camera.is_some() || args.up.is_some() || args.shown.is_some() {
        let message = "is a 2D scene, which has no camera, order or background to choose";
        return Err(Failure::usage(message).at(args.scene.display()).mend("use --size alone"));
    }
    let size = args.size.unwrap_or_else(|| usual_size(file.width, file.height));
    check_size(size.width, size.height).map_err(|error| Failure::usage(error).at("--size"))?;
    let desktop = Desktop::connect()?;
    let backend = Backend::start(&args.backend)?;
    let RequiredEffects { settings, .. } = args.effects.choose(&file.scene, &[], &file.settings)?;
    let session = Session::new(PlaneNavigator::new(file.width, file.height), settings);
    let subject = subject(args, file.scene.len(), 0, &backend);
    desktop.show(&backend, &file.scene, subject, session, size)
}

fn run_3d(args: &ViewArgs, opened: &Opened3d) -> Result<(), Failure> {
    let scene = &opened.file.scene;
    let bulk = cameras::bulk_of(scene)?;
    let start = start(args, opened)?;
    start.camera.validate().map_err(|error| Failure::usage(error).at("--camera or --size"))?;
    let size = args.size.unwrap_or_else(|| usual_size(start.camera.width, start.camera.height));
    check_size(size.width, size.height).map_err(|error| Failure::usage(error).at("--size"))?;
    let desktop = Desktop::connect()?;
    let backend = Backend::start(&args.backend)?;
    // What turns go around has to be ahead; a point beside the axis is taken at its depth.
    let depth = start.camera.to_camera(start.target).z;
    let distance = if depth > 0.0 { depth } else { bulk.radius };
    // One may move to wherever one likes.
    let RequiredEffects { settings, .. } = args.effects.choose(scene, &[], &start.settings)?;
    opened.note_guess(&args.shown);
    let session = Session::new(Navigator::new(&start.camera, distance, start.up, bulk), settings);
    let subject = subject(args, scene.len(), scene.sh_degree, &backend);
    desktop.show(&backend, scene, subject, session, size)
}

fn subject(args: &ViewArgs, gaussians: usize, sh_degree: u8, backend: &Backend) -> Subject {
    let name = args.scene.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    Subject { name, gaussians, sh_degree, machine: backend.run_3d(Describe) }
}

/// The size of a window for a picture of so many pixels.
fn usual_size(width: u32, height: u32) -> Size {
    let (width, height) = (width as f32, height as f32);
    let scale = (LARGEST.width as f32 / width).min(LARGEST.height as f32 / height).min(1.0);
    let scaled = |side: f32| ((side * scale).round() as u32).max(1);
    Size { width: scaled(width), height: scaled(height) }
}

/// Asks a backend what it is.
struct Describe;

impl Task3d for Describe {
    type Output = String;

    fn run<R: Optimizer<Scene3d>>(self, rasterizer: &R) -> String {
        rasterizer.describe()
    }
}

fn start(args: &ViewArgs, opened: &Opened3d) -> Result<Start, Failure> {
    let up = args.up.map(|axis| axis.0);
    let Some(name) = &args.camera else {
        let Home { camera, target, up } = Home::of(&opened.file, args.size, up)?;
        return Ok(Start { camera, target, up, settings: opened.settings(&args.shown, None) });
    };
    let dataset = args.reading.read(&name.dataset)?;
    let camera = cameras::of_view(&dataset, name)?;
    Ok(Start {
        camera,
        target: cameras::looked_at(&dataset, &camera),
        up: up.unwrap_or_else(|| cameras::up_of(&dataset)),
        settings: opened.settings(&args.shown, Some(&dataset)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_that_nobody_sized_fits_the_screen_and_the_picture() {
        assert_eq!(usual_size(800, 600), Size { width: 800, height: 600 });
        assert_eq!(usual_size(1296, 1936), Size { width: 536, height: 800 });
        assert_eq!(usual_size(16_000, 1), Size { width: 1280, height: 1 });
    }
}
