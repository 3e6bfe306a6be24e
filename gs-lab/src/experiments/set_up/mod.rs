//! The paper's set-up and result (§3.1 to §3.3, Figs. 6, 7, 8): 20 large Gaussians become 600, the
//! loss falls, and whether growth is the cause.
//!
//! "Spikes in count bring drops in loss" is tested by statistics: the slope of ln loss after each
//! round of growth compared with that before it, and the loss 100 steps later compared with a fit
//! without growth. The rounds of a seed are not independent, so each seed contributes one value,
//! the mean over its rounds.

mod findings;

use gs_backend::FutureExt as _;
use gs_core::{Optimizer, Scene as _, Scene2d};
use gs_density::{Grow, Policy, Signal};

use super::{
    Cell, Circumstance, Claim, ExperimentSize, Findings, Laboratory, Number, Paired, Picture, Table,
    laboratory::{Ellipses, Run, SHARP_DB, Shown, curve_charts},
    paired::{Sense, gain, mean, median},
};
use crate::report::figure::Series;
use gs_train::{Error, FitSettings, Init, InitialCount, Rounds, Trainer, init::Random, paper_target};

/// σ of 600 Gaussians that cover as much as the paper's 20 of 15 px: N σ² is the same.
pub(crate) const SMALL_SCALE_PX: f32 = 2.738_613;

/// Steps before and after a round over which the slope of the loss is taken: half the distance of
/// two rounds.
const WINDOW: usize = 50;

/// Steps at either end of a window whose losses are averaged.
const END: usize = 10;

/// The paper's fit. The quick form ends soon after growth has ended.
pub(crate) fn paper_settings(extent: ExperimentSize, seed: u32) -> FitSettings {
    FitSettings::paper().with(|s| {
        s.seed = seed;
        s.iterations = extent.choose(s.iterations, 1000);
    })
}

/// Forced growth alone, in a round every 100 steps to the end.
pub(crate) fn forced_growth_settings(extent: ExperimentSize, seed: u32) -> FitSettings {
    paper_settings(extent, seed).with(|s| {
        s.policy = Policy::Grow(Grow::percentile(Signal::MeanGradient));
        s.rounds = Rounds::until(100, s.iterations - 1);
    })
}

/// A fit without growth: `count` Gaussians of `scale_px` from the start.
pub(crate) fn fixed_settings(extent: ExperimentSize, seed: u32, count: u32, scale_px: f32) -> FitSettings {
    paper_settings(extent, seed).with(|s| {
        s.initial = InitialCount::Fixed(count);
        s.init = Init::Random(Random::default().with(|s| s.scale_px = scale_px));
        s.policy = Policy::None;
        s.rounds = Rounds::NEVER;
    })
}

/// A way of reaching the final scene, over all seeds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Way {
    /// Description.
    pub(crate) label: String,
    /// Final number of Gaussians, one value per seed.
    pub(crate) counts: Vec<u32>,
    /// Final PSNR, dB, one value per seed.
    pub(crate) psnr: Vec<f64>,
    /// Final loss, one value per seed.
    pub(crate) loss: Vec<f64>,
}

/// A round of growth and its effect on the loss. Slopes are those of ln loss per 100 steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GrowthRound {
    pub(crate) seed: u32,
    /// The step after which it took place.
    pub(crate) step: u32,
    /// Number of Gaussians before and after.
    pub(crate) count: (u32, u32),
    /// Slope in the 50 steps before.
    pub(crate) slope_before: f64,
    /// Slope in the 50 steps after.
    pub(crate) slope_after: f64,
    /// ln of the loss right after the round divided by that right before: the effect of the edit
    /// itself.
    pub(crate) jump: f64,
    /// ln of the loss before the next round divided by that before this one: the net effect of the
    /// round.
    pub(crate) net: f64,
    /// Net effect in that fit.
    pub(crate) control_net: f64,
}

/// The results of the experiment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SetUpMeasured {
    /// The paper's growth.
    pub(crate) grown: Way,
    /// Forced growth alone.
    pub(crate) forced: Way,
    /// 20 Gaussians without growth.
    pub(crate) twenty: Way,
    /// 600 Gaussians from the start, which cover as much as the 20.
    pub(crate) many_small: Way,
    /// 600 Gaussians from the start, each as large as the 20.
    pub(crate) many_large: Way,
    /// Steps until the paper's growth reaches 600, one value per seed; the number of all steps
    /// where it does not.
    pub(crate) steps_to_budget: Vec<u32>,
    /// Rounds in which the count grew, with the paper's growth and with forced growth alone.
    pub(crate) rounds: Vec<GrowthRound>,
    /// Change of the slope at these rounds, per 100 steps, averaged by seed.
    pub(crate) change: Paired,
    /// Net effect of a round, ln loss, less that in the fit without growth, averaged by seed.
    pub(crate) net_beyond_control: Paired,
    /// PSNR of the better fit that starts with 600 less that of growth from the same seed, dB.
    pub(crate) start_against_growth: Paired,
    extent: ExperimentSize,
    curves: [Vec<Series>; 2],
    pictures: Vec<Picture>,
}

