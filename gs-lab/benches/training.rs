//! Training in 3D on both backends: time of a step from the points of a reconstruction, and the
//! result of equally many steps.
//!
//! `GS_DATA=../shared/data cargo bench -p gs-lab --bench training -- [--threads N] [--quick]`

#![allow(clippy::print_stdout)]

mod measure;

use pollster::FutureExt as _;
use std::time::Instant;

use clap::Parser;
use gs_conformance::data;
use gs_core::{Optimizer, Scene3d};
use gs_io::dataset::{Dataset, DatasetSettings, read_dataset};
use gs_train::{
    Rounds, TrainPreset, TrainSettings, Trainer3d,
    train::{Start, Views},
};
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use measure::{Options, Outcome, Quantiles, memory, ms, number, print_columns, print_head, print_row, print_section};

/// Every 7th view of banana is held out, as in the published figures of that data set; lego has a
/// split of its own.
const HOLDOUT: u32 = 7;

fn main() -> Outcome {
    let options = Options::parse();
    let Ok(banana) = dataset("banana") else {
        println!("skipped: no test data; set GS_DATA to the folder that holds banana/ and lego/");
        return Ok(());
    };
    let about = format!("banana: {} views, {} points", banana.views.len(), banana.points.len());
    print_head("Training in 3D", &options, &[options.threads()], &about);
    let cpu = options.rasterizer(options.threads())?;
    let (degrees, epochs) = ([0, 3], options.pick(20, 2));
    let on_cpu = degrees.map(|degree| steps(&cpu, &banana, degree, epochs));
    // Measured before a software driver allocates memory in the same process.
    if let Some(bytes) = memory::peak() {
        println!("- peak memory of gs-cpu's training, with all images: {} MB", bytes / 1_000_000);
    }
    let wgpu = WgpuRasterizer::new(WgpuSettings::default()).block_on()?;
    println!("- adapter: {}; {}", wgpu.adapter(), wgpu.reason());

    print_section("One training step of banana, from its points, L1 + D-SSIM, means over the 12 views of an epoch");
    print_columns(&["SH degree", "cpu, ms", "wgpu, ms", "wgpu/cpu"]);
    for (degree, on_cpu) in degrees.into_iter().zip(on_cpu) {
        let (on_cpu, on_wgpu) = (on_cpu?, steps(&wgpu, &banana, degree, epochs)?);
        print_row(&[degree.to_string(), ms(on_cpu), ms(on_wgpu), number(on_wgpu.median / on_cpu.median)]);
    }

    print_section("The same steps on both, preset 3dgs");
    print_columns(&[
        "data set",
        "steps",
        "Gaussians, cpu",
        "wgpu",
        "PSNR, cpu, dB",
        "wgpu",
        "difference",
        "cpu, s",
        "wgpu, s",
    ]);
    for (name, count) in [("banana", options.pick(1_000, 20)), ("lego", options.pick(600, 20))] {
        let data = dataset(name)?;
        let (a, b) = (trained(&cpu, &data, count)?, trained(&wgpu, &data, count)?);
        print_row(&[
            name.to_owned(),
            count.to_string(),
            a.count.to_string(),
            b.count.to_string(),
            format!("{:.3}", a.psnr),
            format!("{:.3}", b.psnr),
            format!("{:+.3}", b.psnr - a.psnr),
            number(a.seconds),
            number(b.seconds),
        ]);
    }
    Ok(())
}

fn dataset(name: &str) -> Result<Dataset, gs_io::Error> {
    let settings = DatasetSettings::default().with(|s| s.test_every = HOLDOUT.try_into().ok());
    read_dataset(data::folder().join(name), &settings)
}

fn start(data: &Dataset) -> Start {
    if data.points.is_empty() { Start::Random } else { Start::Points(data.points.clone()) }
}

/// Seconds per step, one value per epoch.
fn steps<R: Optimizer<Scene3d>>(on: &R, data: &Dataset, degree: u8, epochs: u32) -> Result<Quantiles, gs_train::Error> {
    let mut settings = TrainPreset::ThreeDgs.settings(None);
    (settings.rounds, settings.sh_degree_every) = (Rounds::NEVER, 0);
    settings.render.effects.sh_degree = degree;
    let views = Views::of_dataset(data);
    let in_an_epoch = views.train.len();
    let mut trainer = Trainer3d::from_views(on, views, start(data), settings).block_on()?;
    let mut epoch = || -> Result<f64, gs_train::Error> {
        let started = Instant::now();
        (0..in_an_epoch).try_for_each(|_| trainer.step_once().block_on().map(|_| ()))?;
        Ok(started.elapsed().as_secs_f64() / in_an_epoch as f64)
    };
    // The first epochs read images and compile pipelines.
    (0..2).try_for_each(|_| epoch().map(|_| ()))?;
    Ok(Quantiles::of(&(0..epochs).map(|_| epoch()).collect::<Result<Vec<_>, _>>()?))
}

struct Trained {
    count: u32,
    psnr: f64,
    seconds: f64,
}

fn trained<R: Optimizer<Scene3d>>(on: &R, data: &Dataset, steps: u32) -> Result<Trained, gs_train::Error> {
    let settings: TrainSettings = TrainPreset::ThreeDgs.settings(Some(steps)).on([1.0; 3]);
    let mut trainer = Trainer3d::from_views(on, Views::of_dataset(data), start(data), settings).block_on()?;
    trainer.run(&mut ()).block_on()?;
    Ok(Trained { count: trainer.count(), psnr: trainer.quality().block_on()?.psnr, seconds: trainer.seconds() })
}
