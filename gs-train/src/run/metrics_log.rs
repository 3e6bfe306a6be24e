//! The table of a run's metrics: the numbers behind its curves of count, loss and quality.

use std::collections::{BTreeMap, VecDeque};

use gs_core::{Culled, SavedState, edit::EditCounts};
use gs_io::Checkpoint;
use serde::{Deserialize, Serialize};

use super::{
    checkpoint::{step_of, table, to_table},
    clamped::Clamped,
    observer::{Control, Observer, Progress},
    recovery::FreshStart,
};
use crate::error::Error;

/// Key of the table in a checkpoint's metadata.
const KEY: &str = "metrics";

/// Largest number of rows in a checkpoint, the last ones; a file's metadata must stay small.
const MOST_KEPT_ROWS: usize = 20_000;

const HEADINGS: &str = "step,seconds,count,cloned,split,seeded,pruned_transparent,pruned_too_large,pruned_not_finite,\
                        pruned_unimportant,loss,l1,psnr,culled_not_finite,culled_near,culled_degenerate,culled_transparent,\
                        culled_outside,clamped_smallest,clamped_largest,began_again_at_loss,first_loss";

/// A row of a [`MetricsLog`]. Exhaustive: tables have a column for each field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct MetricsRow {
    /// Steps done.
    pub step: u32,
    /// Training time, s; see [`Progress::seconds`].
    pub seconds: f64,
    /// Number of Gaussians after the step.
    pub count: u32,
    /// Edits of density control since the previous row.
    #[serde(flatten)]
    pub edits: EditCounts,
    /// Loss before the step.
    pub loss: f32,
    /// Mean absolute difference of the 8-bit rendering from the target after the step, where it was
    /// measured.
    pub l1: Option<f64>,
    /// PSNR of the 8-bit rendering after the step, dB, where it was measured.
    pub psnr: Option<f64>,
    /// Gaussians that the measured renderings left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub culled: Option<Culled>,
    /// Gaussians with a scale at a bound, where it was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clamped: Option<Clamped>,
    /// Restart of the run after the step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fresh_start: Option<FreshStart>,
}

/// An observer that keeps a table of metrics.
///
/// It has a row for the first step, every `every` steps, every round of density control, every
/// restart, and the last step. A checkpoint holds its rows with all their digits, so that the log of
/// a resumed run continues them: [`MetricsLog::resumed`].
#[derive(Debug, Clone, PartialEq)]
pub struct MetricsLog {
    every: u32,
    measured_every: u32,
    rows: Vec<MetricsRow>,
    /// Rows whose loss has not arrived.
    awaiting: VecDeque<MetricsRow>,
}

impl MetricsLog {
    /// A log with a row every `every` steps, at least 1, and the quality in each row, which costs a
    /// rendering.
    pub fn new(every: u32) -> Self {
        let (rows, awaiting) = (Vec::new(), VecDeque::new());
        Self { every: every.max(1), measured_every: 1, rows, awaiting }
    }

    /// A log with about a hundred rows and those of density control, for a run of this many steps.
    ///
    /// The quality is measured in about twenty rows: after the first step, every twentieth of all
    /// steps, and the last.
    pub fn for_steps(iterations: u32) -> Self {
        let log = Self::new(iterations / 100);
        Self { measured_every: 5 * log.every, ..log }
    }

    /// Returns this log with the quality in at most this many rows, or a few more: after the first
    /// step, at equal distances, and after the last.
    #[must_use]
    pub fn measured_at_most(self, times: u32, iterations: u32) -> Self {
        let distance = iterations.div_ceil(times.max(1)).next_multiple_of(self.every);
        Self { measured_every: self.measured_every.max(distance), ..self }
    }

    /// The log of a run that is resumed from a checkpoint with this metadata: the intervals of this
    /// log, and the rows of the checkpoint, if it has any.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where the rows cannot be those of its run.
    pub fn resumed(self, metadata: &BTreeMap<String, String>) -> Result<Self, Error> {
        let Kept { row: rows } = if metadata.contains_key(KEY) { table(metadata, KEY)? } else { Kept::default() };
        let last_step = step_of(metadata)?;
        let is_in_order = rows.is_sorted_by(|before, row| before.step < row.step);
        match rows.last() {
            Some(last) if !is_in_order || last.step > last_step => {
                Err(Error::Checkpoint(format!("the rows of its `{KEY}` are not those of a run at step {last_step}")))
            }
            _ => Ok(Self { rows, ..self }),
        }
    }

    /// The rows whose loss has arrived.
    pub fn rows(&self) -> &[MetricsRow] {
        &self.rows
    }

    /// The table as comma-separated values with a line of headings. The PSNR of equal images is
    /// `inf`; a quality that was not measured is an empty cell.
    pub fn to_csv(&self) -> String {
        format!("{HEADINGS}\n{}", self.csv_from(0))
    }

    /// The lines of [`Self::to_csv`] from row `first` on, without headings, to append to a table
    /// with the earlier rows.
    pub fn csv_from(&self, first: usize) -> String {
        self.rows.iter().skip(first).map(line).collect()
    }

    fn is_due(&self, progress: &Progress) -> bool {
        let regular = progress.step == 1 || progress.step.is_multiple_of(self.every) || progress.is_last();
        regular || progress.edits.is_some() || progress.fresh_start.is_some()
    }

    fn is_measured(&self, progress: &Progress) -> bool {
        let regular = progress.step == 1 || progress.step.is_multiple_of(self.measured_every) || progress.is_last();
        regular && self.is_due(progress)
    }
}

