//! What the stages of a training step cost, as the backend times them, and whole passes, as a caller
//! sees them.

use std::{fmt, time::Instant};

use gs_backend::FutureExt as _;
use gs_core::{
    Binning, Error, Loss, Parameterization, Rasterizer, RenderSettings, Scene, TrainStep, Wait,
    profile::{Clock, Profile, Profiler, Quantiles, StageTime, still},
};
use serde::Serialize;

use super::timing::Times;
use crate::report::{Cell, Table};

/// Training steps that are sent before the last is waited for, as in a fit.
const STEPS: u32 = 4;

/// The times of all stages and of whole passes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StagePrices {
    /// Entries of all tiles' lists.
    pub(super) entries: usize,
    /// Pixel–Gaussian pairs that blending visits.
    pub(super) pairs: u64,
    /// The clock of the stages. Whole passes are always timed by the host.
    #[serde(flatten)]
    pub(super) clock: Clock,
    /// The stages, in their order.
    pub(super) stages: Vec<Stage>,
    /// Sum of the medians of the stages that have a share.
    pub(super) sum_seconds: f64,
    /// Training steps that make new lists: means over four steps, sent without waiting, as in a fit.
    pub(super) train_step_fresh: Times,
    /// Training steps with the lists of the step before.
    pub(super) train_step_reused: Times,
    /// Forward passes alone.
    pub(super) forward: Times,
}

/// A stage of a training step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Stage {
    /// Its name.
    pub(super) stage: &'static str,
    /// Seconds.
    pub(super) seconds: Times,
    /// Share of the sum, 0 to 1; `None` if a training step runs another stage instead.
    pub(super) share: Option<f64>,
    /// That other stage.
    pub(super) replaced_by: Option<&'static str>,
    /// Pixel–Gaussian pairs; `None` if it visits none.
    pub(super) pairs: Option<u64>,
    /// Pairs that it visits in a second.
    pub(super) pairs_per_second: Option<f64>,
}

/// Times the stages of training steps that do not move the Gaussians of a scene, whose target is the
/// scene's own rendering, and whole passes, `repetitions` times after one that is not timed.
///
/// # Errors
/// Those of the backend.
pub fn stage_prices<S: Scene, R: Profiler<S>>(
    rasterizer: &R,
    scene: &S,
    view: &S::View,
    settings: &RenderSettings,
    (loss, parameterization): (Loss, Parameterization),
    repetitions: usize,
) -> Result<StagePrices, Error> {
    let own = rasterizer.render(scene, view, settings).block_on()?;
    let target = Rasterizer::<S>::upload_target(rasterizer, &own)?;
    let mut splats = rasterizer.upload(scene, parameterization)?;
    let profile = rasterizer.profile(&mut splats, view, &target, settings, loss, repetitions).block_on()?;
    let rates = still();
    let mut losses = Vec::new();
    let mut train = |splats: &mut R::Splats, binning: Binning| {
        let start = Instant::now();
        for _ in 0..STEPS {
            let step = TrainStep { settings, loss, rates: &rates, binning };
            rasterizer.train_step(splats, view, &target, &step).block_on()?;
        }
        losses.clear();
        rasterizer.losses(splats, Wait::All, &mut losses).block_on()?;
        Ok::<f64, Error>(start.elapsed().as_secs_f64() / f64::from(STEPS))
    };
    let mut passes = [const { Vec::new() }; 3];
    for _ in 0..=repetitions {
        // The second makes use of the lists of the first.
        passes[0].push(train(&mut splats, Binning::Fresh)?);
        passes[1].push(train(&mut splats, Binning::Reuse)?);
        let start = Instant::now();
        drop(rasterizer.forward(&splats, view, settings).block_on()?);
        passes[2].push(start.elapsed().as_secs_f64());
    }
    let sum_seconds = profile.of_a_step().map(|stage| Quantiles::of(&stage.seconds).median).sum();
    let [train_step_fresh, train_step_reused, forward] = passes.map(|seconds| Times::from(seconds[1..].to_vec()));
    Ok(StagePrices {
        entries: profile.entries,
        pairs: profile.pairs,
        stages: profile.stages.iter().map(|stage| Stage::new(&profile, stage, sum_seconds)).collect(),
        clock: profile.clock,
        sum_seconds,
        train_step_fresh,
        train_step_reused,
        forward,
    })
}

impl Stage {
    fn new(profile: &Profile, time: &StageTime, sum: f64) -> Self {
        let seconds = Times::from(time.seconds.clone());
        let replaced_by = profile.replaced_by(time);
        let pairs = (time.pairs > 0).then_some(time.pairs);
        Self {
            stage: time.stage,
            share: replaced_by.is_none().then(|| seconds.spread.median / sum),
            replaced_by,
            pairs,
            pairs_per_second: pairs.map(|pairs| pairs as f64 / seconds.spread.median),
            seconds,
        }
    }
}

