//! Comparison of two arms: paired differences, their interval, and the verdict.

use serde::Serialize;

use super::{
    contrast::{Cell, Contrast, Judged},
    remark::{Pairing, ResultRemark},
    statistics::Interval,
    tables::{Metric, Results},
    verdict::Verdict,
};
use crate::study::Matching;

/// How much better an arm is than another.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Difference {
    /// What is held equal between the arms.
    pub(crate) matching: Matching,
    /// What is measured.
    pub(crate) metric: Metric,
    /// The largest number of Gaussians allowed.
    pub(crate) budget: u32,
    /// The arm that is judged.
    pub(crate) arm: String,
    /// The arm that it is compared with.
    pub(crate) against: String,
    /// What the interval is over.
    pub(crate) pairing: Pairing,
    /// Number of pairs: of images or seeds, and in 3D of views, of which several belong to one scene
    /// or one run.
    pub(crate) pairs: usize,
    /// Mean difference, in the metric's unit; `None` without pairs and where it is not finite.
    pub(crate) mean: Option<f64>,
    /// 95 % interval of the mean difference.
    pub(crate) interval: Option<Interval>,
    /// The verdict.
    pub(crate) verdict: Verdict,
    /// What the reader must know besides the numbers, such as why there is no verdict.
    pub(crate) remarks: Vec<ResultRemark>,
}

impl Difference {
    /// The first remark that forbids a verdict.
    pub(crate) fn obstacle(&self) -> Option<&ResultRemark> {
        self.remarks.iter().find(|remark| remark.forbids_verdict())
    }
}

impl Results<'_> {
    /// Compares every arm with every arm listed before it, at equal count, iterations or time as
    /// given.
    pub(crate) fn differences(&self, matchings: &[Matching]) -> Vec<Difference> {
        let arms = self.plan.study.arms.len();
        let mut differences = Vec::new();
        for (matching, metric) in self.measures(matchings) {
            for &budget in &self.plan.study.budgets {
                for arm in 1..arms {
                    for against in 0..arm {
                        differences.push(self.difference(matching, metric, budget, arm, against));
                    }
                }
            }
        }
        differences
    }

    /// What is held equal and measured: those of the study's matchings that are given, each with its
    /// metrics. Other metrics than PSNR are measured at the end only.
    pub(crate) fn measures(&self, matchings: &[Matching]) -> Vec<(Matching, Metric)> {
        let asked = self.plan.study.matchings.iter().filter(|matching| matchings.contains(matching));
        let metrics = |matching| if matching == Matching::Count { &Metric::ALL[..] } else { &Metric::ALL[..1] };
        let all = asked.flat_map(|&matching| metrics(matching).iter().map(move |&metric| (matching, metric)));
        all.filter(|(_, metric)| self.is_measured(*metric)).collect()
    }

    /// Compares two arms over the pairs of runs that both finished.
    pub(crate) fn difference(
        &self,
        matching: Matching,
        metric: Metric,
        budget: u32,
        arm: usize,
        against: usize,
    ) -> Difference {
        let contrast = Contrast(vec![(Cell { arm, budget }, 1.0), (Cell { arm: against, budget }, -1.0)]);
        let Judged { pairing, pairs, mean, interval, verdict, remarks } = self.judge(&contrast, matching, metric);
        Difference {
            matching,
            metric,
            budget,
            arm: self.plan.study.arms[arm].name.clone(),
            against: self.plan.study.arms[against].name.clone(),
            pairing,
            pairs,
            mean,
            interval,
            verdict,
            remarks,
        }
    }
}
