//! Peak memory of training 3D scenes against the number of Gaussians, of tile entries and of
//! pixels, for both backends and for SH degrees 0 and 3. Each size runs in a process of its own.
//!
//! `cargo bench -p gs-lab --bench memory -- [--backend wgpu] [--threads N] [--quick]`
//!
//! For gs-wgpu the figure is valid if the driver computes on the host, such as lavapipe: only then
//! is the device's memory that of the process.

#![allow(clippy::print_stdout)]

mod measure;

use pollster::FutureExt as _;
use std::{
    error::Error,
    process::{Command, Stdio},
};

use clap::{Parser, ValueEnum};
use glam::Vec3;
use gs_core::{
    Binning, Blend, Camera, EditPlan, Gaussian3d, Image, Loss, MomentFormat, Parameterization, RenderSettings, Scene,
    Scene3d, TrainStep, Wait,
    edit::{Birth, Moments, Origin, Place},
    effects::{Antialias, Order, Statistics},
    logit,
    profile::{Profiler, still},
};
use gs_density::Rng;
use gs_wgpu::{WgpuRasterizer, WgpuSettings};
use measure::{
    Options, Outcome, count, linear::LinearModel, memory, number, print_columns, print_head, print_row, print_section,
};
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

/// Images: (columns, rows).
const SIZES: [(u32, u32); 2] = [(800, 532), (1920, 1080)];

/// Mean scales, px. With two of them, the number of entries is not proportional to that of
/// Gaussians.
const SCALES_PX: [f32; 2] = [1.0, 3.0];

/// Training steps before the edit and after it.
const STEPS: usize = 2;

#[derive(Debug, Parser)]
struct MemoryOptions {
    #[command(flatten)]
    common: Options,
    /// The backend that trains
    #[arg(long, value_enum, default_value = "cpu")]
    backend: Backend,
    /// Adam's moments of SH above degree 0 take 16 bits
    #[arg(long)]
    bf16: bool,
    /// Measures one case and prints it as JSON; the benchmark calls itself with this option
    #[arg(long, hide = true)]
    case: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Backend {
    Cpu,
    Wgpu,
}

/// A size to be measured.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Case {
    gaussians: u32,
    width: u32,
    height: u32,
    scale_px: f32,
    sh_degree: u8,
}

/// The measurement of a case.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Measured {
    case: Case,
    entries: usize,
    /// Peak memory above that before scene and image were made, bytes.
    bytes: u64,
}

fn main() -> Outcome {
    let options = MemoryOptions::parse();
    if let Some(case) = &options.case {
        println!("{}", serde_json::to_string(&measure_here(&options, serde_json::from_str(case)?)?)?);
        return Ok(());
    }
    let common = &options.common;
    let name = options.backend.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
    print_head(
        "Memory in training",
        common,
        &[common.threads()],
        &format!("3D Gaussians strewn over the picture, L1 + D-SSIM, dilated, global, mean gradient; backend {name}"),
    );
    let counts: &[u32] = common.pick(&[50_000, 200_000, 1_000_000], &[2_000, 8_000, 20_000]);
    for sh_degree in [0, 3] {
        print_section(&format!("SH degree {sh_degree}"));
        print_columns(&["image, px", "σ, px", "Gaussians", "entries", "peak, MB", "bytes a Gaussian"]);
        let mut of_sizes = Vec::new();
        for (width, height) in SIZES {
            let mut measured = Vec::new();
            for scale_px in SCALES_PX {
                for &gaussians in counts {
                    let found = measure_elsewhere(Case { gaussians, width, height, scale_px, sh_degree })?;
                    print_row(&[
                        format!("{width}x{height}"),
                        number(scale_px.into()),
                        count(found.case.gaussians.into()),
                        count(found.entries as u64),
                        number(found.bytes as f64 / 1e6),
                        number(found.bytes as f64 / f64::from(found.case.gaussians)),
                    ]);
                    measured.push(found);
                }
            }
            of_sizes.push(measured);
        }
        print_models(&of_sizes);
    }
    println!(
        "\nPeak of the process from before scene and picture are made: the scene on the host until it is uploaded, the splats with Adam's \
         moments and statistics, lists, forward pass, target; {STEPS} training steps, a round in which the scene comes to the host and every \
         tenth Gaussian is cloned, {STEPS} more. Counts are those after it. Memory is VmHWM of Linux."
    );
    Ok(())
}

