//! `gs render` of a 2D scene: a picture of any size, or a part of it.

use glam::Vec2;
use gs_backend::FutureExt as _;
use gs_core::{Canvas, effects::RequiredEffects};
use gs_io::{File2d, GsiFile, PngExtras, StoredImage, write_png_with};
use gs_train::draw_picture;

use super::RenderArgs;
use crate::{
    failure::Failure,
    files::output_folder,
    flags::{
        effects_args,
        values::{Region, Size},
    },
    memory,
    terminal::output,
};

/// Renders a picture into a PNG.
pub(super) fn run(args: &RenderArgs, mut picture: GsiFile) -> Result<(), Failure> {
    output_folder::check_file(&args.output, args.inputs())?;
    let canvas = canvas(&picture.colors, args);
    canvas.validate().map_err(|error| Failure::usage(error).at("--size or --region"))?;
    memory::check_picture(args.scene.display(), (canvas.width, canvas.height))?;
    picture.colors.settings = args.with_accuracy(picture.colors.settings)?;
    let File2d { scene, settings, .. } = &picture.colors;
    let RequiredEffects { settings, decisions } = args.effects.choice().choose(scene, &[canvas], settings)?;
    picture.colors.settings = settings;
    if let Some(alpha) = &mut picture.alpha {
        alpha.settings = settings.on(alpha.settings.background_color());
    }
    let backend = args.backend.open_to_render_2d(&settings)?;
    let StoredImage { image, alpha, profile, .. } = draw_picture(&backend.rasterizer, &picture, &canvas).block_on()?;
    let extras = PngExtras { alpha: alpha.as_deref(), profile: profile.as_ref() };
    write_png_with(&args.output, &image, extras)?;
    if let Some(effects) = effects_args::describe(&decisions).filter(|_| args.verbose) {
        output::note(effects);
    }
    output::note(format_args!("wrote {}, {}x{} px", args.output.display(), canvas.width, canvas.height));
    Ok(())
}

fn canvas(file: &File2d, args: &RenderArgs) -> Canvas {
    let whole = Region { origin: Vec2::ZERO, extent: Vec2::new(file.width as f32, file.height as f32) };
    let Region { origin, extent } = args.region.unwrap_or(whole);
    // Rounded up: a region of less than a pixel still has one.
    let natural = Size { width: extent.x.ceil() as u32, height: extent.y.ceil() as u32 };
    let Size { width, height } = args.size.unwrap_or(natural);
    Canvas::new(width, height).showing(origin, extent)
}
