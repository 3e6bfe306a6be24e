//! Comparison of two arms: paired differences, their interval, the verdict, and what prevents a
//! verdict.

use std::collections::BTreeSet;

use crate::statistics::{FEWEST, Interval, bootstrap_interval, mean};
use serde::{Deserialize, Serialize};

use crate::{
    plan::Run,
    reach::Reach,
    record::Finished,
    remark::{FEWEST_SEEDS, Pairing, ResultRemark},
    study::Matching,
    tables::{Metric, Results},
};

/// Counts that differ by more than this share are treated as different.
pub(crate) const EQUAL_COUNT: f64 = 0.01;

/// The verdict on a difference between two arms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Verdict {
    /// The whole interval lies above 0.
    Better,
    /// The whole interval lies below 0.
    Worse,
    /// 0 lies in the interval, there is no interval, or a remark forbids a verdict.
    CannotTell,
}

impl Verdict {
    /// The verdict that follows from an interval alone, of a metric of which more is better.
    pub fn of(interval: Interval) -> Self {
        if interval.low > 0.0 {
            Self::Better
        } else if interval.high < 0.0 {
            Self::Worse
        } else {
            Self::CannotTell
        }
    }

    /// The verdict as reports print it.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "worse",
            Self::CannotTell => "can't tell",
        }
    }
}

/// How much better an arm is than another.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Difference {
    /// What is held equal between the arms.
    pub matching: Matching,
    /// What is measured.
    pub metric: Metric,
    /// The largest number of Gaussians allowed.
    pub budget: u32,
    /// The arm that is judged.
    pub arm: String,
    /// The arm that it is compared with.
    pub against: String,
    /// Whether images or seeds are paired.
    pub pairing: Pairing,
    /// Number of pairs.
    pub pairs: usize,
    /// Mean difference, in the metric's unit; `None` without pairs and where it is not finite.
    pub mean: Option<f64>,
    /// 95 % interval of the mean difference over all images (or seeds).
    pub interval: Option<Interval>,
    /// The verdict.
    pub verdict: Verdict,
    /// What the reader must know besides the numbers, such as why there is no verdict.
    pub remarks: Vec<ResultRemark>,
}

impl Difference {
    /// The first remark that forbids a verdict.
    pub(crate) fn obstacle(&self) -> Option<&ResultRemark> {
        self.remarks.iter().find(|remark| remark.forbids_verdict())
    }
}

/// Two finished runs on the same image with the same seed.
struct Pair<'a> {
    run: &'a Run,
    twin: &'a Run,
    arm: &'a Finished,
    against: &'a Finished,
}

