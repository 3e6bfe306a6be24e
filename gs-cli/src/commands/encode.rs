//! `gs encode`: an image becomes a compressed `.gsi` file.

use std::{path::PathBuf, str::FromStr};

use clap::Args;
use gs_backend::FutureExt as _;
use gs_core::counted;
use gs_io::{GSI_EXTENSION, write_durably};
use gs_train::{EncodeSettings, EncodeTarget, Encoded, FitSettings, Preset, encode};
use serde::Serialize;

use crate::{
    backend::BackendArgs,
    failure::Failure,
    image_fit::Target,
    memory::{self, Need},
    output, output_folder,
    values::{Color, whole},
};

const AFTER_HELP: &str = "\
gs decode FILE.gsi -o PNG makes a picture of the file, of any size; gs view shows it, and all other \
commands that take a 2D scene read it. The PSNR is that of the decoded 8-bit picture. Transparent \
pixels are encoded as they look on white or on --background.";

/// The flags of `gs encode`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct EncodeArgs {
    /// The image: PNG, JPEG, BMP, TIFF, WebP, GIF or PNM
    image: PathBuf,
    /// The .gsi file to write
    #[arg(short, long, value_name = "FILE.gsi")]
    output: PathBuf,
    #[command(flatten)]
    target: TargetArgs,
    /// Make a file whose beginning shows the picture: a third of it looks like a file of that size
    #[arg(long)]
    progressive: bool,
    /// Colour behind transparent pixels: R,G,B from 0 to 1, black or white [default: white]
    #[arg(long, value_name = "R,G,B")]
    background: Option<Color>,
    /// Seed of all random numbers
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u32,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    backend: BackendArgs,
}

/// What the file must be; at most one.
#[derive(Debug, Clone, Args)]
#[group(multiple = false)]
#[command(next_help_heading = "Target")]
struct TargetArgs {
    /// Largest size, bits per pixel
    #[arg(long, value_name = "BITS", value_parser = positive)]
    bpp: Option<f64>,
    /// Largest size, such as 40k or 40000 bytes
    #[arg(long, value_name = "SIZE")]
    bytes: Option<Bytes>,
    /// Least PSNR, dB: the smallest file that has it
    #[arg(long, value_name = "DB", value_parser = positive)]
    psnr: Option<f64>,
    /// Quality from 1 (small file) to 100 (best image) [default: 50]
    #[arg(long, value_name = "Q", value_parser = whole::<u8>(1..=100))]
    quality: Option<u8>,
}

impl TargetArgs {
    fn of_image(&self, (width, height): (u32, u32)) -> EncodeTarget {
        let pixels = f64::from(width) * f64::from(height);
        match (self.bpp, self.bytes, self.psnr) {
            (Some(bits), ..) => EncodeTarget::Bytes((bits * pixels / 8.0) as u64),
            (_, Some(Bytes(bytes)), _) => EncodeTarget::Bytes(bytes),
            (.., Some(psnr)) => EncodeTarget::Psnr(psnr),
            _ => EncodeTarget::Quality(self.quality.unwrap_or(50)),
        }
    }
}

/// A number of bytes, with k for thousands and M for millions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Bytes(u64);

impl FromStr for Bytes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (number, unit) = match text.char_indices().last() {
            Some((end, 'k' | 'K')) => (&text[..end], 1e3),
            Some((end, 'm' | 'M')) => (&text[..end], 1e6),
            _ => (text, 1.0),
        };
        match number.parse::<f64>() {
            Ok(count) if count > 0.0 && count * unit < 1e12 => Ok(Self((count * unit) as u64)),
            _ => Err("write it as a number of bytes, such as 40000, 40k or 1.5M".to_owned()),
        }
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("must be a positive number".to_owned()),
    }
}

/// What `gs encode --json` prints; a PSNR of ∞ is `null`.
#[derive(Debug, Serialize)]
struct Summary {
    written: String,
    width: u32,
    height: u32,
    bytes: usize,
    /// Bits per pixel.
    bpp: f64,
    gaussians: usize,
    /// PSNR of the decoded 8-bit picture against the image, dB.
    psnr: f64,
    seconds: f64,
}

/// Encodes an image.
pub(crate) fn run(args: &EncodeArgs) -> Result<(), Failure> {
    if args.output.extension().is_none_or(|ending| ending != GSI_EXTENSION) {
        let failure = Failure::usage("a compressed image is written as .gsi").at(args.output.display());
        return Err(failure.hint("let its name end in .gsi"));
    }
    memory::check_image(&args.image)?;
    let target = Target::read(Some(&args.image), args.background)?;
    target.remarks.iter().for_each(output::note);
    output_folder::check_file(&args.output, [&args.image])?;
    let (width, height) = target.image.size();
    let settings = EncodeSettings::default().with(|s| {
        s.target = args.target.of_image((width, height));
        s.progressive = args.progressive;
        s.seed = args.seed;
    });
    settings.validate()?;
    let fit: FitSettings = FitSettings::from_preset(Preset::Standard, (width, height), None, None);
    let (what, held) = (format!("encoding {}", target.name()), size_of_val(target.image.pixels()) as u64);
    Need { what, bytes: 2 * fit.peak_bytes((width, height)), held, less: "take a smaller image" }.check_and_print()?;
    let backend = args.backend.open_to_render_2d(&fit.render)?;
    output::note(&backend.reason);
    let Encoded { bytes, gaussians, psnr, seconds, .. } =
        encode(&backend.rasterizer, &target.image, &settings).block_on()?;
    write_durably(&args.output, |file| file.write_all(&bytes))?;
    let bpp = bytes.len() as f64 * 8.0 / (f64::from(width) * f64::from(height));
    let written = args.output.display().to_string();
    if args.json {
        return output::json(&Summary { written, width, height, bytes: bytes.len(), bpp, gaussians, psnr, seconds });
    }
    output::result(format_args!(
        "wrote      {written}, {} ({bpp:.3} bits per pixel of {width}x{height} px)\n\
         holds      {}\nPSNR       {psnr:.2} dB of the decoded picture\ntime       {seconds:.1} s",
        counted(bytes.len(), "byte"),
        counted(gaussians, "Gaussian"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units() {
        assert_eq!(
            ["40000", "40k", "1.5M"].map(|text| text.parse::<Bytes>()),
            [40_000, 40_000, 1_500_000].map(|b| Ok(Bytes(b)))
        );
        for wrong in ["", "k", "-4k", "40kB", "1e30"] {
            assert!(wrong.parse::<Bytes>().is_err(), "{wrong}");
        }
    }
}
