//! The table of a run's metrics: the numbers behind its curves of count, loss and quality.

use std::collections::{BTreeMap, VecDeque};

use gs_core::{Culled, SavedState, edit::EditCounts};
use gs_io::Checkpoint;
use serde::{Deserialize, Serialize};

use super::{
    checkpoint::step_of,
    clamped::Clamped,
    observer::{Control, Observer, Progress},
    recovery::FreshStart,
};
use crate::error::Error;

/// Key of the table in a checkpoint's metadata.
const KEY: &str = "metrics";

/// Largest number of rows in a checkpoint, the last ones; a file's metadata must stay small.
const MOST_KEPT_ROWS: usize = 50_000;

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
        let step = step_of(metadata)?;
        let rows = metadata.get(KEY).map_or(Ok(Vec::new()), |csv| rows_of(csv, step))?;
        Ok(Self { rows, ..self })
    }

    /// The rows whose loss has arrived.
    pub fn rows(&self) -> &[MetricsRow] {
        &self.rows
    }

    /// The table as comma-separated values with a line of headings. The PSNR of equal images is
    /// `inf`; a quality that was not measured is an empty cell.
    pub fn to_csv(&self) -> String {
        csv(&self.rows, Digits::Shown)
    }

    /// The lines of [`Self::to_csv`] from row `first` on, without headings, to append to a table
    /// with the earlier rows.
    pub fn csv_from(&self, first: usize) -> String {
        self.rows.iter().skip(first).map(|row| line(row, Digits::Shown)).collect()
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

/// How many digits a table has of times and qualities.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Digits {
    /// Those that say something.
    Shown,
    /// As many as it takes to read the same number again.
    All,
}

fn csv(rows: &[MetricsRow], digits: Digits) -> String {
    let mut csv = format!("{HEADINGS}\n");
    csv.extend(rows.iter().map(|row| line(row, digits)));
    csv
}

/// A row with its line break.
fn line(row: &MetricsRow, digits: Digits) -> String {
    let MetricsRow { step, seconds, count, edits: e, loss, l1, psnr, culled, clamped, fresh_start } = row;
    let (cloned, split, seeded) = (e.cloned, e.split, e.seeded);
    let (transparent, too_large) = (e.pruned_transparent, e.pruned_too_large);
    let (not_finite, unimportant) = (e.pruned_not_finite, e.pruned_unimportant);
    let number = |value: f64, places: usize| match digits {
        Digits::Shown => format!("{value:.places$}"),
        Digits::All => value.to_string(),
    };
    let seconds = number(*seconds, 6);
    let l1 = l1.map_or_else(String::new, |l1| number(l1, 7));
    let psnr = psnr.map_or_else(String::new, |psnr| number(psnr, 4));
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
        "{step},{seconds},{count},{cloned},{split},{seeded},{transparent},{too_large},{not_finite},{unimportant},\
         {loss},{l1},{psnr},{culled},{clamped},{began_again}\n"
    )
}

/// The rows of a table, which must be in order and not beyond `last_step`.
fn rows_of(csv: &str, last_step: u32) -> Result<Vec<MetricsRow>, Error> {
    let wrong = |line: usize, what: &str| Error::Checkpoint(format!("line {line} of its `{KEY}` {what}"));
    let mut lines = csv.lines();
    if lines.next() != Some(HEADINGS) {
        return Err(wrong(1, "does not name the columns of a table of metrics"));
    }
    let mut rows: Vec<MetricsRow> = Vec::new();
    for (line, text) in lines.enumerate().map(|(i, text)| (i + 2, text)) {
        let cells: Vec<&str> = text.split(',').collect();
        let row = row_of(&cells).ok_or_else(|| wrong(line, &format!("is no row of metrics: `{text}`")))?;
        if rows.last().is_some_and(|before| before.step >= row.step) || row.step > last_step {
            return Err(wrong(line, &format!("is out of order: step {} of a fit at step {last_step}", row.step)));
        }
        rows.push(row);
    }
    Ok(rows)
}

