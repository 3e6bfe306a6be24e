//! Why a run ends with fewer Gaussians than its budget.

use std::fmt;

use gs_core::{Optimizer, counted, edit::EditCounts};
use gs_density::{GrowthLimit, Policy, share_of};
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

/// Largest number of rounds that is suggested.
const MOST_ROUNDS: u32 = 10_000;

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
            policy,
            first: (gaussians + self.edits().pruned()).saturating_sub(self.edits().added()),
            last: gaussians,
            budget,
            rounds: self.rounds_of_scene(actions.map_or(1.0, |actions| actions.growth_fraction)),
            exactly,
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
struct Growth<'p> {
    /// `None` for a policy of the caller's own.
    policy: Option<&'p Policy>,
    /// Number of Gaussians at the start, and at the end.
    first: u32,
    last: u32,
    budget: u32,
    /// Rounds of density control in which the number of Gaussians grows.
    rounds: u32,
    /// Whether a schedule ends at exactly the budget.
    exactly: bool,
    edits: EditCounts,
}

impl Growth<'_> {
    fn reason(&self) -> String {
        let rounds = counted(self.rounds, "round");
        if self.policy == Some(&Policy::None) && !self.exactly {
            return "policy `none` adds no Gaussians".to_owned();
        }
        if self.rounds == 0 {
            return "the run was too short for a round of density control".to_owned();
        }
        let name = self.policy.map_or_else(|| OWN.to_owned(), |policy| format!("`{}`", policy.name()));
        if self.exactly {
            return self.by_schedule(&name);
        }
        let Some(policy) = self.policy else { return self.by_rate() };
        let GrowthLimit { percent, condition, either, .. } = policy.growth_limit();
        let condition = condition.map(|which| format!("{which}, and too few did in {rounds}"));
        let grown = match (percent, condition) {
            (Some(percent), Some(which)) if either => {
                format!("lets {percent} % of the Gaussians grow in a round, and besides those {which}")
            }
            (Some(percent), condition) => return self.by_share(&name, percent, condition),
            (None, Some(which)) => format!("lets only Gaussians grow {which}"),
            (None, None) => "adds none after its last round".to_owned(),
        };
        format!("policy {name} {grown}{}", self.pruned())
    }

    /// The reason for a policy of the caller's own, of which only its edits are known.
    fn by_rate(&self) -> String {
        let (added, pruned, rounds) = (self.edits.added(), self.pruned(), counted(self.rounds, "round"));
        if added == 0 || self.last <= self.first {
            let added = if added == 0 { "no Gaussians".to_owned() } else { counted(added, "Gaussian") };
            return format!("{OWN} added {added} in {rounds}{pruned}");
        }
        let rate = (f64::from(self.last) / f64::from(self.first.max(1))).powf(1.0 / f64::from(self.rounds)) - 1.0;
        let percent = 100.0 * rate as f32;
        let hint = self.hint(percent).map_or_else(String::new, |hint| format!("; at this rate {hint}"));
        let Self { first, last, .. } = self;
        format!("{OWN} turned the initial {first} into {last} in {rounds}, {percent:.1} % more in each{pruned}{hint}")
    }

    /// The reason for a run that should have ended at exactly the budget. In each of its rounds a
    /// Gaussian becomes at most two.
    fn by_schedule(&self, name: &str) -> String {
        let rounds = counted(self.rounds, "round");
        let most = f64::from(self.first) * 2f64.powi(self.rounds.min(64) as i32);
        if most < f64::from(self.budget) {
            let needed = (f64::from(self.budget) / f64::from(self.first.max(1))).log2().ceil();
            let first = self.first;
            return format!(
                "a Gaussian becomes at most two in a round, so that {rounds} of {name} can turn the initial {first} \
                 into {most}; the budget takes {needed} rounds"
            );
        }
        format!("it did not reach the end of its schedule in {rounds} of {name}{}", self.pruned())
    }

    /// The reason for a policy that lets a share of the Gaussians grow in each round, among those
    /// above a threshold if it has one.
    fn by_share(&self, name: &str, percent: f32, calling: Option<String>) -> String {
        let grows = format!("policy {name} adds at most {percent} % of the Gaussians in a round");
        let reached = (0..self.rounds).fold(self.first, |count, _| self.next(count, percent));
        if reached >= self.budget {
            let calling = calling.map_or_else(String::new, |calling| format!(", and only Gaussians {calling}"));
            return format!("{grows}{calling}{}", self.pruned());
        }
        let rounds = counted(self.rounds, "round");
        let hint = self.hint(percent).map_or_else(String::new, |hint| format!("; {hint}"));
        format!("{grows}, so that {rounds} can turn the initial {} into {reached}{hint}", self.first)
    }

    /// Number of Gaussians after a round with `count`.
    fn next(&self, count: u32, percent: f32) -> u32 {
        let added = share_of(count as usize, percent);
        count.saturating_add(u32::try_from(added).unwrap_or(u32::MAX)).min(self.budget)
    }

    /// Number of rounds, or of first Gaussians, that reach the budget, in words.
    fn hint(&self, percent: f32) -> Option<String> {
        let mut count = self.first;
        let needed = (1..=MOST_ROUNDS).find(|_| {
            count = self.next(count, percent);
            count >= self.budget
        })?;
        let factor = (1.0 + f64::from(percent) / 100.0).powf(f64::from(self.rounds));
        let first = (f64::from(self.budget) / factor).ceil();
        Some(format!("the budget takes {needed} rounds (more steps), or {first} initial Gaussians"))
    }

    fn pruned(&self) -> String {
        match self.edits.pruned() {
            0 => String::new(),
            1 => "; 1 Gaussian was pruned".to_owned(),
            pruned => format!("; {} were pruned", counted(pruned, "Gaussian")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn growth(policy: &Policy, first: u32, rounds: u32, edits: EditCounts) -> Growth<'_> {
        Growth { policy: Some(policy), first, last: first, budget: 1_000, rounds, exactly: false, edits }
    }

    fn reason(name: &str, first: u32, rounds: u32, edits: EditCounts) -> String {
        growth(&Policy::from_name(name).unwrap(), first, rounds, edits).reason()
    }

    #[test]
    fn slow_growth_of_a_policy_is_a_reason_for_a_shortfall() {
        let none = EditCounts::default();
        assert_eq!(
            reason("percentile", 80, 5, none),
            "policy `percentile` adds at most 10 % of the Gaussians in a round, so that 5 rounds can turn the initial 80 into 130; \
             the budget takes 27 rounds (more steps), or 621 initial Gaussians"
        );
        assert!(reason("mcmc", 57, 12, none).contains("12 rounds can turn the initial 57 into 109"));
        assert!(!reason("mcmc", 900, 12, none).contains("so that"), "growth is fast enough");
    }

    #[test]
    fn threshold_or_pruning_is_the_reason_where_growth_is_fast_enough() {
        let pruned = EditCounts { pruned_transparent: 7, cloned: 9, ..EditCounts::default() };
        assert_eq!(
            reason("absolute", 80, 5, pruned),
            "policy `absolute` lets only Gaussians grow whose mean gradient is at least 0.0002, and too few did in 5 rounds; \
             7 Gaussians were pruned"
        );
        assert!(reason("hybrid-error", 500, 9, EditCounts::default()).contains("pixel error is at least 0.00"));
        assert!(reason("mcmc", 900, 12, pruned).ends_with("7 Gaussians were pruned"));
        assert_eq!(reason("none", 80, 5, pruned), "policy `none` adds no Gaussians");
        assert_eq!(reason("paper", 20, 0, pruned), "the run was too short for a round of density control");
    }

    #[test]
    fn policies_with_evidence_say_which_gaussians_may_grow() {
        let pruned = EditCounts { pruned_transparent: 7, ..EditCounts::default() };
        assert_eq!(
            reason("fastgs", 80, 5, pruned),
            "policy `fastgs` lets only Gaussians grow whose absolute gradient is at least 0.0012 and that cover 6 pixels \
             of high error, and too few did in 5 rounds; 7 Gaussians were pruned"
        );
        for (name, which) in [
            ("taming", "whose mean gradient is at least 0.0002"),
            ("improved-gs", "that draw edges and whose absolute gradient is at least 0.0003"),
            ("steep-gs", "eigenvalue below -0.000001"),
            ("pixel-gs", "whose pixel-aware gradient is at least 0.0002"),
        ] {
            let reason = reason(name, 80, 5, pruned);
            assert!(
                reason.contains(&format!("`{name}` lets only Gaussians grow")) && reason.contains(which),
                "{reason}"
            );
        }
        let slow = reason("mrnf", 80, 5, pruned);
        assert!(slow.contains("at most 7 %") && slow.contains("5 rounds can turn the initial 80 into 115"), "{slow}");
        let few = reason("mrnf", 900, 12, pruned);
        assert!(few.contains("only Gaussians whose error in some view is at least 0.003 px"), "{few}");
    }

    #[test]
    fn growth_of_a_policy_of_the_callers_own_is_described_by_its_rate() {
        let own = |last, rounds, edits| {
            Growth { policy: None, first: 200, last, budget: 1_000, rounds, exactly: false, edits }.reason()
        };
        let grown = EditCounts { split: 203, pruned_transparent: 2, ..EditCounts::default() };
        assert_eq!(
            own(401, 6, grown),
            "the custom policy turned the initial 200 into 401 in 6 rounds, 12.3 % more in each; 2 Gaussians were \
             pruned; at this rate the budget takes 14 rounds (more steps), or 499 initial Gaussians"
        );
        assert_eq!(own(200, 6, EditCounts::default()), "the custom policy added no Gaussians in 6 rounds");
        let shrunk = EditCounts { cloned: 1, pruned_too_large: 4, ..EditCounts::default() };
        assert_eq!(own(197, 1, shrunk), "the custom policy added 1 Gaussian in 1 round; 4 Gaussians were pruned");
        assert_eq!(own(200, 0, EditCounts::default()), "the run was too short for a round of density control");
    }

    #[test]
    fn a_schedule_doubles_at_most() {
        let exactly = |name: &str, first, rounds| {
            let policy = Policy::from_name(name).unwrap();
            let growth = growth(&policy, first, rounds, EditCounts::default());
            Growth { exactly: true, ..growth }.reason()
        };
        assert_eq!(
            exactly("absolute", 100, 3),
            "a Gaussian becomes at most two in a round, so that 3 rounds of `absolute` can turn the initial 100 into 800; \
             the budget takes 4 rounds"
        );
        assert!(exactly("none", 100, 3).contains("`none` can turn the initial 100 into 800"));
        assert!(exactly("fastgs", 100, 9).starts_with("it did not reach the end of its schedule in 9 rounds"));
    }
}
