//! How far the arms of a study get on an image: the step and the second at which all of them are compared, and where a run is then.
//!
//! There is one such place for each image and budget, that of all arms of the study, so that whoever leads by a table's means is held
//! against the others by the same means. Times are an arm's, not a run's: the median over its runs. A run that the machine was slow for is
//! put on that clock and judged where the others are, instead of moving the place for everybody.

use crate::statistics::median;

use crate::{
    plan::Run,
    record::Finished,
    study::Matching,
    tables::{Metric, Results},
};

/// How far every arm gets on an image at a budget.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reach {
    /// Steps that the finished runs of all arms have done.
    steps: u32,
    /// The shortest of the arms' times, s.
    seconds: f64,
    /// Each arm's time, s; nothing where none of its runs has finished.
    arms: Vec<Option<f64>>,
}

impl Reach {
    /// That of each image of the study, in its order.
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

    /// An arm's time on the image, s.
    pub(crate) fn seconds_of(&self, arm: usize) -> Option<f64> {
        self.arms[arm]
    }

    /// What is measured of a run on the image where all arms are equal in this respect. At equal count that is its end.
    pub(crate) fn measured(&self, matching: Matching, metric: Metric, run: &Run, end: &Finished) -> Option<f64> {
        match matching {
            Matching::Count => metric.of(end),
            Matching::Iterations => end.psnr_after(self.steps),
            Matching::Time => self.psnr_within(self.seconds, run, end),
        }
    }

    /// PSNR of a run after so many seconds of its arm's clock, dB.
    pub(crate) fn psnr_within(&self, seconds: f64, run: &Run, end: &Finished) -> Option<f64> {
        let arm = self.seconds_of(run.arm)?;
        let own = if arm > 0.0 { seconds * end.seconds / arm } else { seconds };
        end.psnr_within(own)
    }
}
