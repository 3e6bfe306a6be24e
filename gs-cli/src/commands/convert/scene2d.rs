//! `gs convert` of a 2D scene, from a `.gsi` file, a checkpoint or a scene file, into a scene file.

use std::{fmt::Write, path::Path};

use gs_core::{
    Scene as _, counted,
    examination::{self, Repair},
};
use gs_io::{ConversionLoss, File2d, SCENE_EXTENSION, write_2d};
use serde::Serialize;

use super::{ConvertArgs, none_is_left};
use crate::{failure::Failure, files::scene::is_scene_2d, terminal::output};

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
}

/// Converts a 2D scene that was read from `from`.
pub(super) fn run(args: &ConvertArgs, from: &Path, mut file: File2d, has_alpha: bool) -> Result<(), Failure> {
    if !is_scene_2d(&args.to) {
        let failure = Failure::usage("cannot write a 2D scene in this format").at(args.to.display());
        return Err(failure.hint(format_args!("use .{SCENE_EXTENSION}, or draw a PNG with gs render")));
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
    write_2d(&args.to, &file)?;
    let conversion = Conversion {
        read: from.display().to_string(),
        written: args.to.display().to_string(),
        bytes: std::fs::metadata(&args.to).map_or(0, |file| file.len()),
        width: file.width,
        height: file.height,
        gaussians: file.scene.len(),
        dropped,
        lost,
    };
    output::answer(args.json, &conversion, || text(&conversion))
}

fn text(conversion: &Conversion) -> String {
    let Conversion { read, written, bytes, width, height, gaussians, dropped, lost } = conversion;
    let mut text = format!("read        {read}: 2D scene, {width}x{height} px\n");
    if *dropped > 0 {
        let _ = writeln!(text, "dropped     {} that cannot be drawn", counted(*dropped, "Gaussian"));
    }
    let _ = write!(text, "Gaussians   {gaussians}\nwrote       {written}, {bytes} bytes");
    lost.iter().for_each(|what| _ = write!(text, "\nlost        {what}"));
    if lost.is_empty() && *dropped == 0 {
        text += "\nlost        nothing";
    }
    text
}
