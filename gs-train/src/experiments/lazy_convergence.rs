//! Lazy convergence (paper §3.4.3, §5.2, Fig. 9 bottom): the absolute threshold under which growth stagnates, forced growth that does
//! not, and why no threshold is universal.
//!
//! A threshold on a gradient has a unit. 3DGS compares in normalised device units (the image is 2 wide); a solver that compares the same
//! 0.0002 with gradients per pixel asks for 64 times as much at 128 px. Both are measured. The threshold that would have worked is found
//! by bisection on a grid of half octaves: the largest with which growth reaches its budget.

mod findings;

use gs_core::{PlanarScene, Rasterizer, constants::TAU_POSITION};
use gs_density::{AbsoluteThreshold, Hybrid, Policy, RelativePercentile};

use super::{
    Axis, Cell, Chart, Claim, Extent, Findings, Laboratory, Number, Picture, Series, Table, Verdict,
    findings::significant,
    laboratory::{Ellipses, Run, Shown, seeds_in_words},
    paired::mean,
    set_up::paper_settings,
};
use crate::{
    error::Error,
    init::{Init, Random},
    rounds::Rounds,
    settings::FitSettings,
    targets::{DiscAndSquare, Fill, PAPER_SIDE_PX, PAPER_SQUARE, SyntheticTarget},
};

/// Who grows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Criterion {
    /// The absolute threshold 0.0002 in normalised device units, as 3DGS has it.
    AbsoluteDevice,
    /// The same number on gradients per pixel.
    AbsolutePixel,
    /// The top 10 %.
    Forced,
    /// The top 10 % above a floor, until the budget.
    Hybrid,
}

impl Criterion {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::AbsoluteDevice, Self::AbsolutePixel, Self::Forced, Self::Hybrid];

    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::AbsoluteDevice => "absolute, τ = 0.0002 per device unit",
            Self::AbsolutePixel => "absolute, τ = 0.0002 per pixel",
            Self::Forced => "forced growth, top 10 %",
            Self::Hybrid => "hybrid: rank × floor × budget",
        }
    }

    /// The policy for an image of `side` px.
    pub fn policy(self, side: u32) -> Policy {
        let absolute = |threshold| Policy::Absolute(AbsoluteThreshold { threshold, ..AbsoluteThreshold::default() });
        match self {
            Self::AbsoluteDevice => absolute(TAU_POSITION),
            Self::AbsolutePixel => absolute(per_pixel(side)),
            Self::Forced => Policy::Percentile(RelativePercentile::default()),
            Self::Hybrid => Policy::Hybrid(Hybrid::default()),
        }
    }

    /// The paper's fit under this criterion, with rounds to the end.
    pub fn settings(self, extent: Extent, seed: u32) -> FitSettings {
        let paper = paper_settings(extent, seed);
        FitSettings { policy: self.policy(PAPER_SIDE_PX), rounds: Rounds::until(100, paper.iterations - 1), ..paper }
    }
}

/// 3DGS's threshold taken per pixel, in normalised device units: a pixel is 2/side of them.
fn per_pixel(side: u32) -> f32 {
    TAU_POSITION * side as f32 / 2.0
}

/// How a criterion fared on the paper's target.
#[derive(Debug, Clone, PartialEq)]
pub struct Growth {
    /// Which.
    pub criterion: Criterion,
    /// Gaussians at the end, one a seed.
    pub counts: Vec<u32>,
    /// The last step at which the count rose, mean.
    pub last_growth: f64,
    /// PSNR at the end, dB, mean.
    pub psnr: f64,
}

/// A target that differs from the paper's in one respect.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// In which.
    pub label: &'static str,
    /// The target.
    pub target: DiscAndSquare,
    /// The largest threshold with which growth reaches the budget, normalised device units; nothing where the smallest tried is too large.
    pub working: Option<f64>,
    /// Gaussians with 3DGS's threshold per device unit.
    pub count_device: u32,
    /// Gaussians with the same number per pixel.
    pub count_pixel: u32,
    /// Gaussians with the threshold that works on the paper's target.
    pub count_transferred: u32,
    /// Gaussians with the hybrid, which has the same settings in all cases.
    pub count_hybrid: u32,
    /// PSNR with the hybrid, dB.
    pub psnr_hybrid: f64,
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct LazyMeasured {
    /// The criteria on the paper's target, as in [`Criterion::ALL`].
    pub growths: Vec<Growth>,
    /// (threshold in normalised device units, Gaussians, PSNR in dB) on the paper's target.
    pub scan: Vec<(f64, u32, f64)>,
    /// Targets that differ in one respect; the first is the paper's.
    pub cases: Vec<Case>,
    /// How the cases are fitted.
    pub trial: Trial,
    extent: Extent,
    curves: [Vec<Series>; 2],
    pictures: Vec<Picture>,
}

