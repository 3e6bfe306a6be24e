//! `gs encode`: images become compressed `.gsi` files.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use clap::Args;
use gs_backend::{Chosen, FutureExt as _};
use gs_core::{Blend, RenderSettings, counted};
use gs_io::{GSI_EXTENSION, IccProfile, Inputs, StoredImage, read_stored_image, write_durably};
use gs_train::{EncodeLayers, EncodeProgress, EncodeSettings, EncodeTarget, EncodeWork, Encoded, Tune, encode};
use serde::Serialize;

use crate::{
    failure::Failure,
    files::output_folder::{self, OutputFolder, OverwriteArgs},
    flags::{
        backend::BackendArgs,
        values::{Color, by_name, bytes, positive, whole},
    },
    image_fit::batch::{self, BatchImage, Done, Row},
    memory::{self, Need},
    terminal::{
        output::{self, printable},
        stages::Stages,
    },
};

const AFTER_HELP: &str = "\
gs decode FILE.gsi -o PNG makes a picture of the file, of any size; gs view shows it, and all other \
commands that take a 2D scene read it. The PSNR is that of the decoded 8-bit picture. Alpha is kept, \
and so is an ICC profile of RGB by a matrix and curves, such as Display P3; colours of other profiles \
are converted to sRGB. The PSNR of a transparent image is that of its premultiplied colours and its \
alpha.

With several images, or a folder, OUTPUT is a folder, made if necessary: photo.jpg becomes \
OUTPUT/photo.gsi. Of a folder, its images are taken, without folders in it. Small images are encoded \
side by side, one for each thread. An image that fails does not keep the others from being encoded; \
a table comes at the end, then the failures, and the exit status is 1. Ctrl-C lets the images under \
way come to their end. Files in OUTPUT are replaced if gs wrote them, others with --overwrite.";

/// The flags of `gs encode`.
#[derive(Debug, Clone, Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct EncodeArgs {
    /// Images, and folders of images: PNG, JPEG, BMP, TIFF, WebP, GIF or PNM
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// The .gsi file to write, or the folder for those of several images
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// The measure to tune for [default: psnr]
    #[arg(long, value_parser = by_name::<Tune>(), value_name = "MEASURE")]
    tune: Option<Tune>,
    /// Let the first third of the file show the picture nearly as well as a file of that size; the whole
    /// is about 1.4 dB worse
    #[arg(long, conflicts_with = "preview")]
    progressive: bool,
    /// Let the first 300 bytes of the file show a coarse picture
    #[arg(long)]
    preview: bool,
    /// Put transparent pixels on this colour of the image's colour space, instead of keeping alpha: R,G,B
    /// from 0 to 1, black or white
    #[arg(long, value_name = "R,G,B")]
    background: Option<Color>,
    /// Memory to take at most: larger images are encoded in bands
    #[arg(long, value_name = "SIZE", default_value = "4G", value_parser = bytes)]
    memory: u64,
    /// Seed of all random numbers
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u32,
    /// Print JSON: an object, or for several images an array of objects; one that failed has "error"
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    target: TargetArgs,
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
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    bytes: Option<u64>,
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
            (_, Some(bytes), _) => EncodeTarget::Bytes(bytes),
            (.., Some(psnr)) => EncodeTarget::Psnr(psnr),
            _ => EncodeTarget::Quality(self.quality.unwrap_or(50)),
        }
    }
}

/// What `gs encode --json` prints; a PSNR of ∞ is `null`.
#[derive(Debug, Serialize)]
struct Summary {
    image: String,
    written: String,
    width: u32,
    height: u32,
    bytes: usize,
    /// Bits per pixel.
    bpp: f64,
    gaussians: usize,
    /// The measure that the file is tuned for (`--tune`).
    tune: Tune,
    /// Whether the file has alpha.
    alpha: bool,
    /// Name of its ICC profile; `null` for sRGB.
    profile: Option<String>,
    /// PSNR of the decoded 8-bit picture against the image, dB.
    psnr: f64,
    seconds: f64,
}

/// Encodes images.
pub(crate) fn run(args: &EncodeArgs) -> Result<(), Failure> {
    let is_gsi = args.output.extension().is_some_and(|ending| ending == GSI_EXTENSION);
    match batch::several(&args.images)? {
        None if !is_gsi => {
            let failure = Failure::usage("a compressed image is written as .gsi").at(args.output.display());
            Err(failure.hint("let its name end in .gsi"))
        }
        None => run_one(args, &args.images[0]),
        Some(_) if is_gsi => {
            let failure = Failure::usage("several images are written into a folder").at(args.output.display());
            Err(failure.hint("name a folder with --output"))
        }
        Some(images) => run_several(args, &images),
    }
}