impl Results<'_> {
    /// Compares every arm with every arm listed before it, at equal count, iterations or time as
    /// given.
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

    /// Compares two arms over the pairs of runs that both finished.
    pub fn difference(
        &self,
        matching: Matching,
        metric: Metric,
        budget: u32,
        arm: usize,
        against: usize,
    ) -> Difference {
        let images = self.plan.targets.len();
        let pairs = self.pairs(arm, against, budget);
        let reach = Reach::of_images(self, budget);
        let gain = |pair: &Pair<'_>| {
            let measured = |run, end| reach[pair.run.target].measured(matching, metric, run, end);
            Some((pair.run.target, measured(pair.run, pair.arm)? - measured(pair.twin, pair.against)?))
        };
        let gains: Vec<(usize, f64)> = pairs.iter().filter_map(gain).collect();
        let of_image = |target: usize| gains.iter().filter(move |gain| gain.0 == target).map(|gain| gain.1);
        let pairing = if images > 1 { Pairing::Images } else { Pairing::Seeds };
        let units: Vec<f64> = match pairing {
            Pairing::Seeds => gains.iter().map(|gain| gain.1).collect(),
            Pairing::Images => {
                (0..images).filter(|&target| of_image(target).next().is_some()).map(|t| mean(of_image(t))).collect()
            }
        };
        let interval = if units.len() < FEWEST { None } else { bootstrap_interval(&units) };
        let infinite = gains.iter().filter(|gain| !gain.1.is_finite()).count();
        let mut remarks = self.gaps(&pairs, pairing);
        remarks.extend((infinite > 0).then_some(ResultRemark::Infinite { pairs: infinite }));
        remarks.extend(match matching {
            Matching::Count => self.counts_differ(&pairs),
            Matching::Time => self.clocks_differ(budget),
            Matching::Iterations => None,
        });
        let seeds = self.plan.study.seeds.len();
        if units.len() < FEWEST {
            remarks.push(ResultRemark::TooFew { pairs: units.len(), pairing });
        } else if seeds < FEWEST_SEEDS {
            remarks.push(ResultRemark::FewSeeds { seeds });
        }
        let verdict = match interval {
            Some(interval) if !remarks.iter().any(ResultRemark::forbids_verdict) => Verdict::of(interval),
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
            mean: Some(mean(&units)).filter(|mean| mean.is_finite()),
            interval,
            verdict,
            remarks,
        }
    }

    /// Pairs of finished runs of two arms at a budget, with the same image and seed.
    fn pairs(&self, arm: usize, against: usize, budget: u32) -> Vec<Pair<'_>> {
        let others: Vec<_> = self.finished(against, budget).collect();
        self.finished(arm, budget)
            .filter_map(|(run, end)| {
                let twin = others.iter().find(|(other, _)| (other.target, other.seed) == (run.target, run.seed))?;
                Some(Pair { run, twin: twin.0, arm: end, against: twin.1 })
            })
            .collect()
    }

    /// Remarks about images or pairs that are missing because runs failed or were not done.
    fn gaps(&self, pairs: &[Pair<'_>], pairing: Pairing) -> Vec<ResultRemark> {
        let images = self.plan.targets.len();
        let is_missing = |target: &usize| pairs.iter().all(|pair| pair.run.target != *target);
        let missing = (0..images).filter(is_missing).count();
        let asked = images * self.plan.study.seeds.len();
        match pairing {
            Pairing::Images if missing > 0 => vec![ResultRemark::ImagesMissing { missing, of: images }],
            _ if pairs.len() < asked => vec![ResultRemark::Incomplete { pairs: pairs.len(), of: asked }],
            _ => Vec::new(),
        }
    }

    /// A remark if the arms end with different counts on some image; it names the image with the
    /// largest difference. Counts are compared run by run, so that a surplus in one run does not
    /// balance a deficit in another.
    fn counts_differ(&self, pairs: &[Pair<'_>]) -> Option<ResultRemark> {
        let of_image = |target: usize| {
            let counts = || {
                let of_target = pairs.iter().filter(move |pair| pair.run.target == target);
                of_target.map(|pair| (f64::from(pair.arm.gaussians), f64::from(pair.against.gaussians)))
            };
            let (arm, against) = (mean(counts().map(|c| c.0)), mean(counts().map(|c| c.1)));
            let share = mean(counts().map(|(a, b)| (a - b).abs())) / arm.max(against);
            (share, arm, against, target)
        };
        let shares = (0..self.plan.targets.len()).map(of_image).filter(|found| found.0 > EQUAL_COUNT);
        let (_, arm, against, target) = shares.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let image = (self.plan.targets.len() > 1).then(|| self.plan.targets[target].label().to_owned());
        Some(ResultRemark::CountsDiffer { arm, against, image })
    }

    /// A remark if the runs at a budget were not all timed under the same conditions.
    fn clocks_differ(&self, budget: u32) -> Option<ResultRemark> {
        let clock = |end: &Finished| match end.side_by_side {
            1 => end.backend.clone(),
            n => format!("{}, {n} side by side", end.backend),
        };
        let clocks: BTreeSet<String> = self.all_finished(budget).map(|(_, end)| clock(end)).collect();
        (clocks.len() > 1).then(|| ResultRemark::ClocksDiffer { clocks: clocks.into_iter().collect() })
    }
}
