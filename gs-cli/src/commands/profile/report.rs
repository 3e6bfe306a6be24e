//! The report of a profile as a table, as CSV and as JSON, with the same numbers.

use std::fmt::Write;

use gs_backend::Chosen;
use gs_core::{
    Blend, Loss, Parameterization, Scene, counted,
    effects::{Antialias, Order},
    profile::{Clock, Profile, Quantiles, StageTime},
};
use serde::Serialize;

use super::measure::{Subject, Whole};

/// A kind of scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SceneKind {
    TwoD,
    ThreeD,
}

/// What `profile.json` holds and `--json` prints.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    /// The scene or the image; `null` is the paper's circle and square.
    input: Option<String>,
    #[serde(skip)]
    kind: SceneKind,
    #[serde(skip)]
    name: String,
    gaussians: usize,
    /// Steps in which the Gaussians were fitted to the image; `null` for a scene.
    fitted_steps: Option<u32>,
    /// The target's file, or "its own rendering".
    target: String,
    width: u32,
    height: u32,
    blend: Blend,
    order: Order,
    antialias: Antialias,
    sh_degree: u8,
    loss: Loss,
    parameterization: Parameterization,
    /// Entries of all tiles' lists.
    entries: usize,
    /// Pixel–Gaussian pairs that blending visits.
    pairs: u64,
    backend: &'static str,
    adapter: Option<String>,
    threads: usize,
    simd: Option<String>,
    /// The backend, and why it is this one.
    reason: String,
    clock: ClockName,
    #[serde(skip)]
    clock_text: String,
    /// Why a GPU's own clock is not used.
    clock_reason: Option<String>,
    repetitions: usize,
    stages: Vec<Stage>,
    /// Sum of the medians of the stages that have a share.
    sum_seconds: f64,
    train_step_fresh: Times,
    train_step_reused: Times,
    forward: Times,
}

/// The clock of the stages. Whole passes are always timed by the host.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(rename_all = "kebab-case")]
enum ClockName {
    Host,
    RoundTrip,
    Device,
}

/// A row of the table.
#[derive(Debug, Serialize)]
struct Stage {
    stage: &'static str,
    seconds: Times,
    /// Share of the sum, 0 to 1; `null` if a training step runs another stage instead.
    share: Option<f64>,
    replaced_by: Option<&'static str>,
    /// `null` if the stage visits no pairs.
    pairs: Option<u64>,
    pairs_per_second: Option<f64>,
}

/// Seconds.
#[derive(Debug, Clone, Serialize)]
struct Times {
    median: f64,
    /// The 10 % quantile.
    low: f64,
    /// The 90 % quantile.
    high: f64,
    samples: Vec<f64>,
}

impl Times {
    fn of(samples: &[f64]) -> Self {
        let Quantiles { low, median, high } = Quantiles::of(samples);
        Self { median, low, high, samples: samples.to_vec() }
    }
}

impl Stage {
    fn new(profile: &Profile, time: &StageTime, sum: f64) -> Self {
        let seconds = Times::of(&time.seconds);
        let replaced_by = profile.replaced_by(time);
        let pairs = (time.pairs > 0).then_some(time.pairs);
        Self {
            stage: time.stage,
            share: replaced_by.is_none().then(|| seconds.median / sum),
            replaced_by,
            pairs,
            pairs_per_second: pairs.map(|pairs| pairs as f64 / seconds.median),
            seconds,
        }
    }
}

impl Report {
    pub(super) fn new<S: Scene>(
        subject: &Subject<S>,
        backend: &Chosen,
        profile: &Profile,
        whole: &Whole,
        repetitions: usize,
    ) -> Self {
        let sum_seconds = profile.of_a_step().map(|stage| Quantiles::of(&stage.seconds).median).sum();
        let (clock, clock_reason) = match &profile.clock {
            Clock::Host => (ClockName::Host, None),
            Clock::RoundTrip { why } => (ClockName::RoundTrip, Some(why.clone())),
            Clock::Device => (ClockName::Device, None),
        };
        let (effects, (width, height)) = (&subject.render.effects, subject.target.image.size());
        Self {
            input: subject.input.clone(),
            kind: subject.kind,
            name: subject.name.clone(),
            gaussians: subject.scene.len(),
            fitted_steps: subject.fitted_steps,
            target: subject.target.name.clone(),
            width,
            height,
            blend: effects.blend,
            order: effects.order,
            antialias: effects.antialias,
            sh_degree: effects.sh_degree,
            loss: subject.loss,
            parameterization: subject.parameterization,
            entries: profile.entries,
            pairs: profile.pairs,
            backend: backend.rasterizer.name(),
            adapter: backend.rasterizer.adapter().map(str::to_owned),
            threads: backend.threads,
            simd: backend.rasterizer.simd_level(),
            reason: backend.reason.clone(),
            clock,
            clock_text: profile.clock.to_string(),
            clock_reason,
            repetitions,
            stages: profile.stages.iter().map(|stage| Stage::new(profile, stage, sum_seconds)).collect(),
            sum_seconds,
            train_step_fresh: Times::of(&whole.train_step_fresh),
            train_step_reused: Times::of(&whole.train_step_reused),
            forward: Times::of(&whole.forward),
        }
    }