fn row_of(cells: &[&str]) -> Option<MetricsRow> {
    let (
        &[step, seconds, count, cloned, split, seeded, transparent, too_large, not_finite, unimportant, loss, l1, psnr],
        measurements,
    ) = cells.split_first_chunk::<13>()?;
    let whole = |cell: &str| cell.parse::<u32>().ok();
    let measured = |cell: &str| if cell.is_empty() { Some(None) } else { cell.parse().ok().map(Some) };
    let edits = EditCounts {
        cloned: whole(cloned)?,
        split: whole(split)?,
        seeded: whole(seeded)?,
        pruned_transparent: whole(transparent)?,
        pruned_too_large: whole(too_large)?,
        pruned_not_finite: whole(not_finite)?,
        pruned_unimportant: whole(unimportant)?,
    };
    let (seconds, loss) = (seconds.parse().ok()?, loss.parse().ok()?);
    let (l1, psnr) = (measured(l1)?, measured(psnr)?);
    let (measurements, fresh_start) = measurements.split_first_chunk::<7>()?;
    let (culled, clamped) = match *measurements {
        ["", "", "", "", "", "", ""] => (None, None),
        [not_finite, near, degenerate, transparent, outside, smallest, largest] => {
            let culled = Culled {
                not_finite: whole(not_finite)?,
                near: whole(near)?,
                degenerate: whole(degenerate)?,
                transparent: whole(transparent)?,
                outside: whole(outside)?,
            };
            (Some(culled), Some(Clamped { smallest: whole(smallest)?, largest: whole(largest)? }))
        }
    };
    let (step, count) = (whole(step)?, whole(count)?);
    let fresh_start = match *fresh_start {
        ["", ""] => None,
        [loss, first] => Some(FreshStart { step, loss: loss.parse().ok()?, first: first.parse().ok()? }),
        _ => return None,
    };
    Some(MetricsRow { step, seconds, count, edits, loss, l1, psnr, culled, clamped, fresh_start })
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
        checkpoint.metadata.insert(KEY.to_owned(), csv(kept, Digits::All));
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

    #[test]
    fn rows_come_back_from_their_table() {
        let rows: Vec<MetricsRow> = (1..4).map(row).collect();
        let all = |rows: &[MetricsRow]| csv(rows, Digits::All);
        assert_eq!(rows_of(&all(&rows), 3).unwrap(), rows);
        assert_eq!(rows_of(&all(&[]), 0).unwrap(), []);
        let shown = csv(&rows, Digits::Shown);
        assert!(shown.contains("\n1,0.333333,") && shown.contains(",0.3000000,33.3333,"), "{shown}");
        assert_eq!(csv(&rows_of(&all(&rows), 3).unwrap(), Digits::Shown), shown);
        let log = MetricsLog { rows, ..MetricsLog::new(1) };
        assert_eq!(
            log.csv_from(1) + &log.csv_from(9),
            log.to_csv().lines().skip(2).map(|l| format!("{l}\n")).collect::<String>()
        );
    }

    #[test]
    fn a_table_of_another_fit_is_refused() {
        let good = csv(&[row(1), row(2)], Digits::All);
        for (bad, expected) in [
            (good.replace("loss", "cost"), "line 1"),
            (String::new(), "line 1"),
            (good.clone() + "3,x\n", "line 4 of its `metrics` is no row"),
            (good.clone() + "2,0.1,1,0,0,0,0,0,0,0,0.5,,,,,,,,,,,\n", "out of order"),
            (good.clone() + "3,0.1,1,0,0,0,0,0,0,0,0.5,,blur,,,,,,,,,\n", "line 4"),
            (good.clone() + "10,0.1,1,0,0,0,0,0,0,0,0.5,,,,,,,,,,,\n", "step 10 of a fit at step 9"),
            (good + "3,0.1,-1,0,0,0,0,0,0,0,0.5,,,,,,,,,,,\n", "line 4"),
        ] {
            let message = rows_of(&bad, 9).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
