//! Time of each stage of a training step on a fitted scene, and the rate of blending relative to
//! its bare inner loop.
//!
//! `cargo bench -p gs-lab --bench stages -- [--level avx2] [--threads N] [--quick]`

#![allow(clippy::print_stdout)]

mod bare_loop;
mod measure;

use pollster::FutureExt as _;
use std::error::Error;

use bare_loop::{BareLoop, PAIRS, instructions};
use clap::Parser;
use gs_core::{
    Blend, Canvas, Image, Rasterizer,
    profile::{Profile, Profiler},
};
use gs_cpu::CpuRasterizer;
use measure::{
    Options, Outcome, Quantiles, cell, count,
    images::BenchImages,
    ms, number, print_columns, print_head, print_row, print_section,
    scenes::{Fitted, OVER_L1_DSSIM, SUM_L2, Variant},
    time,
};

const GAUSSIANS: u32 = 9_000;

/// Gaussians per sample of a bare loop: about a millisecond.
const BARE_GAUSSIANS: usize = 20_000;

fn main() -> Outcome {
    let options = Options::parse();
    let images = BenchImages::load()?;
    let portrait = images.portrait();
    let image = &portrait.image;
    let data = format!("{} ({}x{} px); found: {}", portrait.name, image.width(), image.height(), images.origin);
    print_head("Stages of a training step", &options, &options.thread_counts(), &data);
    let rasterizer = options.rasterizer(options.threads())?;
    for (variant, iterations) in [(SUM_L2, options.pick(500, 50)), (OVER_L1_DSSIM, options.pick(150, 50))] {
        let fitted = variant.fit(&rasterizer, image, GAUSSIANS, iterations)?;
        measure(&options, &variant, image, &fitted)?;
    }
    Ok(())
}

/// The measurements with a number of threads.
struct Measured {
    threads: usize,
    profile: Profile,
    /// Seconds per pair of the bare loops, forward and backward, one thread.
    bare: [Vec<f64>; 2],
}

fn measure(options: &Options, variant: &Variant, image: &Image, fitted: &Fitted) -> Outcome {
    let measured = options
        .thread_counts()
        .into_iter()
        .map(|threads| measure_threads(options, threads, variant, image, fitted))
        .collect::<Result<Vec<_>, _>>()?;
    let Profile { pairs, entries, stages, .. } = &measured[0].profile;
    let (pairs, entries) = (*pairs, *entries as u64);
    print_section(variant.name);
    println!(
        "{} Gaussians after {} steps, {:.2} dB;",
        count(fitted.scene.means.len() as u64),
        fitted.settings.iterations,
        fitted.psnr
    );
    println!("{} entries in tiles' lists, {} pairs (16 per row of an entry).\n", count(entries), count(pairs));
    let mut columns = vec!["stage".to_owned()];
    for Measured { threads, .. } in &measured {
        let unit = if *threads == 1 { "thread" } else { "threads" };
        columns.extend([format!("ms, {threads} {unit}"), format!("ns per pair, {threads} {unit}")]);
    }
    print_columns(&columns.iter().map(String::as_str).collect::<Vec<_>>());
    for (i, stage) in stages.iter().enumerate() {
        let mut row = vec![format!("`{}`", stage.stage)];
        for Measured { profile, .. } in &measured {
            let seconds = Quantiles::of(&profile.stages[i].seconds);
            row.extend([ms(seconds), number(seconds.median * 1e9 / pairs as f64)]);
        }
        print_row(&row);
    }
    if variant.blend == Blend::Sum {
        print_rates(&measured[0]);
    }
    Ok(())
}

/// Profiles the stages and the bare loops in turns, so that both are affected by the same
/// disturbances.
fn measure_threads(
    options: &Options,
    threads: usize,
    variant: &Variant,
    image: &Image,
    fitted: &Fitted,
) -> Result<Measured, Box<dyn Error>> {
    let rasterizer = options.rasterizer(threads)?;
    let level = instructions(options.level()).ok_or("the SIMD level is not one of this machine")?;
    let mut splats = rasterizer.upload(&fitted.scene, fitted.settings.parameterization)?;
    let target = rasterizer.for_2d().upload_target(image)?;
    let view = Canvas::new(image.width(), image.height());
    let mut profile = |rasterizer: &CpuRasterizer, repetitions: usize| {
        rasterizer
            .for_2d()
            .profile(&mut splats, &view, &target, &fitted.settings.render, variant.loss, repetitions)
            .block_on()
    };
    profile(&rasterizer, 2)?;
    let mut bare_loop = BareLoop::new();
    let mut bare = [Vec::new(), Vec::new()];
    let mut total: Option<Profile> = None;
    for _ in 0..options.pick(40, 3) {
        let round = profile(&rasterizer, 5)?;
        let per_pair = |seconds: Vec<f64>| seconds.into_iter().map(|s| s / (BARE_GAUSSIANS * PAIRS) as f64);
        bare[0].extend(per_pair(time(3, || bare_loop.forward(level, BARE_GAUSSIANS))));
        bare[1].extend(per_pair(time(3, || bare_loop.backward(level, BARE_GAUSSIANS))));
        match &mut total {
            None => total = Some(round),
            Some(total) => {
                for (all, new) in total.stages.iter_mut().zip(round.stages) {
                    all.seconds.extend(new.seconds);
                }
            }
        }
    }
    let profile = total.ok_or("no round was measured")?;
    Ok(Measured { threads, profile, bare })
}

/// Prints the share of the bare loops' rates that the blend stages reach on one thread.
fn print_rates(Measured { profile, bare, .. }: &Measured) {
    println!(
        "\nAgainst the bare inner loop on 16 rows in the first-level cache, 1 thread; the goal is a rate of at least 0.5:\n"
    );
    print_columns(&["stage", "ns per pair", "bare loop, ns per pair", "rate of the bare loop reached"]);
    for (name, bare) in ["blend", "blend_bwd"].into_iter().zip(bare) {
        let Some(stage) = profile.stages.iter().find(|stage| stage.stage == name) else { continue };
        let whole = Quantiles::of(&stage.seconds).times(1e9 / profile.pairs as f64);
        let bare = Quantiles::of(bare).times(1e9);
        print_row(&[format!("`{name}`"), cell(whole), cell(bare), number(bare.median / whole.median)]);
    }
}
