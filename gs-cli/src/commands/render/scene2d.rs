//! `gs render` of a 2D scene: a picture of any size, or a part of it.

use glam::Vec2;
use gs_backend::FutureExt as _;
use gs_core::{Canvas, Rasterizer as _, effects::RequiredEffects};
use gs_io::File2d;
use gs_lab::frontier::FrontierSettings;

use super::RenderArgs;
use crate::{
    effects_args,
    failure::Failure,
    frontier_settings, memory, output, output_folder,
    values::{Region, Size},
};

/// Renders a scene into a PNG.
pub(super) fn run(args: &RenderArgs, mut file: File2d) -> Result<(), Failure> {
    output_folder::check_file(&args.output, args.inputs())?;
    let canvas = canvas(&file, args);
    canvas.validate().map_err(|error| Failure::usage(error).at("--size or --region"))?;
    memory::check_picture(args.scene.display(), (canvas.width, canvas.height))?;
    let frontier = args.settings.as_deref().map(frontier_settings::read).transpose()?;
    if let Some(FrontierSettings { accuracy, .. }) = &frontier {
        file.settings.accuracy = *accuracy;
    }
    let RequiredEffects { settings, decisions } = args.effects().choose(&file.scene, &[canvas], &file.settings)?;
    let backend = args.backend(frontier.as_ref()).open_to_render_2d(&settings)?;
    let image = backend.rasterizer.render(&file.scene, &canvas, &settings).block_on()?;
    gs_io::write_png(&args.output, &image)?;
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
