//! Fits that are made to fail, and must not: learning rates a hundred times too high, targets that nothing can fit, brightness beyond all
//! measure, nothing to see at all. No NaN, no count beyond the budget, no memory without end, and a loss no worse than at the start.
//!
//! The slow tests run 20,000 steps from each of 20 seeds; the ordinary ones a few hundred from two.

/// Shared with benchmarks, which use all of it.
#[allow(dead_code)]
#[path = "../benches/measure/memory.rs"]
mod memory;
/// Shared with other tests, which use all of it.
#[allow(dead_code)]
mod space;

use glam::{Vec2, Vec3};
use gs_core::{Adam, Blend, Image, PlanarGaussian, PlanarScene, Rasterizer, SpatialScene, adam::Group};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::{
    Control, Error, FitSettings, InitialCount, Observer, Progress, SpatialPreset, SpatialSettings, SpatialTrainer,
    Trainable, Trainer,
    spatial::{PosedView, Start, Views},
};
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

    /// Whether its rates are too high.
    fn is_hasty(self) -> bool {
        matches!(self, Self::Rates | Self::BrightRates)
    }

    fn adam(self, usual: Adam) -> Adam {
        if !self.is_hasty() {
            return usual;
        }
        let hasty = |group: Group| Group { learning_rate: 100.0 * group.learning_rate, ..group };
        Adam {
            mean: hasty(usual.mean),
            scale: hasty(usual.scale),
            rotation: hasty(usual.rotation),
            opacity: hasty(usual.opacity),
            color: hasty(usual.color),
            color_rest: hasty(usual.color_rest),
            ..usual
        }
    }
}

/// How long, and from how many seeds.
#[derive(Debug, Clone, Copy)]
struct Length {
    steps: u32,
    seeds: u32,
    /// So many times the loss at the start may be that at the end. A short fit whose rates are too high ends while they still are.
    worst: f64,
}

const SHORT: Length = Length { steps: 300, seeds: 2, worst: 2.0 };
const LONG: Length = Length { steps: 20_000, seeds: 20, worst: 1.001 };
/// Sixty Gaussians cannot follow noise or a checkerboard, and where all opacities have been reset they do not always come back to what they were.
const LONG_IN_SPACE: Length = Length { worst: 1.06, ..LONG };

/// What a process may have had at most after all its fits, of 60 Gaussians on 192 pixels, where the system tells.
const MOST_BYTES: u64 = 256 << 20;

/// Of the steps, this part at the end is what the loss has come to: one step may have another view than the first, or be a stumble.
const END: usize = 10;

/// What a fit went through.
#[derive(Default)]
struct Course {
    losses: Vec<f32>,
    most: u32,
}

impl Observer for Course {
    fn on_step(&mut self, progress: &Progress) -> Control {
        self.most = self.most.max(progress.count);
        Control::Continue
    }

    fn on_losses(&mut self, _: u32, losses: &[f32]) {
        self.losses.extend(losses);
    }
}

/// Runs a fit to its end and finds what must not be. With rates that are too high every Gaussian may leave the picture, or vanish, where steps are in
/// pixels or world units: such a fit may end at the loss of `nothing`.
fn endure<R: Rasterizer<S>, S: Trainable>(
    mut trainer: Trainer<'_, R, S>,
    budget: u32,
    length: Length,
    nothing: Option<f32>,
) -> Result<(), String> {
    let mut course = Course::default();
    trainer.run(&mut course).map_err(|error| error.to_string())?;
    let scene = trainer.scene().map_err(|error| error.to_string())?;
    scene.validate().map_err(|error| error.to_string())?;
    if course.most > budget {
        return Err(format!("{} Gaussians, {budget} allowed", course.most));
    }
    let part = (course.losses.len() / END).max(1);
    let mean = |losses: &[f32]| losses.iter().map(|&loss| f64::from(loss)).sum::<f64>() / losses.len() as f64;
    // As many steps at the start would hide a fit that is worse than what it began with.
    let (first, last) = (mean(&course.losses[..part.min(4)]), mean(&course.losses[course.losses.len() - part..]));
    if last <= first.max(nothing.unwrap_or(0.0).into()) * length.worst {
        return Ok(());
    }
    let least = course.losses.iter().copied().fold(f32::INFINITY, f32::min);
    Err(format!("the loss was {first:e}, {least:e} at its least, and is {last:e}, of {} Gaussians", scene.len()))
}

/// Runs every hostility from every seed and tells of all that failed.
fn endure_all(length: Length, fit: impl Fn(Hostility, u32) -> Result<(), String>) {
    let mut failures = Vec::new();
    for hostility in Hostility::ALL {
        for seed in 0..length.seeds {
            if let Err(failure) = fit(hostility, seed) {
                failures.push(format!("{hostility:?}, seed {seed}: {failure}"));
            }
        }
    }
    assert!(failures.is_empty(), "{} fits failed:\n{}", failures.len(), failures.join("\n"));
    let peak = memory::peak().unwrap_or(0);
    assert!(peak <= MOST_BYTES, "{peak} bytes");
}

const PLANE: (u32, u32) = (16, 12);

