//! `gs render`: a scene as a picture of any size, or a part of it.

use std::path::PathBuf;

use clap::Args;
use glam::Vec2;
use gs_core::{Canvas, Image, PlanarScene, Rasterizer};
use gs_io::PlanarFile;

use crate::{
    backend::{Backend, BackendArgs, Task},
    failure::Failure,
    output,
    values::{Region, Size},
};

/// The flags of `gs render`.
#[derive(Debug, Clone, Args)]
pub(crate) struct RenderArgs {
    /// The scene, such as the scene.gs2d.safetensors that a fit has written
    scene: PathBuf,
    /// The PNG to write
    #[arg(short, long, value_name = "PNG")]
    output: PathBuf,
    /// Size of the picture; other proportions stretch it [default: that of the image or of the region]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Show only this part, in pixels of the original image; it may reach beyond the border
    #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true)]
    region: Option<Region>,
    #[command(flatten)]
    backend: BackendArgs,
}

/// Renders a scene into a PNG.
///
/// # Errors
/// Where the scene cannot be read, the size is not possible, or the picture cannot be written.
pub(crate) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let file = gs_io::read_scene(&args.scene)?;
    let canvas = canvas(&file, args);
    canvas.validate().map_err(|error| Failure::usage(error).at("--size or --region"))?;
    let image = Backend::start(&args.backend)?.run(Render { file: &file, canvas: &canvas })?;
    gs_io::write_png(&args.output, &image)?;
    output::note(format_args!("wrote {}, {}x{} px", args.output.display(), canvas.width, canvas.height));
    Ok(())
}

fn canvas(file: &PlanarFile, args: &RenderArgs) -> Canvas {
    let whole = Region { origin: Vec2::ZERO, extent: Vec2::new(file.width as f32, file.height as f32) };
    let Region { origin, extent } = args.region.unwrap_or(whole);
    // Rounding up, a region of less than a pixel still has one.
    let natural = Size { width: extent.x.ceil() as u32, height: extent.y.ceil() as u32 };
    let Size { width, height } = args.size.unwrap_or(natural);
    Canvas::new(width, height).showing(origin, extent)
}

struct Render<'a> {
    file: &'a PlanarFile,
    canvas: &'a Canvas,
}

impl Task for Render<'_> {
    type Output = Result<Image, gs_core::Error>;

    fn run<R: Rasterizer<PlanarScene>>(self, rasterizer: &R) -> Self::Output {
        rasterizer.render(&self.file.scene, self.canvas, &self.file.settings)
    }
}