/// How long, and how many Gaussians, a case is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Gaussians that growth has to reach.
    pub budget: u32,
    /// Steps; there is a round every 100 of them.
    pub iterations: u32,
    /// The hybrid's share, %: what leads from 20 to the budget in these rounds.
    pub percent: f32,
    /// Half octaves between the thresholds tried.
    stride: i32,
}

impl Trial {
    fn of(extent: Extent) -> Self {
        extent.choose(
            Self { budget: 200, iterations: 1200, percent: 25.0, stride: 1 },
            Self { budget: 100, iterations: 700, percent: 35.0, stride: 2 },
        )
    }

    /// The fit of a case: the paper's, with lengths in proportion to the image.
    pub fn settings(&self, side: u32, policy: Policy) -> FitSettings {
        let paper = FitSettings::paper();
        let zoom = side as f32 / PAPER_SIDE_PX as f32;
        let mut adam = paper.adam;
        adam.mean.learning_rate *= zoom;
        FitSettings {
            gaussians: self.budget,
            iterations: self.iterations,
            init: Init::Random(Random { scale_px: 15.0 * zoom, ..Random::default() }),
            adam,
            policy,
            rounds: Rounds::until(100, self.iterations - 1),
            ..paper
        }
    }
}

/// Side of the paper's square, px.
const SQUARE_SIDE_PX: f32 = PAPER_SQUARE.1.x - PAPER_SQUARE.0.x;

/// Exponents, in half octaves, of the thresholds that are tried: 3DGS's over 256 to 3DGS's times 256.
const HALF_OCTAVES: (i32, i32) = (-16, 16);

fn threshold(half_octaves: i32) -> f64 {
    f64::from(TAU_POSITION) * 2f64.powf(f64::from(half_octaves) / 2.0)
}

fn absolute(threshold: f64) -> Policy {
    Policy::Absolute(AbsoluteThreshold { threshold: threshold as f32, ..AbsoluteThreshold::default() })
}

/// The targets: the paper's, and others that differ from it in size, contrast or frequency.
fn targets(extent: Extent) -> Vec<(&'static str, DiscAndSquare)> {
    let quick = ["paper", "paper-64px", "paper-contrast-10"];
    (SyntheticTarget::ALL.into_iter())
        .filter(|target| extent == Extent::Full || quick.contains(&target.name()))
        .filter_map(|target| Some((target.about(), target.disc_and_square()?)))
        .collect()
}

/// Grows by all criteria on the paper's target, and looks for the threshold that works on others.
///
/// # Errors
/// Those of the fits.
pub fn measure<R: Rasterizer<PlanarScene>>(laboratory: &mut Laboratory<'_, R>) -> Result<LazyMeasured, Error> {
    let extent = laboratory.extent();
    let target = DiscAndSquare::default().image()?;
    let mut runs: Vec<Vec<Run>> = Vec::new();
    for criterion in Criterion::ALL {
        let one = |seed| {
            let label = format!("{}, seed {seed}", criterion.name());
            laboratory.fit(&label, &target, criterion.settings(extent, seed))
        };
        runs.push((0..extent.choose(3, 1)).map(one).collect::<Result<_, Error>>()?);
    }
    let scanned: &[f64] =
        extent.choose(&[0.0002, 0.0005, 0.001, 0.002, 0.004, 0.006, 0.008, 0.01, 0.0128, 0.02, 0.04, 0.08], &[]);
    let mut scan = Vec::new();
    for &tau in scanned {
        let settings = FitSettings { policy: absolute(tau), ..Criterion::AbsoluteDevice.settings(extent, 0) };
        let run = laboratory.fit(&format!("threshold {tau}"), &target, settings)?;
        scan.push((tau, run.count(), run.psnr()));
    }
    let trial = Trial::of(extent);
    let mut cases: Vec<Case> = Vec::new();
    for (label, target) in targets(extent) {
        let transferred = cases.first().and_then(|paper| paper.working);
        cases.push(Case::measure(laboratory, label, target, trial, transferred)?);
    }
    let curves = [Run::count_curve as fn(&Run) -> _, Run::loss_curve].map(|curve| {
        let named = Criterion::ALL.iter().zip(&runs);
        named.map(|(criterion, runs)| Series::line(criterion.name(), curve(&runs[0]))).collect()
    });
    let mut pictures = Vec::new();
    for (index, name) in [(0, "absolute-device"), (1, "absolute-pixel"), (2, "forced")] {
        let run = &runs[index][0];
        let render = &run.fit.summary.settings.render;
        let shown = Shown { size: target.size(), render, ellipses: Ellipses::LeftOut };
        let caption = format!("{}: {} Gaussians, {:.1} dB.", Criterion::ALL[index].name(), run.count(), run.psnr());
        pictures.push(laboratory.picture(name, caption, &run.fit.scene, shown)?);
    }
    Ok(LazyMeasured {
        growths: Criterion::ALL.iter().zip(&runs).map(|(&criterion, runs)| Growth::of(criterion, runs)).collect(),
        scan,
        cases,
        trial,
        extent,
        curves,
        pictures,
    })
}

