//! A target of the lazy-convergence experiment: the threshold that would have worked on it, and a
//! relative criterion with the same settings on all targets.

use gs_core::{Optimizer, Scene2d, constants::TAU_POSITION};
use gs_density::{FORCED_GROWTH_PERCENT, Grow, Policy, Signal};

use super::{Blank, per_pixel};
use crate::{
    experiments::{
        ExperimentSize, Laboratory,
        findings::significant,
        laboratory::Run,
        paired::{mean, median},
    },
    synthetic::SyntheticTarget,
};
use gs_train::{DiscAndSquare, Error, FitSettings, Init, PAPER_SIDE_PX, PAPER_SQUARE, Rounds, init::Random};

/// Side of the paper's square, px.
pub(super) const SQUARE_SIDE_PX: f32 = PAPER_SQUARE.1.x - PAPER_SQUARE.0.x;

/// Exponents, in half octaves, of the thresholds to try: a quarter of 3DGS's to 64 times as much.
const HALF_OCTAVES: (i32, i32) = (-4, 12);

/// How a target differs from the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Variation {
    /// Not at all: the paper's target.
    None,
    /// The size of the image.
    Size,
    /// The contrast of the shapes with the white.
    Contrast,
    /// The softness of the square's edge.
    Softness,
    /// The period of stripes in the square.
    Stripes,
}

impl Variation {
    /// The first respect in which the target differs.
    fn of(target: DiscAndSquare) -> Self {
        let paper = DiscAndSquare::PAPER;
        let respects = [
            (target.side_px != paper.side_px, Self::Size),
            (target.contrast != paper.contrast, Self::Contrast),
            (target.softness_px != paper.softness_px, Self::Softness),
            (target.fill != paper.fill, Self::Stripes),
        ];
        respects.into_iter().find(|(differs, _)| *differs).map_or(Self::None, |(_, respect)| respect)
    }
}

/// A target that differs from the paper's in one respect.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Case {
    /// Description of the target.
    pub(crate) label: String,
    pub(crate) variation: Variation,
    pub(crate) target: DiscAndSquare,
    /// The fits, one value per seed.
    pub(crate) outcomes: Vec<Outcome>,
    /// Gaussians with 3DGS's threshold per device unit, seed 0.
    pub(crate) count_device: u32,
    /// Gaussians with the same number per pixel, seed 0.
    pub(crate) count_pixel: u32,
}

/// The fits of a seed on a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outcome {
    /// The largest threshold with which growth reaches the budget, normalised device units; `None`
    /// if the smallest tried is too large.
    pub(crate) working: Option<f64>,
    /// PSNR with that threshold, which is tuned to target and seed, dB; NaN without one.
    pub(crate) psnr_tuned: f64,
    /// Gaussians with the threshold that works on the paper's target with the same seed.
    pub(crate) count_transferred: u32,
    /// PSNR with it, dB.
    pub(crate) psnr_transferred: f64,
    /// Gaussians with the paper's top 10 %.
    pub(crate) count_forced: u32,
    /// PSNR with them, dB.
    pub(crate) psnr_forced: f64,
    /// Gaussians with the hybrid, whose share is in [`Trial`].
    pub(crate) count_hybrid: u32,
    /// PSNR with it, dB.
    pub(crate) psnr_hybrid: f64,
}

/// The settings of the fits of all cases.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Trial {
    /// The budget that growth has to reach.
    pub(crate) budget: u32,
    /// Number of steps; there is a round every 100 steps.
    pub(crate) iterations: u32,
    /// The hybrid's share, %, chosen so that growth from 20 reaches the budget in these rounds. The
    /// paper's 10 % does not.
    pub(crate) percent: f32,
    /// Number of seeds.
    pub(crate) seeds: u32,
    /// Half octaves between the thresholds.
    pub(crate) stride: i32,
}

impl Trial {
    pub(super) fn of(extent: ExperimentSize) -> Self {
        extent.choose(
            Self { budget: 200, iterations: 1200, percent: 25.0, seeds: 6, stride: 1 },
            Self { budget: 100, iterations: 700, percent: 35.0, seeds: 2, stride: 2 },
        )
    }

    /// The fit of a case: the paper's, with lengths in proportion to the image.
    pub(crate) fn settings(&self, side: u32, policy: Policy, seed: u32) -> FitSettings {
        let paper = FitSettings::paper();
        let zoom = side as f32 / PAPER_SIDE_PX as f32;
        let mut adam = paper.adam;
        adam.mean.learning_rate *= zoom;
        paper.with(|s| {
            s.seed = seed;
            s.gaussians = self.budget;
            s.iterations = self.iterations;
            s.init = Init::Random(Random::default().with(|s| s.scale_px = 15.0 * zoom));
            s.adam = adam;
            s.policy = policy;
            s.rounds = Rounds::until(100, self.iterations - 1);
        })
    }