impl StagePrices {
    /// Stages, their sum, and whole passes.
    fn table(&self) -> Table {
        let cell = |value: Option<f64>, digits| value.map_or(Cell::Empty, |value| Cell::Fixed(value, digits));
        let row =
            |name: &str, Quantiles { low, median, high }: Quantiles, share: Option<f64>, stage: Option<&Stage>| {
                let spread = [low, high].map(|seconds| if seconds.is_nan() { None } else { Some(1e3 * seconds) });
                let rate = stage.and_then(|stage| stage.pairs_per_second);
                vec![
                    name.into(),
                    Cell::Fixed(1e3 * median, 4),
                    cell(spread[0], 4),
                    cell(spread[1], 4),
                    cell(share.map(|share| 100.0 * share), 1),
                    stage.and_then(|stage| stage.pairs).map_or(Cell::Empty, Cell::Count),
                    cell(rate.map(|rate| 1e-9 * rate), 3),
                ]
            };
        let sum = Quantiles { low: f64::NAN, median: self.sum_seconds, high: f64::NAN };
        let stages = self.stages.iter().map(|stage| row(stage.stage, stage.seconds.spread, stage.share, Some(stage)));
        let passes = [
            ("training step, lists made anew", &self.train_step_fresh),
            ("training step, lists used again", &self.train_step_reused),
            ("forward pass alone", &self.forward),
        ];
        let passes = passes.map(|(name, times)| row(name, times.spread, None, None));
        let rows = stages.chain([row("sum", sum, Some(1.0), None)]).chain(passes).collect();
        Table::new("profile", "", &["stage", "ms", "10 %", "90 %", "share, %", "pairs", "Gpairs/s"], rows)
    }
}

/// What was visited and how it was timed, the table, and why stages have no share.
impl fmt::Display for StagePrices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { entries, pairs, clock, train_step_fresh, .. } = self;
        write!(
            f,
            "{entries} entries in tiles' lists, {pairs} pairs of a pixel and a Gaussian\nclock of the stages: {clock}; \
             {} repetitions\n\n{}",
            train_step_fresh.samples.len(),
            self.table().text()
        )?;
        let replaced = self.stages.iter().filter_map(|stage| Some((stage.stage, stage.replaced_by?)));
        let (names, by): (Vec<&str>, Vec<&str>) = replaced.unzip();
        if let Some(by) = by.first() {
            write!(
                f,
                "\nA training step runs {by} in place of {}, which are shown for comparison and are not in the sum.",
                names.join(", ")
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use gs_core::{Blend, Canvas, Gaussian2d, Scene2d};
    use gs_cpu::{CpuRasterizer, CpuSettings};

    use super::*;

    /// What is timed of a picture that is the sum of so many Gaussians.
    fn timed(gaussians: u8, loss: Loss) -> StagePrices {
        let at = |i: u8| Gaussian2d {
            mean: glam::Vec2::splat(f32::from(i)),
            log_scale: glam::Vec2::ONE,
            rotation: 0.0,
            opacity_logit: 0.0,
            color: glam::Vec3::ONE,
        };
        let scene: Scene2d = (0..gaussians).map(at).collect();
        let cpu = CpuRasterizer::new(CpuSettings::default().with(|s| s.threads = Some(1))).unwrap();
        let settings = RenderSettings::blended(Blend::Sum);
        let with = (loss, Parameterization::CovarianceFactor);
        stage_prices(cpu.for_2d(), &scene, &Canvas::new(24, 18), &settings, with, 3).unwrap()
    }

    #[test]
    fn shares_are_those_of_the_stages_that_a_step_runs() {
        let found = timed(9, Loss::L2);
        // Added up under L2, a tile is blended forward and backward in one pass.
        let fused = |stage: &&Stage| stage.replaced_by == Some("fused");
        let replaced: Vec<&str> = found.stages.iter().filter(fused).map(|stage| stage.stage).collect();
        assert_eq!(replaced, ["blend", "loss", "blend_bwd"]);
        let (mut shares, mut sum) = (0.0, 0.0);
        for stage in &found.stages {
            let Quantiles { low, median, high } = stage.seconds.spread;
            assert!(0.0 <= low && low <= median && median <= high && stage.seconds.samples.len() == 3, "{stage:?}");
            assert_eq!(stage.share.is_some(), stage.replaced_by.is_none());
            let blends = stage.stage.starts_with("blend") || stage.stage == "fused";
            assert_eq!(stage.pairs, blends.then_some(found.pairs), "{stage:?}");
            shares += stage.share.unwrap_or(0.0);
            sum += if stage.share.is_some() { median } else { 0.0 };
        }
        assert!((shares - 1.0).abs() < 1e-9 && (sum - found.sum_seconds).abs() < 1e-12, "{shares}, {sum}");
        assert!(found.entries >= 9 && found.pairs >= 9 && found.forward.samples.len() == 3);
    }

    #[test]
    fn the_table_has_stages_sum_and_whole_passes() {
        let found = timed(9, Loss::L1);
        let (text, rows) = (found.to_string(), found.stages.len() + 4);
        assert!(!text.contains("fused") && text.contains("clock of the stages: host; 3 repetitions"), "{text}");
        assert_eq!(found.table().rows.len(), rows);
        for row in ["project ", "bin ", "blend ", "loss ", "blend_bwd ", "sum ", "training step, lists made anew "] {
            assert!(text.lines().any(|line| line.starts_with(row)), "{row}: {text}");
        }
        let nothing = timed(0, Loss::L2).to_string();
        assert!(!nothing.contains("NaN") && !nothing.contains("inf"), "{nothing}");
    }
}
