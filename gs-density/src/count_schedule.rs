//! Exact numbers of Gaussians: a schedule of counts that ends at the budget, for any policy.

use std::collections::BTreeSet;

use gs_core::{
    EditPlan, Error,
    edit::{PruneCause, Removal},
    sigmoid,
};

use crate::{
    observation::{DensityGaussian, DensityPolicy, DensityScene, Observation, Rng},
    policy::Policy,
    round::{Densify, Ranking, WhenFlat, scheduled_count},
};

/// Corrects the plans of a policy to the schedule of counts of Taming 3DGS, so that a run ends with
/// exactly as many Gaussians as its budget.
///
/// The scheduled count bounds the growth that the policy plans. If the policy adds too few
/// Gaussians, those with the highest densification statistic among the ones that it left alone grow
/// too. If too many Gaussians remain, those with the smallest product of opacity and largest scale
/// are removed. *Source:* a schedule of target counts for any policy is the idea of Smart Target
/// Point Control (arXiv 2605.16158).
#[derive(Debug, Clone, Copy, Default)]
pub struct CountSchedule {
    /// How Gaussians that the policy left alone are cloned or split.
    pub densify: Densify,
}

impl From<&Policy> for CountSchedule {
    /// Clones and splits with the policy's settings, or with the defaults of [`Densify`] for a
    /// policy that neither clones nor splits.
    fn from(policy: &Policy) -> Self {
        Self { densify: policy.actions().map(|actions| actions.densify).unwrap_or_default() }
    }
}

impl CountSchedule {
    /// The edits of `policy` in one round, corrected to the scheduled count.
    ///
    /// # Errors
    /// Those of the policy, and [`Error::Setting`] where a setting of [`Self::densify`] is outside
    /// its range.
    pub fn plan<S: DensityScene>(
        &self,
        policy: &dyn DensityPolicy<S>,
        observation: &Observation<'_, S>,
        rng: &mut Rng,
    ) -> Result<EditPlan<S::Gaussian>, Error> {
        self.densify.validate()?;
        let before = observation.scene.len();
        let wanted = scheduled_count(before, observation.budget, observation.progress_before, observation.progress);
        // A policy with a schedule of its own plans for the whole budget.
        let mut own = rng.clone();
        let mut plan = policy.plan(observation, &mut own)?;
        if plan.len_after(before) > wanted {
            plan = policy.plan(&Observation { budget: wanted, ..*observation }, rng)?;
        } else {
            *rng = own;
        }
        let planned = plan.len_after(before);
        if planned < wanted {
            self.grow(&mut plan, observation, wanted - planned, rng);
        } else {
            remove_least(&mut plan, observation, planned - wanted);
        }
        Ok(plan)
    }

    /// Adds up to `missing` Gaussians by growth of those that the plan leaves alone.
    fn grow<S: DensityScene>(
        &self,
        plan: &mut EditPlan<S::Gaussian>,
        observation: &Observation<'_, S>,
        missing: usize,
        rng: &mut Rng,
    ) {
        let left_alone = left_alone(plan, observation.scene.len());
        let has_signal = left_alone.iter().any(|&index| observation.statistics.mean_signal(index as usize) > 0.0);
        let score = |index: u32| match has_signal {
            true => observation.statistics.mean_signal(index as usize),
            false => importance(observation, index),
        };
        let ranking = Ranking::new(left_alone.iter().map(|&index| (index, score(index))), WhenFlat::Forced);
        let all = ranking.at_least(0.0);
        let mut chosen = all[..all.len().min(missing)].to_vec();
        chosen.sort_unstable();
        for index in chosen {
            let (change, birth) = self.densify.grow(index, observation, rng);
            plan.changed.extend(change);
            plan.added.push(birth);
        }
    }
}

/// Removes the `excess` least important Gaussians of those that the plan leaves alone.
fn remove_least<S: DensityScene>(plan: &mut EditPlan<S::Gaussian>, observation: &Observation<'_, S>, excess: usize) {
    if excess == 0 {
        return;
    }
    let mut ranked: Vec<(f32, u32)> = left_alone(plan, observation.scene.len())
        .into_iter()
        .map(|index| (importance(observation, index), index))
        .collect();
    ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    ranked.truncate(excess);
    plan.removed.extend(ranked.into_iter().map(|(_, index)| Removal { index, cause: PruneCause::Unimportant }));
    plan.removed.sort_unstable_by_key(|removal| removal.index);
}

