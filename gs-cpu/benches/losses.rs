//! Time of a loss and its gradient: stage `loss` for several image sizes, on one thread and on all.
//!
//! `cargo bench -p gs-cpu --bench losses`. Prints medians, with the 10 % and 90 % quantiles.

#![allow(clippy::print_stdout)]

use glam::{Vec2, Vec3};
use gs_core::{
    Blend, Canvas, Error, Gaussian2d, Image, Loss, Parameterization, Rasterizer, RenderSettings, Scene2d,
    profile::{Profiler, Quantiles},
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use pollster::FutureExt as _;

const REPETITIONS: usize = 60;

const SIZES: [(u32, u32); 4] = [(400, 400), (768, 512), (1920, 1080), (3840, 2160)];

/// A few large Gaussians: the time of the loss does not depend on their number.
fn scene((width, height): (u32, u32)) -> Scene2d {
    let gaussian = |i: u32| Gaussian2d {
        mean: Vec2::new(width as f32, height as f32) * (i as f32 / 8.0),
        log_scale: Vec2::new(0.3 * width as f32, 0.2 * height as f32).map(f32::ln),
        rotation: i as f32,
        opacity_logit: f32::INFINITY,
        color: Vec3::splat(0.2),
    };
    (0..8).map(gaussian).collect()
}

fn main() -> Result<(), Error> {
    println!("| px | threads | L2, ms | L1, ms | L1 + D-SSIM, ms |\n|---|---|---|---|---|");
    let all = CpuRasterizer::new(CpuSettings::default())?;
    let one = CpuRasterizer::new(CpuSettings { threads: Some(1), level: None })?;
    for size @ (width, height) in SIZES {
        let image = Image::from_fn(width, height, |x, y| [(x % 7) as f32 / 7.0, (y % 5) as f32 / 5.0, 0.5])?;
        for rasterizer in [&one, &all] {
            let cpu = rasterizer.for_2d();
            let target = cpu.upload_target(&image)?;
            let mut splats = cpu.upload(&scene(size), Parameterization::ScaleRotation)?;
            print!("| {width}x{height} | {}", rasterizer.threads());
            for loss in [Loss::L2, Loss::L1, Loss::L1Dssim { lambda: 0.2 }] {
                let settings = RenderSettings::blended(Blend::Over);
                let canvas = Canvas::new(width, height);
                let profile = cpu.profile(&mut splats, &canvas, &target, &settings, loss, REPETITIONS).block_on()?;
                let stage = profile.stages.iter().find(|stage| stage.stage == "loss").expect("a step has a loss");
                let Quantiles { low, median, high } = Quantiles::of(&stage.seconds);
                print!(" | {:.2} ({:.2}–{:.2})", 1e3 * median, 1e3 * low, 1e3 * high);
            }
            println!(" |");
        }
    }
    Ok(())
}
