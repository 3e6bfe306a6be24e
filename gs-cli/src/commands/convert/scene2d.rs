//! `gs convert` of a 2D scene: into a PLY that splat viewers show as the image, or into an SVG.

use std::path::Path;

use gs_backend::FutureExt as _;
use gs_core::{Scene as _, counted, examination};
use gs_io::{File2d, Format3d, write_ply, write_svg};
use gs_train::{ColorRange, Viewable, viewable};
use serde::Serialize;

use super::ConvertArgs;
use crate::{
    backend::{BackendArgs, Choice},
    failure::Failure,
    memory, output,
};

/// What `gs convert --json` prints of a 2D scene.
#[derive(Debug, Serialize)]
struct Conversion {
    read: String,
    written: String,
    /// Size of the written file.
    bytes: u64,
    /// Width of the image, px.
    width: u32,
    height: u32,
    /// Number of Gaussians in the written file.
    gaussians: usize,
    /// Gaussians that `--drop-broken` left out.
    dropped: usize,
    /// PSNR of the written Gaussians, as a viewer shows them, against the scene, dB; `null` if they
    /// are equal.
    psnr: f64,
}

/// Whether a file is an SVG by its ending.
pub(super) fn is_svg(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg"))
}

/// Converts a 2D scene that was read from `from`.
pub(super) fn run(args: &ConvertArgs, from: &Path, mut file: File2d) -> Result<(), Failure> {
    let range = match (is_svg(&args.to), Format3d::to_write(&args.to)) {
        (true, _) => ColorRange::Unit,
        (false, Some(Format3d::Ply)) => ColorRange::NotNegative,
        (false, _) => {
            let failure = Failure::usage("a 2D scene is not written in this format").at(args.to.display());
            return Err(failure.hint("let its name end in .ply or .svg; gs convert makes other formats of the PLY"));
        }
    };
    memory::check_picture(from.display(), (file.width, file.height))?;
    let dropped = if args.drop_broken { examination::repair(&mut file.scene)?.removed } else { 0 };
    // GPUs do not offer all that is needed.
    let cpu = BackendArgs { backend: Choice::Cpu, ..BackendArgs::default() }.open()?;
    let Viewable { file: made, psnr, .. } = viewable(&cpu.rasterizer, &file, range).block_on()?;
    match range {
        ColorRange::Unit => write_svg(&args.to, &made)?,
        ColorRange::NotNegative => write_ply(&args.to, &made)?,
    }
    let conversion = Conversion {
        read: from.display().to_string(),
        written: args.to.display().to_string(),
        bytes: std::fs::metadata(&args.to).map_or(0, |file| file.len()),
        width: made.width,
        height: made.height,
        gaussians: made.scene.len(),
        dropped,
        psnr,
    };
    if args.json { output::json(&conversion) } else { output::result(text(&conversion)) }
}

fn text(conversion: &Conversion) -> String {
    let Conversion { read, written, bytes, width, height, gaussians, dropped, psnr } = conversion;
    let dropped = if *dropped > 0 {
        format!("\ndropped     {} that cannot be drawn", counted(*dropped, "Gaussian"))
    } else {
        String::new()
    };
    format!(
        "read        {read}: 2D scene, {width}x{height} px{dropped}\nGaussians   {gaussians}\nwrote       {written}, {bytes} bytes\n\
         PSNR        {psnr:.2} dB of the written Gaussians, seen from the front at {width}x{height} px, against the scene"
    )
}
