//! Fits Gaussians to an image on the GPU, or on the CPU where there is none.
//!
//! `cargo run --release -p gs-lab --example fit_on_gpu -- photo.png`

use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::{FitSettings, fit, paper_target};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use pollster::FutureExt as _;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let target = match std::env::args().nth(1) {
        Some(path) => gs_io::read_image(path)?.image,
        None => paper_target(),
    };
    let settings = FitSettings::standard(600);
    let result = match WgpuRasterizer::new(WgpuSettings::default()).block_on() {
        Ok(gpu) => {
            eprintln!("on {}: {}", gpu.adapter(), gpu.reason());
            fit(&gpu, &target, settings, &mut ()).block_on()?
        }
        Err(reason) => {
            eprintln!("on the CPU: {reason}");
            fit(&CpuRasterizer::new(CpuSettings::default())?, &target, settings, &mut ()).block_on()?
        }
    };
    gs_io::write_png("fitted.png", &result.image)?;
    let summary = result.summary;
    eprintln!("{} Gaussians, {:.2} dB in {:.2} s", summary.gaussians, summary.psnr, summary.seconds);
    Ok(())
}
