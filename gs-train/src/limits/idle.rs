//! Parts of policies that have no effect in a run.

use gs_density::Policy;

use crate::train::TrainSettings;

impl TrainSettings {
    /// The parts of the policy that never run, because their steps do not follow the length of the
    /// run, each with the reason: [`Actions::simplify`](gs_density::Actions::simplify), and the
    /// pruning of Improved-GS after opacity resets.
    pub fn idle_parts(&self) -> Vec<String> {
        self.idle_simplification().into_iter().chain(self.idle_recovery()).collect()
    }

    /// Whether some round of density control is after a step, counted from 1, for which this holds.
    fn any_round(&self, holds: impl Fn(u32) -> bool) -> bool {
        (1..=self.iterations).any(|step| self.rounds.progress(step, self.iterations).is_some() && holds(step))
    }

    fn idle_recovery(&self) -> Option<String> {
        let Policy::ImprovedGs(policy) = &self.policy else { return None };
        let steps = policy.recovery_steps;
        let is_round = |step: u32| self.rounds.progress(step, self.iterations).is_some();
        // A reset is made in a round, too.
        let recovers = |step: u32| policy.recovers_after(step - 1) && is_round(step.saturating_sub(steps));
        if policy.recovery_percent == 0.0 || policy.recovery_resets == 0 || self.any_round(recovers) {
            return None;
        }
        let reason = match policy.actions.reset.every {
            0 => "these settings reset no opacities".to_owned(),
            every => format!("opacities are reset every {every} steps, and no round is {steps} steps after a reset"),
        };
        Some(format!(
            "Improved-GS prunes nothing {steps} steps after opacity resets: {reason}; it takes multiples of the {} steps \
             from round to round for policy.actions.reset.every and policy.recovery-steps",
            self.rounds.every
        ))
    }

    fn idle_simplification(&self) -> Option<String> {
        let simplify = self.policy.actions()?.simplify?;
        if self.any_round(|step| simplify.is_due(step)) {
            return None;
        }
        let (every, from) = (simplify.every, simplify.from);
        let rounds = match self.rounds.last(self.iterations) {
            0 => "the run has no rounds of density control".to_owned(),
            last => format!("the last round of density control is after step {last}"),
        };
        Some(format!(
            "actions.simplify never runs: it is due every {every} steps from step {from}, but {rounds}; lower `from` and \
             `every`, or take more steps"
        ))
    }
}

#[cfg(test)]
mod tests {
    use gs_density::Simplify;

    use super::*;
    use crate::train::TrainPreset;

    #[test]
    fn a_simplification_after_the_last_round_is_reported() {
        let with = |preset: TrainPreset, iterations, simplify: Option<Simplify>| {
            let mut settings = preset.settings(Some(iterations));
            settings.policy.actions_mut().unwrap().simplify = simplify;
            settings.idle_parts().pop()
        };
        let speedy = Some(Simplify::speedy_splat());
        let message = with(TrainPreset::Standard, 4_000, speedy).unwrap();
        assert!(
            message.contains("every 3000 steps from step 6000") && message.contains("after step 2600"),
            "{message}"
        );
        assert_eq!(with(TrainPreset::ThreeDgs, 7_000, speedy), None);
        assert_eq!(with(TrainPreset::Standard, 4_000, None), None);
        let early = Simplify::speedy_splat().with(|s| (s.every, s.from) = (500, 500));
        assert_eq!(with(TrainPreset::Standard, 4_000, Some(early)), None);
        let odd = early.with(|s| s.every = 7_777);
        assert!(with(TrainPreset::Standard, 4_000, Some(odd)).is_some());
        assert!(with(TrainPreset::Standard, 0, speedy).unwrap().contains("no rounds"));
    }

    #[test]
    fn pruning_after_resets_is_reported_where_there_are_none() {
        let with = |preset: TrainPreset, iterations| {
            let policy = Policy::from_name("improved-gs").unwrap();
            preset.settings(Some(iterations)).with_policy(policy).idle_parts().join("; ")
        };
        assert!(with(TrainPreset::Standard, 4_000).contains("these settings reset no opacities"));
        assert_eq!(with(TrainPreset::ThreeDgs, 7_000), "");
        assert!(with(TrainPreset::Quick, 2_000).contains("reset every 3000 steps, and no round is 300 steps after"));
        let mut settings =
            TrainPreset::Standard.settings(Some(2_000)).with_policy(Policy::from_name("improved-gs").unwrap());
        // Rounds are 66 steps apart: after step 660 there is one, after step 360 there is no reset.
        settings.policy.actions_mut().unwrap().reset.every = 360;
        assert!(settings.idle_parts()[0].contains("multiples of the 66 steps"), "{:?}", settings.idle_parts());
        let Policy::ImprovedGs(policy) = &mut settings.policy else { panic!("it is improved-gs") };
        (policy.actions.reset.every, policy.recovery_steps) = (660, 132);
        assert!(settings.idle_parts().is_empty());
    }
}