    /// Whole passes with the names of their rows in files and in the table.
    fn whole(&self) -> [(&'static str, &'static str, &Times); 3] {
        [
            ("train_step_fresh", "training step, lists made anew", &self.train_step_fresh),
            ("train_step_reused", "training step, lists used again", &self.train_step_reused),
            ("forward", "forward pass alone", &self.forward),
        ]
    }

    /// The table as CSV: stages, their sum, whole passes. Cells that do not apply are empty.
    pub(super) fn csv(&self) -> String {
        let cell = |value: Option<String>| value.unwrap_or_default();
        let mut csv = String::from("row,seconds,seconds_low,seconds_high,share,pairs,pairs_per_second\n");
        for stage in &self.stages {
            let Times { median, low, high, .. } = stage.seconds;
            let share = cell(stage.share.map(|share| share.to_string()));
            let pairs = cell(stage.pairs.map(|pairs| pairs.to_string()));
            let rate = cell(stage.pairs_per_second.map(|rate| rate.to_string()));
            let _ = writeln!(csv, "{},{median},{low},{high},{share},{pairs},{rate}", stage.stage);
        }
        let _ = writeln!(csv, "sum,{},,,1,,", self.sum_seconds);
        for (row, _, Times { median, low, high, .. }) in self.whole() {
            let _ = writeln!(csv, "{row},{median},{low},{high},,,");
        }
        csv
    }

    /// The head, the table and its legend.
    pub(super) fn text(&self) -> String {
        let mut text = self.head();
        let _ =
            writeln!(text, "\n{:<32}{:>10}{:>10}{:>10}{:>9}{:>10}", "stage", "ms", "10 %", "90 %", "share", "Gpairs/s");
        for stage in &self.stages {
            let share = match (stage.share, stage.replaced_by) {
                (Some(share), _) => format!("{:.1} %", 100.0 * share),
                (None, by) => by.map_or_else(String::new, |by| format!("({by})")),
            };
            let rate = stage.pairs_per_second.map_or_else(|| "-".to_owned(), |rate| format!("{:.3}", 1e-9 * rate));
            let _ = writeln!(text, "{:<32}{}{share:>9}{rate:>10}", stage.stage, milliseconds(&stage.seconds));
        }
        let _ = writeln!(text, "{:<32}{:>10.4}{:>29}", "sum", 1e3 * self.sum_seconds, "100.0 %");
        text.push('\n');
        for (_, row, times) in self.whole() {
            let _ = writeln!(text, "{row:<32}{}", milliseconds(times));
        }
        text.push_str(&self.legend());
        text
    }

    fn head(&self) -> String {
        let Self { reason, name, width, height, target, clock_text, repetitions, .. } = self;
        let fitted =
            self.fitted_steps.map_or_else(String::new, |steps| format!(", fitted in {}", counted(steps, "step")));
        let Self { blend, loss, parameterization, .. } = self;
        // 2D scenes have none of these.
        let effects = match self.kind {
            SceneKind::TwoD => String::new(),
            SceneKind::ThreeD => {
                let (order, antialias) = (self.order.name(), self.antialias.name());
                format!(", order {order}, antialias {antialias}, SH degree {}", self.sh_degree)
            }
        };
        format!(
            "{reason}\n{name}: {} Gaussians{fitted}; {width}x{height} px, {blend}{effects}, {loss}, {parameterization}; target: {target}\n\
             {} entries in tiles' lists, {} pairs of a pixel and a Gaussian\nclock of the stages: {clock_text}; \
             {repetitions} repetitions\n",
            self.gaussians, self.entries, self.pairs
        )
    }

    /// The explanation of stages without a share.
    fn legend(&self) -> String {
        let mut legend = String::new();
        let replaced: Vec<&str> =
            self.stages.iter().filter(|stage| stage.replaced_by.is_some()).map(|stage| stage.stage).collect();
        if let Some(by) = self.stages.iter().find_map(|stage| stage.replaced_by) {
            let _ = write!(
                legend,
                "\nA training step runs {by} in place of {}, which are shown for comparison and are not in the sum.",
                replaced.join(", ")
            );
        }
        legend
    }
}

/// Median and quantiles as three cells.
fn milliseconds(Times { median, low, high, .. }: &Times) -> String {
    format!("{:>10.4}{:>10.4}{:>10.4}", 1e3 * median, 1e3 * low, 1e3 * high)
}
