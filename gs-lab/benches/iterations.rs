//! Time of a training iteration compared with OpenSplat's CPU path.
//!
//! `cargo bench -p gs-lab --bench iterations -- [--level avx2] [--threads N] [--quick]`

#![allow(clippy::print_stdout)]

mod measure;

use clap::Parser;
use measure::{
    Options, Outcome, count,
    images::{BenchImages, cropped, halved},
    ms, number, print_columns, print_head, print_row, print_section,
    scenes::{OVER_L1_DSSIM, OVER_L2, SUM_L2},
};

const GAUSSIANS: u32 = 10_000;

/// OpenSplat's CPU path on two cores: side of a square image, px, and seconds per iteration
/// (forward, backward, Adam) with 10,000 Gaussians.
const OPENSPLAT: [(u32, f64); 2] = [(512, 0.625), (256, 0.135)];

fn main() -> Outcome {
    let options = Options::parse();
    let images = BenchImages::load()?;
    let portrait = images.portrait();
    let large = cropped(&portrait.image, OPENSPLAT[0].0, OPENSPLAT[0].0);
    let small = halved(&large);
    let data = format!("{}, its middle of 512x512 px and that at half size; found: {}", portrait.name, images.origin);
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
                let seconds = |rebin_every| fitted.iterations(&rasterizer, image, rebin_every, repetitions);
                let [usual, fresh] = [seconds(fitted.settings.rebin_every)?, seconds(1)?];
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
