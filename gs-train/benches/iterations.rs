//! Time of one training iteration beside that of a comparable engine on the CPU.
//!
//! `cargo bench -p gs-train --bench iterations -- [--level avx2] [--threads N] [--quick]`

#![allow(clippy::print_stdout)]

mod measure;

use clap::Parser;
use gs_core::{AdamRates, Binning, Canvas, Image, Rasterizer, TrainStep};
use gs_cpu::CpuRasterizer;
use measure::{
    Options, Outcome, Quantiles, count, ms, number,
    photographs::{Photographs, cropped, halved},
    print_columns, print_head, print_row, print_section,
    scenes::{Fitted, OVER_L1_DSSIM, OVER_L2, SUM_L2, Variant},
    try_time,
};

const GAUSSIANS: u32 = 10_000;

/// OpenSplat's CPU path on two cores: seconds for one iteration (forward, backward, Adam) with 10,000 Gaussians on a square
/// image of so many pixels a side.
const OPENSPLAT: [(u32, f64); 2] = [(512, 0.625), (256, 0.135)];

fn main() -> Outcome {
    let options = Options::parse();
    let photographs = Photographs::load()?;
    let portrait = photographs.portrait();
    let large = cropped(&portrait.image, OPENSPLAT[0].0, OPENSPLAT[0].0);
    let small = halved(&large);
    let data =
        format!("{}, its middle of 512x512 px and that at half size; found: {}", portrait.name, photographs.origin);
    print_head("Training iterations", &options, &options.thread_counts(), &data);
    for ((side, opensplat), image) in OPENSPLAT.into_iter().zip([&large, &small]) {
        print_section(&format!("{side}x{side} px, {} Gaussians", count(u64::from(GAUSSIANS))));
        println!("OpenSplat on two cores: {} ms.\n", number(opensplat * 1e3));
        print_columns(&[
            "blending, loss",
            "threads",
            "ms per iteration",
            "times OpenSplat's speed",
            "goal",
            "ms, lists always anew",
        ]);
        for (variant, goal) in [(SUM_L2, 100), (OVER_L2, 30), (OVER_L1_DSSIM, 30)] {
            let most = options.rasterizer(options.threads())?;
            let fitted = variant.fit(&most, image, GAUSSIANS, options.pick(100, 20))?;
            for threads in options.thread_counts() {
                let rasterizer = options.rasterizer(threads)?;
                let repetitions = options.pick(60, 3);
                let usual =
                    iterations(&rasterizer, &variant, image, &fitted, fitted.settings.rebin_every, repetitions)?;
                let fresh = iterations(&rasterizer, &variant, image, &fitted, 1, repetitions)?;
                print_row(&[
                    variant.name.to_owned(),
                    threads.to_string(),
                    ms(usual),
                    number(opensplat / usual.median),
                    goal.to_string(),
                    ms(fresh),
                ]);
            }
        }
    }
    println!(
        "\nScenes are those of the standard preset cut to {} steps; the lists of which Gaussian touches which pixels are made \
         anew at every 4th iteration, as that preset has it, or at every one.",
        options.pick(100, 20),
    );
    Ok(())
}

/// Seconds per iteration, as means over so many that lists are made anew once.
fn iterations(
    rasterizer: &CpuRasterizer,
    variant: &Variant,
    image: &Image,
    fitted: &Fitted,
    rebin_every: u32,
    repetitions: usize,
) -> Result<Quantiles, gs_core::Error> {
    let mut cloud = rasterizer.upload(&fitted.scene, fitted.settings.chart)?;
    let rasterizer = rasterizer.planar();
    let target = rasterizer.upload_target(image)?;
    let view = Canvas::new(image.width(), image.height());
    // The rates of the end: the scene goes on as it is.
    let rates: AdamRates = fitted.settings.adam.at(1.0);
    let mut round = || {
        for step in 0..rebin_every {
            let binning = if step == 0 { Binning::Fresh } else { Binning::Reuse };
            let step = TrainStep { settings: &fitted.settings.render, loss: variant.loss, rates: &rates, binning };
            rasterizer.train_step(&mut cloud, &view, &target, &step)?;
        }
        Ok(())
    };
    round()?;
    let seconds = try_time(repetitions * 4 / rebin_every as usize, round)?;
    Ok(Quantiles::of(&seconds).times(1.0 / f64::from(rebin_every)))
}
