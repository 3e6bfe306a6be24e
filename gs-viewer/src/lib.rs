//! A window that shows a scene of Gaussian splats, drawn by the backend chosen at run time.
//!
//! [`view`] opens the window and returns when it is closed. Over a 2D scene one pans and zooms;
//! through a 3D scene one orbits and flies, and switches the order of blending and the antialiasing
//! with keys. [`KEYS`] lists them.
//!
//! Of a scene with levels of detail ([`Levels`]), a thread reads what the camera needs, coarse levels
//! first, while frames show what is there. Levels that change fade over a quarter of a second.
//!
//! Slow frames are rendered in fewer pixels while the picture moves. A text over the picture shows
//! the time per frame, the effects, and the keys.
//!
//! ```no_run
//! use gs_backend::{Request, block_on, open};
//! use gs_core::{Blend, RenderSettings, Scene2d};
//! use gs_viewer::{Options, Viewed, view};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let backend = block_on(open(&Request::default()))?;
//! let scene = Scene2d::default();
//! let settings = RenderSettings::blended(Blend::Sum);
//! let options = Options::new("empty", (800, 600), settings);
//! let viewed = Viewed::TwoD { scene: &scene, width: 800, height: 600, profile: None };
//! view(viewed, &backend.rasterizer, options)?;
//! # Ok(()) }
//! ```

mod error;
mod keys;
mod levels;
mod navigation;
mod overlay;
mod pixels;
mod renderer;
mod resolution;
mod session;
mod text;
mod window;

use glam::Vec3;
use gs_backend::AnyRasterizer;
use gs_core::{Backend as _, Camera, RenderSettings, Scene as _, Scene2d, Scene3d, view::Bulk};
use gs_io::{IccProfile, LodFile3d};

pub use self::error::Error;
use self::{
    navigation::{CameraNavigator, CanvasNavigator},
    overlay::Subject,
    session::Session,
};

/// What the keys and the pointer do, as text.
pub const KEYS: &str = "\
In the window of a 3D scene:
  drag           turn around the target; when flying, look around
  shift+drag     pan; so does the right button
  wheel          zoom; when flying, change the speed
  F              orbit or fly: W A S D forward, left, back, right; Q E down, up; shift is four \
times as fast
  arrow keys     turn
  R              back to the first camera
  O, or 1 2      order of blending: global, per-pixel
  A, or 3 4 5 6  antialiasing: none, dilate, mip, compensated (when flying, A moves)
  H              hide the text
  Esc            close

In the window of a 2D scene:
  drag, arrows   pan
  wheel, + -     zoom; the Gaussians are rendered anew at each zoom
  R, H, Esc      back to the whole picture; hide the text; close

If frames take longer than 50 ms, they are rendered in fewer pixels while the picture moves; the \
text says so.";

/// A scene to view, and where the view begins.
#[derive(Debug, Clone, Copy)]
pub enum Viewed<'a> {
    /// A 2D scene. All of it is in view at first.
    TwoD {
        /// The scene.
        scene: &'a Scene2d,
        /// Columns of the image that the scene was made for.
        width: u32,
        /// Rows of that image.
        height: u32,
        /// Profile of the scene's colours; `None` for sRGB. Frames are converted to sRGB.
        profile: Option<&'a IccProfile>,
    },
    /// A 3D scene.
    ThreeD {
        /// The scene.
        scene: &'a Scene3d,
        /// The first camera.
        camera: Camera,
        /// The point to orbit around, world units.
        target: Vec3,
        /// The up direction, of any length.
        up: Vec3,
        /// The levels of detail that `scene` has the coarsest of.
        levels: Option<Levels<'a>>,
    },
}

/// A scene with levels of detail, of which the window reads and draws what each camera needs.
#[derive(Debug, Clone, Copy)]
pub struct Levels<'a> {
    /// The file.
    pub file: &'a LodFile3d,
    /// Most Gaussians that are drawn, at least 1; the coarsest levels may have more, and up to twice as many are drawn
    /// while levels change.
    pub budget: usize,
}

/// How a scene is viewed.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Options {
    /// The name of the scene, for the title and the overlay.
    pub name: String,
    /// Columns and rows of the window, px.
    pub size: (u32, u32),
    /// Effects and background at first.
    pub settings: RenderSettings,
}

impl Options {
    /// A window of `size` (columns and rows, px) for the scene called `name`, drawn at first with
    /// these settings.
    pub fn new(name: impl Into<String>, size: (u32, u32), settings: RenderSettings) -> Self {
        Self { name: name.into(), size, settings }
    }
}

/// Shows a scene in a window until it is closed. It must be called on the main thread.
///
/// # Errors
/// [`Error::NoDisplay`]; [`Error::Window`] if the window fails; [`Error::Backend`] if the backend
/// does; [`Error::NothingVisible`] for a 3D scene without a Gaussian that can be seen.
pub fn view(scene: Viewed<'_>, rasterizer: &AnyRasterizer, options: Options) -> Result<(), Error> {
    let Options { name, size, settings } = options;
    let subject = |gaussians: usize, sh_degree: u8| {
        let machine = rasterizer.describe();
        Subject { name, gaussians, sh_degree, machine }
    };
    match scene {
        Viewed::TwoD { scene, width, height, profile } => {
            let session = Session::new(CanvasNavigator::new(width, height), settings);
            window::show(rasterizer, (scene, profile, None), subject(scene.len(), 0), session, size)
        }
        Viewed::ThreeD { scene, camera, target, up, levels } => {
            let bulk = Bulk::of(scene).ok_or(Error::NothingVisible)?;
            // The target has to be ahead; a point beside the axis is taken at its depth.
            let depth = camera.to_camera(target).z;
            let distance = if depth > 0.0 { depth } else { bulk.radius };
            let session = Session::new(CameraNavigator::new(&camera, distance, up, bulk), settings);
            let all = levels.and_then(|levels| levels.file.counts().first().copied());
            let subject = subject(all.unwrap_or(scene.len()), scene.sh_degree);
            let finer = levels.map(|Levels { file, budget }| levels::finer(file.clone(), budget));
            window::show(rasterizer, (scene, None, finer), subject, session, size)
        }
    }
}
