//! `gs render` of an image's scene: a picture of any size, or a part of it.

use glam::Vec2;
use gs_core::{Canvas, Image, Optimizer, RenderSettings, Scene2d, effects::RequiredEffects};
use gs_io::File2d;
use pollster::FutureExt as _;

use super::RenderArgs;
use crate::{
    backend::{Backend, Task},
    chosen::ChosenSettings,
    effects::choice::told,
    failure::Failure,
    memory, output, output_folder,
    values::{Region, Size},
};

/// Renders a scene into a PNG.
///
/// # Errors
/// Where the size is not possible, or the picture cannot be written.
pub(super) fn run(args: &RenderArgs, mut file: File2d) -> Result<(), Failure> {
    output_folder::check_file(&args.output, args.inputs())?;
    let canvas = canvas(&file, args);
    canvas.validate().map_err(|error| Failure::usage(error).at("--size or --region"))?;
    memory::check_picture(args.scene.display(), (canvas.width, canvas.height))?;
    let chosen = args.settings.as_deref().map(ChosenSettings::read).transpose()?;
    if let Some(ChosenSettings { accuracy, .. }) = &chosen {
        file.settings.accuracy = *accuracy;
    }
    let RequiredEffects { settings, decisions: verdicts } =
        args.effects().choose(&file.scene, &[canvas], &file.settings)?;
    let flags = args.backend.or_chosen(chosen.as_ref().map(|chosen| &chosen.machine));
    let backend = Backend::start_for_image(&flags, &settings)?;
    let image = backend.run(Render { file: &file, canvas: &canvas, settings: &settings })?;
    gs_io::write_png(&args.output, &image)?;
    if let Some(told) = told(&verdicts).filter(|_| args.verbose) {
        output::note(told);
    }
    output::note(format_args!("wrote {}, {}x{} px", args.output.display(), canvas.width, canvas.height));
    Ok(())
}

fn canvas(file: &File2d, args: &RenderArgs) -> Canvas {
    let whole = Region { origin: Vec2::ZERO, extent: Vec2::new(file.width as f32, file.height as f32) };
    let Region { origin, extent } = args.region.unwrap_or(whole);
    // Rounding up, a region of less than a pixel still has one.
    let natural = Size { width: extent.x.ceil() as u32, height: extent.y.ceil() as u32 };
    let Size { width, height } = args.size.unwrap_or(natural);
    Canvas::new(width, height).showing(origin, extent)
}

struct Render<'a> {
    file: &'a File2d,
    canvas: &'a Canvas,
    settings: &'a RenderSettings,
}

impl Task for Render<'_> {
    type Output = Result<Image, gs_core::Error>;

    fn run<R: Optimizer<Scene2d>>(self, rasterizer: &R) -> Self::Output {
        rasterizer.render(&self.file.scene, self.canvas, self.settings).block_on()
    }
}