    fn hybrid(&self) -> Policy {
        Policy::Grow(Grow::hybrid(Signal::MeanGradient).with(|s| s.percent = self.percent))
    }

    fn by_rank(percent: f32) -> Policy {
        Policy::Grow(Grow::percentile(Signal::MeanGradient).with(|s| s.percent = percent))
    }
}

fn threshold(half_octaves: i32) -> f64 {
    f64::from(TAU_POSITION) * 2f64.powf(f64::from(half_octaves) / 2.0)
}

fn absolute(threshold: f64) -> Policy {
    Policy::Grow(Grow::absolute(Signal::MeanGradient).with(|s| s.threshold = threshold as f32))
}

/// The targets: first the paper's, then others that differ from it in size, contrast or frequency.
pub(super) fn targets(extent: ExperimentSize) -> Vec<(String, Variation, DiscAndSquare)> {
    let quick = ["paper", "paper-contrast-10", "paper-soft-4px", "paper-stripes-5px"];
    (SyntheticTarget::ALL.into_iter())
        .filter(|target| extent == ExperimentSize::Full || quick.contains(&target.name()))
        .filter_map(|target| {
            let varied = target.disc_and_square()?;
            Some((target.about().to_owned(), Variation::of(varied), varied))
        })
        .collect()
}

impl Case {
    /// Searches the threshold that works, and fits with the other criteria. `of_paper` are the
    /// thresholds that work on the paper's target, one per seed; without them, this is that target.
    pub(super) fn measure<R: Optimizer<Scene2d>>(
        laboratory: &mut Laboratory<'_, R>,
        label: String,
        variation: Variation,
        target: DiscAndSquare,
        trial: Trial,
        of_paper: Option<&[Option<f64>]>,
    ) -> Result<Self, Error> {
        let image = target.image()?;
        let side = target.side_px;
        let named = |tau: f64| format!("τ = {}", significant(tau, 2));
        let mut fit = |what: &str, policy: Policy, seed: u32| {
            let label = format!("{label}: {what}, seed {seed}");
            laboratory.fit(&label, &image, trial.settings(side, policy, seed))
        };
        let mut count = |tau: f64| Ok::<_, Error>(fit(&named(tau), absolute(tau), 0)?.count());
        let (count_device, count_pixel) = (count(TAU_POSITION.into())?, count(per_pixel(side).into())?);
        let mut outcomes = Vec::new();
        for seed in 0..trial.seeds {
            // (threshold, Gaussians, PSNR) of fits that were made already.
            let mut tried: Vec<(f64, u32, f64)> = Vec::new();
            let mut by_threshold = |tau: f64| {
                if let Some(&(_, count, psnr)) = tried.iter().find(|tried| tried.0 == tau) {
                    return Ok((count, psnr));
                }
                let run = fit(&named(tau), absolute(tau), seed)?;
                tried.push((tau, run.count(), run.psnr()));
                Ok::<_, Error>((run.count(), run.psnr()))
            };
            let works = |half_octaves| Ok(by_threshold(threshold(half_octaves))?.0 >= trial.budget);
            let working = bisect(works, trial.stride)?.map(threshold);
            let psnr_tuned = working.map_or(Ok(f64::NAN), |tau| Ok::<_, Error>(by_threshold(tau)?.1))?;
            // If no threshold works on the paper's target, none is transferred, and nothing grows.
            let transferred = of_paper.map_or(working, |of_paper| of_paper[seed as usize]).unwrap_or(f64::MAX);
            let (count_transferred, psnr_transferred) = by_threshold(transferred)?;
            let forced = fit("top 10 %", Trial::by_rank(FORCED_GROWTH_PERCENT), seed)?;
            let hybrid = fit("hybrid", trial.hybrid(), seed)?;
            outcomes.push(Outcome {
                working,
                psnr_tuned,
                count_transferred,
                psnr_transferred,
                count_forced: forced.count(),
                psnr_forced: forced.psnr(),
                count_hybrid: hybrid.count(),
                psnr_hybrid: hybrid.psnr(),
            });
        }
        Ok(Self { label, variation, target, outcomes, count_device, count_pixel })
    }

