//! The step and the time at which the arms of a study are compared on an image or a scene.
//!
//! Each image (or scene) and budget has one such step and one such time for all arms, so that tables, rankings
//! and verdicts use the same numbers. Times belong to arms, not to runs: an arm's time is the
//! median over its runs. A run that was slowed down by other programs is rescaled to that time,
//! instead of changing the comparison for all arms.

use super::statistics::median;

use super::tables::{Metric, Results};
use crate::{
    run::{Finished, ViewResult},
    study::Matching,
};

/// The common step and time of all arms on an image or a scene at a budget.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reach {
    /// Number of steps that the finished runs of all arms have reached.
    steps: u32,
    /// The shortest of the arms' times, s.
    seconds: f64,
    /// Time of each arm, s; `None` for an arm without a finished run.
    arms: Vec<Option<f64>>,
}

impl Reach {
    /// Returns a value for each image or scene of the study, in its order.
    pub(crate) fn of_targets(results: &Results<'_>, budget: u32) -> Vec<Self> {
        let plan = results.plan;
        let arms = plan.study.arms.len();
        let mut seconds = vec![vec![Vec::new(); arms]; plan.targets.len()];
        let mut steps = vec![u32::MAX; plan.targets.len()];
        for (run, end) in results.all_finished(budget) {
            seconds[run.target][run.arm].push(end.seconds);
            steps[run.target] = steps[run.target].min(end.iterations);
        }
        let of_image = |(of_arms, steps): (Vec<Vec<f64>>, u32)| {
            let arms: Vec<Option<f64>> =
                of_arms.iter().map(|seconds| (!seconds.is_empty()).then(|| median(seconds))).collect();
            Self { steps, seconds: arms.iter().flatten().copied().fold(f64::INFINITY, f64::min), arms }
        };
        seconds.into_iter().zip(steps).map(of_image).collect()
    }

    /// Time of an arm, s.
    pub(crate) fn seconds_of(&self, arm: usize) -> Option<f64> {
        self.arms[arm]
    }

    /// The metric of an arm's run at the point where all arms are equal in count, iterations or time. At
    /// equal count that is the end of the run.
    pub(crate) fn measured(&self, matching: Matching, metric: Metric, arm: usize, end: &Finished) -> Option<f64> {
        match matching {
            Matching::Count => metric.of(end),
            Matching::Iterations => end.psnr_after(self.steps, None),
            Matching::Time => self.psnr_within(self.seconds, arm, end, None),
        }
    }

    /// [`Self::measured`] of each held-out view, or of the one image.
    pub(crate) fn measured_by_view(
        &self,
        matching: Matching,
        metric: Metric,
        arm: usize,
        end: &Finished,
    ) -> Option<Vec<f64>> {
        if end.views.is_empty() {
            return Some(vec![self.measured(matching, metric, arm, end)?]);
        }
        let of_view = |(index, view): (usize, &ViewResult)| match matching {
            Matching::Count => metric.of_view(view),
            Matching::Iterations => end.psnr_after(self.steps, Some(index)),
            Matching::Time => self.psnr_within(self.seconds, arm, end, Some(index)),
        };
        end.views.iter().enumerate().map(of_view).collect()
    }

    /// PSNR of an arm's run after `seconds` of the arm's time, dB; of one view, if asked.
    pub(crate) fn psnr_within(&self, seconds: f64, arm: usize, end: &Finished, view: Option<usize>) -> Option<f64> {
        end.psnr_within(self.own_seconds(seconds, arm, end)?, view)
    }

    /// The count of an arm's run after `seconds` of the arm's time.
    pub(crate) fn count_within(&self, seconds: f64, arm: usize, end: &Finished) -> Option<f64> {
        end.count_at(self.own_seconds(seconds, arm, end)?, |row| row.seconds)
    }

    /// The time of a run at `seconds` of its arm's time, s.
    fn own_seconds(&self, seconds: f64, arm: usize, end: &Finished) -> Option<f64> {
        let of_arm = self.seconds_of(arm)?;
        Some(if of_arm > 0.0 { seconds * end.seconds / of_arm } else { seconds })
    }
}
