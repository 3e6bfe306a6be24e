//! Comparison of two arms: paired differences, their interval, and the verdict.

use super::{
    contrast::{Cell, Contrast, Judged},
    tables::{Metric, Results},
};
use crate::study::Matching;

/// How much better an arm is than another.
pub(crate) type Difference = Judged<Pair>;

/// Two arms at a budget.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Pair {
    /// The largest number of Gaussians allowed.
    pub(crate) budget: u32,
    /// The arm that is judged.
    pub(crate) arm: String,
    /// The arm that it is compared with.
    pub(crate) against: String,
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
        let name = |arm: usize| self.plan.study.arms[arm].name.clone();
        self.judge(Pair { budget, arm: name(arm), against: name(against) }, &contrast, matching, metric)
    }
}