    /// A number of the outcomes, averaged over seeds.
    pub(crate) fn mean_of(&self, value: impl Fn(&Outcome) -> f64) -> f64 {
        mean(self.outcomes.iter().map(value))
    }

    /// Median over seeds of the largest threshold that works, normalised device units; `None` if a
    /// seed has none.
    pub(crate) fn working(&self) -> Option<f64> {
        let working: Option<Vec<f64>> = self.outcomes.iter().map(|outcome| outcome.working).collect();
        working.map(median)
    }

    /// Octaves by which the threshold that works is above that of another target with the same
    /// seed; infinite where one of them has none.
    pub(crate) fn octaves_above(&self, other: &Self) -> Vec<f64> {
        let octaves = |outcome: &Outcome| outcome.working.map_or(f64::NEG_INFINITY, f64::log2);
        let pairs = self.outcomes.iter().zip(&other.outcomes);
        pairs
            .filter(|(a, b)| a.working.is_some() || b.working.is_some())
            .map(|(a, b)| octaves(a) - octaves(b))
            .collect()
    }

    /// Whether the threshold moves against another target's beyond the variation over seeds: for
    /// each seed, in the same direction.
    pub(crate) fn moves_against(&self, other: &Self) -> bool {
        let octaves = self.octaves_above(other);
        !octaves.is_empty()
            && octaves.len() == self.outcomes.len()
            && (octaves.iter().all(|&octave| octave > 0.0) || octaves.iter().all(|&octave| octave < 0.0))
    }
}

impl Blank {
    pub(super) fn measure<R: Optimizer<Scene2d>>(
        laboratory: &mut Laboratory<'_, R>,
        trial: Trial,
    ) -> Result<Self, Error> {
        let white = DiscAndSquare { contrast: 0.0, ..DiscAndSquare::default() }.image()?;
        let mut counts = |what: &str, policy: Policy| {
            let one = |seed| {
                let settings = trial.settings(PAPER_SIDE_PX, policy.clone(), seed);
                laboratory.fit(&format!("white: {what}, seed {seed}"), &white, settings)
            };
            let runs: Vec<Run> = (0..trial.seeds).map(one).collect::<Result<_, Error>>()?;
            Ok::<_, Error>(runs.iter().map(Run::count).collect())
        };
        Ok(Self {
            by_rank: counts("by rank", Trial::by_rank(trial.percent))?,
            by_hybrid: counts("hybrid", trial.hybrid())?,
        })
    }
}

/// The largest exponent on the grid that works, if `works` is monotonic.
fn bisect(mut works: impl FnMut(i32) -> Result<bool, Error>, stride: i32) -> Result<Option<i32>, Error> {
    let (lowest, highest) = HALF_OCTAVES;
    let at = |index: i32| lowest + index * stride;
    // `low` works or is one below the grid; `high` does not work or is one above it.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bisection_finds_the_last_that_works() {
        for stride in [1, 2] {
            for last in [-5, -4, -3, 0, 7, 12, 40] {
                let found = bisect(|exponent| Ok(exponent <= last), stride).unwrap();
                let grid = (HALF_OCTAVES.0..=HALF_OCTAVES.1).step_by(stride as usize);
                assert_eq!(found, grid.filter(|&exponent| exponent <= last).last(), "{stride} {last}");
            }
        }
        assert!((threshold(2) / f64::from(TAU_POSITION) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_threshold_moves_where_it_does_with_every_seed() {
        let case = |working: &[Option<f64>]| Case {
            label: String::new(),
            variation: Variation::Contrast,
            target: DiscAndSquare::default(),
            outcomes: working
                .iter()
                .map(|&working| Outcome {
                    working,
                    psnr_tuned: 0.0,
                    count_transferred: 0,
                    psnr_transferred: 0.0,
                    count_forced: 0,
                    psnr_forced: 0.0,
                    count_hybrid: 0,
                    psnr_hybrid: 0.0,
                })
                .collect(),
            count_device: 0,
            count_pixel: 0,
        };
        let paper = case(&[Some(1.0), Some(1.4)]);
        assert!(case(&[Some(0.5), Some(1.0)]).moves_against(&paper));
        assert!(!case(&[Some(0.5), Some(1.4)]).moves_against(&paper), "one seed does not move");
        assert!(!case(&[Some(0.5), Some(2.0)]).moves_against(&paper), "they move apart");
        assert!(case(&[None, Some(1.0)]).moves_against(&paper), "none works any more");
        assert!(!case(&[None, None]).moves_against(&case(&[None, None])), "nothing to compare");
    }
}
