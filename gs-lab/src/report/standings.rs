//! The leading arm at each budget, and the arms that it cannot be distinguished from.

use std::collections::BTreeMap;

use crate::result::mean;

use crate::{
    result::{Metric, Reach, Results, Verdict},
    study::Matching,
};

/// The ranking of the arms at a budget. Means and verdicts are of the same runs, as far as all arms
/// have finished.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Standing {
    pub(crate) matching: Matching,
    pub(crate) budget: u32,
    /// The arm with the best mean, and that mean, dB.
    pub(crate) leader: (usize, f64),
    /// The second-best mean, dB.
    pub(crate) next: Option<f64>,
    /// Arms that are compared with the leader and not shown to be worse.
    pub(crate) indistinguishable: Vec<usize>,
    /// Arms without a verdict, by the reason.
    pub(crate) not_judged: BTreeMap<String, Vec<usize>>,
}

/// The standings of the study, without those for which no arm has finished runs.
pub(crate) fn standings(results: &Results<'_>) -> Vec<Standing> {
    let study = &results.plan.study;
    let all = study.matchings.iter().flat_map(|&matching| study.budgets.iter().map(move |&budget| (matching, budget)));
    all.filter_map(|(matching, budget)| standing(results, matching, budget)).collect()
}

fn standing(results: &Results<'_>, matching: Matching, budget: u32) -> Option<Standing> {
    let mut means = mean_psnrs(results, matching, budget);
    means.sort_by(|a, b| b.1.total_cmp(&a.1));
    let &leader = means.first()?;
    let (mut indistinguishable, mut not_judged) = (Vec::new(), BTreeMap::<_, Vec<usize>>::new());
    for arm in (0..results.plan.study.arms.len()).filter(|&arm| arm != leader.0) {
        let difference = results.difference(matching, Metric::Psnr, budget, leader.0, arm);
        match difference.obstacle() {
            Some(obstacle) => not_judged.entry(obstacle.to_string()).or_default().push(arm),
            None if difference.verdict == Verdict::Better => {}
            None => indistinguishable.push(arm),
        }
    }
    let next = means.get(1).map(|next| next.1);
    Some(Standing { matching, budget, leader, next, indistinguishable, not_judged })
}

/// Mean PSNR of each arm that has finished runs on all images or scenes: over these, and over the seeds that
/// all of these arms have finished.
fn mean_psnrs(results: &Results<'_>, matching: Matching, budget: u32) -> Vec<(usize, f64)> {
    let images = results.plan.targets.len();
    let seeds = &results.plan.study.seeds;
    let reach = Reach::of_targets(results, budget);
    let values: BTreeMap<(usize, usize, u32), f64> = results
        .all_finished(budget)
        .filter_map(|(run, end)| {
            let value = reach[run.target].measured(matching, Metric::Psnr, run.arm, end)?;
            Some(((run.arm, run.target, run.seed), value))
        })
        .collect();
    let has_all = |arm: &usize| (0..images).all(|t| seeds.iter().any(|&seed| values.contains_key(&(*arm, t, seed))));
    let ranked: Vec<usize> = (0..results.plan.study.arms.len()).filter(has_all).collect();
    let common = |target: usize, seed: u32| ranked.iter().all(|&arm| values.contains_key(&(arm, target, seed)));
    let of_image = |arm: usize, target: usize| {
        mean(seeds.iter().filter(|&&seed| common(target, seed)).filter_map(|&seed| values.get(&(arm, target, seed))))
    };
    // If the arms have no common seed on an image, there is no fair mean.
    let of_arm =
        |arm: usize| Some((arm, mean((0..images).map(|t| of_image(arm, t))))).filter(|found| !found.1.is_nan());
    ranked.iter().filter_map(|&arm| of_arm(arm)).collect()
}