/// Fits with the paper's growth, and equally long fits without growth.
pub(crate) fn measure<R: Optimizer<Scene2d>>(laboratory: &mut Laboratory<'_, R>) -> Result<SetUpMeasured, Error> {
    let extent = laboratory.extent();
    let target = paper_target();
    let mut runs = |what: &str, seeds: u32, settings: &dyn Fn(u32) -> FitSettings| {
        let one = |seed| laboratory.fit(&format!("{what}, seed {seed}"), &target, settings(seed));
        (0..seeds).map(one).collect::<Result<Vec<Run>, Error>>()
    };
    let seeds = extent.choose(8, 6);
    let grown = runs("20 to 600", seeds, &|seed| paper_settings(extent, seed))?;
    let forced = runs("forced growth alone", seeds, &|seed| forced_growth_settings(extent, seed))?;
    let twenty = runs("20 without growth", seeds, &|seed| fixed_settings(extent, seed, 20, 15.0))?;
    let few = extent.choose(8, 2);
    let many_small = runs("600 small ones", few, &|seed| fixed_settings(extent, seed, 600, SMALL_SCALE_PX))?;
    let many_large = runs("600 large ones", few, &|seed| fixed_settings(extent, seed, 600, 15.0))?;

    let rounds: Vec<GrowthRound> = [&grown, &forced]
        .into_iter()
        .flat_map(|runs| (0..).zip(runs.iter().zip(&twenty)))
        .flat_map(|(seed, (run, control))| growth_rounds(seed, run, control))
        .collect();
    let budget = paper_settings(extent, 0).gaussians;
    let reached = |run: &Run| run.counts.iter().position(|&c| c >= budget).unwrap_or(run.counts.len()) as u32 + 1;
    let labelled = [("20 to 600", &grown[0]), ("forced growth alone", &forced[0]), ("20, no growth", &twenty[0])];
    let labelled = labelled.into_iter().chain([("600 from the start", &many_small[0])]);
    let curves = [Run::count_curve as fn(&Run) -> _, Run::loss_curve]
        .map(|curve| labelled.clone().map(|(label, run)| Series::line(label, curve(run))).collect());
    Ok(SetUpMeasured {
        change: by_seed(&rounds, seeds, |r| r.slope_after - r.slope_before),
        net_beyond_control: by_seed(&rounds, seeds, |r| r.net - r.control_net),
        start_against_growth: Paired::of(
            &(many_small.iter().zip(&many_large).zip(&grown))
                .map(|((small, large), grown)| gain(small.psnr().max(large.psnr()), grown.psnr()))
                .collect::<Vec<_>>(),
        ),
        steps_to_budget: grown.iter().map(reached).collect(),
        pictures: pictures(laboratory, &grown[0], &twenty[0])?,
        grown: Way::of("growth from 20 to 600 (forced growth and threshold)", &grown),
        forced: Way::of("growth from 20, the top 10 % alone", &forced),
        twenty: Way::of("20 from the start, no growth", &twenty),
        many_small: Way::of("600 from the start of σ 2.7 px, no growth", &many_small),
        many_large: Way::of("600 from the start of σ 15 px, no growth", &many_large),
        rounds,
        extent,
        curves,
    })
}

impl Way {
    fn of(label: &str, runs: &[Run]) -> Self {
        Self {
            label: label.to_owned(),
            counts: runs.iter().map(Run::count).collect(),
            psnr: runs.iter().map(Run::psnr).collect(),
            loss: runs.iter().map(Run::last_loss).collect(),
        }
    }

    /// Mean PSNR over the seeds, dB.
    pub(crate) fn mean_psnr(&self) -> f64 {
        mean(self.psnr.iter().copied())
    }

    /// The lowest and the highest PSNR, dB.
    fn range(&self) -> (f64, f64) {
        self.psnr.iter().fold((f64::MAX, f64::MIN), |(low, high), &psnr| (low.min(psnr), high.max(psnr)))
    }

    fn mean_count(&self) -> f64 {
        mean(self.counts.iter().map(|&count| f64::from(count)))
    }
}

