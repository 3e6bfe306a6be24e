//! Fits Gaussians to an image and renders them at twice its size.
//!
//! `cargo run --release -p gs-lab --example fit_image -- photo.png`

use gs_core::{Canvas, Rasterizer, RenderSettings};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::{Preset, fit, paper_target};
use pollster::FutureExt as _;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let target = match std::env::args().nth(1) {
        Some(path) => gs_io::read_image(path)?.image,
        None => paper_target(),
    };
    let (width, height) = target.size();
    let rasterizer = CpuRasterizer::new(CpuSettings::default())?;
    let settings = Preset::Standard.settings(600, (width, height));
    let render: RenderSettings = settings.render;
    let result = fit(&rasterizer, &target, settings, &mut ()).block_on()?;
    let double = Canvas::new(width, height).resized(2 * width, 2 * height);
    gs_io::write_png("doubled.png", &rasterizer.render(&result.scene, &double, &render).block_on()?)?;
    let summary = result.summary;
    eprintln!("{} Gaussians, {:.2} dB in {:.2} s", summary.gaussians, summary.psnr, summary.seconds);
    Ok(())
}
