//! Numerical instability (paper §3.4.2): what becomes of a loss and its gradients as a scale goes to zero, without guards, with the
//! paper's clamp and ε, and with this project's guards, which allow less than a pixel; and what each costs in PSNR.
//!
//! The product's guards cannot be switched off. What is computed without them is computed by `textbook`, a dense solver as the paper's
//! formulas are written down, of which nothing else is used.

mod findings;

use glam::{Mat2, Vec2, Vec3};
use gs_core::{Canvas, Image, Loss, PlanarGaussian, PlanarScene, Rasterizer, Scene as _, metrics, scene::logit};
use gs_density::Policy;

use super::{
    Axis, Cell, Chart, Claim, Extent, Findings, Laboratory, Number, Picture, Series, Table, Verdict,
    findings::significant,
    laboratory::{Ellipses, Run, Shown},
    paired::mean,
    set_up::paper_settings,
    textbook::{Guards, Textbook, covariance},
};
use crate::{
    error::Error,
    init::{Init, Random},
    rounds::Rounds,
    settings::{FitSettings, InitialCount},
    targets::SyntheticTarget,
    trainer::Trainer,
};

/// The smallest σ allowed in the fits that price a floor, px: the paper's and this project's.
pub const FLOORS_PX: [f32; 2] = [1.0, 0.25];

/// Gaussians of a small fit.
const SMALL_GAUSSIANS: u32 = 6;

/// Length of the needle whose other scale is driven to zero, px.
const NEEDLE_PX: f32 = 10.0;

/// Adam's steps for the scales in the fits without this project's guards, px. The paper names none.
const SCALE_RATES_PX: [f32; 3] = [0.05, 0.2, 1.0];

/// What keeps a scale from harm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Guard {
    /// Nothing.
    Off,
    /// An ε of 1e-6 px⁴ on the determinant.
    Epsilon,
    /// No scale below 1 px, and the ε: the paper's.
    Paper,
    /// This project's: the product itself.
    Project,
}

impl Guard {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Off, Self::Epsilon, Self::Paper, Self::Project];

    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "none",
            Self::Epsilon => "ε = 1e-6 on the determinant",
            Self::Paper => "the paper's: σ ≥ 1 px and ε",
            Self::Project => "this project's: σ ≥ 0.25 px",
        }
    }

    fn of_textbook(self) -> Option<Guards> {
        match self {
            Self::Off => Some(Guards::OFF),
            Self::Epsilon => Some(Guards::EPSILON),
            Self::Paper => Some(Guards::PAPER),
            Self::Project => None,
        }
    }
}

/// A needle, turned by many angles, one of whose scales goes down to 1e-12 px by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Drive {
    /// What guards it.
    pub guard: Guard,
    /// Angles tried.
    pub angles: usize,
    /// At how many of them the loss or a gradient stops being finite somewhere.
    pub not_finite: usize,
    /// The largest scale at which it does, px.
    pub from_px: Option<f64>,
    /// The largest scale at which the Gaussian is left out, px; this project's guard does that.
    pub left_out_px: Option<f64>,
}

/// Small fits with one guard, in which the optimiser does what it wants.
#[derive(Debug, Clone, PartialEq)]
pub struct Free {
    /// What guards them.
    pub guard: Guard,
    /// Adam's step for the scales, px; nothing for the product, which moves their logarithms.
    pub scale_rate_px: Option<f32>,
    /// Fits made, one a seed.
    pub fits: usize,
    /// Fits whose loss or gradients stopped being finite.
    pub diverged: usize,
    /// The smallest |σ| met in any of them, px.
    pub smallest_scale_px: f64,
    /// PSNR at the end of the fits that lived, dB, mean; nothing where none did.
    pub psnr: Option<f64>,
}

/// A floor of the scales in the paper's own fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// The target.
    pub target: &'static str,
    /// The smallest σ allowed, px.
    pub min_scale_px: f32,
    /// PSNR at the end, dB, one a seed.
    pub psnr: Vec<f64>,
    /// Gaussians of which a scale is below 1 px at the end, share of all, mean.
    pub below_one_px: f64,
}

