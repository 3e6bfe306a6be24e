//! Fits that are made to fail, and must not: learning rates a hundred times too high, targets that
//! nothing can fit, brightness beyond all measure, nothing to see at all. No NaN, no count beyond
//! the budget, no memory without end, and a loss no worse than at the start.
//!
//! The slow tests run 20,000 steps from each of 20 seeds; the ordinary ones a few hundred from two.

/// Shared with other tests, which use all of it.
#[allow(dead_code)]
#[path = "../../gs-train/tests/main/fixture_3d.rs"]
mod fixture_3d;

use glam::{Vec2, Vec3};
use gs_core::{
    Adam, Blend, Camera, Canvas, Gaussian2d, Image, Loss, Optimizer, Parameterization, RenderSettings, Scene, Scene2d,
    Scene3d, adam::Group,
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::{
    Control, Error, FitSettings, InitialCount, Observer, Progress, TrainPreset, Trainable, Trainer, Trainer3d,
    train::{PosedView, Start, Views},
};
use pollster::FutureExt as _;
use rand::{RngExt, SeedableRng};

/// What is hostile about a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Hostility {
    /// All learning rates times 100.
    Rates,
    /// Every pixel another colour.
    Noise,
    /// Black and white by turns, pixel by pixel.
    Checkerboard,
    /// Noise up to 10,000.
    Bright,
    /// Nothing but black.
    Black,
    /// Nothing but white.
    White,
    /// Gaussians of which nothing is seen to begin with.
    Transparent,
    /// All at once: noise up to 10,000 with learning rates times 100.
    BrightRates,
}

impl Hostility {
    const ALL: [Self; 8] = [
        Self::Rates,
        Self::Noise,
        Self::Checkerboard,
        Self::Bright,
        Self::Black,
        Self::White,
        Self::Transparent,
        Self::BrightRates,
    ];

    /// A target of this size, from a seed.
    fn target(self, (width, height): (u32, u32), seed: u32) -> Image {
        let mut rng = gs_density::Rng::seed_from_u64(seed.into());
        let mut noise = move |brightest: f32| std::array::from_fn(|_| rng.random_range(0.0..=brightest));
        let pixel = |x: u32, y: u32| match self {
            Self::Noise => noise(1.0),
            Self::Bright | Self::BrightRates => noise(1e4),
            Self::Checkerboard => [((x + y) % 2) as f32; 3],
            Self::Black => [0.0; 3],
            Self::White => [1.0; 3],
            Self::Rates | Self::Transparent => [x as f32 / width as f32, y as f32 / height as f32, 0.5],
        };
        Image::from_fn(width, height, pixel).expect("a possible size")
    }

    /// Whether the fit's rates are too high.
    fn is_hasty(self) -> bool {
        matches!(self, Self::Rates | Self::BrightRates)
    }

    fn adam(self, usual: Adam) -> Adam {
        if !self.is_hasty() {
            return usual;
        }
        let hasty = |group: Group| group.with(|s| s.learning_rate = 100.0 * group.learning_rate);
        usual.with(|s| {
            s.mean = hasty(usual.mean);
            s.scale = hasty(usual.scale);
            s.rotation = hasty(usual.rotation);
            s.opacity = hasty(usual.opacity);
            s.color = hasty(usual.color);
            s.color_rest = hasty(usual.color_rest);
        })
    }
}

/// Length of the fits, and the number of their seeds.
#[derive(Debug, Clone, Copy)]
struct Length {
    steps: u32,
    seeds: u32,
}

const SHORT: Length = Length { steps: 300, seeds: 2 };
const LONG: Length = Length { steps: 20_000, seeds: 20 };

/// The largest allowed ratio of the loss at the end to that at the start: 1, apart from rounding.
const NO_WORSE: f64 = 1.0 + 1e-6;

/// Largest memory of the process after all its fits, of 60 Gaussians on 192 pixels, where the
/// system reports it.
const MOST_BYTES: u64 = 256 << 20;

/// The record of a fit.
#[derive(Default)]
struct TrainingTask {
    losses: Vec<f32>,
    most: u32,
}

impl Observer for TrainingTask {
    fn on_step(&mut self, progress: &Progress) -> Control {
        self.most = self.most.max(progress.count);
        Control::Continue
    }

