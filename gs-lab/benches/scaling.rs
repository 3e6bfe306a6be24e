//! Time and memory against the number of Gaussians, of tile entries and of pixel–Gaussian pairs, up
//! to 1,000,000 Gaussians on 4096×4096 px. Each size runs in a process of its own.
//!
//! `cargo bench -p gs-lab --bench scaling -- [--level avx2] [--threads N] [--quick]`

#![allow(clippy::print_stdout)]

mod measure;

use gs_core::Optimizer as _;
use pollster::FutureExt as _;
use std::{
    error::Error,
    process::{Command, Stdio},
};

use clap::{Parser, ValueEnum};
use glam::{Vec2, Vec3};
use gs_core::{
    Adam, Binning, Blend, Canvas, Gaussian2d, Image, Loss, Parameterization, Rasterizer, RenderSettings, Scene2d,
    TrainStep, logit,
};
use gs_density::Rng;
use measure::{
    Options, Outcome, Quantiles, count, linear::LinearModel, memory, ms, number, print_columns, print_head, print_row,
    print_section, try_time,
};
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

/// Steps between which lists are made anew.
const REBIN_EVERY: usize = 4;

#[derive(Debug, Parser)]
struct ScalingOptions {
    #[command(flatten)]
    common: Options,
    /// Measures one size and prints it as JSON; the benchmark calls itself with this option
    #[arg(long, hide = true, requires = "series")]
    gaussians: Option<u32>,
    /// The series of that size
    #[arg(long, hide = true)]
    series: Option<Series>,
}

/// How scenes change with the number of Gaussians, and their blending.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Series {
    SumShrinking,
    SumConstant,
    OverShrinking,
    OverConstant,
}

impl Series {
    fn blend(self) -> Blend {
        match self {
            Self::SumShrinking | Self::SumConstant => Blend::Sum,
            Self::OverShrinking | Self::OverConstant => Blend::Over,
        }
    }

    fn title(self) -> &'static str {
        match self {
            Self::SumShrinking => "Sum, σ ∝ 1/√N: the canvas is covered as often",
            Self::SumConstant => "Sum, σ = 4 px: each Gaussian covers as much",
            Self::OverShrinking => "Over, σ ∝ 1/√N: the canvas is covered as often",
            Self::OverConstant => "Over, σ = 4 px: each Gaussian covers as much",
        }
    }

    /// Mean scale, px, of `gaussians` on a square of `side` px.
    fn sigma(self, gaussians: u32, side: u32) -> f32 {
        match self {
            Self::SumShrinking | Self::OverShrinking => 0.6 * side as f32 / (gaussians as f32).sqrt(),
            Self::SumConstant | Self::OverConstant => 4.0,
        }
    }

    /// Gaussians at random positions, twice as long as wide.
    fn scene(self, gaussians: u32, side: u32) -> Scene2d {
        let sigma = self.sigma(gaussians, side);
        let mut random = Rng::seed_from_u64(u64::from(gaussians));
        let log_scale = Vec2::new((sigma * 2f32.sqrt()).ln(), (sigma / 2f32.sqrt()).ln());
        let opacity_logit = if self.blend() == Blend::Sum { f32::INFINITY } else { logit(0.5) };
        let mut gaussian = || Gaussian2d {
            mean: Vec2::new(random.random(), random.random()) * side as f32,
            log_scale,
            rotation: random.random::<f32>() * std::f32::consts::PI,
            opacity_logit,
            color: Vec3::new(random.random(), random.random(), random.random()) * 0.3,
        };
        (0..gaussians).map(|_| gaussian()).collect()
    }
}

/// The measurement of a size.
#[derive(Debug, Serialize, Deserialize)]
struct Measured {
    gaussians: u32,
    entries: u64,
    pairs: u64,
    /// Seconds of forward passes.
    forward: Vec<f64>,
    /// Seconds of training steps, averaged over [`REBIN_EVERY`].
    step: Vec<f64>,
    /// Peak memory above that before the scene was made, bytes; `None` where the system does not
    /// provide it.
    bytes: Option<u64>,
}

fn main() -> Outcome {
    let options = ScalingOptions::parse();
    let common = &options.common;
    let side = common.pick(4096, 512);
    if let Some((gaussians, series)) = options.gaussians.zip(options.series) {
        println!("{}", serde_json::to_string(&measure(common, series, gaussians, side)?)?);
        return Ok(());
    }
    let data = format!("Gaussians strewn at random over {side}x{side} px, loss L2");
    print_head("Scaling", common, &[common.threads()], &data);
    let sizes: &[u32] =
        common.pick(&[1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000], &[1_000, 3_000, 10_000]);
    for pair in [[Series::SumShrinking, Series::SumConstant], [Series::OverShrinking, Series::OverConstant]] {
        let mut both = Vec::new();
        for series in pair {
            print_section(series.title());
            print_columns(&[
                "Gaussians",
                "entries",
                "pairs",
                "forward, ms",
                "ns per pair",
                "step, ms",
                "ns per pair",
                "memory, MB",
                "bytes per Gaussian",
                "bytes per entry",
            ]);
            for &gaussians in sizes {
                let measured = measure_elsewhere(series, gaussians)?;
                print_measured(&measured);
                both.push(measured);
            }
        }
        print_models(&both);
    }
    println!(
        "\nForward passes make their lists; of training steps, every {REBIN_EVERY}th does. Memory is the process's peak less \
         what it held before the scene was made (mostly the target): the scene on the host, the splats, lists and forward passes."
    );
    Ok(())
}

