//! `gs view`: a scene in a window.

use std::path::PathBuf;

use clap::Args;
use glam::Vec3;

use crate::{
    failure::Failure,
    flags::{
        backend::BackendArgs,
        dataset::ReadingArgs,
        effects_args::{EffectsArgs, EffectsChoice},
        render_args::RenderArgs3d,
        values::{Size, ViewName, axis, whole},
    },
};

/// What to do without a window.
const HINT: &str = "without a display, gs render SCENE -o turn.apng --orbit 60 shows a scene from all sides";

fn after_help() -> String {
    #[cfg(feature = "viewer")]
    let keys = gs_viewer::KEYS;
    #[cfg(not(feature = "viewer"))]
    let keys = "This program was built without its feature `viewer`, so it has no window.";
    format!("{keys}\n\nWithout a display, gs render SCENE -o turn.apng --orbit 60 shows the same.")
}

/// The flags of `gs view`.
#[derive(Debug, Clone, Args)]
#[command(after_help = after_help())]
#[cfg_attr(not(feature = "viewer"), allow(dead_code, reason = "only the window reads them"))]
pub(crate) struct ViewArgs {
    /// The scene: a scene file, a checkpoint, or the output folder of gs fit or gs train
    scene: PathBuf,
    /// Size of the picture [default: 800x600, or the proportions of the view]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Draw at most N Gaussians of a scene with levels of detail, which are chosen as the camera moves
    /// [default: 1000000]
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..))]
    max_gaussians: Option<u32>,
    /// Begin with the camera of a view of a data set
    #[arg(long, value_name = "DATASET:VIEW", help_heading = "Camera")]
    camera: Option<ViewName>,
    /// Up direction, around which the camera turns: x, y, z, -x, -y or -z [default: that of the
    /// data set, otherwise -y]
    #[arg(long, value_name = "AXIS", value_parser = axis, allow_hyphen_values = true, help_heading = "Camera")]
    up: Option<Vec3>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    effects: EffectsArgs,
    #[command(flatten)]
    render: RenderArgs3d,
    #[command(flatten)]
    backend: BackendArgs,
}

/// Fails, as this build has no window.
#[cfg(not(feature = "viewer"))]
pub(crate) fn run(_: &ViewArgs) -> Result<(), Failure> {
    Err(Failure::failed("gs view needs a program built with its feature `viewer`").hint(HINT))
}

#[cfg(feature = "viewer")]
pub(crate) use self::window::run;

#[cfg(feature = "viewer")]
mod window {
    use gs_core::{check_size, effects::RequiredEffects};
    use gs_io::{AnyScene, File2d, File3d};
    use gs_viewer::{Options, Viewed, view};

    use super::*;
    use crate::{
        files::{lod::Lod, scene},
        flags::cameras::Home,
        memory,
    };

    /// The largest default size of a window, px: images may be larger than screens.
    const LARGEST: Size = Size { width: 1280, height: 800 };

    /// Shows a scene until its window is closed.
    pub(crate) fn run(args: &ViewArgs) -> Result<(), Failure> {
        if let Some(lod) = Lod::for_window(&args.scene, args.max_gaussians)? {
            return run_3d(args, &lod.coarsest()?, Some(&lod));
        }
        match scene::read_any(&args.scene)? {
            AnyScene::TwoD(file) => run_2d(args, &file),
            AnyScene::ThreeD(file) => run_3d(args, &file, None),
        }
    }

    fn run_2d(args: &ViewArgs, file: &File2d) -> Result<(), Failure> {
        if args.camera.is_some() || args.up.is_some() || args.render.is_some() {
            let message = "is a 2D scene, which has no camera, order or background to choose";
            return Err(Failure::usage(message).at(args.scene.display()).hint("use --size alone"));
        }
        let size = size(args, file.width, file.height)?;
        let backend = args.backend.open()?;
        let RequiredEffects { settings, .. } = args.effects.choice().choose(&file.scene, &[], &file.settings)?;
        let File2d { scene, width, height, profile, .. } = file;
        let viewed = Viewed::TwoD { scene, width: *width, height: *height, profile: profile.as_ref() };
        view(viewed, &backend.rasterizer, Options::new(name(args), size, settings)).map_err(failure)
    }

    fn run_3d(args: &ViewArgs, file: &File3d, lod: Option<&Lod>) -> Result<(), Failure> {
        let scene = &file.scene;
        let (Home { camera, target, up }, dataset) =
            Home::named(args.camera.as_ref(), &args.reading, file, args.size, args.up)?;
        let settings = args.render.settings(file, dataset.as_ref());
        camera.validate().map_err(|error| Failure::usage(error).at("--camera or --size"))?;
        let size = size(args, camera.width, camera.height)?;
        let backend = args.backend.open()?;
        // The camera may move anywhere, so the effects must be right from everywhere.
        let RequiredEffects { settings: mut chosen, .. } = args.effects.choice().choose(scene, &[], &settings)?;
        if lod.is_some() && matches!(args.effects.choice(), EffectsChoice::Auto) {
            // Finer levels may vary more with the direction than the coarsest do.
            chosen.effects.sh_degree = settings.effects.sh_degree;
        }
        let levels = lod.map(Lod::levels).map(|(file, budget)| gs_viewer::Levels { file, budget });
        let viewed = Viewed::ThreeD { scene, camera, target, up, levels };
        view(viewed, &backend.rasterizer, Options::new(name(args), size, chosen)).map_err(failure)?;
        args.render.note_guess(file);
        Ok(())
    }

    fn name(args: &ViewArgs) -> String {
        args.scene.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    }

    fn failure(error: gs_viewer::Error) -> Failure {
        match error {
            gs_viewer::Error::Backend(error) => error.into(),
            error @ (gs_viewer::Error::NoDisplay | gs_viewer::Error::Window { .. }) => {
                Failure::failed(error).hint(HINT)
            }
            error => Failure::failed(error),
        }
    }

    /// The size of the window: the flag's, or that of the picture, scaled down if it is too large
    /// for a screen.
    fn size(args: &ViewArgs, width: u32, height: u32) -> Result<(u32, u32), Failure> {
        let Size { width, height } = args.size.unwrap_or_else(|| default_size(width, height));
        check_size(width, height).map_err(|error| Failure::usage(error).at("--size"))?;
        memory::check_picture(args.scene.display(), (width, height))?;
        Ok((width, height))
    }

    fn default_size(width: u32, height: u32) -> Size {
        let (width, height) = (width as f32, height as f32);
        let scale = (LARGEST.width as f32 / width).min(LARGEST.height as f32 / height).min(1.0);
        let scaled = |side: f32| ((side * scale).round() as u32).max(1);
        Size { width: scaled(width), height: scaled(height) }
    }

    #[test]
    fn the_default_window_fits_the_screen_and_the_picture() {
        assert_eq!(default_size(800, 600), Size { width: 800, height: 600 });
        assert_eq!(default_size(1296, 1936), Size { width: 536, height: 800 });
        assert_eq!(default_size(16_000, 1), Size { width: 1280, height: 1 });
    }
}