/// What is left of a determinant in `f32`.
#[derive(Debug, Clone, PartialEq)]
pub struct Precision {
    /// (short scale in px, relative error of a·c − b² in `f32`, of the determinant of the frame in `f32`).
    pub errors: Vec<(f64, f64, f64)>,
    /// The largest short scale at which a·c − b² is wrong by more than a tenth, px.
    pub wrong_below_px: f64,
    /// The largest at which it is not positive, px.
    pub singular_below_px: f64,
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct InstabilityMeasured {
    /// The determinant of a needle of 10 px.
    pub precision: Precision,
    /// A scale that is driven to zero, as in [`Guard::ALL`].
    pub drives: Vec<Drive>,
    /// Fits that may drive one there themselves.
    pub free: Vec<Free>,
    /// The price of a floor, in fits of 600 Gaussians.
    pub floors: Vec<Floor>,
    scales: Vec<Series>,
    pictures: Vec<Picture>,
}

/// The product's fit of a small start: L1, no growth, as many steps as the textbook's.
pub fn small_settings(seed: u32) -> FitSettings {
    FitSettings {
        seed,
        gaussians: SMALL_GAUSSIANS,
        initial: InitialCount::Fixed(SMALL_GAUSSIANS),
        iterations: 800,
        init: Init::Random(Random { scale_px: 3.0, ..Random::default() }),
        loss: Loss::L1,
        policy: Policy::None,
        rounds: Rounds::NEVER,
        ..FitSettings::paper()
    }
}

/// The paper's fit with another floor of the scales.
pub fn floor_settings(extent: Extent, seed: u32, min_scale_px: f32) -> FitSettings {
    let mut settings = paper_settings(extent, seed);
    settings.adam.min_scale = min_scale_px;
    settings
}

/// Drives a scale to zero with every guard, lets fits do so, and prices the floors.
///
/// # Errors
/// Those of the product's fits.
pub fn measure<R: Rasterizer<PlanarScene>>(laboratory: &mut Laboratory<'_, R>) -> Result<InstabilityMeasured, Error> {
    let extent = laboratory.extent();
    let lines = SyntheticTarget::THIN_LINES_24_PX.image();
    let angles = extent.choose(32, 8);
    let drives = Guard::ALL.iter().map(|&guard| drive(laboratory.rasterizer(), guard, &lines, angles));
    let drives = drives.collect::<Result<_, Error>>()?;
    let (mut free, mut scales) = (Vec::new(), Vec::new());
    for guard in Guard::ALL {
        let Some(guards) = guard.of_textbook() else {
            let run = |seed| laboratory.fit(&format!("thin lines, seed {seed}"), &lines, small_settings(seed));
            let runs = (0..extent.choose(10, 2)).map(run).collect::<Result<Vec<Run>, Error>>()?;
            free.push(Free::of(guard, None, &runs.iter().map(Course::by_product).collect::<Vec<_>>()));
            continue;
        };
        for rate in SCALE_RATES_PX {
            let course = |seed| {
                let settings = small_settings(seed);
                let scene = Trainer::new(laboratory.rasterizer(), &lines, settings.clone())?.scene()?;
                let textbook = Textbook::new(&scene, settings.render.background, guards, rate);
                Course::by_textbook(&lines, settings.iterations, textbook)
            };
            let courses = (0..extent.choose(10, 2)).map(course).collect::<Result<Vec<Course>, Error>>()?;
            if guard == Guard::Off {
                scales.push(Series::line(format!("step of {rate} px"), courses[0].scales.clone()));
            }
            free.push(Free::of(guard, Some(rate), &courses));
        }
    }
    let mut floors = Vec::new();
    let mut pictures = Vec::new();
    for (name, target) in [("circle and square", SyntheticTarget::PAPER), ("thin lines", SyntheticTarget::THIN_LINES)] {
        let target = target.image();
        for min_scale_px in FLOORS_PX {
            let one = |seed| {
                let label = format!("{name}, σ ≥ {min_scale_px} px, seed {seed}");
                laboratory.fit(&label, &target, floor_settings(extent, seed, min_scale_px))
            };
            let runs = (0..extent.choose(3, 1)).map(one).collect::<Result<Vec<Run>, Error>>()?;
            if name == "thin lines" {
                let render = &runs[0].fit.summary.settings.render;
                let shown = Shown { size: target.size(), render, ellipses: Ellipses::LeftOut };
                let file = if min_scale_px == FLOORS_PX[0] { "lines-clamped" } else { "lines-guarded" };
                let caption = format!("Thin lines, σ ≥ {min_scale_px} px: {:.1} dB.", runs[0].psnr());
                pictures.push(laboratory.picture(file, caption, &runs[0].fit.scene, shown)?);
            }
            floors.push(Floor::of(name, min_scale_px, &runs));
        }
    }
    Ok(InstabilityMeasured { precision: Precision::of_needle(), drives, free, floors, scales, pictures })
}

/// Lets one scale of a needle go to zero, in 8 steps a decade.
fn drive<R: Rasterizer<PlanarScene>>(
    rasterizer: &R,
    guard: Guard,
    target: &Image,
    angles: u32,
) -> Result<Drive, Error> {
    let (mut not_finite, mut from_px, mut left_out_px) = (0, 0.0f64, 0.0f64);
    let uploaded = rasterizer.upload_target(target)?;
    let settings = small_settings(0);
    for angle in 0..angles {
        let mut is_finite = true;
        for eighth in 0..=96 {
            let short = 10f32.powf(-(eighth as f32) / 8.0);
            let scene: PlanarScene = [needle(short, angle as f32 / angles as f32 * 3.0 + 0.05)].into_iter().collect();
            let finite = match guard.of_textbook() {
                Some(guards) => {
                    let found = Textbook::new(&scene, settings.render.background, guards, 0.0).clamped().step(target);
                    found.loss.is_finite() && found.has_finite_gradients
                }
                None => {
                    let cloud = rasterizer.upload(&scene, settings.chart)?;
                    let canvas = Canvas::new(target.width(), target.height());
                    let frame = rasterizer.forward(&cloud, &canvas, &settings.render)?;
                    if rasterizer.culled(&frame)?.degenerate > 0 {
                        left_out_px = left_out_px.max(short.into());
                    }
                    let (loss, gradients) = rasterizer.backward(&cloud, frame, &uploaded, &settings.loss)?;
                    loss.is_finite() && rasterizer.download_gradients(&cloud, &gradients)?.validate().is_ok()
                }
            };
            if !finite {
                is_finite = false;
                from_px = from_px.max(short.into());
            }
        }
        not_finite += usize::from(!is_finite);
    }
    let met = |scale: f64| (scale > 0.0).then_some(scale);
    Ok(Drive { guard, angles: angles as usize, not_finite, from_px: met(from_px), left_out_px: met(left_out_px) })
}

/// A needle off the centres of pixels.
fn needle(short_px: f32, angle: f32) -> PlanarGaussian {
    PlanarGaussian {
        mean: Vec2::new(12.3, 11.6),
        log_scale: Vec2::new(NEEDLE_PX.ln(), short_px.ln()),
        rotation: angle,
        opacity_logit: logit(0.7),
        color: Vec3::splat(0.2),
    }
}

/// One small fit.
struct Course {
    diverged: bool,
    smallest_scale_px: f64,
    psnr: Option<f64>,
    /// The smallest |σ| over the steps.
    scales: Vec<(f64, f64)>,
}

impl Course {
    fn by_textbook(target: &Image, iterations: u32, mut textbook: Textbook) -> Result<Self, Error> {
        let (mut scales, mut smallest_scale_px) = (Vec::new(), f64::INFINITY);
        for step in 1..=iterations {
            let found = textbook.step(target);
            let scale = f64::from(found.smallest_scale_px);
            smallest_scale_px = smallest_scale_px.min(scale);
            if !(found.loss.is_finite() && found.has_finite_gradients) {
                return Ok(Self { diverged: true, smallest_scale_px, psnr: None, scales });
            }
            if step % 4 == 1 {
                scales.push((step.into(), scale));
            }
        }
        let image = textbook.render(target.width(), target.height())?.clamped();
        Ok(Self { diverged: false, smallest_scale_px, psnr: Some(metrics::psnr(&image, target)?), scales })
    }