impl Growth {
    fn of(criterion: Criterion, runs: &[Run]) -> Self {
        let last_growth = |run: &Run| run.counts.windows(2).rposition(|pair| pair[1] > pair[0]).map_or(0, |i| i + 2);
        Self {
            criterion,
            counts: runs.iter().map(Run::count).collect(),
            last_growth: mean(runs.iter().map(|run| last_growth(run) as f64)),
            psnr: mean(runs.iter().map(Run::psnr)),
        }
    }

    /// Gaussians at the end, mean.
    pub fn mean_count(&self) -> f64 {
        mean(self.counts.iter().map(|&count| f64::from(count)))
    }
}

impl Case {
    fn measure<R: Rasterizer<PlanarScene>>(
        laboratory: &mut Laboratory<'_, R>,
        label: &'static str,
        target: DiscAndSquare,
        trial: Trial,
        transferred: Option<f64>,
    ) -> Result<Self, Error> {
        let image = target.image()?;
        let side = target.side_px;
        let mut fit = |what: &str, policy: Policy| {
            laboratory.fit(&format!("{label}: {what}"), &image, trial.settings(side, policy))
        };
        let mut count =
            |tau: f64| Ok::<u32, Error>(fit(&format!("τ = {}", significant(tau, 2)), absolute(tau))?.count());
        let working = bisect(|half_octaves| Ok(count(threshold(half_octaves))? >= trial.budget), trial.stride)?;
        let working = working.map(threshold);
        let count_device = count(TAU_POSITION.into())?;
        let count_pixel = count(per_pixel(side).into())?;
        let count_transferred = match transferred.or(working) {
            Some(tau) => count(tau)?,
            None => 0,
        };
        let hybrid = fit("hybrid", Policy::Hybrid(Hybrid { percent: trial.percent, ..Hybrid::default() }))?;
        Ok(Self {
            working,
            count_device,
            count_pixel,
            count_transferred,
            count_hybrid: hybrid.count(),
            psnr_hybrid: hybrid.psnr(),
            label,
            target,
        })
    }
}

/// The largest exponent on the grid that works, where smaller ones do if larger ones do.
fn bisect(mut works: impl FnMut(i32) -> Result<bool, Error>, stride: i32) -> Result<Option<i32>, Error> {
    let (lowest, highest) = HALF_OCTAVES;
    let at = |index: i32| lowest + index * stride;
    // `low` works, or is one below the grid; `high` does not, or is one above it.
    let (mut low, mut high) = (-1, (highest - lowest) / stride + 1);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if works(at(middle))? {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok((low >= 0).then(|| at(low)))
}

impl LazyMeasured {
    /// How a criterion fared on the paper's target.
    ///
    /// # Panics
    /// Never: all criteria are measured.
    pub fn growth(&self, criterion: Criterion) -> &Growth {
        self.growths.iter().find(|growth| growth.criterion == criterion).expect("all criteria are measured")
    }

    /// The largest threshold that worked over the smallest, over all cases; ∞ where one has none.
    pub fn spread_of_thresholds(&self) -> f64 {
        let working = self.cases.iter().map(|case| case.working.unwrap_or(0.0));
        let (low, high) = working.fold((f64::MAX, 0.0f64), |(low, high), tau| (low.min(tau), high.max(tau)));
        high / low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bisection_finds_the_last_that_works() {
        for stride in [1, 2] {
            for last in [-17, -16, -3, 0, 7, 16, 40] {
                let found = bisect(|exponent| Ok(exponent <= last), stride).unwrap();
                let grid = (HALF_OCTAVES.0..=HALF_OCTAVES.1).step_by(stride as usize);
                assert_eq!(found, grid.filter(|&exponent| exponent <= last).last(), "{stride} {last}");
            }
        }
    }

    #[test]
    fn a_threshold_per_pixel_is_stricter_by_half_the_side() {
        assert!((per_pixel(128) / TAU_POSITION - 64.0).abs() < 1e-4);
        assert!((threshold(2) / f64::from(TAU_POSITION) - 2.0).abs() < 1e-12);
    }
}
