//! Contrasts: weighted sums of arms over the same images or scenes and seeds, with their intervals,
//! and what forbids a verdict on them. The difference of two arms is one, and so is each effect of a
//! factorial design.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    reach::Reach,
    remark::{FEWEST_SEEDS, Pairing, ResultRemark},
    statistics::{FEWEST, Interval, Strata, cluster_interval, freedom, mean, mean_of_strata},
    tables::{Metric, Results},
    verdict::Verdict,
};
use crate::{run::Finished, study::Matching};

/// Counts that differ by more than this share are treated as different.
pub(crate) const EQUAL_COUNT: f64 = 0.01;

/// Fewest seeds of each scene for an interval over seeds: of two, the lowest and the highest mean
/// are closer together than Student's interval is wide.
pub(crate) const FEWEST_SEEDS_OF_SCENE: usize = 3;

/// An arm at a budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Cell {
    pub(crate) arm: usize,
    pub(crate) budget: u32,
}

/// Cells with their weights.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Contrast(pub(crate) Vec<(Cell, f64)>);

/// A contrast with its interval and verdict: a difference between arms, or an effect of factors.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Judged<Of> {
    /// What is held equal between the arms.
    pub(crate) matching: Matching,
    /// What is measured.
    pub(crate) metric: Metric,
    /// What the contrast is of.
    pub(crate) of: Of,
    /// What the interval is over.
    pub(crate) pairing: Pairing,
    /// Number of pairs: of images or seeds, and in 3D of views, of which several belong to one scene
    /// or one run.
    pub(crate) pairs: usize,
    /// The value, in the metric's unit; `None` without pairs and where it is not finite.
    pub(crate) mean: Option<f64>,
    /// 95 % interval of the value.
    pub(crate) interval: Option<Interval>,
    /// The verdict.
    pub(crate) verdict: Verdict,
    /// What the reader must know besides the numbers, such as why there is no verdict.
    pub(crate) remarks: Vec<ResultRemark>,
}

impl<Of> Judged<Of> {
    /// The first remark that forbids a verdict.
    pub(crate) fn obstacle(&self) -> Option<&ResultRemark> {
        self.remarks.iter().find(|remark| remark.forbids_verdict())
    }
}

/// Image or scene, and seed, of runs that are compared.
type Place = (usize, u32);

/// The finished runs of a contrast at one place, in the order of its cells.
type Ends<'r> = Vec<&'r Finished>;