/// The rows in a checkpoint.
#[derive(Default, Serialize, Deserialize)]
struct Kept {
    row: Vec<MetricsRow>,
}

/// A row with its line break.
fn line(row: &MetricsRow) -> String {
    let MetricsRow { step, seconds, count, edits: e, loss, l1, psnr, culled, clamped, fresh_start } = row;
    let (cloned, split, seeded) = (e.cloned, e.split, e.seeded);
    let (transparent, too_large) = (e.pruned_transparent, e.pruned_too_large);
    let (not_finite, unimportant) = (e.pruned_not_finite, e.pruned_unimportant);
    let l1 = l1.map_or_else(String::new, |l1| format!("{l1:.7}"));
    let psnr = psnr.map_or_else(String::new, |psnr| format!("{psnr:.4}"));
    let culled = culled.map_or_else(
        || ",,,,".to_owned(),
        |Culled { not_finite, near, degenerate, transparent, outside }| {
            format!("{not_finite},{near},{degenerate},{transparent},{outside}")
        },
    );
    let clamped =
        clamped.map_or_else(|| ",".to_owned(), |Clamped { smallest, largest }| format!("{smallest},{largest}"));
    let began_again = fresh_start.map_or_else(|| ",".to_owned(), |start| format!("{},{}", start.loss, start.first));
    format!(
        "{step},{seconds:.6},{count},{cloned},{split},{seeded},{transparent},{too_large},{not_finite},{unimportant},\
         {loss},{l1},{psnr},{culled},{clamped},{began_again}\n"
    )
}

impl Observer for MetricsLog {
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        self.is_measured(progress)
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        if self.is_due(progress) {
            // A quality that another observer requested is left out, so that the table does not
            // depend on other observers.
            let quality = progress.quality.as_ref().filter(|_| self.is_measured(progress));
            self.awaiting.push_back(MetricsRow {
                step: progress.step,
                seconds: progress.seconds,
                count: progress.count,
                edits: progress.edits.unwrap_or_default(),
                loss: progress.loss,
                l1: quality.map(|q| q.l1),
                psnr: quality.map(|q| q.psnr),
                culled: quality.map(|q| q.culled),
                clamped: quality.map(|q| q.clamped),
                fresh_start: progress.fresh_start,
            });
        }
        Control::Continue
    }

    fn on_losses(&mut self, first_step: u32, losses: &[f32]) {
        let of = |step: u32| losses.get(step.checked_sub(first_step)? as usize).copied();
        while let Some((&row, loss)) = self.awaiting.front().and_then(|row| Some((row, of(row.step)?))) {
            self.rows.push(MetricsRow { loss, ..row });
            self.awaiting.pop_front();
        }
    }

    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        let kept = &self.rows[self.rows.len().saturating_sub(MOST_KEPT_ROWS)..];
        checkpoint.metadata.insert(KEY.to_owned(), to_table(KEY, &Kept { row: kept.to_vec() })?);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(step: u32) -> MetricsRow {
        let edits = EditCounts { seeded: 7 * step, pruned_unimportant: step, ..EditCounts::default() };
        let (seconds, loss) = (f64::from(step) / 3.0, 0.1 / step as f32);
        let (l1, psnr) = match step {
            2 => (None, None),
            3 => (Some(0.1 + 0.2), Some(100.0 / 3.0)),
            _ => (Some(0.25), Some(f64::INFINITY)),
        };
        let culled = psnr.map(|_| Culled { outside: step, near: 3, ..Culled::default() });
        let clamped = psnr.map(|_| Clamped { smallest: 2 * step, largest: 1 });
        let fresh_start = (step == 2).then_some(FreshStart { step, loss: 0.1 + 0.2, first: 0.1 });
        MetricsRow { step, seconds, count: 20 + step, edits, loss, l1, psnr, culled, clamped, fresh_start }
    }

    /// The log of a checkpoint at a step that has these rows.
    fn resumed(step: u32, rows: &str) -> Result<MetricsLog, Error> {
        let metadata = [("step", step.to_string()), (KEY, rows.to_owned())];
        MetricsLog::new(1).resumed(&metadata.map(|(key, value)| (key.to_owned(), value)).into())
    }

    fn kept(rows: &[MetricsRow]) -> String {
        to_table(KEY, &Kept { row: rows.to_vec() }).unwrap()
    }

    #[test]
    fn rows_come_back_from_a_checkpoint_with_all_digits() {
        let rows: Vec<MetricsRow> = (1..4).map(row).collect();
        assert_eq!(resumed(3, &kept(&rows)).unwrap().rows(), rows);
        assert!(resumed(0, &kept(&[])).unwrap().rows().is_empty());
    }

    #[test]
    fn the_table_has_the_digits_that_say_something() {
        let log = MetricsLog { rows: (1..4).map(row).collect(), ..MetricsLog::new(1) };
        let shown = log.to_csv();
        assert!(shown.contains("\n1,0.333333,") && shown.contains(",0.3000000,33.3333,"), "{shown}");
        let after_first: String = shown.lines().skip(2).map(|line| format!("{line}\n")).collect();
        assert_eq!(log.csv_from(1) + &log.csv_from(9), after_first);
    }

    #[test]
    fn rows_of_another_fit_are_refused() {
        let good = [row(1), row(2)];
        for (bad, expected) in [
            ("[[row]]\nstep = 'x'".to_owned(), "its `metrics`: "),
            (kept(&[good[0], good[1], good[1]]), "not those of a run at step 9"),
            (kept(&[row(10)]), "not those of a run at step 9"),
        ] {
            let message = resumed(9, &bad).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