    fn by_product(run: &Run) -> Self {
        let scales = run.fit.scene.log_scales.iter().map(|s| f64::from(s.min_element().exp()));
        let smallest_scale_px = scales.fold(f64::INFINITY, f64::min);
        Self { diverged: false, smallest_scale_px, psnr: Some(run.psnr()), scales: Vec::new() }
    }
}

impl Free {
    fn of(guard: Guard, scale_rate_px: Option<f32>, courses: &[Course]) -> Self {
        let psnr = mean(courses.iter().filter_map(|course| course.psnr));
        Self {
            guard,
            scale_rate_px,
            fits: courses.len(),
            diverged: courses.iter().filter(|course| course.diverged).count(),
            smallest_scale_px: courses.iter().map(|course| course.smallest_scale_px).fold(f64::INFINITY, f64::min),
            psnr: psnr.is_finite().then_some(psnr),
        }
    }
}

impl Floor {
    fn of(target: &'static str, min_scale_px: f32, runs: &[Run]) -> Self {
        let below = |run: &Run| {
            let scales = &run.fit.scene.log_scales;
            scales.iter().filter(|s| s.min_element() < 0.0).count() as f64 / scales.len().max(1) as f64
        };
        Self {
            target,
            min_scale_px,
            psnr: runs.iter().map(Run::psnr).collect(),
            below_one_px: mean(runs.iter().map(below)),
        }
    }

