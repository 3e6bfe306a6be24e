//! Sizes of compressed images against JPEG, WebP, AVIF and JPEG XL at equal quality.
//!
//! `cargo bench -p gs-lab --bench compression -- [--threads N] [--quick] [--csv FILE] [--plots FOLDER]`
//!
//! The other formats are made by `cjpeg` and `djpeg`, `cwebp` and `dwebp`, `avifenc` and `avifdec`,
//! `cjxl` and `djxl`; a format whose programs are not there is left out, and JPEG is then made by the
//! crate `image`. Sizes are those of files on disk; PSNR, MS-SSIM and SSIMULACRA2 are those of the
//! decoded 8-bit picture.

#![allow(clippy::print_stdout)]

mod codec;
mod curve;
#[path = "../measure/images.rs"]
mod images;
#[path = "../measure/mod.rs"]
mod measure;
mod plots;
mod points;
mod tables;

use std::{error::Error, fs, path::PathBuf};

use clap::Parser;
use gs_conformance::data;
use images::{BenchImage, BenchImages};
use measure::{Options, Outcome, print_head};

use self::{
    codec::CODECS,
    points::{OURS, Points, TUNED},
};

#[derive(Debug, Parser)]
struct CompressionOptions {
    #[command(flatten)]
    common: Options,
    /// Also writes a line per file to FILE
    #[arg(long)]
    csv: Option<PathBuf>,
    /// Also writes the curves as SVG into FOLDER: the mean of each set, and each image
    #[arg(long)]
    plots: Option<PathBuf>,
}

/// Sizes of `.gsi` files, bits per pixel.
const SIZES: [f64; 6] = [0.1, 0.2, 0.4, 0.8, 1.4, 2.0];

/// Images that are shown together.
struct Set {
    name: &'static str,
    images: Vec<BenchImage>,
}

fn main() -> Outcome {
    let options = CompressionOptions::parse();
    let common = &options.common;
    let kodak = BenchImages::load()?;
    let origin = format!("{}; others from the test data where they are there", kodak.origin);
    let mut sets =
        vec![Set { name: "Kodak", images: kodak.all }, Set { name: "Other images", images: other_images()? }];
    sets.iter_mut().for_each(|set| set.images.truncate(common.pick(usize::MAX, 1)));
    sets.retain(|set| !set.images.is_empty());
    print_head("Compressed images", common, &[common.threads()], &origin);
    for codec in &CODECS {
        let maker = if codec.is_there() { codec.maker() } else { "left out".to_owned() };
        println!("- {}: {maker}", codec.name);
    }
    let rasterizer = common.rasterizer(common.threads())?;
    let sizes = common.pick(&SIZES[..], &[0.2, 0.8, 1.4][..]);
    let mut points = Points::default();
    for image in sets.iter().flat_map(|set| &set.images) {
        for &bpp in sizes {
            points.add_gsi(&rasterizer, image, OURS, bpp)?;
            points.add_gsi(&rasterizer, image, TUNED, bpp)?;
        }
        points.add_others(image, common.is_quick())?;
    }
    for set in &sets {
        println!("\n# {}", set.name);
        tables::files_by_size(&points, set, OURS, sizes);
        tables::files_by_size(&points, set, TUNED, sizes);
        tables::rates(&points, set);
    }
    tables::published(&points, &sets[0]);
    tables::prefixes(&points, &rasterizer, &sets)?;
    if let Some(path) = &options.csv {
        fs::write(path, points.to_csv()).map_err(|e| format!("{} cannot be written: {e}", path.display()))?;
    }
    if let Some(folder) = &options.plots {
        plots::write(&points, &sets, folder)?;
    }
    Ok(())
}

/// Images that are not of the Kodak set: those in the folder `images` of the test data, and two
/// photographs of the data set `banana`. Those that are not there are left out.
fn other_images() -> Result<Vec<BenchImage>, Box<dyn Error>> {
    let folder = |name: &str| gs_io::image_files(data::folder().join(name)).unwrap_or_default();
    let views = folder("banana/images_2");
    let two = views.iter().step_by((views.len() / 2).max(1)).take(2).cloned();
    let read = |path: PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(BenchImage { name, image: gs_io::read_image(&path)?.image })
    };
    folder("images").into_iter().chain(two).map(read).collect()
}
