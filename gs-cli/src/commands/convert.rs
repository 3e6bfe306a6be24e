//! `gs convert`: a 3D scene from one format into another, or a 2D scene for viewers, and what of it is lost on the way.

pub(crate) mod planar;

use std::{
    fmt::Write,
    path::{Path, PathBuf},
};

use clap::{Args, ValueEnum};
use gs_core::{
    Scene,
    examination::{self, Repair},
};
use gs_io::{GltfBuffer, Loss, SpatialFormat, SpatialOptions, SpzOptions, SpzVersion};
use gs_train::{Opened, OpenedScene, Values};
use serde::Serialize;

use crate::{failure::Failure, opened, output};

const AFTER_HELP: &str = "\
A 2D scene becomes a flat 3D scene (.ply) that viewers of 3D Gaussian splats show as the picture, or an SVG of soft ellipses. Viewers \
blend Gaussians front to back, widen them by 0.3 square pixels, and have no negative colours and no background. So the Gaussians are \
trained for that first, which takes a second or two for a photograph. The PSNR that is printed says how well the new Gaussians show what \
the scene shows.";

/// The flags of `gs convert`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct ConvertArgs {
    /// The scene: PLY (3DGS or compressed), .splat, SPZ, .gltf or .glb, told by its content; a 2D scene, a checkpoint, or the
    /// output folder of gs fit or gs train
    from: PathBuf,
    /// The file to write; its ending says the format: .ply, .splat, .spz, .gltf or .glb; of a 2D scene .ply or .svg
    to: PathBuf,
    /// Version of an SPZ: 4 is smaller, 3 for readers older than 2026
    #[arg(long, value_name = "VERSION", default_value = "4")]
    spz_version: Version,
    /// Where the numbers of a .gltf go
    #[arg(long, value_name = "PLACE", default_value = "inside")]
    gltf_buffer: Buffer,
    /// Leave out Gaussians that cannot be drawn, and say how many; gs doctor tells which and why
    #[arg(long)]
    drop_broken: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Version {
    #[value(name = "3")]
    V3,
    #[value(name = "4")]
    V4,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Buffer {
    /// Into the JSON as base64
    Inside,
    /// Into a .bin of the same name
    Beside,
}

/// What `gs convert --json` prints.
#[derive(Debug, Serialize)]
struct Conversion {
    read: Side,
    written: Side,
    gaussians: usize,
    sh_degree: u8,
    /// Gaussians that `--drop-broken` left out.
    dropped: usize,
    /// What of the read file is not in the written one, in words.
    lost: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Side {
    file: String,
    format: String,
    /// With the buffer beside a glTF.
    bytes: u64,
    bytes_per_gaussian: f64,
}

impl Side {
    fn new(path: &Path, format: SpatialFormat, bytes: u64, gaussians: usize) -> Self {
        let bytes_per_gaussian = bytes as f64 / gaussians as f64;
        Self { file: path.display().to_string(), format: format.to_string(), bytes, bytes_per_gaussian }
    }
}

/// Converts a scene.
///
/// # Errors
/// Where it cannot be read, holds what is not finite and is not told to drop it, or cannot be written.
pub(crate) fn run(args: &ConvertArgs) -> Result<(), Failure> {
    if SpatialFormat::to_write(&args.to).is_none() && !planar::is_svg(&args.to) {
        return Err(gs_io::Error::UnknownEnding { path: args.to.clone() }.into());
    }
    let values = if args.drop_broken { Values::Any } else { Values::Checked };
    let Opened { path, scene, .. } = opened::open(&args.from, values)?;
    let file = match scene {
        OpenedScene::Planar(file) => return planar::run(args, &path, *file),
        OpenedScene::Spatial { file, .. } => file,
    };
    if planar::is_svg(&args.to) {
        let message = "a 3D scene is not written as SVG, which is for 2D scenes";
        return Err(Failure::usage(message).at(args.to.display()).mend("gs render draws it as PNG"));
    }
    let (all, mut scene, mut losses) = (file.scene.len(), file.scene, file.losses);
    if args.drop_broken {
        let Repair { widened, .. } = examination::repair(&mut scene)?;
        losses.extend((widened > 0).then_some(Loss::ZeroScales { gaussians: widened }));
    }
    let options = SpatialOptions {
        spz: SpzOptions {
            version: match args.spz_version {
                Version::V3 => SpzVersion::V3,
                Version::V4 => SpzVersion::V4,
            },
            ..SpzOptions::default()
        },
        gltf_buffer: match args.gltf_buffer {
            Buffer::Inside => GltfBuffer::Inside,
            Buffer::Beside => GltfBuffer::Beside,
        },
    };
    let written = gs_io::write_spatial(&args.to, &scene, &options).map_err(Failure::of_scene)?;
    let size = |path: &Path| std::fs::metadata(path).map_or(0, |file| file.len());
    let bytes = size(&args.to) + written.beside.as_deref().map_or(0, size);
    let conversion = Conversion {
        read: Side::new(&path, file.format, file.bytes, all),
        written: Side::new(&args.to, written.format, bytes, scene.len()),
        gaussians: scene.len(),
        sh_degree: scene.sh_degree,
        dropped: all - scene.len(),
        lost: losses.iter().chain(&written.losses).map(Loss::to_string).collect(),
    };
    if args.json { output::json(&conversion) } else { output::result(text(&conversion)) }
}

fn text(conversion: &Conversion) -> String {
    let Conversion { read, written, gaussians, sh_degree, dropped, lost } = conversion;
    let side = |Side { file, format, bytes, bytes_per_gaussian }: &Side| {
        format!("{file}: {format}, {bytes} bytes, {bytes_per_gaussian:.1} a Gaussian")
    };
    let mut text = format!("read        {}\nGaussians   {gaussians}, SH degree {sh_degree}\n", side(read));
    if *dropped > 0 {
        let _ = writeln!(text, "dropped     {dropped} Gaussians that cannot be drawn");
    }
    let _ = write!(text, "wrote       {}", side(written));
    if lost.is_empty() {
        text += "\nlost        nothing";
    }
    lost.iter().for_each(|loss| _ = write!(text, "\nlost        {loss}"));
    text
}