    /// PSNR, dB, mean.
    pub fn mean_psnr(&self) -> f64 {
        mean(self.psnr.iter().copied())
    }
}

impl Precision {
    /// Of a Gaussian of 10 px by less and less, turned by many angles: the worst of them.
    fn of_needle() -> Self {
        let angles = || (0..32).map(|i| 0.05 + i as f32 * 0.093);
        let errors: Vec<(f64, f64, f64)> = (0..=48)
            .map(|i| {
                let short = 10f32.powf(-(i as f32) / 8.0);
                let exact = f64::from(NEEDLE_PX).powi(2) * f64::from(short).powi(2);
                let worst = |determinant: &dyn Fn(f32) -> f32| {
                    angles().map(|angle| (f64::from(determinant(angle)) - exact).abs() / exact).fold(0.0, f64::max)
                };
                let textbook = worst(&|angle| {
                    let [a, b, c] = covariance(NEEDLE_PX, short, angle);
                    a * c - b * b
                });
                let frame = worst(&|angle| {
                    let rotation = Mat2::from_angle(angle);
                    Mat2::from_cols(rotation.x_axis * NEEDLE_PX, rotation.y_axis * short).determinant().powi(2)
                });
                (f64::from(short), textbook, frame)
            })
            .collect();
        let first = |limit: f64| errors.iter().find(|e| e.1 > limit).map_or(0.0, |e| e.0);
        // A relative error above 1 is a determinant of the wrong sign, or more than twice the right one.
        Self { wrong_below_px: first(0.1), singular_below_px: first(1.0), errors }
    }
}

impl InstabilityMeasured {
    /// A driven scale under a guard.
    ///
    /// # Panics
    /// Never: all guards are measured.
    pub fn drive(&self, guard: Guard) -> &Drive {
        self.drives.iter().find(|drive| drive.guard == guard).expect("all guards are measured")
    }

    /// What the clamp at 1 px costs on a target against this project's floor, dB.
    pub fn price_of_clamp(&self, target: &str) -> f64 {
        self.psnr_at(target, FLOORS_PX[1]) - self.psnr_at(target, FLOORS_PX[0])
    }

    /// PSNR on a target with this floor, dB; NaN where that was not measured.
    fn psnr_at(&self, target: &str, min_scale_px: f32) -> f64 {
        let found = self.floors.iter().find(|floor| floor.target == target && floor.min_scale_px == min_scale_px);
        found.map_or(f64::NAN, Floor::mean_psnr)
    }

    /// (fits, of them diverged) with a guard, whatever the step of the scales.
    pub fn free_fits(&self, guard: Guard) -> (usize, usize) {
        let with = self.free.iter().filter(|free| free.guard == guard);
        with.fold((0, 0), |(fits, diverged), free| (fits + free.fits, diverged + free.diverged))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_keeps_the_digits_that_the_covariance_loses() {
        let precision = Precision::of_needle();
        assert!((1e-3..0.1).contains(&precision.wrong_below_px), "{precision:?}");
        assert!(precision.singular_below_px < precision.wrong_below_px);
        assert!(precision.errors.iter().all(|e| e.2 < 1e-5), "{precision:?}");
    }
}
