//! `gs convert` of a 2D scene: into a PLY that splat viewers show as the image, or a scene file (from a
//! `.gsi` file or a checkpoint).

use std::{fmt::Write, path::Path};

use gs_backend::{FutureExt as _, Wanted};
use gs_core::{
    Scene as _, counted,
    examination::{self, Repair},
};
use gs_io::{ConversionLoss, File2d, SCENE_EXTENSION, write_2d, write_ply};
use gs_train::{Viewable, viewable};
use serde::Serialize;

use super::{ConvertArgs, none_is_left};
use crate::{failure::Failure, files::scene::is_scene_2d, flags::backend::BackendArgs, memory, terminal::output};

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
    /// What the written file lacks, in words.
    lost: Vec<String>,
    /// PSNR of the written Gaussians, as a viewer shows them, against the scene, dB; `null` if they
    /// are equal.
    psnr: f64,
}

/// Converts a 2D scene that was read from `from`.
pub(super) fn run(args: &ConvertArgs, from: &Path, mut file: File2d, has_alpha: bool) -> Result<(), Failure> {
    let is_copy = is_scene_2d(&args.to);
    if !is_copy && !args.to.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("ply")) {
        let failure = Failure::usage("cannot write a 2D scene in this format").at(args.to.display());
        return Err(failure
            .hint(format_args!("use .ply or .{SCENE_EXTENSION}; for other 3D formats, write a .ply and convert it")));
    }
    let mut lost: Vec<String> = has_alpha.then(|| "alpha: the picture is on white".to_owned()).into_iter().collect();
    let mut dropped = 0;
    if args.drop_broken {
        let all = file.scene.len();
        let Repair { removed, widened, .. } = examination::repair(&mut file.scene)?;
        if file.scene.is_empty() && all > 0 {
            return Err(none_is_left(all, &args.to));
        }
        dropped = removed;
        lost.extend((widened > 0).then(|| ConversionLoss::ZeroScales { gaussians: widened }.to_string()));
    }
    let (written, psnr) = match is_copy {
        true => {
            write_2d(&args.to, &file)?;
            (file.scene.len(), f64::INFINITY)
        }
        false => trained(args, from, &file)?,
    };
    let conversion = Conversion {
        read: from.display().to_string(),
        written: args.to.display().to_string(),
        bytes: std::fs::metadata(&args.to).map_or(0, |file| file.len()),
        width: file.width,
        height: file.height,
        gaussians: written,
        dropped,
        lost,
        psnr,
    };
    output::answer(args.json, &conversion, || text(&conversion, is_copy))
}

/// Trains Gaussians that viewers show as the scene, and writes them; returns their number and their
/// PSNR.
fn trained(args: &ConvertArgs, from: &Path, file: &File2d) -> Result<(usize, f64), Failure> {
    memory::check_picture(from.display(), (file.width, file.height))?;
    // GPUs do not offer all that is needed.
    let cpu = BackendArgs { backend: Wanted::Cpu, ..BackendArgs::default() }.open()?;
    let Viewable { file: made, psnr, .. } = viewable(&cpu.rasterizer, file).block_on()?;
    write_ply(&args.to, &made)?;
    Ok((made.scene.len(), psnr))
}

fn text(conversion: &Conversion, is_copy: bool) -> String {
    let Conversion { read, written, bytes, width, height, gaussians, dropped, lost, psnr } = conversion;
    let mut text = format!("read        {read}: 2D scene, {width}x{height} px\n");
    if *dropped > 0 {
        let _ = writeln!(text, "dropped     {} that cannot be drawn", counted(*dropped, "Gaussian"));
    }
    let _ = write!(text, "Gaussians   {gaussians}\nwrote       {written}, {bytes} bytes");
    lost.iter().for_each(|what| _ = write!(text, "\nlost        {what}"));
    if psnr.is_finite() {
        let _ = write!(
            text,
            "\nPSNR        {psnr:.2} dB of the written Gaussians, seen from the front at {width}x{height} px, against the scene"
        );
    } else if is_copy && lost.is_empty() && *dropped == 0 {
        text += "\nlost        nothing";
    }
    text
}
