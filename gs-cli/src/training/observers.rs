//! Observers of a run besides its display and its checkpoints: the table of metrics, Ctrl-C, the
//! curve.

use std::{
    fs::{self, File},
    io::Write,
    path::PathBuf,
};

use gs_core::SavedState;
use gs_io::Checkpoint;
use gs_lab::report::curve::CurvePoint;
use gs_train::{Control, Error, MetricsLog, Observer, Progress};

use crate::{failure::Failure, files::output_folder::OutputFolder, terminal::progress_bar::Printer};

/// The table of a finished run.
const TABLE: &str = "metrics.csv";
/// The rows of a run under way, or of one that has failed. The table of an earlier run stays until
/// this one is complete.
const ROWS: &str = "metrics.part.csv";

/// Adds the rows of a log to a file as they come, so that they survive whatever ends the run.
pub(crate) struct LogFile<'a> {
    log: &'a mut MetricsLog,
    /// `None` after an error.
    file: Option<File>,
    path: PathBuf,
    /// Rows in the file.
    written: usize,
    printer: Printer,
}

impl<'a> LogFile<'a> {
    /// Starts the file again, with the rows that the log already has.
    pub(crate) fn begin(folder: &OutputFolder, log: &'a mut MetricsLog, printer: Printer) -> Result<Self, Failure> {
        let path = folder.file(ROWS);
        let begun = File::create(&path).and_then(|mut file| {
            file.write_all(log.to_csv().as_bytes())?;
            Ok(file)
        });
        match begun {
            Ok(file) => Ok(Self { written: log.rows().len(), log, file: Some(file), path, printer }),
            Err(error) => {
                let hint = "choose another folder with --output";
                Err(Failure::failed(format_args!("cannot be written: {error}")).at(path.display()).hint(hint))
            }
        }
    }

    /// Adds new rows. A full disk does not end the run: the whole table is written at the end, with
    /// the results.
    fn catch_up(&mut self) {
        let Some(file) = self.file.as_mut().filter(|_| self.log.rows().len() > self.written) else { return };
        if let Err(error) = file.write_all(self.log.csv_from(self.written).as_bytes()) {
            let path = self.path.display();
            self.printer.print(format_args!("note: {path}: cannot be written: {error}; the run continues without it"));
            self.file = None;
        }
        self.written = self.log.rows().len();
    }
}

/// Writes the whole table in place of the rows.
pub(crate) fn write_table(folder: &OutputFolder, log: &MetricsLog) -> Result<(), Failure> {
    folder.write_text_durably(TABLE, &log.to_csv())?;
    // If the rows stay, they do no harm.
    let _ = fs::remove_file(folder.file(ROWS));
    Ok(())
}

impl Observer for LogFile<'_> {
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        self.log.wants_quality(progress)
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        self.log.on_step(progress)
    }

    fn on_losses(&mut self, first_step: u32, losses: &[f32]) {
        self.log.on_losses(first_step, losses);
        self.catch_up();
    }

    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        self.log.on_checkpoint(checkpoint)
    }
}

/// Stops the run after a step for which the function returns true.
pub(crate) struct StopIf<F>(pub(crate) F);

impl<F: FnMut(u32) -> bool> Observer for StopIf<F> {
    fn on_step(&mut self, progress: &Progress) -> Control {
        if (self.0)(progress.step) { Control::Stop } else { Control::Continue }
    }
}

/// Collects the points of the curve. The count comes with every step, its loss then or a few steps
/// later.
#[derive(Debug, Default)]
pub(crate) struct Curve(pub(crate) Vec<CurvePoint>);

impl Curve {
    /// The curve of a run whose first rows are in `log`.
    pub(crate) fn begun_by(log: &MetricsLog) -> Self {
        let points = log.rows().iter().map(|row| CurvePoint { step: row.step, count: row.count, loss: row.loss });
        Self(points.collect())
    }
}

impl Observer for Curve {
    fn on_step(&mut self, progress: &Progress) -> Control {
        self.0.push(CurvePoint { step: progress.step, count: progress.count, loss: f32::NAN });
        Control::Continue
    }

    fn on_losses(&mut self, first_step: u32, losses: &[f32]) {
        for (step, &loss) in (first_step..).zip(losses) {
            if let Ok(place) = self.0.binary_search_by_key(&step, |point| point.step) {
                self.0[place].loss = loss;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_losses_are_added_to_their_points() {
        let mut curve = Curve(vec![CurvePoint { step: 10, count: 1, loss: 0.5 }]);
        let progress = |step| Progress {
            step,
            iterations: 20,
            seconds: 0.0,
            count: step,
            loss: 0.5,
            loss_step: 10,
            edits: None,
            fresh_start: None,
            psnr_estimate: None,
            quality: None,
        };
        for step in 14..=17 {
            curve.on_step(&progress(step));
        }
        // Steps 12 and 13, of another run, have no points.
        curve.on_losses(12, &[0.4, 0.3, 0.2]);
        curve.on_losses(15, &[0.1, 0.05]);
        let points: Vec<(u32, f32)> = curve.0.iter().map(|p| (p.step, p.loss)).collect();
        assert_eq!(points[..4], [(10, 0.5), (14, 0.2), (15, 0.1), (16, 0.05)]);
        assert!(points[4].0 == 17 && points[4].1.is_nan());
    }
}
