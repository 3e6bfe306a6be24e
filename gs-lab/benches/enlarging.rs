//! Fits of images reduced by two, rendered at twice their size: how much of the original returns,
//! for several lower bounds of the scales, beside an enlargement by Lanczos-3, and the same
//! corrected by back-projection until its reduction by two is the reduced image.
//!
//! `cargo bench -p gs-lab --bench enlarging -- [--threads N] [--quick] [--crops FOLDER]`

#![allow(clippy::print_stdout)]

mod measure;

use pollster::FutureExt as _;
use std::{error::Error, path::PathBuf};

use clap::Parser;
use glam::Vec2;
use gs_core::{Blend, Canvas, Image, Rasterizer as _, RenderSettings, Scene2d};
use gs_cpu::CpuRasterizer;
use gs_train::{FitSettings, ImageQuality, Preset, fit};
use image::{Rgb32FImage, imageops};
use measure::{
    Options, Outcome, count,
    images::{BenchImage, BenchImages, halved},
    mean, number, print_columns, print_head, print_row, print_section,
};

/// Lower bounds of the scales that are compared beside that of the preset, px.
const BOUNDS_PX: [f32; 4] = [0.25, 0.35, 0.5, 0.6];

/// Corrections of the enlargement; more change nothing.
const CORRECTIONS: u32 = 3;

/// Side of a crop, px of the reduced image, and how many times it is enlarged.
const CROP_PX: u32 = 64;
const CROP_ENLARGED: u32 = 8;

#[derive(Debug, Parser)]
struct EnlargingOptions {
    #[command(flatten)]
    common: Options,
    /// Also writes the middle of each fit, enlarged eight times, into FOLDER
    #[arg(long)]
    crops: Option<PathBuf>,
}

/// One fit of a reduced image.
struct Run {
    own_size: f64,
    enlarged: f64,
    seconds: f64,
}

fn main() -> Outcome {
    let options = EnlargingOptions::parse();
    let common = &options.common;
    let mut images = BenchImages::load()?;
    images.all.truncate(common.pick(usize::MAX, 1));
    print_head("Fits that are enlarged", common, &[common.threads()], &images.origin);
    let rasterizer = common.rasterizer(common.threads())?;
    if let Some(folder) = &options.crops {
        std::fs::create_dir_all(folder).map_err(|e| format!("{} cannot be made: {e}", folder.display()))?;
    }
    let enlarged = |corrections| -> Result<f64, Box<dyn Error>> {
        let each = images.all.iter().map(|of| psnr(&enlarged_by_lanczos(&halved(&of.image), corrections)?, &of.image));
        Ok(mean(each.collect::<Result<Vec<f64>, _>>()?))
    };
    let (lanczos, corrected) = (enlarged(0)?, enlarged(CORRECTIONS)?);
    println!("\nLanczos-3 enlargement of the reduced images: {lanczos:.2} dB against the originals.");
    println!("Corrected until its reduction is the reduced image: {corrected:.2} dB.");
    for &gaussians in common.pick(&[2_250, 9_000, 20_000][..], &[2_250]) {
        print_section(&format!("{} Gaussians, preset standard", count(u64::from(gaussians))));
        print_columns(&[
            "smallest scale, px",
            "own size, dB",
            "twice the size, dB",
            "to Lanczos-3, dB",
            "fitting, s (mean)",
        ]);
        let preset = Preset::Standard.settings(gaussians, (1, 1)).adam.min_scale;
        let [finest, fine, coarse, coarsest] = &BOUNDS_PX;
        for bound in common.pick(&[finest, fine, &preset, coarse, coarsest][..], &[&preset]) {
            let run = |of| fit_one(&rasterizer, of, gaussians, **bound, &options);
            let runs = images.all.iter().map(run).collect::<Result<Vec<Run>, _>>()?;
            let enlarged = mean(runs.iter().map(|run| run.enlarged));
            let mark = if **bound == preset { " (preset)" } else { "" };
            print_row(&[
                format!("{bound}{mark}"),
                format!("{:.2}", mean(runs.iter().map(|run| run.own_size))),
                format!("{enlarged:.2}"),
                format!("{:+.2}", enlarged - lanczos),
                number(mean(runs.iter().map(|run| run.seconds))),
            ]);
        }
    }
    Ok(())
}

