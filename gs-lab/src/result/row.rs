//! Rows of a study's tables, as they are stored in `results.json`.

use serde::Serialize;

use crate::{
    run::{Record, RunOutcome},
    study::{Plan, Run},
};

/// One run in `runs.csv` and `results.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Row {
    pub(crate) row: usize,
    pub(crate) arm: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) image: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) data_set: Option<String>,
    pub(crate) budget: u32,
    pub(crate) seed: u32,
    pub(crate) address: String,
    pub(crate) status: String,
    pub(crate) gaussians: Option<u32>,
    pub(crate) bytes: Option<u64>,
    pub(crate) iterations: Option<u32>,
    pub(crate) psnr: Option<f64>,
    pub(crate) ssim: Option<f64>,
    pub(crate) ms_ssim: Option<f64>,
    pub(crate) l1: Option<f64>,
    pub(crate) scene: Option<String>,
    pub(crate) error: Option<String>,
}

impl Row {
    /// The row of a run with its record.
    pub(crate) fn new(plan: &Plan, run: &Run, record: Option<&Record>) -> Self {
        let end = record.and_then(|record| record.outcome.finished());
        let (status, error) = match record.map(|record| &record.outcome) {
            Some(RunOutcome::Finished(_)) => ("finished", None),
            Some(RunOutcome::Failed { error }) => ("failed", Some(error.clone())),
            None => ("missing", None),
        };
        let target = Some(plan.target(run).name.clone());
        let (image, data_set) = if plan.study.is_of_scenes() { (None, target) } else { (target, None) };
        Self {
            row: run.row,
            arm: plan.arm(run).name.clone(),
            image,
            data_set,
            budget: run.budget,
            seed: run.seed,
            address: run.address.clone(),
            status: status.to_owned(),
            gaussians: end.map(|end| end.gaussians),
            bytes: end.map(|end| end.bytes),
            iterations: end.map(|end| end.iterations),
            psnr: end.map(|end| end.psnr),
            ssim: end.map(|end| end.ssim),
            ms_ssim: end.and_then(|end| end.ms_ssim),
            l1: end.map(|end| end.l1),
            scene: end.map(|end| end.scene.clone()),
            error,
        }
    }
}
