//! Lazy convergence (paper §3.4.3, §5.2, Fig. 9 bottom): the absolute threshold under which growth stagnates, forced growth that does
//! not, and why no threshold is universal.
//!
//! A threshold on a gradient has a unit. 3DGS compares in normalised device units (the image is 2 wide); a solver that compares the same
//! 0.0002 with gradients per pixel asks for 64 times as much at 128 px. Both are measured. The threshold that would have worked is found
//! by bisection on a grid of half octaves: the largest with which growth reaches its budget. [`Case`] does so on targets that differ from
//! the paper's in one respect, and asks of a relative criterion, which is the same on all of them, whether it does as well.

mod case;
mod findings;

use gs_core::{Optimizer, Scene2d, constants::TAU_POSITION};
use gs_density::{Grow, Policy, Signal};

pub use self::case::{Case, Outcome, Trial, Variation};
use self::case::{SQUARE_SIDE_PX, absolute, targets};
use super::{
    Cell, Circumstance, Claim, Extent, Findings, Laboratory, Number, Paired, Picture, SHARP_DB, Table,
    findings::significant,
    laboratory::{Ellipses, Run, Shown, seeds_in_words},
    paired::{Sense, gain, mean},
    set_up::paper_settings,
};
use crate::figure::{Axis, Figure, Marks, Series};
use gs_train::{DiscAndSquare, Error, Fill, FitSettings, PAPER_SIDE_PX, Rounds};

/// Who grows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Criterion {
    /// The absolute threshold 0.0002 in normalised device units, as 3DGS has it.
    AbsoluteDevice,
    /// The same number on gradients per pixel.
    AbsolutePixel,
    /// The top 10 %.
    Forced,
}

impl Criterion {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::AbsoluteDevice, Self::AbsolutePixel, Self::Forced];

    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::AbsoluteDevice => "absolute, τ = 0.0002 per device unit",
            Self::AbsolutePixel => "absolute, τ = 0.0002 per pixel",
            Self::Forced => "forced growth, top 10 %",
        }
    }

    /// The policy for an image of `side` px.
    pub fn policy(self, side: u32) -> Policy {
        let absolute = |threshold| Policy::Grow(Grow { threshold, ..Grow::absolute(Signal::MeanGradient) });
        match self {
            Self::AbsoluteDevice => absolute(TAU_POSITION),
            Self::AbsolutePixel => absolute(per_pixel(side)),
            Self::Forced => Policy::Grow(Grow::percentile(Signal::MeanGradient)),
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
    /// PSNR at the end, dB, one a seed.
    pub psnr: Vec<f64>,
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
    /// A target without anything on it: what is left to gain on it is nothing.
    pub blank: Blank,
    /// How the cases are fitted.
    pub trial: Trial,
    extent: Extent,
    curves: [Vec<Series>; 2],
    pictures: Vec<Picture>,
}

/// Growth by rank on a white image, with a floor and without: Gaussians at the end, one a seed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Blank {
    /// By rank alone.
    pub by_rank: Vec<u32>,
    /// By the hybrid: rank × floor × budget.
    pub by_hybrid: Vec<u32>,
}

/// Grows by all criteria on the paper's target, and looks for the threshold that works on others.
///
/// # Errors
/// Those of the fits.
pub fn measure<R: Optimizer<Scene2d>>(laboratory: &mut Laboratory<'_, R>) -> Result<LazyMeasured, Error> {
    let extent = laboratory.extent();
    let target = DiscAndSquare::default().image()?;
    let mut runs: Vec<Vec<Run>> = Vec::new();
    for criterion in Criterion::ALL {
        let one = |seed| {
            let label = format!("{}, seed {seed}", criterion.name());
            laboratory.fit(&label, &target, criterion.settings(extent, seed))
        };
        runs.push((0..extent.choose(6, 2)).map(one).collect::<Result<_, Error>>()?);
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
    for (label, variation, target) in targets(extent) {
        let of_paper =
            cases.first().map(|paper| paper.outcomes.iter().map(|outcome| outcome.working).collect::<Vec<_>>());
        cases.push(Case::measure(laboratory, label, variation, target, trial, of_paper.as_deref())?);
    }
    let blank = Blank::measure(laboratory, trial)?;
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
        blank,
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
            psnr: runs.iter().map(Run::psnr).collect(),
        }
    }

    /// PSNR at the end, dB, mean.
    pub fn mean_psnr(&self) -> f64 {
        mean(self.psnr.iter().copied())
    }

    /// Gaussians at the end, mean.
    pub fn mean_count(&self) -> f64 {
        mean(self.counts.iter().map(|&count| f64::from(count)))
    }
}

impl LazyMeasured {
    /// How a criterion fared on the paper's target.
    ///
    /// # Panics
    /// Never: all criteria are measured.
    pub fn growth(&self, criterion: Criterion) -> &Growth {
        self.growths.iter().find(|growth| growth.criterion == criterion).expect("all criteria are measured")
    }

    /// PSNR of another criterion less that of this one from the same seed, dB.
    fn against(&self, other: Criterion, this: Criterion) -> Paired {
        let pairs = self.growth(other).psnr.iter().zip(&self.growth(this).psnr);
        Paired::of(&pairs.map(|(&other, &this)| gain(other, this)).collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_threshold_per_pixel_is_stricter_by_half_the_side() {
        assert!((per_pixel(128) / TAU_POSITION - 64.0).abs() < 1e-4);
    }
}