fn fit_one(
    rasterizer: &CpuRasterizer,
    of: &BenchImage,
    gaussians: u32,
    smallest: f32,
    options: &EnlargingOptions,
) -> Result<Run, Box<dyn Error>> {
    let reduced = halved(&of.image);
    let (width, height) = reduced.size();
    let settings: FitSettings = Preset::Standard.settings(gaussians, (width, height));
    let fit = fit(rasterizer, &reduced, settings.with(|s| s.adam.min_scale = smallest), &mut ()).block_on()?;
    let canvas = Canvas::new(width, height);
    let enlarged = draw(rasterizer, &fit.scene, canvas.resized(2 * width, 2 * height))?;
    if let Some(folder) = &options.crops {
        let side = CROP_PX.min(width).min(height);
        let middle = Canvas {
            origin: Vec2::new(((width - side) / 2) as f32, ((height - side) / 2) as f32),
            ..Canvas::new(side, side)
        };
        let crop = draw(rasterizer, &fit.scene, middle.resized(CROP_ENLARGED * side, CROP_ENLARGED * side))?;
        gs_io::write_png(folder.join(format!("{}-{gaussians}-{smallest}.png", of.name)), &crop)?;
    }
    let enlarged = psnr(&enlarged, &of.image)?;
    Ok(Run { own_size: fit.summary.psnr, enlarged, seconds: fit.summary.seconds })
}

fn draw(rasterizer: &CpuRasterizer, scene: &Scene2d, canvas: Canvas) -> Result<Image, gs_core::Error> {
    rasterizer.render(scene, &canvas, &RenderSettings::blended(Blend::Sum)).block_on()
}

/// PSNR, dB, of an image as 8 bits against the part of `original` that it covers: all of it, but
/// for a last column or row where a side is odd.
fn psnr(found: &Image, original: &Image) -> Result<f64, gs_core::Error> {
    let covered = Image::from_fn(found.width(), found.height(), |x, y| original.pixel(x, y))?;
    Ok(ImageQuality::as_written(found, &covered)?.psnr)
}

/// An enlargement by two. Each correction adds the enlarged difference between the reduced image and
/// the reduction of what is there (*source:* iterative back-projection, Irani and Peleg 1991).
fn enlarged_by_lanczos(reduced: &Image, corrections: u32) -> Result<Image, gs_core::Error> {
    let (width, height) = reduced.size();
    let twice = |image: &Image| {
        let of = Rgb32FImage::from_fn(width, height, |x, y| image::Rgb(image.pixel(x, y)));
        let enlarged = imageops::resize(&of, 2 * width, 2 * height, imageops::FilterType::Lanczos3);
        Image::from_fn(2 * width, 2 * height, |x, y| enlarged.get_pixel(x, y).0)
    };
    let mut enlarged = twice(reduced)?;
    for _ in 0..corrections {
        let found = halved(&enlarged);
        let missing = Image::from_fn(width, height, |x, y| {
            // The crate clamps to 0..=1, so differences are shifted into that.
            std::array::from_fn(|k| 0.5 + 0.5 * (reduced.pixel(x, y)[k] - found.pixel(x, y)[k]))
        })?;
        let missing = twice(&missing)?;
        let sums = enlarged.pixels_mut().as_flattened_mut().iter_mut().zip(missing.pixels().as_flattened());
        sums.for_each(|(value, missing)| *value += 2.0 * missing - 1.0);
    }
    Ok(enlarged)
}
