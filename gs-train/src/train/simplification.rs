//! Settings of pruning by contribution that have no effect.

use super::settings::TrainSettings;

impl TrainSettings {
    /// Why [`Actions::simplify`](gs_density::Actions::simplify) never runs, where no round of
    /// density control is at a step at which it is due. Its steps do not follow the length of the
    /// run.
    pub fn idle_simplification(&self) -> Option<String> {
        let simplify = self.policy.actions()?.simplify?;
        let is_round = |step: &u32| self.rounds.progress(*step, self.iterations).is_some();
        if (1..=self.iterations).filter(is_round).any(|step| simplify.is_due(step)) {
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

    use crate::train::presets::TrainPreset;

    #[test]
    fn a_simplification_after_the_last_round_is_reported() {
        let with = |preset: TrainPreset, iterations, simplify: Option<Simplify>| {
            let mut settings = preset.settings(Some(iterations));
            settings.policy.actions_mut().unwrap().simplify = simplify;
            settings.idle_simplification()
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
}
