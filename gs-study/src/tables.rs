//! What a study comes to: quality of each arm at each budget, and paired differences between arms.

use serde::Serialize;

use crate::{
    folder::StudyFolder,
    plan::{Plan, Run},
    record::{Finished, Outcome, Record},
    statistics::{FEWEST, Interval, Verdict, bootstrap_interval, mean, variance},
    study::Matching,
};

/// Counts whose means differ by more than this share are not equal counts.
pub const EQUAL_COUNT: f64 = 0.01;

/// All that is known of a study's runs.
#[derive(Debug, Clone)]
pub struct Results<'a> {
    /// The study laid out.
    pub plan: &'a Plan,
    /// What is stored of each run, in the plan's order; nothing where it was not done yet.
    pub records: Vec<Option<Record>>,
}

/// What is measured at the end of a fit. More is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Metric {
    /// dB.
    Psnr,
    /// Structural similarity, 0 to 1.
    Ssim,
    /// Multi-scale structural similarity, 0 to 1; only images of 176 px or more have one.
    MsSsim,
}

impl Metric {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Psnr, Self::Ssim, Self::MsSsim];

    /// Its name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Psnr => "psnr",
            Self::Ssim => "ssim",
            Self::MsSsim => "ms-ssim",
        }
    }

    fn of(self, run: &Finished) -> Option<f64> {
        match self {
            Self::Psnr => Some(run.psnr),
            Self::Ssim => Some(run.ssim),
            Self::MsSsim => run.ms_ssim,
        }
    }
}

/// A mean over images of means over seeds, and how much a single run strays from its image's mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// Standard deviation over seeds, pooled over images; nothing for a single seed.
    pub over_seeds: Option<f64>,
}

/// How good an arm is at a budget.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Quality {
    /// The arm's name.
    pub arm: String,
    /// The most Gaussians there might be.
    pub budget: u32,
    /// Runs that did all their steps.
    pub finished: usize,
    /// Runs that failed.
    pub failed: usize,
    /// Runs that were not done yet.
    pub missing: usize,
    /// Gaussians at the end.
    pub gaussians: Option<Spread>,
    /// dB.
    pub psnr: Option<Spread>,
    /// 0 to 1.
    pub ssim: Option<Spread>,
    /// 0 to 1.
    pub ms_ssim: Option<Spread>,
}

/// What is paired in a comparison, and so what its interval generalises to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pairing {
    /// Images, each with its mean over seeds: other images of the same kind.
    Images,
    /// Seeds, where there is one image only: other seeds, for this image.
    Seeds,
}

impl Pairing {
    /// In a word.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Images => "images",
            Self::Seeds => "seeds",
        }
    }
}

/// How much better an arm is than another.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Difference {
    /// What is equal.
    pub matching: Matching,
    /// What is measured.
    pub metric: Metric,
    /// The most Gaussians there might be.
    pub budget: u32,
    /// The arm judged.
    pub arm: String,
    /// The arm it is held against.
    pub against: String,
    /// What is paired.
    pub pairing: Pairing,
    /// How many pairs there are.
    pub pairs: usize,
    /// Mean difference, in the metric's unit; nothing without pairs.
    pub mean: Option<f64>,
    /// Where the mean difference of all images (or seeds) probably lies.
    pub interval: Option<Interval>,
    /// What may be said.
    pub verdict: Verdict,
    /// Why nothing may be said where numbers alone would allow it.
    pub remark: Option<String>,
}

impl<'a> Results<'a> {
    /// Reads what is stored of a plan's runs.
    pub fn read(plan: &'a Plan, folder: &StudyFolder) -> Self {
        Self { plan, records: plan.runs.iter().map(|run| folder.record(run)).collect() }
    }

    /// Each run with what is stored of it, in the plan's order.
    pub fn rows(&self) -> impl Iterator<Item = (&'a Run, Option<&Record>)> {
        self.plan.runs.iter().zip(self.records.iter().map(Option::as_ref))
    }

    /// The runs of an arm at a budget that did all their steps.
    pub fn finished(&self, arm: usize, budget: u32) -> impl Iterator<Item = (&'a Run, &Finished)> {
        self.rows()
            .filter(move |(run, _)| run.arm == arm && run.budget == budget)
            .filter_map(|(run, record)| Some((run, record?.outcome.finished()?)))
    }

    /// Whether every run has ended, well or not.
    pub fn is_whole(&self) -> bool {
        self.records.iter().all(Option::is_some)
    }

    /// The quality of every arm at every budget.
    pub fn qualities(&self) -> Vec<Quality> {
        let budgets = &self.plan.study.budgets;
        budgets
            .iter()
            .flat_map(|&budget| (0..self.plan.study.arms.len()).map(move |arm| (arm, budget)))
            .map(|(arm, budget)| self.quality(arm, budget))
            .collect()
    }

    fn quality(&self, arm: usize, budget: u32) -> Quality {
        let of_arm = || self.rows().filter(move |(run, _)| run.arm == arm && run.budget == budget);
        let failed = of_arm().filter(|(_, r)| r.is_some_and(|r| matches!(r.outcome, Outcome::Failed { .. }))).count();
        Quality {
            arm: self.plan.study.arms[arm].name.clone(),
            budget,
            finished: self.finished(arm, budget).count(),
            failed,
            missing: of_arm().filter(|(_, record)| record.is_none()).count(),
            gaussians: self.spread(arm, budget, |run| Some(f64::from(run.gaussians))),
            psnr: self.spread(arm, budget, |run| Metric::Psnr.of(run)),
            ssim: self.spread(arm, budget, |run| Metric::Ssim.of(run)),
            ms_ssim: self.spread(arm, budget, |run| Metric::MsSsim.of(run)),
        }
    }