    fn on_losses(&mut self, _: u32, losses: &[f32]) {
        self.losses.extend(losses);
    }
}

/// Runs a fit to its end and checks the result; returns the number of restarts. `loss_of` is the
/// loss of a scene over all images.
fn endure<R: Optimizer<S>, S: Trainable>(
    mut trainer: Trainer<'_, R, S>,
    loss_of: impl Fn(&S) -> Result<f64, Error>,
    budget: u32,
) -> Result<usize, String> {
    let text = |error: Error| error.to_string();
    let first = trainer.scene().block_on().and_then(|scene| loss_of(&scene)).map_err(text)?;
    let mut trajectory = TrainingTask::default();
    trainer.run(&mut trajectory).block_on().map_err(text)?;
    let scene = trainer.scene().block_on().map_err(text)?;
    scene.validate().map_err(|error| error.to_string())?;
    if trajectory.most > budget {
        return Err(format!("{} Gaussians, {budget} allowed", trajectory.most));
    }
    let last = loss_of(&scene).map_err(text)?;
    if last <= first * NO_WORSE {
        return Ok(trainer.fresh_starts().len());
    }
    let (count, least) = (scene.len(), trajectory.losses.iter().copied().fold(f32::INFINITY, f32::min));
    let fresh_starts: Vec<u32> = trainer.fresh_starts().iter().map(|start| start.step).collect();
    Err(format!(
        "the loss was {first:e}, {least:e} at its least, and is {last:e}, of {count} Gaussians; fresh starts: {fresh_starts:?}"
    ))
}

/// Runs every hostility from every seed and reports all failures and restarts.
#[expect(clippy::print_stdout, reason = "the numbers of a record")]
fn endure_all(length: Length, fit: impl Fn(Hostility, u32) -> Result<usize, String>) {
    let mut failures = Vec::new();
    for hostility in Hostility::ALL {
        let (mut restarted, mut fresh_starts) = (0, 0);
        for seed in 0..length.seeds {
            match fit(hostility, seed) {
                Ok(count) => (restarted, fresh_starts) = (restarted + usize::from(count > 0), fresh_starts + count),
                Err(failure) => failures.push(format!("{hostility:?}, seed {seed}: {failure}")),
            }
        }
        println!("{hostility:?}: {restarted} of {} restarted, {fresh_starts} times", length.seeds);
    }
    assert!(failures.is_empty(), "{} fits failed:\n{}", failures.len(), failures.join("\n"));
    let peak = peak_memory().unwrap_or(0);
    assert!(peak <= MOST_BYTES, "{peak} bytes");
}

/// Peak memory of this process in bytes; on Linux only.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

const PLANE: (u32, u32) = (16, 12);

/// The project's own settings for images under `Sum`; the paper's under `Over`.
fn scene_2d(
    rasterizer: &CpuRasterizer,
    hostility: Hostility,
    blend: Blend,
    length: Length,
    seed: u32,
) -> Result<usize, String> {
    let usual = match blend {
        Blend::Sum => FitSettings::for_image(24, PLANE, length.steps),
        Blend::Over => FitSettings::paper().with_iterations(length.steps),
    };
    let settings = usual.with(|s| {
        s.gaussians = 24;
        s.initial = InitialCount::Fixed(8);
        s.seed = seed;
        s.adam = hostility.adam(s.adam);
    });
    let target = hostility.target(PLANE, seed);
    let trainer = match hostility {
        Hostility::Transparent => {
            let unseen = |i: u32| Gaussian2d {
                mean: Vec2::new(2.0 * i as f32, i as f32),
                log_scale: Vec2::splat(0.5),
                rotation: 0.0,
                opacity_logit: if blend == Blend::Over { -30.0 } else { f32::INFINITY },
                color: Vec3::ZERO,
            };
            Trainer::from_scene(rasterizer, &target, &(0..8).map(unseen).collect::<Scene2d>(), settings.clone())
                .block_on()
        }
        _ => Trainer::new(rasterizer, &target, settings.clone()).block_on(),
    };
    let pictures = [(Canvas::new(PLANE.0, PLANE.1), target.clone())];
    let loss_of = |scene: &Scene2d| loss_of(rasterizer, scene, &pictures, (&settings.render, settings.loss));
    endure(trainer.map_err(|error| error.to_string())?, loss_of, 24)
}

