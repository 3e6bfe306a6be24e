//! Why a run ends with fewer Gaussians than its budget.

use std::fmt;

use gs_core::{Optimizer, counted, edit::EditCounts};
use gs_density::Policy;
use serde::{Deserialize, Serialize};

use super::{
    recovery::FreshStart,
    task::{LoopSettings, RunSettings, Trainable},
    trainer::Trainer,
};

/// Share of its budget below which a run has missed it.
const CLEARLY: f64 = 0.9;

/// A policy whose kind is not known.
const OWN: &str = "the custom policy";

/// A finished run's shortfall: it has less than nine tenths of the Gaussians of its budget, or fewer
/// than all where it should end with exactly as many.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Shortfall {
    /// Number of Gaussians of the scene.
    pub gaussians: u32,
    /// Largest number of Gaussians allowed.
    pub budget: u32,
    /// Why the policy did not reach the budget, in words.
    pub reason: String,
}

impl fmt::Display for Shortfall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { gaussians, budget, reason } = self;
        write!(f, "the run ends with {gaussians} Gaussians of {budget}: {reason}")
    }
}

impl<R: Optimizer<S>, S: Trainable> Trainer<'_, R, S> {
    /// Why the run ends with clearly fewer Gaussians than its settings allow, also under a policy of
    /// the caller's own ([`Trainer::controlled_by`]).
    ///
    /// `None` where the run is not finished or comes near its budget. `None` also where the budget
    /// is the default and the policy of the settings does not aim at it, such as that of 3DGS: it is
    /// then only a bound.
    pub fn shortfall(&self) -> Option<Shortfall> {
        let LoopSettings { budget, exactly, policy, .. } = self.settings().of_loop();
        let (gaussians, policy) = (self.count(), Some(policy).filter(|_| !self.has_custom_policy()));
        let least = if exactly { 1.0 } else { CLEARLY };
        let is_bound = policy.is_some() && self.settings().budget_is_bound();
        if !self.is_finished() || is_bound || f64::from(gaussians) >= least * f64::from(budget) {
            return None;
        }
        let actions = policy.filter(|_| !exactly).and_then(Policy::actions);
        let growth = Growth {
            policy: match policy {
                None => Some(OWN.to_owned()),
                Some(Policy::None) if !exactly => None,
                Some(policy) => Some(format!("policy `{}`", policy.name())),
            },
            first: (gaussians + self.edits().pruned()).saturating_sub(self.edits().added()),
            last: gaussians,
            rounds: self.rounds_of_scene(actions.map_or(1.0, |actions| actions.growth_fraction)),
            edits: *self.edits(),
        };
        let reason = match self.fresh_starts().last() {
            Some(FreshStart { step, .. }) => format!(
                "it restarted with its first {} after step {step}, and then {}",
                counted(growth.first, "Gaussian"),
                growth.reason()
            ),
            None => growth.reason(),
        };
        Some(Shortfall { gaussians, budget, reason })
    }
}

/// Growth of a scene in a run.
struct Growth {
    /// The policy in words; `None` for one that adds no Gaussians.
    policy: Option<String>,
    /// Number of Gaussians at the start, and at the end.
    first: u32,
    last: u32,
    /// Rounds of density control in which the number of Gaussians grows.
    rounds: u32,
    edits: EditCounts,
}

impl Growth {
    fn reason(&self) -> String {
        let Some(policy) = &self.policy else { return "policy `none` adds no Gaussians".to_owned() };
        if self.rounds == 0 {
            return "the run was too short for a round of density control".to_owned();
        }
        let Self { first, last, edits, .. } = self;
        let (added, rounds) = (edits.added(), counted(self.rounds, "round"));
        let pruned = match edits.pruned() {
            0 => String::new(),
            1 => "; 1 Gaussian was pruned".to_owned(),
            pruned => format!("; {} were pruned", counted(pruned, "Gaussian")),
        };
        if added == 0 || last <= first {
            let added = if added == 0 { "no Gaussians".to_owned() } else { counted(added, "Gaussian") };
            return format!("{policy} added {added} in {rounds}{pruned}");
        }
        let rate = (f64::from(*last) / f64::from((*first).max(1))).powf(1.0 / f64::from(self.rounds)) - 1.0;
        let percent = 100.0 * rate as f32;
        format!("{policy} turned the initial {first} into {last} in {rounds}, {percent:.1} % more in each{pruned}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_is_described_by_its_rate() {
        let own = |last, rounds, edits| {
            let policy = Some("policy `mcmc`".to_owned());
            Growth { policy, first: 200, last, rounds, edits }.reason()
        };
        let grown = EditCounts { split: 203, pruned_transparent: 2, ..EditCounts::default() };
        assert_eq!(
            own(401, 6, grown),
            "policy `mcmc` turned the initial 200 into 401 in 6 rounds, 12.3 % more in each; 2 Gaussians were \
             pruned"
        );
        assert_eq!(own(200, 6, EditCounts::default()), "policy `mcmc` added no Gaussians in 6 rounds");
        let shrunk = EditCounts { cloned: 1, pruned_too_large: 4, ..EditCounts::default() };
        assert_eq!(own(197, 1, shrunk), "policy `mcmc` added 1 Gaussian in 1 round; 4 Gaussians were pruned");
        assert_eq!(own(200, 0, EditCounts::default()), "the run was too short for a round of density control");
    }
}
