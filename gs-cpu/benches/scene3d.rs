//! Random 3D scenes: time of forward and backward, and of training steps with each kind of optimizer
//! state. `gs profile` measures the stages of a step of any scene.
//!
//! `cargo bench -p gs-cpu --bench scene3d -- [SCENE…]`, with the scene names of the output; all
//! without names. Scenes are drawn with the fixed seed [`SEED`].

#![allow(clippy::print_stdout)]

mod garden;

use gs_core::Backend as _;
use pollster::FutureExt as _;
use std::time::Instant;

use garden::{Random, SEED, garden};
use glam::Vec3;
use gs_core::{
    AdamRates, Binning, Blend, Camera, Error, Gaussian3d, Image, Loss, MomentFormat, Optimizer, Parameterization,
    Participants, RenderSettings, Scene, Scene3d, TrainStep,
    effects::{Antialias, Order, Statistics},
    logit,
    profile::{Quantiles, still},
};
use gs_cpu::{CpuRasterizer, CpuSettings};

/// A scene to measure, with its view and settings.
struct Subject {
    name: String,
    scene: Scene3d,
    camera: Camera,
    settings: RenderSettings,
    repetitions: usize,
}

/// A start from structure from motion as in 3DGS: grey, translucent Gaussians at points on an
/// object and around it, each with the mean distance of its three nearest neighbours as scale.
fn structure_from_motion(count: usize, (width, height): (u32, u32)) -> (Scene3d, Camera) {
    let mut random = Random(SEED);
    let points: Vec<Vec3> = (0..count)
        .map(|i| match i % 10 {
            0..7 => Vec3::new(0.0, 0.1, 2.6) + random.direction() * Vec3::new(0.8, 0.35, 0.35),
            7..9 => Vec3::new(6.0 * random.unit() - 3.0, 0.5, 1.2 + 6.0 * random.unit()),
            _ => Vec3::new(0.0, 0.0, 3.0) + random.direction() * 6.0,
        })
        .collect();
    let mut scene = Scene3d { sh_degree: 3, ..Scene3d::default() };
    for &point in &points {
        let mut nearest = [f32::INFINITY; 3];
        for &other in points.iter().filter(|&&other| other != point) {
            let mut distance = point.distance_squared(other);
            for slot in &mut nearest {
                if distance < *slot {
                    std::mem::swap(slot, &mut distance);
                }
            }
        }
        let scale = (nearest.iter().sum::<f32>() / 3.0).max(1e-7).sqrt();
        let gaussian = Gaussian3d {
            mean: point,
            log_scale: Vec3::splat(scale.ln()),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: logit(0.1),
            sh: vec![Vec3::new(random.normal(), random.normal(), random.normal()) * 0.5],
        };
        scene.push(gaussian.with_degree(3));
    }
    (scene, Camera::looking_forward(width, height, 1.1))
}

fn settings(order: Order, sh_degree: u8) -> RenderSettings {
    let mut settings = RenderSettings::blended(Blend::Over);
    settings.effects.order = order;
    settings.effects.sh_degree = sh_degree;
    settings.effects.antialias = Antialias::Dilate;
    settings.effects.statistics = Statistics::MeanGradient;
    settings
}

/// Number of Gaussians, and the image's columns and rows.
type Size = (usize, (u32, u32));

fn subjects() -> Vec<(String, Box<dyn Fn() -> Subject>)> {
    let full = (1920, 1080);
    let start: [(&str, Size, Order); 2] =
        [("start", (6_277, (800, 532)), Order::Global), ("start-per-pixel", (6_277, (800, 532)), Order::PerPixel)];
    let gardens: [(&str, Size, Order); 6] = [
        ("garden-250k", (250_000, full), Order::Global),
        ("garden-500k", (500_000, full), Order::Global),
        ("garden-1m", (1_000_000, full), Order::Global),
        ("garden-2m", (2_000_000, full), Order::Global),
        ("garden-4m", (4_000_000, full), Order::Global),
        ("garden-250k-per-pixel", (250_000, full), Order::PerPixel),
    ];
    let subject = |(name, (count, size), order): (&str, Size, Order), make: fn(usize, (u32, u32)) -> _, sh_degree| {
        let name = name.to_owned();
        let repetitions = if count < 100_000 { 15 } else { 5 };
        let of = name.clone();
        let make = move || {
            let (scene, camera) = make(count, size);
            Subject { name: of.clone(), scene, camera, settings: settings(order, sh_degree), repetitions }
        };
        (name, Box::new(make) as Box<dyn Fn() -> Subject>)
    };
    let starts = start.into_iter().map(|s| subject(s, structure_from_motion, 0));
    starts.chain(gardens.into_iter().map(|s| subject(s, garden, 3))).collect()
}

/// The median time of `work`, ms, after one run to warm up.
fn median(repetitions: usize, mut work: impl FnMut() -> Result<(), Error>) -> Result<f64, Error> {
    work()?;
    let mut seconds = Vec::with_capacity(repetitions);
    for _ in 0..repetitions {
        let start = Instant::now();
        work()?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    Ok(Quantiles::of(&seconds).median * 1e3)
}

fn measure(cpu: &impl Optimizer<Scene3d>, subject: &Subject) -> Result<(), Error> {
    let Subject { name, scene, camera, settings, repetitions } = subject;
    let image = Image::from_fn(camera.width, camera.height, |x, y| {
        [x as f32 / camera.width as f32, y as f32 / camera.height as f32, 0.5]
    })?;
    let target = cpu.upload_target(&image)?;
    let mut splats = cpu.upload(scene, Parameterization::ScaleRotation)?;
    let (loss, rates) = (Loss::PAPER, still());
    println!("{name}: {} Gaussians, {}x{} px", scene.len(), camera.width, camera.height);
    let both = median(*repetitions, || {
        let pass = cpu.forward(&splats, camera, settings).block_on()?;
        cpu.backward(&splats, pass, &target, &loss).block_on().map(drop)
    })?;
    println!("  {:36} {both:8.1} ms", "forward and backward");
    let half = AdamRates { color_rest_moments: MomentFormat::Bf16, ..rates };
    let together = AdamRates { participants: Participants::Visible, ..half };
    for (name, rates) in [
        ("training step", rates),
        ("with color-rest-moments = bf16", half),
        ("and with participants = visible", together),
    ] {
        let step = TrainStep { settings, loss, rates: &rates, binning: Binning::Fresh };
        let whole = median(*repetitions, || cpu.train_step(&mut splats, camera, &target, &step).block_on())?;
        println!("  {name:36} {whole:8.1} ms");
    }
    Ok(())
}

fn main() -> Result<(), Error> {
    // Cargo adds `--bench`.
    let wanted: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let cpu = CpuRasterizer::new(CpuSettings::default())?;
    println!("{}, seed {SEED}, L1 + D-SSIM, dilated, mean gradient", cpu.for_3d().describe());
    for (_, make) in subjects().iter().filter(|(name, _)| wanted.is_empty() || wanted.contains(name)) {
        measure(cpu.for_3d(), &make())?;
    }
    Ok(())
}