/// The project's own settings for images under `Sum`; the paper's under `Over`.
fn planar(
    rasterizer: &CpuRasterizer,
    hostility: Hostility,
    blend: Blend,
    length: Length,
    seed: u32,
) -> Result<(), String> {
    let usual = match blend {
        Blend::Sum => FitSettings::for_image(24, PLANE, length.steps),
        Blend::Over => FitSettings::paper().with_iterations(length.steps),
    };
    let settings =
        FitSettings { gaussians: 24, initial: InitialCount::Fixed(8), seed, adam: hostility.adam(usual.adam), ..usual };
    let target = hostility.target(PLANE, seed);
    let trainer = match hostility {
        Hostility::Transparent => {
            let unseen = |i: u32| PlanarGaussian {
                mean: Vec2::new(2.0 * i as f32, i as f32),
                log_scale: Vec2::splat(0.5),
                rotation: 0.0,
                opacity_logit: if blend == Blend::Over { -30.0 } else { f32::INFINITY },
                color: Vec3::ZERO,
            };
            Trainer::from_scene(rasterizer, &target, &(0..8).map(unseen).collect::<PlanarScene>(), settings.clone())
        }
        _ => Trainer::new(rasterizer, &target, settings.clone()),
    };
    // In the local frame none gets so far.
    let nothing = match blend == Blend::Over && hostility.is_hasty() {
        true => Some(first_loss(Trainer::from_scene(rasterizer, &target, &PlanarScene::default(), settings))?),
        false => None,
    };
    endure(trainer.map_err(|error| error.to_string())?, 24, length, nothing)
}

/// The loss that a fit begins with.
fn first_loss<R: Rasterizer<S>, S: Trainable>(trainer: Result<Trainer<'_, R, S>, Error>) -> Result<f32, String> {
    trainer.and_then(|mut trainer| trainer.step_once()).map(|progress| progress.loss).map_err(|error| error.to_string())
}

/// Two views of nearly the same, by the settings of 3DGS.
fn spatial(rasterizer: &CpuRasterizer, hostility: Hostility, length: Length, seed: u32) -> Result<(), String> {
    let view = |i: usize| {
        let camera = gs_core::Camera { width: PLANE.0, height: PLANE.1, ..space::camera(i) };
        let camera = gs_core::Camera { center: Vec2::new(8.0, 6.0), focal: Vec2::splat(20.0), ..camera };
        PosedView::of_image(format!("{i}"), camera, hostility.target(PLANE, seed))
    };
    let usual = SpatialPreset::ThreeDgs.settings(Some(length.steps));
    let mut settings = SpatialSettings { gaussians: 60, seed, adam: hostility.adam(usual.adam), ..usual };
    settings.init.random = 30;
    let mut unseen = space::thirty();
    unseen.opacity_logits.fill(-30.0);
    let start = if hostility == Hostility::Transparent { unseen.clone() } else { space::thirty() };
    let train = |scene: SpatialScene, settings: SpatialSettings| {
        let views = Views::new((0..2).map(view).collect(), Vec::new());
        SpatialTrainer::from_views(rasterizer, views, Start::Scene(scene), settings)
    };
    let trainer = train(start, settings.clone());
    // 3DGS prunes what is larger than a tenth of the scene, and a white picture is made of nothing else: what is left is seen by no view.
    let nothing = match hostility.is_hasty() || hostility == Hostility::White {
        true => Some(first_loss(train(unseen, settings))?),
        false => None,
    };
    endure(trainer.map_err(|error| error.to_string())?, 60, length, nothing)
}

/// One thread: the images are too small for more.
fn rasterizer() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings { threads: Some(1), level: None }).expect("a thread can be started")
}

#[test]
fn short_hostile_fits_under_sum_end_well() {
    let rasterizer = rasterizer();
    endure_all(SHORT, |hostility, seed| planar(&rasterizer, hostility, Blend::Sum, SHORT, seed));
}

#[test]
fn short_hostile_fits_under_over_end_well() {
    let rasterizer = rasterizer();
    endure_all(SHORT, |hostility, seed| planar(&rasterizer, hostility, Blend::Over, SHORT, seed));
}

#[test]
fn short_hostile_trainings_in_space_end_well() {
    let rasterizer = rasterizer();
    endure_all(SHORT, |hostility, seed| spatial(&rasterizer, hostility, SHORT, seed));
}

#[test]
#[ignore = "slow: 160 fits of 20,000 steps; `cargo xtask test --slow` runs it"]
fn long_hostile_fits_under_sum_end_well() {
    let rasterizer = rasterizer();
    endure_all(LONG, |hostility, seed| planar(&rasterizer, hostility, Blend::Sum, LONG, seed));
}

#[test]
#[ignore = "slow: 160 fits of 20,000 steps; `cargo xtask test --slow` runs it"]
fn long_hostile_fits_under_over_end_well() {
    let rasterizer = rasterizer();
    endure_all(LONG, |hostility, seed| planar(&rasterizer, hostility, Blend::Over, LONG, seed));
}

#[test]
#[ignore = "slow: 160 trainings of 20,000 steps; `cargo xtask test --slow` runs it"]
fn long_hostile_trainings_in_space_end_well() {
    let rasterizer = rasterizer();
    endure_all(LONG_IN_SPACE, |hostility, seed| spatial(&rasterizer, hostility, LONG_IN_SPACE, seed));
}
