//! gs-wgpu compared with gs-cpu: time of a training iteration and of start-up, and quality of fits.
//!
//! `cargo bench -p gs-lab --bench backends -- [--threads N] [--quick]`

#![allow(clippy::print_stdout)]

mod measure;

use pollster::FutureExt as _;
use std::time::Instant;

use clap::Parser;
use gs_core::{AdamRates, Binning, Canvas, Image, Optimizer, Scene2d, TrainStep, Wait};
use gs_train::{Preset, fit};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use measure::{
    Options, Outcome, Quantiles,
    images::BenchImages,
    ms, number, print_columns, print_head, print_row, print_section,
    scenes::{Fitted, OVER_L1_DSSIM, OVER_L2, SUM_L2, Variant},
    try_time,
};

const GAUSSIANS: u32 = 9_000;

fn main() -> Outcome {
    let options = Options::parse();
    let images = BenchImages::load()?;
    let portrait = images.portrait();
    print_head("Backends", &options, &[options.threads()], &images.origin);
    let cpu = options.rasterizer(options.threads())?;

    print_section("Starting up");
    let start = Instant::now();
    let wgpu = WgpuRasterizer::new(WgpuSettings::default()).block_on()?;
    let device = start.elapsed();
    println!("- adapter: {}; {}", wgpu.adapter(), wgpu.reason());
    println!("- adapter and device: {} s", number(device.as_secs_f64()));
    for variant in [SUM_L2, OVER_L1_DSSIM] {
        let start = Instant::now();
        let fitted = variant.fit(&wgpu, &portrait.image, 100, 20)?;
        println!(
            "- {}: first fit of {} Gaussians, 20 steps, all its pipelines compiled: {} s",
            variant.name,
            fitted.scene.means.len(),
            number(start.elapsed().as_secs_f64())
        );
    }

    print_section("One iteration, 9,000 Gaussians, lists made anew at every 4th");
    print_columns(&["blending, loss", "cpu, ms", "wgpu, ms", "wgpu/cpu"]);
    for variant in [SUM_L2, OVER_L2, OVER_L1_DSSIM] {
        let fitted = variant.fit(&cpu, &portrait.image, GAUSSIANS, options.pick(100, 20))?;
        let repetitions = options.pick(30, 3);
        let on_cpu = iterations(&cpu, &variant, &portrait.image, &fitted, repetitions)?;
        let on_wgpu = iterations(&wgpu, &variant, &portrait.image, &fitted, repetitions)?;
        print_row(&[variant.name.to_owned(), ms(on_cpu), ms(on_wgpu), number(on_wgpu.median / on_cpu.median)]);
    }

    print_section("Fits of images, preset standard, 9,000 Gaussians");
    print_columns(&["image", "cpu, dB", "wgpu, dB", "difference, dB", "cpu, s", "wgpu, s"]);
    for kodak in images.all.iter().take(options.pick(usize::MAX, 1)) {
        let settings = || Preset::Standard.settings(GAUSSIANS, kodak.image.size());
        let on_cpu = fit(&cpu, &kodak.image, settings(), &mut ()).block_on()?.summary;
        let on_wgpu = fit(&wgpu, &kodak.image, settings(), &mut ()).block_on()?.summary;
        print_row(&[
            kodak.name.clone(),
            format!("{:.3}", on_cpu.psnr),
            format!("{:.3}", on_wgpu.psnr),
            format!("{:+.3}", on_wgpu.psnr - on_cpu.psnr),
            number(on_cpu.seconds),
            number(on_wgpu.seconds),
        ]);
    }
    Ok(())
}

/// Seconds per iteration, averaged over four, of which the first makes new lists. As in training,
/// the device may be some steps behind when a round ends, but by equally many in each round.
fn iterations<R: Optimizer<Scene2d>>(
    rasterizer: &R,
    variant: &Variant,
    image: &Image,
    fitted: &Fitted,
    repetitions: usize,
) -> Result<Quantiles, gs_core::Error> {
    let mut splats = rasterizer.upload(&fitted.scene, fitted.settings.parameterization)?;
    let target = rasterizer.upload_target(image)?;
    let view = Canvas::new(image.width(), image.height());
    // With the learning rates of the end, the scene hardly changes.
    let rates: AdamRates = fitted.settings.adam.at(1.0);
    let mut losses = Vec::new();
    let mut round = || {
        for step in 0..4 {
            let binning = if step == 0 { Binning::Fresh } else { Binning::Reuse };
            let step = TrainStep { settings: &fitted.settings.render, loss: variant.loss, rates: &rates, binning };
            rasterizer.train_step(&mut splats, &view, &target, &step).block_on()?;
            losses.clear();
            rasterizer.losses(&mut splats, Wait::Arrived, &mut losses).block_on()?;
        }
        Ok(())
    };
    // Fills the queue, until a step has to wait for another.
    (0..2).try_for_each(|_| round())?;
    Ok(Quantiles::of(&try_time(repetitions, round)?).times(0.25))
}
