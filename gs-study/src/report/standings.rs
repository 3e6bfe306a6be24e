//! Who leads: in each respect, at each budget, the best arm and those that cannot be told from it.

use crate::{
    record::Finished,
    statistics::{Verdict, mean},
    study::Matching,
    tables::{Metric, Results},
};

/// The arms in one respect at one budget.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Standing {
    pub(crate) matching: Matching,
    pub(crate) budget: u32,
    /// The arm with the best mean, and that mean, dB.
    pub(crate) leader: (usize, f64),
    /// The best mean of the others, dB.
    pub(crate) next: Option<f64>,
    /// Arms that the leader is not shown to be better than.
    pub(crate) not_told_apart: Vec<usize>,
    /// Of those, the ones that are not compared at all, since their counts differ.
    pub(crate) not_compared: Vec<usize>,
}

/// Every respect of the study at every budget; without those that no arm has finished runs for.
pub(crate) fn standings(results: &Results<'_>) -> Vec<Standing> {
    let study = &results.plan.study;
    let all = study.matchings.iter().flat_map(|&matching| study.budgets.iter().map(move |&budget| (matching, budget)));
    all.filter_map(|(matching, budget)| standing(results, matching, budget)).collect()
}

fn standing(results: &Results<'_>, matching: Matching, budget: u32) -> Option<Standing> {
    let arms = 0..results.plan.study.arms.len();
    let mut means: Vec<(usize, f64)> =
        arms.filter_map(|arm| Some((arm, mean_psnr(results, matching, budget, arm)?))).collect();
    means.sort_by(|a, b| b.1.total_cmp(&a.1));
    let &leader = means.first()?;
    let (mut not_told_apart, mut not_compared) = (Vec::new(), Vec::new());
    for &(arm, _) in &means[1..] {
        let difference = results.difference(matching, Metric::Psnr, budget, leader.0, arm);
        if difference.verdict != Verdict::Better {
            not_told_apart.push(arm);
            if difference.interval.is_some() && difference.remark.is_some() {
                not_compared.push(arm);
            }
        }
    }
    let next = means.get(1).map(|next| next.1);
    Some(Standing { matching, budget, leader, next, not_told_apart, not_compared })
}

/// Mean over images of means over seeds, at a place that the runs of all arms have reached.
fn mean_psnr(results: &Results<'_>, matching: Matching, budget: u32, arm: usize) -> Option<f64> {
    let arms = 0..results.plan.study.arms.len();
    let all = |target: usize| {
        arms.clone().flat_map(move |arm| results.finished(arm, budget)).filter(move |(run, _)| run.target == target)
    };
    let images: Vec<f64> = (0..results.plan.targets.len())
        .filter_map(|target| {
            let steps = all(target).map(|(_, run)| run.iterations).min()?;
            let seconds = all(target).map(|(_, run)| run.seconds).fold(f64::INFINITY, f64::min);
            let value = |run: &Finished| match matching {
                Matching::Count => Some(run.psnr),
                Matching::Iterations => run.psnr_after(steps),
                Matching::Time => run.psnr_within(seconds),
            };
            let of_target = results.finished(arm, budget).filter(|(run, _)| run.target == target);
            let values: Vec<f64> = of_target.filter_map(|(_, run)| value(run)).collect();
            (!values.is_empty()).then(|| mean(&values))
        })
        .collect();
    (!images.is_empty()).then(|| mean(&images))
}