/// The rounds in which the count grew, with a whole window on either side.
fn growth_rounds(seed: u32, run: &Run, control: &Run) -> Vec<GrowthRound> {
    let last = run.counts.len().saturating_sub(2 * WINDOW) + 1;
    (WINDOW..last)
        .filter(|&step| run.counts[step - 1] > run.counts[step - 2])
        .map(|step| {
            let (slope_before, slope_after) = slopes(&run.losses, step);
            GrowthRound {
                seed,
                step: step as u32,
                count: (run.counts[step - 2], run.counts[step - 1]),
                slope_before,
                slope_after,
                jump: (f64::from(run.losses[step]) / f64::from(run.losses[step - 1])).ln(),
                net: net(&run.losses, step),
                control_net: net(&control.losses, step),
            }
        })
        .collect()
}

/// A number of the rounds, averaged for each seed that has rounds.
fn by_seed(rounds: &[GrowthRound], seeds: u32, value: impl Fn(&GrowthRound) -> f64) -> Paired {
    let of_seed = |seed| mean(rounds.iter().filter(|round| round.seed == seed).map(&value));
    Paired::of(&(0..seeds).map(of_seed).filter(|mean| !mean.is_nan()).collect::<Vec<_>>())
}

/// ln of the loss 100 steps after `step` divided by that before the round at `step`.
fn net(losses: &[f32], step: usize) -> f64 {
    level(losses, step + 2 * WINDOW - END) - level(losses, step - END)
}

/// ln of the mean of [`END`] losses.
fn level(losses: &[f32], from: usize) -> f64 {
    mean(losses[from..from + END].iter().map(|&loss| f64::from(loss))).ln()
}

/// Slopes of ln loss in the windows before and after `step`, per 100 steps. `losses[i]` is the loss
/// before step i + 1, so the second window starts with the loss of the edited scene.
fn slopes(losses: &[f32], step: usize) -> (f64, f64) {
    let slope =
        |from: usize| (level(losses, from + WINDOW - END) - level(losses, from)) * 100.0 / (WINDOW - END) as f64;
    (slope(step - WINDOW), slope(step))
}

/// The start and the result, plain and with ellipses (Figs. 6 and 7), and the fit of 20 Gaussians.
fn pictures<R: Optimizer<Scene2d>>(
    laboratory: &Laboratory<'_, R>,
    grown: &Run,
    twenty: &Run,
) -> Result<Vec<Picture>, Error> {
    let target = paper_target();
    let settings = &grown.fit.summary.settings;
    let start = Trainer::new(laboratory.rasterizer(), &target, settings.clone()).block_on()?.scene().block_on()?;
    let shown = |ellipses| Shown { size: target.size(), render: &settings.render, ellipses };
    let end = &grown.fit.scene;
    let count = end.len();
    let psnr = grown.psnr();
    Ok(vec![
        Picture { name: "target", caption: "The target.".to_owned(), image: target.clone(), ellipses: None },
        laboratory.picture("start", "The start: 20 Gaussians of σ 15 px.", &start, shown(Ellipses::Drawn))?,
        laboratory.picture(
            "reconstruction",
            format!("{count} Gaussians, {psnr:.1} dB."),
            end,
            shown(Ellipses::LeftOut),
        )?,
        laboratory.picture(
            "ellipses",
            "The same as ellipses of one standard deviation.",
            end,
            shown(Ellipses::Drawn),
        )?,
        laboratory.picture(
            "twenty",
            format!("20 Gaussians without growth, as many steps: {:.1} dB.", twenty.psnr()),
            &twenty.fit.scene,
            shown(Ellipses::Drawn),
        )?,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_is_one_witness_however_many_its_rounds() {
        let round = |seed: u32, jump: f64| GrowthRound {
            seed,
            step: 100,
            count: (20, 22),
            slope_before: 0.0,
            slope_after: 0.0,
            jump,
            net: 0.0,
            control_net: 0.0,
        };
        let rounds: Vec<_> = (0..30).map(|_| round(0, -3.0)).chain([round(1, 1.0), round(1, 2.0)]).collect();
        let found = by_seed(&rounds, 3, |round| round.jump);
        assert_eq!((found.pairs, found.negative, found.mean), (2, 1, -0.75), "{found:?}");
    }

    #[test]
    fn slopes_are_those_of_either_side() {
        // Falls by a factor of e every 200 steps before step 100, every 50 after.
        let loss = |step: usize| match step {
            s if s < 100 => (-(s as f32) / 200.0).exp(),
            s => 0.9 * (-((s - 100) as f32) / 50.0).exp(),
        };
        let losses: Vec<f32> = (0..200).map(loss).collect();
        let (before, after) = slopes(&losses, 100);
        assert!((before + 0.5).abs() < 1e-3 && (after + 2.0).abs() < 1e-3, "{before} {after}");
    }
}
