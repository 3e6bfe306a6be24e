//! A table of how a fit went: the numbers behind its curves of count, loss and quality.

use std::fmt::Write;

use gs_core::edit::EditCounts;
use serde::{Deserialize, Serialize};

use crate::{
    observer::{Control, Observer, Progress},
    settings::FitSettings,
};

/// One row of a [`MetricsLog`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct MetricsRow {
    /// Steps done.
    pub step: u32,
    /// Time spent fitting, s; see [`Progress::seconds`].
    pub seconds: f64,
    /// Gaussians after the step.
    pub count: u32,
    /// What density control did since the row before.
    #[serde(flatten)]
    pub edits: EditCounts,
    /// The loss before the step.
    pub loss: f32,
    /// Mean absolute difference from the target after the step, both clamped.
    pub l1: f64,
    /// PSNR after the step, both clamped, dB.
    pub psnr: f64,
}

/// An observer that keeps a row for the first step, every `every` steps, every round of density control, and the last step.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricsLog {
    every: u32,
    rows: Vec<MetricsRow>,
    edits: EditCounts,
}

impl MetricsLog {
    /// A log with a row every `every` steps, at least 1.
    pub fn new(every: u32) -> Self {
        Self { every: every.max(1), rows: Vec::new(), edits: EditCounts::default() }
    }

    /// A log with about a hundred rows, and those of density control.
    pub fn for_settings(settings: &FitSettings) -> Self {
        Self::new(settings.iterations / 100)
    }

    /// The rows so far.
    pub fn rows(&self) -> &[MetricsRow] {
        &self.rows
    }

    /// The table as comma-separated values, with a line of headings; a PSNR of equal images is `inf`.
    pub fn to_csv(&self) -> String {
        let mut csv = String::from(
            "step,seconds,count,cloned,split,seeded,pruned_transparent,pruned_too_large,pruned_not_finite,\
             pruned_unimportant,loss,l1,psnr\n",
        );
        for MetricsRow { step, seconds, count, edits: e, loss, l1, psnr } in &self.rows {
            let (cloned, split, seeded) = (e.cloned, e.split, e.seeded);
            let (transparent, too_large) = (e.pruned_transparent, e.pruned_too_large);
            let (not_finite, unimportant) = (e.pruned_not_finite, e.pruned_unimportant);
            let written = writeln!(
                csv,
                "{step},{seconds:.6},{count},{cloned},{split},{seeded},{transparent},{too_large},{not_finite},\
                 {unimportant},{loss},{l1:.7},{psnr:.4}"
            );
            debug_assert!(written.is_ok(), "a string can always be written to");
        }
        csv
    }

    fn is_due(&self, progress: &Progress) -> bool {
        progress.step == 1 || progress.step.is_multiple_of(self.every) || progress.edits.is_some() || progress.is_last()
    }
}

impl Observer for MetricsLog {
    fn on_edit(&mut self, _: &Progress, counts: &EditCounts) {
        self.edits.accumulate(counts);
    }

    fn wants_quality(&mut self, progress: &Progress) -> bool {
        self.is_due(progress)
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        if let Some(quality) = progress.quality.filter(|_| self.is_due(progress)) {
            self.rows.push(MetricsRow {
                step: progress.step,
                seconds: progress.seconds,
                count: progress.count,
                edits: std::mem::take(&mut self.edits),
                loss: progress.loss,
                l1: quality.l1,
                psnr: quality.psnr,
            });
        }
        Control::Continue
    }
}
