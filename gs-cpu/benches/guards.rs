//! What an iteration of training costs, to be held against one without the guards of the arithmetic.
//!
//! `cargo bench -p gs-cpu --bench guards`, and the same with `RUSTFLAGS='--cfg guards="off"'` and a target directory of its own: then all guards
//! are left out that an ordinary scene does without. The two programs are to take turns. 9,000 Gaussians of the sizes that a fit of a Kodak
//! photograph has, and as many in space, 768×512 px, drawn from a fixed seed; one thread.

#![allow(clippy::print_stdout)]

mod garden;

use std::time::Instant;

use garden::{Random, SEED, garden};
use glam::{Vec2, Vec3};
use gs_core::{
    Adam, Binning, Blend, Canvas, Chart, Error, Image, Loss, PlanarGaussian, PlanarScene, Rasterizer, RenderSettings,
    Scene, TrainStep, Wait, adam::Group, guards::Guard, profile::Quantiles,
};
use gs_cpu::{CpuRasterizer, CpuSettings};

const SIZE: (u32, u32) = (768, 512);

const GAUSSIANS: usize = 9_000;

/// Iterations that are measured, after half as many that are not.
const ITERATIONS: usize = 80;

/// Iterations between two makings of lists.
const REBIN_EVERY: usize = 4;

/// A scene, and how it is trained.
struct Training<S: Scene> {
    name: &'static str,
    scene: S,
    view: S::View,
    settings: RenderSettings,
    loss: Loss,
    chart: Chart,
    adam: Adam,
}

/// σ of about 4 px, aspects of about 2, as a fit's are.
fn planar(name: &'static str, blend: Blend, loss: Loss, chart: Chart) -> Training<PlanarScene> {
    let mut random = Random(SEED);
    let gaussian = |_| PlanarGaussian {
        mean: Vec2::new(random.unit() * SIZE.0 as f32, random.unit() * SIZE.1 as f32),
        log_scale: Vec2::new(1.4 + 0.6 * random.normal(), 1.0 + 0.6 * random.normal()),
        rotation: random.unit() * std::f32::consts::TAU,
        opacity_logit: if blend == Blend::Sum { f32::INFINITY } else { random.normal() },
        color: Vec3::new(random.unit(), random.unit(), random.unit()) * 0.3,
    };
    let (scene, view) = ((0..GAUSSIANS).map(gaussian).collect(), Canvas::new(SIZE.0, SIZE.1));
    let settings = RenderSettings::blended(blend);
    Training { name, scene, view, settings, loss, chart, adam: Adam::default() }
}

/// Waves that have nothing to do with any of the scenes.
fn target() -> Result<Image, Error> {
    Image::from_fn(SIZE.0, SIZE.1, |x, y| {
        let (x, y) = (x as f32 * 0.02, y as f32 * 0.03);
        [0.5 + 0.4 * (x + y).sin(), 0.5 + 0.3 * (x * 1.7).cos(), 0.5 + 0.4 * (y - 0.3 * x).sin()]
    })
}

/// Prints milliseconds of an iteration, and the last loss, in which both programs should agree.
fn measure<S: Scene>(training: &Training<S>) -> Result<(), Error>
where
    CpuRasterizer: Rasterizer<S>,
{
    let Training { name, scene, view, settings, loss, chart, adam } = training;
    let rasterizer = CpuRasterizer::new(CpuSettings { threads: Some(1), level: None })?;
    let mut cloud = rasterizer.upload(scene, *chart)?;
    let target = <CpuRasterizer as Rasterizer<S>>::upload_target(&rasterizer, &target()?)?;
    let rates = adam.at(0.0);
    let (mut rounds, mut losses) = (Vec::new(), Vec::new());
    let warm = ITERATIONS / 2 / REBIN_EVERY;
    for round in 0..warm + ITERATIONS / REBIN_EVERY {
        let started = Instant::now();
        for step in 0..REBIN_EVERY {
            let binning = if step == 0 { Binning::Fresh } else { Binning::Reuse };
            let step = TrainStep { settings, loss: *loss, rates: &rates, binning };
            rasterizer.train_step(&mut cloud, view, &target, &step)?;
        }
        rasterizer.losses(&mut cloud, Wait::All, &mut losses)?;
        if round >= warm {
            rounds.push(started.elapsed().as_secs_f64() * 1e3 / REBIN_EVERY as f64);
        }
    }
    let (Quantiles { low, median, high }, last) = (Quantiles::of(&rounds), losses.last().copied().unwrap_or_default());
    println!("{name}: {median:.3} ms ({low:.3}–{high:.3}), last loss {last:e}");
    Ok(())
}

fn main() -> Result<(), Error> {
    let on = Guard::ALL.iter().filter(|guard| guard.is_on()).count();
    println!("{on} of {} guards", Guard::ALL.len());
    measure(&planar("sum, L2, local frames", Blend::Sum, Loss::L2, Chart::LocalFrame))?;
    measure(&planar("over, L2", Blend::Over, Loss::L2, Chart::ScaleRotation))?;
    measure(&planar("over, L1 + D-SSIM", Blend::Over, Loss::PAPER, Chart::ScaleRotation))?;
    let (scene, view) = garden(GAUSSIANS, SIZE);
    // Small enough steps that the scene stays what it is.
    let adam = Adam { mean: Group::constant(1e-4), scale: Group::constant(1e-3), ..Adam::default() };
    let (settings, loss, chart) = (RenderSettings::blended(Blend::Over), Loss::PAPER, Chart::ScaleRotation);
    measure(&Training { name: "in space, L1 + D-SSIM", scene, view, settings, loss, chart, adam })
}
