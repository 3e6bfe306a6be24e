//! Lazy convergence (paper §3.4.3, §5.2, Fig. 9 bottom): the absolute threshold with which growth
//! stagnates, forced growth, and why no threshold is universal.
//!
//! A threshold on a gradient has a unit. 3DGS compares in normalised device units (the image is 2
//! wide); a solver that compares the same 0.0002 with gradients per pixel requires 64 times as much
//! at 128 px. Both are measured. The threshold that would have worked is found by bisection on a
//! grid of half octaves: the largest with which growth reaches its budget. [`Case`] does so on
//! targets that differ from the paper's in one respect, and tests whether a relative criterion,
//! which is the same on all of them, does as well.

mod case;
mod findings;

use gs_core::{Optimizer, Scene2d, constants::TAU_POSITION};
use gs_density::{Grow, Policy, Signal};

pub(crate) use self::case::{Case, Outcome, Trial, Variation};
use self::case::{SQUARE_SIDE_PX, targets};
use super::{
    Cell, Circumstance, Claim, ExperimentSize, Findings, Laboratory, Number, Paired, Picture, Table,
    findings::significant,
    laboratory::{Ellipses, Run, SHARP_DB, Shown, curve_charts, seeds_in_words},
    paired::{Sense, gain, mean},
    set_up::paper_settings,
};
use crate::report::figure::{Axis, Figure, Marks, Series};
use gs_train::{DiscAndSquare, Error, Fill, FitSettings, PAPER_SIDE_PX, Rounds};

/// The criterion that decides which Gaussians grow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Criterion {
    /// The absolute threshold 0.0002 in normalised device units, as in 3DGS.
    AbsoluteDevice,
    /// The threshold 0.0002 applied to gradients per pixel.
    AbsolutePixel,
    /// The top 10 %.
    Forced,
}

impl Criterion {
    pub(crate) const ALL: [Self; 3] = [Self::AbsoluteDevice, Self::AbsolutePixel, Self::Forced];

    /// The name in reports.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::AbsoluteDevice => "absolute, τ = 0.0002 per device unit",
            Self::AbsolutePixel => "absolute, τ = 0.0002 per pixel",
            Self::Forced => "forced growth, top 10 %",
        }
    }

    /// The policy for an image of `side` px.
    pub(crate) fn policy(self, side: u32) -> Policy {
        let absolute = |threshold| Policy::Grow(Grow::absolute(Signal::MeanGradient).with(|s| s.threshold = threshold));
        match self {
            Self::AbsoluteDevice => absolute(TAU_POSITION),
            Self::AbsolutePixel => absolute(per_pixel(side)),
            Self::Forced => Policy::Grow(Grow::percentile(Signal::MeanGradient)),
        }
    }

    /// The paper's fit with this criterion, with rounds to the end.
    pub(crate) fn settings(self, extent: ExperimentSize, seed: u32) -> FitSettings {
        paper_settings(extent, seed).with(|s| {
            s.policy = self.policy(PAPER_SIDE_PX);
            s.rounds = Rounds::until(100, s.iterations - 1);
        })
    }
}

/// 3DGS's threshold per pixel, in normalised device units: a pixel is 2/side of them.
fn per_pixel(side: u32) -> f32 {
    TAU_POSITION * side as f32 / 2.0
}

/// The fits with a criterion on the paper's target.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Growth {
    pub(crate) criterion: Criterion,
    /// Final number of Gaussians, one value per seed.
    pub(crate) counts: Vec<u32>,
    /// Mean of the last step at which the count rose.
    pub(crate) last_growth: f64,
    /// Final PSNR, dB, one value per seed.
    pub(crate) psnr: Vec<f64>,
}

/// The results of the experiment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LazyMeasured {
    /// The criteria on the paper's target, as in [`Criterion::ALL`].
    pub(crate) growths: Vec<Growth>,
    /// Targets that differ from the paper's in one respect; the first is the paper's.
    pub(crate) cases: Vec<Case>,
    /// A white target, on which growth gains nothing.
    pub(crate) blank: Blank,
    /// The settings of the cases.
    pub(crate) trial: Trial,
    extent: ExperimentSize,
    curves: [Vec<Series>; 2],
    pictures: Vec<Picture>,
}

/// Growth by rank on a white image, with and without a minimum gradient: final number of Gaussians,
/// one value per seed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Blank {
    /// Growth by rank alone.
    pub(crate) by_rank: Vec<u32>,
    /// Growth by rank above a minimum gradient, up to the budget.
    pub(crate) by_hybrid: Vec<u32>,
}

/// Fits the paper's target with all criteria, and searches the threshold that works on other
/// targets.
pub(crate) fn measure<R: Optimizer<Scene2d>>(laboratory: &mut Laboratory<'_, R>) -> Result<LazyMeasured, Error> {
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

    /// Mean final PSNR, dB.
    pub(crate) fn mean_psnr(&self) -> f64 {
        mean(self.psnr.iter().copied())
    }

    /// Mean final number of Gaussians.
    pub(crate) fn mean_count(&self) -> f64 {
        mean(self.counts.iter().map(|&count| f64::from(count)))
    }
}

impl LazyMeasured {
    /// The fits with a criterion.
    pub(crate) fn growth(&self, criterion: Criterion) -> &Growth {
        self.growths.iter().find(|growth| growth.criterion == criterion).expect("all criteria are measured")
    }

    /// PSNR of `other` less that of `this` from the same seed, dB.
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
