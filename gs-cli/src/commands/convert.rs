//! `gs convert`: a spatial scene from one format into another, and what of it is lost on the way.

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
use serde::Serialize;

use crate::{failure::Failure, output, output_folder};

/// The flags of `gs convert`.
#[derive(Debug, Clone, Args)]
pub(crate) struct ConvertArgs {
    /// The scene: PLY (3DGS or compressed), .splat, SPZ, .gltf or .glb, told by its content
    from: PathBuf,
    /// The file to write; its ending says the format: .ply, .splat, .spz, .gltf or .glb
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

impl ConvertArgs {
    /// Whether the numbers go into a second file.
    fn gltf_buffer_beside(&self) -> bool {
        matches!(self.gltf_buffer, Buffer::Beside) && self.to.extension().is_some_and(|ending| ending == "gltf")
    }
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
    if SpatialFormat::to_write(&args.to).is_none() {
        return Err(gs_io::Error::UnknownEnding { path: args.to.clone() }.into());
    }
    // The numbers of a .gltf may be in a file of the same name.
    let inputs = [args.from.clone(), args.from.with_extension("bin")];
    output_folder::check_file(&args.to, &inputs)?;
    if args.gltf_buffer_beside() {
        output_folder::check_file(&args.to.with_extension("bin"), &inputs)?;
    }
    let file =
        if args.drop_broken { gs_io::read_spatial_unchecked(&args.from) } else { gs_io::read_spatial(&args.from) };
    let file = file.map_err(Failure::of_scene)?;
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
        read: Side::new(&args.from, file.format, file.bytes, all),
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