/// The mean loss of a scene over these pictures.
fn loss_of<R: Optimizer<S>, S: Scene>(
    on: &R,
    scene: &S,
    pictures: &[(S::View, Image)],
    (render, loss): (&RenderSettings, Loss),
) -> Result<f64, Error> {
    let splats = on.upload(scene, Parameterization::ScaleRotation)?;
    let losses = pictures.iter().map(|(view, target)| {
        let frame = on.forward(&splats, view, render).block_on()?;
        Ok(f64::from(on.backward(&splats, frame, &on.upload_target(target)?, &loss).block_on()?.0))
    });
    Ok(losses.sum::<Result<f64, Error>>()? / pictures.len() as f64)
}

/// Two views of nearly the same, by the settings of 3DGS.
fn scene_3d(rasterizer: &CpuRasterizer, hostility: Hostility, length: Length, seed: u32) -> Result<usize, String> {
    let camera = |i: usize| {
        let camera = Camera { width: PLANE.0, height: PLANE.1, ..fixture_3d::camera(i) };
        Camera { center: Vec2::new(8.0, 6.0), focal: Vec2::splat(20.0), ..camera }
    };
    let target = hostility.target(PLANE, seed);
    let usual = TrainPreset::ThreeDgs.settings(Some(length.steps));
    let mut settings = usual.with(|s| {
        s.gaussians = 60;
        s.seed = seed;
        s.adam = hostility.adam(s.adam);
    });
    settings.init.random = 30;
    let mut start = fixture_3d::thirty();
    if hostility == Hostility::Transparent {
        start.opacity_logits.fill(-30.0);
    }
    let views = (0..2).map(|i| PosedView::of_image(format!("{i}"), camera(i), target.clone())).collect();
    let views = Views::new(views, Vec::new());
    let trainer = Trainer3d::from_views(rasterizer, views, Start::Scene(start), settings.clone());
    let pictures: Vec<(Camera, Image)> = (0..2).map(|i| (camera(i), target.clone())).collect();
    let loss_of = |scene: &Scene3d| loss_of(rasterizer, scene, &pictures, (&settings.render, settings.loss));
    endure(trainer.block_on().map_err(|error| error.to_string())?, loss_of, 60)
}

/// A rasterizer with one thread: the images are too small for more.
fn rasterizer() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings::default().with(|s| {
        s.threads = Some(1);
        s.level = None;
    }))
    .expect("a thread can be started")
}

#[test]
fn short_hostile_fits_under_sum_end_well() {
    let rasterizer = rasterizer();
    endure_all(SHORT, |hostility, seed| scene_2d(&rasterizer, hostility, Blend::Sum, SHORT, seed));
}

#[test]
fn short_hostile_fits_under_over_end_well() {
    let rasterizer = rasterizer();
    endure_all(SHORT, |hostility, seed| scene_2d(&rasterizer, hostility, Blend::Over, SHORT, seed));
}

#[test]
fn short_hostile_3d_trainings_end_well() {
    let rasterizer = rasterizer();
    endure_all(SHORT, |hostility, seed| scene_3d(&rasterizer, hostility, SHORT, seed));
}

#[test]
#[ignore = "slow: 160 fits of 20,000 steps; `cargo xtask test --slow` runs it"]
fn long_hostile_fits_under_sum_end_well() {
    let rasterizer = rasterizer();
    endure_all(LONG, |hostility, seed| scene_2d(&rasterizer, hostility, Blend::Sum, LONG, seed));
}

#[test]
#[ignore = "slow: 160 fits of 20,000 steps; `cargo xtask test --slow` runs it"]
fn long_hostile_fits_under_over_end_well() {
    let rasterizer = rasterizer();
    endure_all(LONG, |hostility, seed| scene_2d(&rasterizer, hostility, Blend::Over, LONG, seed));
}

#[test]
#[ignore = "slow: 160 trainings of 20,000 steps; `cargo xtask test --slow` runs it"]
fn long_hostile_3d_trainings_end_well() {
    let rasterizer = rasterizer();
    endure_all(LONG, |hostility, seed| scene_3d(&rasterizer, hostility, LONG, seed));
}