/// Runs this program for a size.
fn measure_elsewhere(series: Series, gaussians: u32) -> Result<Measured, Box<dyn Error>> {
    let series = series.to_possible_value().ok_or("every series has a name")?;
    let output = Command::new(std::env::current_exe()?)
        .args(std::env::args_os().skip(1))
        .args(["--gaussians", &gaussians.to_string(), "--series", series.get_name()])
        .stderr(Stdio::inherit())
        .output()?;
    if !output.status.success() {
        return Err(format!("{gaussians} Gaussians could not be measured: {}", output.status).into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

fn measure(options: &Options, series: Series, gaussians: u32, side: u32) -> Result<Measured, Box<dyn Error>> {
    let rasterizer = options.rasterizer(options.threads())?;
    let target = rasterizer.for_2d().upload_target(&Image::filled(side, side, [0.5; 3])?)?;
    let before = memory::forget_peak();
    let scene = series.scene(gaussians, side);
    let mut splats = rasterizer.upload(&scene, Parameterization::CovarianceFactor)?;
    drop(scene);
    let (view, settings) = (Canvas::new(side, side), RenderSettings::blended(series.blend()));
    let pass = rasterizer.for_2d().forward(&splats, &view, &settings).block_on()?;
    let (entries, pairs) = (pass.entries() as u64, pass.pairs());
    drop(pass);
    let forward = try_time(options.pick(15, 3), || rasterizer.for_2d().forward(&splats, &view, &settings).block_on())?;
    // With such learning rates the scene hardly changes.
    let mut adam = Adam::default();
    for group in [&mut adam.mean, &mut adam.scale, &mut adam.rotation, &mut adam.opacity, &mut adam.color] {
        group.learning_rate = 1e-6;
    }
    let rates = adam.at(0.0);
    let mut steps = || {
        (0..REBIN_EVERY).try_for_each(|i| {
            let binning = if i == 0 { Binning::Fresh } else { Binning::Reuse };
            let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning };
            rasterizer.for_2d().train_step(&mut splats, &view, &target, &step).block_on()
        })
    };
    steps()?;
    let step = try_time(options.pick(7, 2), steps)?.into_iter().map(|s| s / REBIN_EVERY as f64).collect();
    let bytes = before.and_then(|before| Some(memory::peak()?.saturating_sub(before)));
    Ok(Measured { gaussians, entries, pairs, forward, step, bytes })
}

fn print_measured(measured: &Measured) {
    let (forward, step) = (Quantiles::of(&measured.forward), Quantiles::of(&measured.step));
    let per_pair = |seconds: Quantiles| number(seconds.median * 1e9 / measured.pairs as f64);
    let bytes = |parts: f64| measured.bytes.map_or("–".to_owned(), |bytes| number(bytes as f64 / parts));
    print_row(&[
        count(u64::from(measured.gaussians)),
        count(measured.entries),
        count(measured.pairs),
        ms(forward),
        per_pair(forward),
        ms(step),
        per_pair(step),
        bytes(1e6),
        bytes(f64::from(measured.gaussians)),
        bytes(measured.entries as f64),
    ]);
}

/// Prints time and memory as linear functions, with the largest deviation.
fn print_models(measured: &[Measured]) {
    println!("\nThe least-squares linear functions through both series:\n");
    let model = |y: fn(&Measured) -> u64, cost: &dyn Fn(&Measured) -> Option<f64>| {
        let points = measured.iter().map(|m| Some([f64::from(m.gaussians), y(m) as f64, cost(m)?]));
        LinearModel::of(&points.collect::<Option<Vec<_>>>()?)
    };
    let time = |name: &str, of: fn(&Measured) -> &[f64]| {
        if let Some(m) = model(|m| m.pairs, &|m| Some(Quantiles::of(of(m)).median * 1e9)) {
            let [fixed, first, second] = [m.fixed * 1e-6, m.first, m.second].map(number);
            let worst = m.worst * 100.0;
            println!("- {name}: {fixed} ms + {first} ns a Gaussian + {second} ns a pair; at most {worst:.0} % from it");
        }
    };
    time("forward", |m| &m.forward);
    time("training step", |m| &m.step);
    if let Some(m) = model(|m| m.entries, &|m| m.bytes.map(|bytes| bytes as f64)) {
        let [fixed, first, second] = [m.fixed * 1e-6, m.first, m.second].map(number);
        let worst = m.worst * 100.0;
        println!(
            "- memory: {fixed} MB + {first} bytes a Gaussian + {second} bytes an entry; at most {worst:.0} % from it"
        );
    }
}
