//! The results of a study: its runs with their records, and the quality of each arm at each budget.

use super::statistics::{mean, variance};
use rayon::prelude::*;

use crate::{
    error::Error,
    run::{Finished, Record, RunOutcome, StudyFolder, ViewResult},
    study::{Plan, Run},
};

/// The results of a study.
#[derive(Debug, Clone)]
pub struct Results<'a> {
    /// The plan of the study.
    pub plan: &'a Plan,
    /// The record of each run, in the plan's order; `None` where the run was not done yet. Records
    /// that [`Results::read`] has read lack the settings, which are also those of the plan's run.
    pub(crate) records: Vec<Option<Record>>,
}

gs_core::choices! {
    /// A quality metric, measured at the end of a run. More is better.
    pub(crate) enum Metric {
        /// Peak signal-to-noise ratio, dB.
        Psnr = "psnr",
        /// Structural similarity, 0 to 1.
        Ssim = "ssim",
        /// Multi-scale structural similarity, 0 to 1; not for images below 161 px.
        MsSsim = "ms-ssim",
    }
}

impl Metric {
    pub(crate) fn of_view(self, view: &ViewResult) -> Option<f64> {
        match self {
            Self::Psnr => Some(view.psnr),
            Self::Ssim => Some(view.ssim),
            Self::MsSsim => view.ms_ssim,
        }
    }

    pub(crate) fn of(self, run: &Finished) -> Option<f64> {
        match self {
            Self::Psnr => Some(run.psnr),
            Self::Ssim => Some(run.ssim),
            Self::MsSsim => run.ms_ssim,
        }
    }
}

/// The mean over images or scenes of means over seeds, and the standard deviation over seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spread {
    /// The mean.
    pub(crate) mean: f64,
    /// Standard deviation over seeds, pooled over images or scenes; nothing for a single seed.
    pub(crate) over_seeds: Option<f64>,
}

/// The quality of an arm at a budget.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub(crate) struct RunQuality {
    /// The arm's name.
    pub(crate) arm: String,
    /// The largest number of Gaussians allowed.
    pub(crate) budget: u32,
    /// Runs that did all their steps.
    pub(crate) finished: usize,
    /// Runs that failed.
    pub(crate) failed: usize,
    /// Runs that were not done yet.
    pub(crate) missing: usize,
    /// Images or scenes with finished runs. The means are over these only.
    pub(crate) images: usize,
    /// Gaussians at the end.
    pub(crate) gaussians: Option<Spread>,
    /// Bytes of their parameters.
    pub(crate) bytes: Option<Spread>,
    /// PSNR, dB.
    pub(crate) psnr: Option<Spread>,
    /// SSIM, 0 to 1.
    pub(crate) ssim: Option<Spread>,
    /// MS-SSIM, 0 to 1.
    pub(crate) ms_ssim: Option<Spread>,
}

impl<'a> Results<'a> {
    /// Reads the records of a plan's runs.
    ///
    /// # Errors
    /// [`Error::Jobs`] where one is there but cannot be read.
    pub fn read(plan: &'a Plan, folder: &StudyFolder) -> Result<Self, Error> {
        let record = |run: &Run| {
            let record = folder.record(run)?;
            Ok(record.map(|record| Record { settings: String::new(), ..record }))
        };
        let records: Result<_, Error> = plan.runs.par_iter().map(record).collect();
        Ok(Self { plan, records: records? })
    }

    /// The runs with their records, in the plan's order.
    pub(crate) fn rows(&self) -> impl Iterator<Item = (&'a Run, Option<&Record>)> {
        self.plan.runs.iter().zip(self.records.iter().map(Option::as_ref))
    }

    /// These runs, by their indices, with their records.
    fn rows_at(&self, indices: impl Iterator<Item = usize>) -> impl Iterator<Item = (&'a Run, Option<&Record>)> {
        indices.map(|index| (&self.plan.runs[index], self.records[index].as_ref()))
    }