/// Runs this program for a case.
fn measure_elsewhere(case: Case) -> Result<Measured, Box<dyn Error>> {
    let output = Command::new(std::env::current_exe()?)
        .args(std::env::args_os().skip(1))
        .args(["--case", &serde_json::to_string(&case)?])
        .stderr(Stdio::inherit())
        .output()?;
    if !output.status.success() {
        return Err(format!("{case:?} could not be measured: {}", output.status).into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

fn measure_here(options: &MemoryOptions, case: Case) -> Result<Measured, Box<dyn Error>> {
    match options.backend {
        Backend::Cpu => measure(options.common.rasterizer(options.common.threads())?.for_3d(), case, options.bf16),
        Backend::Wgpu => measure(WgpuRasterizer::new(WgpuSettings::default()).block_on()?.for_3d(), case, options.bf16),
    }
}

fn measure(rasterizer: &impl Profiler<Scene3d>, case: Case, bf16: bool) -> Result<Measured, Box<dyn Error>> {
    let before = memory::forget_peak().ok_or("peak memory is measured on Linux alone")?;
    let camera = Camera::looking_forward(case.width, case.height, 1.2);
    let target = rasterizer.upload_target(&Image::filled(case.width, case.height, [0.5; 3])?)?;
    let mut settings = RenderSettings::blended(Blend::Over);
    settings.effects.order = Order::Global;
    settings.effects.antialias = Antialias::Dilate;
    settings.effects.sh_degree = case.sh_degree;
    settings.effects.statistics = Statistics::MeanGradient;
    let mut splats = rasterizer.upload(&strewn(case, &camera), Parameterization::ScaleRotation)?;
    // Nothing moves, so the number of entries stays the same.
    let mut rates = still();
    if bf16 {
        rates.color_rest_moments = MomentFormat::Bf16;
    }
    let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
    for _ in 0..STEPS {
        rasterizer.train_step(&mut splats, &camera, &target, &step).block_on()?;
    }
    grow(rasterizer, &mut splats)?;
    for _ in 0..STEPS {
        rasterizer.train_step(&mut splats, &camera, &target, &step).block_on()?;
    }
    rasterizer.losses(&mut splats, Wait::All, &mut Vec::new()).block_on()?;
    let bytes = memory::peak().ok_or("peak memory is measured on Linux alone")?.saturating_sub(before);
    let entries = rasterizer.profile(&mut splats, &camera, &target, &settings, Loss::PAPER, 1).block_on()?.entries;
    Ok(Measured { case: Case { gaussians: rasterizer.len(&splats) as u32, ..case }, entries, bytes })
}

/// Translucent Gaussians all over the picture at all depths.
fn strewn(case: Case, camera: &Camera) -> Scene3d {
    let mut random = Rng::seed_from_u64(u64::from(case.gaussians));
    let mut scene = Scene3d { sh_degree: case.sh_degree, ..Scene3d::default() };
    let (width, height) = (case.width as f32, case.height as f32);
    for _ in 0..case.gaussians {
        let depth = 1.0 + 9.0 * random.random::<f32>();
        let (x, y) = (random.random::<f32>() * width, random.random::<f32>() * height);
        let across = (glam::Vec2::new(x, y) - camera.center) / camera.focal;
        let gaussian = Gaussian3d {
            mean: across.extend(1.0) * depth,
            log_scale: Vec3::splat((case.scale_px * depth / camera.focal.x).ln()),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: logit(0.1),
            sh: vec![Vec3::new(random.random(), random.random(), random.random())],
        };
        scene.push(gaussian.with_degree(case.sh_degree));
    }
    scene
}

/// A round of growth as in training: the scene and its statistics are read back, and every tenth
/// Gaussian is cloned.
fn grow<R: Profiler<Scene3d>>(rasterizer: &R, splats: &mut R::Splats) -> Result<(), gs_core::Error> {
    let (scene, statistics) = (rasterizer.download(splats).block_on()?, rasterizer.statistics(splats).block_on()?);
    let clone = |index: u32| Birth {
        gaussian: scene.gaussian(index as usize),
        parent: Some(index),
        moments: Moments::Fresh,
        origin: Origin::Clone,
        place: Place::Last,
    };
    let plan = EditPlan { added: (0..scene.len() as u32).step_by(10).map(clone).collect(), ..EditPlan::default() };
    drop((scene, statistics));
    rasterizer.edit(splats, &plan).block_on()
}

/// Prints memory as a linear function for each size of image, and the memory per pixel from the
/// difference of the two.
fn print_models(of_sizes: &[Vec<Measured>]) {
    println!();
    let models = of_sizes.iter().map(|measured| {
        let points = measured.iter().map(|m| [f64::from(m.case.gaussians), m.entries as f64, m.bytes as f64]);
        LinearModel::of(&points.collect::<Vec<_>>())
    });
    let Some(models) = models.collect::<Option<Vec<_>>>() else { return };
    for ((width, height), m) in SIZES.iter().zip(&models) {
        let [fixed, first, second] = [m.fixed * 1e-6, m.first, m.second].map(number);
        let worst = 100.0 * m.worst;
        println!(
            "- {width}x{height}: {fixed} MB + {first} bytes a Gaussian + {second} bytes an entry; at most {worst:.0} % from it"
        );
    }
    let pixels = SIZES.map(|(width, height)| f64::from(width * height));
    let each = (models[1].fixed - models[0].fixed) / (pixels[1] - pixels[0]);
    println!("- a pixel: {} bytes, from what the two images take without Gaussians", number(each));
    let at_limit = (20e9 - models[1].fixed) / (models[1].first + models[1].second * mean_entries(&of_sizes[1]));
    println!("- 20 GB hold {} million Gaussians at {}x{}", number(at_limit / 1e6), SIZES[1].0, SIZES[1].1);
}

/// Mean entries per Gaussian.
fn mean_entries(measured: &[Measured]) -> f64 {
    measure::mean(measured.iter().map(|m| m.entries as f64 / f64::from(m.case.gaussians)))
}
