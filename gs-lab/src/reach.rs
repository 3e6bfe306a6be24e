//! The step and the time at which the arms of a study are compared on an image.
//!
//! Each image and budget has one such step and one such time for all arms, so that tables, rankings
//! and verdicts use the same numbers. Times belong to arms, not to runs: an arm's time is the
//! median over its runs. A run that was slowed down by other programs is rescaled to that time,
//! instead of changing the comparison for all arms.

use crate::statistics::median;

use crate::{
    plan::Run,
    record::Finished,
    study::Matching,
    tables::{Metric, Results},
};

/// The common step and time of all arms on an image at a budget.
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
    /// Returns a value for each image of the study, in its order.
    pub(crate) fn of_images(results: &Results<'_>, budget: u32) -> Vec<Self> {
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

    /// Time of an arm on the image, s.
    pub(crate) fn seconds_of(&self, arm: usize) -> Option<f64> {
        self.arms[arm]
    }

    /// The metric of a run at the point where all arms are equal in count, iterations or time. At
    /// equal count that is the end of the run.
    pub(crate) fn measured(&self, matching: Matching, metric: Metric, run: &Run, end: &Finished) -> Option<f64> {
        match matching {
            Matching::Count => metric.of(end),
            Matching::Iterations => end.psnr_after(self.steps),
            Matching::Time => self.psnr_within(self.seconds, run, end),
        }
    }

    /// PSNR of a run after `seconds` of its arm's time, dB.
    pub(crate) fn psnr_within(&self, seconds: f64, run: &Run, end: &Finished) -> Option<f64> {
        let arm = self.seconds_of(run.arm)?;
        let own = if arm > 0.0 { seconds * end.seconds / arm } else { seconds };
        end.psnr_within(own)
    }
}
