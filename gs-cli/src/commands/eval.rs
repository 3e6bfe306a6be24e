//! `gs eval`: how close two images are.

use std::path::{Path, PathBuf};

use clap::Args;
use gs_core::{Image, metrics};
use serde::Serialize;

use crate::{failure::Failure, output};

/// The flags of `gs eval`.
#[derive(Debug, Clone, Args)]
pub(crate) struct EvalArgs {
    /// One image
    a: PathBuf,
    /// The other, of the same size
    b: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// What `gs eval --json` prints; a PSNR of ∞ (equal images) is `null`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Comparison {
    width: u32,
    height: u32,
    psnr: f64,
    ssim: f64,
    /// `null` where a side is shorter than 161 px, too small for its five scales.
    ms_ssim: Option<f64>,
    l1: f64,
}

/// Compares two images.
///
/// # Errors
/// Where one cannot be read, or their sizes differ.
pub(crate) fn run(args: &EvalArgs) -> Result<(), Failure> {
    let (a, b) = (read(&args.a)?, read(&args.b)?);
    if a.size() != b.size() {
        let size =
            |path: &Path, image: &Image| format!("{} is {}x{} px", path.display(), image.width(), image.height());
        let message = format!("sizes differ: {}, {}", size(&args.a, &a), size(&args.b, &b));
        return Err(Failure::failed(message).mend("compare images of one size; gs render --size makes one"));
    }
    let comparison = Comparison {
        width: a.width(),
        height: a.height(),
        psnr: metrics::psnr(&a, &b)?,
        ssim: metrics::ssim(&a, &b)?,
        ms_ssim: metrics::ms_ssim(&a, &b)?,
        l1: metrics::mean_absolute_error(&a, &b)?,
    };
    if args.json {
        return output::json(&comparison);
    }
    let Comparison { width, height, psnr, ssim, ms_ssim, l1 } = comparison;
    let ms_ssim = ms_ssim.map_or_else(|| "none below 161 px a side".to_owned(), |value| format!("{value:.5}"));
    output::result(format_args!(
        "size     {width}x{height} px\nPSNR     {psnr:.3} dB\nSSIM     {ssim:.5}\nMS-SSIM  {ms_ssim}\nL1       {l1:.6}"
    ))
}

fn read(path: &Path) -> Result<Image, Failure> {
    Ok(gs_io::read_image(path)?.image)
}