    /// The finished runs of all arms at a budget.
    pub(crate) fn all_finished(&self, budget: u32) -> impl Iterator<Item = (&'a Run, &Finished)> {
        let rows = self.rows_at(self.plan.at_budget(budget));
        rows.filter_map(|(run, record)| Some((run, record?.outcome.finished()?)))
    }

    /// The finished runs of an arm at a budget.
    pub(crate) fn finished(&self, arm: usize, budget: u32) -> impl Iterator<Item = (&'a Run, &Finished)> {
        let rows = self.rows_at(self.plan.of_arm(arm, budget));
        rows.filter_map(|(run, record)| Some((run, record?.outcome.finished()?)))
    }

    /// The runs without a record that could be read, in the plan's order.
    pub fn missing(&self) -> impl Iterator<Item = &'a Run> {
        self.rows().filter(|(_, record)| record.is_none()).map(|(run, _)| run)
    }

    /// Why runs failed, in the plan's order.
    pub fn failures(&self) -> Vec<&str> {
        let failed = self.records.iter().flatten().filter_map(|record| match &record.outcome {
            RunOutcome::Failed { error } => Some(error.as_str()),
            RunOutcome::Finished(_) => None,
        });
        failed.collect()
    }

    /// The quality of every arm at every budget.
    pub(crate) fn qualities(&self) -> Vec<RunQuality> {
        let budgets = &self.plan.study.budgets;
        budgets
            .iter()
            .flat_map(|&budget| (0..self.plan.study.arms.len()).map(move |arm| (arm, budget)))
            .map(|(arm, budget)| self.quality(arm, budget))
            .collect()
    }

    fn quality(&self, arm: usize, budget: u32) -> RunQuality {
        let of_arm = || self.rows_at(self.plan.of_arm(arm, budget));
        let failed =
            of_arm().filter(|(_, r)| r.is_some_and(|r| matches!(r.outcome, RunOutcome::Failed { .. }))).count();
        let targets = 0..self.plan.targets.len();
        let has_runs = |target: &usize| self.finished(arm, budget).any(|(run, _)| run.target == *target);
        RunQuality {
            arm: self.plan.study.arms[arm].name.clone(),
            budget,
            finished: self.finished(arm, budget).count(),
            failed,
            missing: of_arm().filter(|(_, record)| record.is_none()).count(),
            images: targets.filter(has_runs).count(),
            gaussians: self.spread(arm, budget, |run| Some(f64::from(run.gaussians))),
            bytes: self.spread(arm, budget, |run| Some(run.bytes as f64)),
            psnr: self.spread(arm, budget, |run| Metric::Psnr.of(run)),
            ssim: self.spread(arm, budget, |run| Metric::Ssim.of(run)),
            ms_ssim: self.spread(arm, budget, |run| Metric::MsSsim.of(run)),
        }
    }

    /// Mean and standard deviation of a number over the runs of an arm at a budget.
    pub(crate) fn spread(&self, arm: usize, budget: u32, of: impl Fn(&Finished) -> Option<f64>) -> Option<Spread> {
        let images: Vec<Vec<f64>> = (0..self.plan.targets.len())
            .map(|target| {
                let of_target = self.finished(arm, budget).filter(|(run, _)| run.target == target);
                of_target.filter_map(|(_, run)| of(run)).collect::<Vec<f64>>()
            })
            .filter(|values| !values.is_empty())
            .collect();
        let means: Vec<f64> = images.iter().map(mean).collect();
        let variances: Vec<f64> = images.iter().filter_map(|values| variance(values)).collect();
        let over_seeds = (!variances.is_empty()).then(|| mean(&variances).sqrt());
        (!means.is_empty()).then(|| Spread { mean: mean(&means), over_seeds })
    }

    /// Whether any run has this metric.
    pub(crate) fn is_measured(&self, metric: Metric) -> bool {
        let mut finished = self.records.iter().flatten().filter_map(|record| record.outcome.finished());
        finished.any(|run| metric.of(run).is_some())
    }
}
