//! Time of one round of growth by residual.
//!
//! `cargo run --release -p gs-density --example growth_round` prints the best and the median of 31
//! rounds on a 768×512 picture.
#![allow(clippy::print_stdout, reason = "a report is what this program is for")]

use std::time::Instant;

use glam::{Vec2, Vec3};
use gs_core::{DensityStatistics, Gaussian2d, Image, Scene2d};
use gs_density::{DensityPolicy, Observation, Residual, ResidualGrowth, Rng};
use rand::SeedableRng;

const WIDTH: u32 = 768;
const HEIGHT: u32 = 512;

fn main() -> Result<(), gs_core::Error> {
    let target = Image::from_fn(WIDTH, HEIGHT, |x, y| {
        let (x, y) = (x as f32, y as f32);
        [0.5 + 0.4 * (x * 0.11).sin() * (y * 0.07).cos(), 0.5 + 0.4 * (x * y * 2e-4).sin(), (0.01 * (x + y)).fract()]
    })?;
    let rendered = Image::from_fn(WIDTH, HEIGHT, |x, y| {
        let t = target.pixel(x, y);
        let error = 0.05 * (x as f32 * 0.37).sin() * (y as f32 * 0.23).sin();
        t.map(|v| v + error)
    })?;
    let residual = Residual::new(target, rendered);

    for (count, budget, progress) in
        [(2_800, 9_000, 0.2), (9_000, 9_000, 0.6), (22_000, 70_000, 0.2), (70_000, 70_000, 0.6)]
    {
        let scene = scene(count);
        let statistics = DensityStatistics::zeros(count);
        let observation = Observation {
            scene: &scene,
            statistics: &statistics,
            residual: Some(&residual),
            evidence: None,
            extent: WIDTH as f32,
            step: 60,
            progress,
            progress_before: 0.0,
            budget,
        };
        let mut rng = Rng::seed_from_u64(2);
        let plan = ResidualGrowth::default().plan(&observation, &mut rng)?;
        let name = format!("round at {count}: -{} +{}", plan.removed.len(), plan.added.len());
        report(&name, || ResidualGrowth::default().plan(&observation, &mut rng));
    }
    Ok(())
}

fn scene(count: usize) -> Scene2d {
    (0..count)
        .map(|i| Gaussian2d {
            mean: Vec2::new((i * 37 % WIDTH as usize) as f32, (i * 101 % HEIGHT as usize) as f32),
            log_scale: Vec2::new(0.5 + (i % 17) as f32 * 0.1, 0.3),
            rotation: 0.0,
            opacity_logit: f32::INFINITY,
            color: Vec3::splat(0.01 + (i % 101) as f32 * 0.01),
        })
        .collect()
}

fn report<T>(name: &str, mut work: impl FnMut() -> T) {
    let mut times: Vec<f64> = (0..31)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(work());
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{name:34} best {:7.3} ms, median {:7.3} ms", times[0], times[15]);
}