fn run_one(args: &EncodeArgs, image: &Path) -> Result<(), Failure> {
    let work = Work::read(args, image)?;
    work.image.remarks.iter().for_each(|remark| output::note(printable(&format!("note: {remark}"))));
    output_folder::check_file(&args.output, [image])?;
    work.need().check_and_print()?;
    let backend = args.backend.open_to_render_2d(&RenderSettings::blended(Blend::Sum))?;
    output::note(&backend.reason);
    let stages = Stages::new(Duration::from_secs(1));
    let summary = work.write(&backend, &args.output, &|progress| {
        let work = if progress.work == EncodeWork::Rounding { "rounding" } else { "fitting" };
        let words = format!("{work} {}", counted(progress.gaussians, "Gaussian"));
        stages.show(&progress.stage.to_string(), &words, progress.done);
    });
    stages.printer().clear_bar();
    let summary = summary?;
    if args.json {
        return output::json(&summary);
    }
    let Summary { written, width, height, bytes, bpp, gaussians, alpha, profile, psnr, seconds, .. } = summary;
    let alpha = if alpha { ", with alpha" } else { "" };
    let profile = profile.map_or_else(String::new, |name| format!("\nprofile    {}", printable(&name)));
    output::result(format_args!(
        "wrote      {written}, {} ({bpp:.3} bits per pixel of {width}x{height} px)\n\
         holds      {}{alpha}{profile}\nPSNR       {psnr:.2} dB of the decoded picture\ntime       {seconds:.1} s",
        counted(bytes, "byte"),
        counted(gaussians, "Gaussian"),
    ))
}

fn run_several(args: &EncodeArgs, images: &[BatchImage]) -> Result<(), Failure> {
    // A target out of range fails for every image, so no image is begun.
    args.settings((1000, 1000)).validate()?;
    let name = |image: &BatchImage| format!("{}.{GSI_EXTENSION}", image.name);
    let inputs: Inputs = images.iter().map(|image| &image.file).collect();
    let mut claim = args.overwrite.claim(&args.output, [], inputs);
    claim.files.extend(images.iter().map(name));
    let folder = OutputFolder::begin(claim)?;
    let render = RenderSettings::blended(Blend::Sum);
    let peak = |size| gs_train::memory::encoding(size, false, &args.settings(size));
    let how = "stopping after the images under way";
    batch::run(images, (&args.backend, &render), args.json, how, peak, |image, on, _| {
        let work = Work::read(args, &image.file)?;
        let shown = batch::shown(&image.file);
        let named = |remark| output::note(printable(&format!("{shown}: note: {remark}")));
        work.image.remarks.iter().for_each(named);
        work.need().check()?;
        let file = folder.file(&name(image));
        let summary = work.write(on, &file, &|_| ())?;
        let Summary { width, height, bytes, gaussians, psnr, seconds, .. } = summary;
        let row = Row { size: (width, height), bytes: bytes as u64, gaussians, psnr, seconds };
        Ok(Done { row, summary })
    })
}

/// An image to encode.
struct Work<'a> {
    file: &'a Path,
    image: StoredImage,
    settings: EncodeSettings,
}

impl<'a> Work<'a> {
    fn read(args: &EncodeArgs, file: &'a Path) -> Result<Self, Failure> {
        memory::check_image(file)?;
        let mut image = read_stored_image(file)?;
        if let Some(behind) = args.background {
            image = image.on(behind.0)?;
        }
        let size = image.image.size();
        let settings = args.settings(size);
        settings.validate()?;
        Ok(Self { file, image, settings })
    }

    /// The memory that encoding takes.
    fn need(&self) -> Need<'static> {
        let image = &self.image.image;
        let what = format!("encoding {}", batch::shown(self.file));
        let held = size_of_val(image.pixels()) as u64;
        let bytes = gs_train::memory::encoding(image.size(), self.image.alpha.is_some(), &self.settings);
        Need { what, bytes, held, less: "give less with --memory" }
    }

    /// Encodes the image and writes the file.
    fn write(&self, on: &Chosen, path: &Path, observer: &dyn Fn(EncodeProgress)) -> Result<Summary, Failure> {
        let StoredImage { image, alpha, profile, .. } = &self.image;
        let (width, height) = image.size();
        let Encoded { bytes, gaussians, psnr, seconds, .. } =
            encode(&on.rasterizer, &self.image, &self.settings, observer).block_on()?;
        write_durably(path, |file| file.write_all(&bytes))?;
        Ok(Summary {
            image: batch::shown(self.file),
            written: path.display().to_string(),
            width,
            height,
            bytes: bytes.len(),
            bpp: bytes.len() as f64 * 8.0 / (f64::from(width) * f64::from(height)),
            gaussians,
            tune: self.settings.tune,
            alpha: alpha.is_some(),
            profile: profile.as_ref().map(IccProfile::name),
            psnr,
            seconds,
        })
    }
}

impl EncodeArgs {
    fn settings(&self, size: (u32, u32)) -> EncodeSettings {
        EncodeSettings::default().with(|s| {
            s.target = self.target.of_image(size);
            s.layers = match (self.progressive, self.preview) {
                (true, _) => EncodeLayers::Progressive,
                (_, true) => EncodeLayers::Preview,
                _ => EncodeLayers::One,
            };
            s.tune = self.tune.unwrap_or(s.tune);
            s.memory = self.memory;
            s.seed = self.seed;
        })
    }
}