/// The Gaussians that the plan neither removes nor changes, and that are no parent of an added one.
fn left_alone<G>(plan: &EditPlan<G>, count: usize) -> Vec<u32> {
    let touched: BTreeSet<u32> = (plan.removed.iter().map(|removal| removal.index))
        .chain(plan.changed.iter().map(|change| change.index))
        .chain(plan.added.iter().filter_map(|birth| birth.parent))
        .collect();
    (0..count as u32).filter(|index| !touched.contains(index)).collect()
}

/// Opacity times largest scale.
fn importance<S: DensityScene>(observation: &Observation<'_, S>, index: u32) -> f32 {
    let gaussian = observation.scene.gaussian(index as usize);
    sigmoid(observation.scene.opacity_logit(index as usize)) * gaussian.largest_scale()
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{DensityStatistics, Gaussian2d, Scene as _, Scene2d, logit};
    use rand::SeedableRng;

    use super::*;
    use crate::{observation::Signal, policy::Grow};

    /// Gaussians of these opacities, signals and scales (px).
    fn plan(policy: &Policy, gaussians: &[(f32, f32, f32)], budget: usize) -> EditPlan<Gaussian2d> {
        let scene: Scene2d = gaussians
            .iter()
            .map(|&(opacity, _, scale)| Gaussian2d {
                mean: Vec2::splat(16.0),
                log_scale: Vec2::splat(scale.ln()),
                rotation: 0.0,
                opacity_logit: logit(opacity),
                color: Vec3::ONE,
            })
            .collect();
        let statistics = DensityStatistics {
            signal_sum: gaussians.iter().map(|g| g.1).collect(),
            visible: vec![1; gaussians.len()],
        };
        let observation = Observation {
            scene: &scene,
            statistics: &statistics,
            residual: None,
            extent: 32.0,
            step: 99,
            evidence: None,
            progress: 1.0,
            progress_before: 0.5,
            budget,
        };
        let plan = CountSchedule::default().plan(policy, &observation, &mut Rng::seed_from_u64(1)).unwrap();
        plan.sources(scene.len()).unwrap();
        plan
    }

    fn threshold() -> Policy {
        Policy::Grow(Grow { threshold: 0.5, ..Grow::absolute(Signal::MeanGradient) })
    }

    #[test]
    fn the_next_by_statistic_grow_where_the_policy_grows_too_few() {
        let plan = plan(&threshold(), &[(0.5, 0.1, 1.0), (0.5, 0.9, 1.0), (0.5, 0.3, 1.0), (0.5, 0.2, 1.0)], 7);
        assert_eq!(plan.len_after(4), 7);
        let mut parents: Vec<_> = plan.added.iter().filter_map(|birth| birth.parent).collect();
        parents.sort_unstable();
        assert_eq!(parents, [1, 2, 3]);
    }

    #[test]
    fn the_least_important_go_where_too_many_are_left() {
        let gaussians = [(0.9, 0.9, 1.0), (0.2, 0.9, 1.0), (0.9, 0.9, 0.1), (0.8, 0.9, 1.0), (0.001, 0.9, 1.0)];
        let plan = plan(&threshold(), &gaussians, 2);
        assert_eq!(plan.len_after(5), 2);
        let removed: Vec<_> = plan.removed.iter().map(|removal| (removal.index, removal.cause)).collect();
        let unimportant = PruneCause::Unimportant;
        assert_eq!(removed, [(1, unimportant), (2, unimportant), (4, PruneCause::Transparent)]);
    }

    #[test]
    fn opacity_decides_without_a_statistic() {
        let plan = plan(&Policy::None, &[(0.2, 0.0, 1.0), (0.9, 0.0, 1.0), (0.5, 0.0, 1.0)], 4);
        assert_eq!(plan.added.iter().map(|birth| birth.parent).collect::<Vec<_>>(), [Some(1)]);
    }

    #[test]
    fn a_schedule_reaches_the_budget_whatever_is_pruned() {
        let mut count = 1_000;
        for round in 1..=10u16 {
            let at = |round: u16| f32::from(round) / 10.0;
            count = scheduled_count(count, 5_000, at(round - 1), at(round));
            if round < 10 {
                assert!(count < 5_000);
                count -= 50;
            }
        }
        assert_eq!(count, 5_000);
        assert_eq!(scheduled_count(100, 1_100, 0.0, 0.5), 850);
        assert_eq!(scheduled_count(850, 1_100, 0.5, 1.0), 1_100);
        assert_eq!(scheduled_count(500, 300, 0.5, 1.0), 300);
        assert_eq!(scheduled_count(7, 9, 1.0, 1.0), 9);
        assert_eq!(scheduled_count(7, 9, 0.5, f32::NAN), 7);
    }
}