    /// Mean and spread of what `of` finds in the runs of an arm at a budget.
    pub fn spread(&self, arm: usize, budget: u32, of: impl Fn(&Finished) -> Option<f64>) -> Option<Spread> {
        let images: Vec<Vec<f64>> = (0..self.plan.targets.len())
            .map(|target| {
                let of_target = self.finished(arm, budget).filter(|(run, _)| run.target == target);
                of_target.filter_map(|(_, run)| of(run)).collect::<Vec<f64>>()
            })
            .filter(|values| !values.is_empty())
            .collect();
        let means: Vec<f64> = images.iter().map(|values| mean(values)).collect();
        let variances: Vec<f64> = images.iter().filter_map(|values| variance(values)).collect();
        let over_seeds = (!variances.is_empty()).then(|| mean(&variances).sqrt());
        (!means.is_empty()).then(|| Spread { mean: mean(&means), over_seeds })
    }

    /// Every arm held against every other that stands before it, in each of these respects.
    pub fn differences(&self, matchings: &[Matching]) -> Vec<Difference> {
        let arms = self.plan.study.arms.len();
        let mut differences = Vec::new();
        for &matching in self.plan.study.matchings.iter().filter(|matching| matchings.contains(matching)) {
            let metrics = if matching == Matching::Count { &Metric::ALL[..] } else { &Metric::ALL[..1] };
            for &metric in metrics.iter().filter(|metric| self.is_measured(**metric)) {
                for &budget in &self.plan.study.budgets {
                    for arm in 1..arms {
                        for against in 0..arm {
                            differences.push(self.difference(matching, metric, budget, arm, against));
                        }
                    }
                }
            }
        }
        differences
    }

    fn is_measured(&self, metric: Metric) -> bool {
        let mut finished = self.records.iter().flatten().filter_map(|record| record.outcome.finished());
        finished.any(|run| metric.of(run).is_some())
    }

    /// An arm held against another.
    pub fn difference(
        &self,
        matching: Matching,
        metric: Metric,
        budget: u32,
        arm: usize,
        against: usize,
    ) -> Difference {
        let pairs = self.pairs(arm, against, budget);
        // Of images of many sizes, each has its own time.
        let places: Vec<Common> = (0..self.plan.targets.len()).map(|target| Common::of(&pairs, target)).collect();
        let value = |of: &Run, run: &Finished| match matching {
            Matching::Count => metric.of(run),
            Matching::Iterations => run.psnr_after(places[of.target].steps),
            Matching::Time => run.psnr_within(places[of.target].seconds),
        };
        let gains: Vec<(usize, f64)> =
            pairs.iter().filter_map(|&(run, a, b)| Some((run.target, value(run, a)? - value(run, b)?))).collect();
        let pairing = if self.plan.targets.len() > 1 { Pairing::Images } else { Pairing::Seeds };
        let units: Vec<f64> = match pairing {
            Pairing::Seeds => gains.iter().map(|gain| gain.1).collect(),
            Pairing::Images => (0..self.plan.targets.len())
                .map(|target| gains.iter().filter(|g| g.0 == target).map(|g| g.1).collect::<Vec<f64>>())
                .filter(|gains| !gains.is_empty())
                .map(|gains| mean(&gains))
                .collect(),
        };
        let interval = bootstrap_interval(&units);
        let remark = match (matching, interval) {
            (Matching::Count, Some(_)) => counts_differ(&pairs),
            (_, Some(_)) => None,
            (_, None) => Some(format!("{} {} are too few: {FEWEST} at least", units.len(), pairing.words())),
        };
        let verdict = match (&remark, interval) {
            (None, Some(interval)) => interval.verdict(),
            _ => Verdict::CannotTell,
        };
        Difference {
            matching,
            metric,
            budget,
            arm: self.plan.study.arms[arm].name.clone(),
            against: self.plan.study.arms[against].name.clone(),
            pairing,
            pairs: units.len(),
            mean: (!units.is_empty()).then(|| mean(&units)),
            interval,
            verdict,
            remark,
        }
    }

    /// Finished runs of two arms at a budget that agree in image and seed.
    fn pairs(&self, arm: usize, against: usize, budget: u32) -> Vec<(&'a Run, &Finished, &Finished)> {
        let others: Vec<_> = self.finished(against, budget).collect();
        self.finished(arm, budget)
            .filter_map(|(run, a)| {
                let twin = others.iter().find(|(other, _)| (other.target, other.seed) == (run.target, run.seed))?;
                Some((run, a, twin.1))
            })
            .collect()
    }
}

/// What all runs of a comparison on an image have reached.
struct Common {
    steps: u32,
    /// s.
    seconds: f64,
}

impl Common {
    fn of(pairs: &[(&Run, &Finished, &Finished)], target: usize) -> Self {
        let runs = || pairs.iter().filter(|(run, ..)| run.target == target).flat_map(|&(_, a, b)| [a, b]);
        Self {
            steps: runs().map(|run| run.iterations).min().unwrap_or(0),
            seconds: runs().map(|run| run.seconds).fold(f64::INFINITY, f64::min),
        }
    }
}

/// Arms that end with other counts are not compared at equal count.
fn counts_differ(pairs: &[(&Run, &Finished, &Finished)]) -> Option<String> {
    let counts = |of: fn(&(&Run, &Finished, &Finished)) -> u32| {
        mean(&pairs.iter().map(|p| f64::from(of(p))).collect::<Vec<_>>())
    };
    let (a, b) = (counts(|p| p.1.gaussians), counts(|p| p.2.gaussians));
    ((a - b).abs() > EQUAL_COUNT * a.max(b)).then(|| format!("counts differ: {a:.0} against {b:.0}"))
}
