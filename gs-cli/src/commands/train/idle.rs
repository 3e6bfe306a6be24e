//! A part of a policy that has no effect in a run.

use gs_density::Policy;
use gs_train::TrainSettings;

/// The part of the policy that never runs, because its steps do not follow the length of the
/// run, with the reason: the pruning of Improved-GS after opacity resets.
pub(super) fn idle_part(settings: &TrainSettings) -> Option<String> {
    let Policy::ImprovedGs(policy) = &settings.policy else { return None };
    let steps = policy.recovery_steps;
    let is_round = |step: u32| settings.rounds.progress(step, settings.iterations).is_some();
    // A reset is made in a round, too.
    let recovers = |step: u32| policy.recovers_after(step - 1) && is_round(step.saturating_sub(steps));
    if policy.recovery_percent == 0.0
        || policy.recovery_resets == 0
        || (1..=settings.iterations).any(|step| is_round(step) && recovers(step))
    {
        return None;
    }
    let reason = match policy.actions.reset.every {
        0 => "these settings reset no opacities".to_owned(),
        every => format!("opacities are reset every {every} steps, and no round is {steps} steps after a reset"),
    };
    Some(format!(
        "Improved-GS prunes nothing {steps} steps after opacity resets: {reason}; it takes multiples of the {} steps \
         from round to round for policy.actions.reset.every and policy.recovery-steps",
        settings.rounds.every
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs_train::TrainPreset;

    #[test]
    fn pruning_after_resets_is_reported_where_there_are_none() {
        let with = |preset: TrainPreset, iterations| {
            let policy = Policy::from_name("improved-gs").unwrap();
            idle_part(&preset.settings(Some(iterations)).with_policy(policy)).unwrap_or_default()
        };
        assert!(with(TrainPreset::Standard, 4_000).contains("these settings reset no opacities"));
        assert_eq!(with(TrainPreset::ThreeDgs, 7_000), "");
        assert!(with(TrainPreset::Quick, 2_000).contains("reset every 3000 steps, and no round is 300 steps after"));
        let mut settings =
            TrainPreset::Standard.settings(Some(2_000)).with_policy(Policy::from_name("improved-gs").unwrap());
        // Rounds are 66 steps apart: after step 660 there is one, after step 360 there is no reset.
        settings.policy.actions_mut().unwrap().reset.every = 360;
        assert!(idle_part(&settings).unwrap().contains("multiples of the 66 steps"), "{:?}", idle_part(&settings));
        let Policy::ImprovedGs(policy) = &mut settings.policy else { panic!("it is improved-gs") };
        (policy.actions.reset.every, policy.recovery_steps) = (660, 132);
        assert_eq!(idle_part(&settings), None);
    }
}
