//! What an iteration of a fit costs, to be held against one without the guards of the arithmetic.
//!
//! `cargo bench -p gs-lab --bench guards -- --scenes FOLDER`, and then the same with `RUSTFLAGS='--cfg guards="off"'` and a target directory of its
//! own: that program leaves out all guards that an ordinary scene does without. The two are to take turns. Both go on with the scenes of the
//! folder, which the first run fits where there are none: fitted without guards, scenes would be others.

#![allow(clippy::print_stdout)]

mod measure;

use std::path::{Path, PathBuf};

use clap::Parser;
use gs_core::{Canvas, Image, Rasterizer, guards::Guard};
use gs_cpu::CpuRasterizer;
use gs_io::{File2d, SCENE_EXTENSION, read_scene, write_scene};
use gs_train::ImageQuality;
use measure::{
    Options, Outcome, ms,
    photographs::PosedImages,
    print_columns, print_head, print_row,
    scenes::{Fitted, OVER_L1_DSSIM, OVER_L2, SUM_L2, Variant},
};

const GAUSSIANS: u32 = 9_000;

#[derive(Debug, Parser)]
struct GuardsOptions {
    #[command(flatten)]
    common: Options,
    /// Where fitted scenes stand, or are written to [default: they are fitted, and not kept]
    #[arg(long)]
    scenes: Option<PathBuf>,
}

fn main() -> Outcome {
    let GuardsOptions { common, scenes } = GuardsOptions::parse();
    let photographs = PosedImages::load()?;
    let image = &photographs.portrait().image;
    let threads = common.threads();
    let rasterizer = common.rasterizer(threads)?;
    print_head("Guards", &common, &[threads], &photographs.origin);
    let on = Guard::ALL.iter().filter(|guard| guard.is_on()).count();
    println!("- {on} of {} guards\n", Guard::ALL.len());
    print_columns(&["blending, loss", "ms per iteration"]);
    for variant in [SUM_L2, OVER_L2, OVER_L1_DSSIM] {
        let steps = common.pick(400, 20);
        let fitted = fitted(&variant, &rasterizer, image, steps, scenes.as_deref())?;
        let seconds = fitted.iterations(&rasterizer, image, fitted.settings.rebin_every, common.pick(200, 3))?;
        print_row(&[variant.name.to_owned(), ms(seconds)]);
    }
    Ok(())
}

/// The scene of the folder, or else one that is fitted, and left there.
fn fitted(
    variant: &Variant,
    rasterizer: &CpuRasterizer,
    image: &Image,
    steps: u32,
    folder: Option<&Path>,
) -> Result<Fitted, Box<dyn std::error::Error>> {
    let file = folder.map(|folder| folder.join(format!("{}.{SCENE_EXTENSION}", variant.name)));
    if let Some(file) = file.as_ref().filter(|file| file.exists()) {
        let (settings, scene) = (variant.settings(image, GAUSSIANS, steps), read_scene(file)?.scene);
        let view = Canvas::new(image.width(), image.height());
        let psnr = ImageQuality::as_written(&rasterizer.render(&scene, &view, &settings.render)?, image)?.psnr;
        return Ok(Fitted { scene, settings, psnr });
    }
    let fitted = variant.fit(rasterizer, image, GAUSSIANS, steps)?;
    if let Some(file) = file {
        let (width, height) = image.size();
        let (scene, settings) = (fitted.scene.clone(), fitted.settings.render);
        write_scene(file, &File2d { scene, width, height, settings })?;
    }
    Ok(fitted)
}