impl Results<'_> {
    /// The value of a contrast at equal count, iterations or time, with its interval.
    pub(crate) fn judge<Of>(&self, of: Of, contrast: &Contrast, matching: Matching, metric: Metric) -> Judged<Of> {
        let ends = self.ends(contrast);
        let values = self.values(contrast, &ends, matching, metric);
        let pairing = self.pairing();
        let strata = self.strata(&values, pairing);
        let too_few = self.too_few(&strata, pairing);
        let interval = if too_few.is_some() { None } else { cluster_interval(&strata) };
        let infinite = values.values().filter(|values| values.iter().any(|value| !value.is_finite())).count();
        let mut remarks = self.gaps(&ends, pairing);
        remarks.extend((infinite > 0).then_some(ResultRemark::Infinite { pairs: infinite }));
        remarks.extend(match matching {
            Matching::Count => self.counts_differ(contrast, &ends),
            Matching::Time => self.clocks_differ(contrast),
            Matching::Iterations => None,
        });
        let seeds = self.plan.study.seeds.len();
        let is_checked = too_few.is_some();
        remarks.extend(too_few);
        if !is_checked && pairing == Pairing::SeedsOfScenes && self.plan.targets.len() < FEWEST {
            remarks.push(ResultRemark::FewScenes { scenes: self.plan.targets.len() });
        } else if !is_checked && seeds < FEWEST_SEEDS {
            remarks.push(ResultRemark::FewSeeds { seeds });
        }
        let verdict = match interval {
            Some(interval) if !remarks.iter().any(ResultRemark::forbids_verdict) => Verdict::of(interval),
            _ => Verdict::None,
        };
        let pairs = strata.iter().flatten().map(Vec::len).sum();
        let mean = Some(mean_of_strata(&strata)).filter(|mean| mean.is_finite());
        Judged { matching, metric, of, pairing, pairs, mean, interval, verdict, remarks }
    }

    /// The finished runs of all cells, at the places where all of them have finished.
    fn ends(&self, contrast: &Contrast) -> BTreeMap<Place, Ends<'_>> {
        let mut ends: BTreeMap<Place, BTreeMap<usize, &Finished>> = BTreeMap::new();
        for (index, (cell, _)) in contrast.0.iter().enumerate() {
            for (run, end) in self.finished(cell.arm, cell.budget) {
                ends.entry((run.target, run.seed)).or_default().insert(index, end);
            }
        }
        let complete = ends.into_iter().filter(|(_, ends)| ends.len() == contrast.0.len());
        complete.map(|(place, ends)| (place, ends.into_values().collect())).collect()
    }

    /// The value of the contrast for each view (or the one image) of each place.
    fn values(
        &self,
        contrast: &Contrast,
        ends: &BTreeMap<Place, Ends<'_>>,
        matching: Matching,
        metric: Metric,
    ) -> BTreeMap<Place, Vec<f64>> {
        let budgets: BTreeSet<u32> = contrast.0.iter().map(|(cell, _)| cell.budget).collect();
        let reaches: BTreeMap<u32, Vec<Reach>> =
            budgets.into_iter().map(|budget| (budget, Reach::of_targets(self, budget))).collect();
        let value = |(&place, ends): (&Place, &Ends<'_>)| {
            let mut sums: Vec<f64> = Vec::new();
            for ((cell, weight), end) in contrast.0.iter().zip(ends) {
                let reach = &reaches[&cell.budget][place.0];
                let measured = reach.measured_by_view(matching, metric, cell.arm, end)?;
                if sums.is_empty() {
                    sums = vec![0.0; measured.len()];
                }
                if sums.len() != measured.len() {
                    return None;
                }
                sums.iter_mut().zip(measured).for_each(|(sum, value)| *sum += weight * value);
            }
            Some((place, sums))
        };
        ends.iter().filter_map(value).collect()
    }

    /// What the intervals of the study are over.
    pub(crate) fn pairing(&self) -> Pairing {
        let targets = self.plan.targets.len();
        match self.plan.study.is_of_scenes() {
            true if targets < FEWEST => Pairing::SeedsOfScenes,
            true => Pairing::Scenes,
            false if targets > 1 => Pairing::Images,
            false => Pairing::Seeds,
        }
    }

    /// The values in the clusters and strata of the pairing.
    fn strata(&self, values: &BTreeMap<Place, Vec<f64>>, pairing: Pairing) -> Strata {
        let of_target = |target: usize| values.range((target, 0)..=(target, u32::MAX)).map(|(_, values)| values);
        let targets = (0..self.plan.targets.len()).filter(|&target| of_target(target).next().is_some());
        // The mean over seeds, view by view.
        let over_seeds = |target: usize| {
            let views = of_target(target).map(Vec::len).min().unwrap_or(0);
            (0..views).map(|view| mean(of_target(target).map(|values| values[view]))).collect::<Vec<f64>>()
        };
        match pairing {
            Pairing::Images | Pairing::Scenes => {
                let clusters: Vec<_> = targets.map(over_seeds).collect();
                if clusters.is_empty() { Vec::new() } else { vec![clusters] }
            }
            Pairing::Seeds | Pairing::SeedsOfScenes => {
                targets.map(|target| of_target(target).cloned().collect()).collect()
            }
        }
    }

    /// A remark if there are fewer clusters than an interval needs.
    fn too_few(&self, strata: &Strata, pairing: Pairing) -> Option<ResultRemark> {
        let clusters = strata.iter().map(Vec::len).sum::<usize>();
        if pairing == Pairing::SeedsOfScenes {
            let scenes = self.plan.targets.len();
            let fewest = strata.iter().map(Vec::len).min().unwrap_or(0);
            // As many degrees of freedom as the fewest images have, from as few scenes as there are.
            let needed = FEWEST_SEEDS_OF_SCENE.max(1 + (FEWEST - 1).div_ceil(scenes));
            let is_enough = fewest >= FEWEST_SEEDS_OF_SCENE && freedom(strata) >= FEWEST - 1;
            return (!is_enough).then_some(ResultRemark::TooFewSeeds { seeds: fewest, scenes, needed });
        }
        (clusters < FEWEST).then_some(ResultRemark::TooFew { pairs: clusters, pairing })
    }

    /// Remarks about images, scenes or pairs that are missing because runs failed or were not done.
    fn gaps(&self, ends: &BTreeMap<Place, Ends<'_>>, pairing: Pairing) -> Vec<ResultRemark> {
        let targets = self.plan.targets.len();
        let found: BTreeSet<usize> = ends.keys().map(|place| place.0).collect();
        let missing = targets - found.len();
        let asked = targets * self.plan.study.seeds.len();
        match pairing {
            Pairing::Images if missing > 0 => vec![ResultRemark::ImagesMissing { missing, of: targets }],
            Pairing::Scenes | Pairing::SeedsOfScenes if missing > 0 => {
                vec![ResultRemark::ScenesMissing { missing, of: targets }]
            }
            _ if ends.len() < asked => vec![ResultRemark::Incomplete { pairs: ends.len(), of: asked }],
            _ => Vec::new(),
        }
    }

    /// A remark if two arms end with different counts at the same budget on some image or scene; it
    /// names the one with the largest difference. Counts are compared run by run, so that a surplus
    /// in one run does not balance a deficit in another.
    fn counts_differ(&self, contrast: &Contrast, ends: &BTreeMap<Place, Ends<'_>>) -> Option<ResultRemark> {
        let cells = &contrast.0;
        let pairs = (0..cells.len()).flat_map(|i| (i + 1..cells.len()).map(move |j| (i, j)));
        let comparable = pairs.filter(|&(i, j)| cells[i].0.budget == cells[j].0.budget);
        let places = comparable.flat_map(|pair| (0..self.plan.targets.len()).map(move |target| (pair, target)));
        let shares = places.map(|((i, j), target)| {
            let of_target = || ends.range((target, 0)..=(target, u32::MAX)).map(|(_, ends)| ends);
            let count = |index: usize| of_target().map(move |ends| f64::from(ends[index].gaussians));
            let (arm, against) = (mean(count(i)), mean(count(j)));
            let share = mean(count(i).zip(count(j)).map(|(a, b)| (a - b).abs())) / arm.max(against);
            (share, arm, against, target)
        });
        let largest = shares.filter(|found| found.0 > EQUAL_COUNT).max_by(|a, b| a.0.total_cmp(&b.0));
        let (_, arm, against, target) = largest?;
        let place = || format!("{} {}", self.plan.study.target_word(), self.plan.targets[target].label());
        Some(ResultRemark::CountsDiffer { arm, against, place: (self.plan.targets.len() > 1).then(place) })
    }

    /// A remark if the runs at a budget were not all timed under the same conditions.
    fn clocks_differ(&self, contrast: &Contrast) -> Option<ResultRemark> {
        let clock = |end: &Finished| match end.side_by_side {
            1 => end.backend.clone(),
            n => format!("{}, {n} side by side", end.backend),
        };
        let budgets: BTreeSet<u32> = contrast.0.iter().map(|(cell, _)| cell.budget).collect();
        let ends = budgets.into_iter().flat_map(|budget| self.all_finished(budget));
        let clocks: BTreeSet<String> = ends.map(|(_, end)| clock(end)).collect();
        (clocks.len() > 1).then(|| ResultRemark::ClocksDiffer { clocks: clocks.into_iter().collect() })
    }
}
