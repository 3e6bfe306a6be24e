//! What a run's record takes from the steps of the run. Checkpoints hold it, so that the record of a
//! resumed run has all of it, bit for bit.

use std::collections::BTreeMap;

use gs_core::SavedState;
use gs_io::Checkpoint;
use gs_train::{Control, Error, MetricsLog, MetricsRow, Observer, Progress};

/// Entry of a checkpoint's metadata with the curves of the views: a line for each measurement, with
/// a PSNR for each view.
const KEY: &str = "study-views";

/// The table of a run's metrics, and the PSNR of each view at each measurement.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Trajectory {
    log: MetricsLog,
    views: Vec<Vec<f64>>,
}

impl Trajectory {
    /// That of a run of this many steps before the first.
    pub(crate) fn begun(iterations: u32) -> Self {
        Self { log: MetricsLog::for_steps(iterations), views: Vec::new() }
    }

    /// That of a run of this many steps which goes on from a checkpoint with this metadata.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where the checkpoint has no trajectory.
    pub(crate) fn resumed(iterations: u32, metadata: &BTreeMap<String, String>) -> Result<Self, Error> {
        let log = MetricsLog::for_steps(iterations).resumed(metadata)?;
        let wrong = || Error::Checkpoint(format!("its `{KEY}` are not curves"));
        let lines = metadata.get(KEY).ok_or_else(wrong)?.lines();
        let psnrs = |line: &str| line.split_terminator(',').map(str::parse).collect::<Result<Vec<f64>, _>>();
        let views = lines.map(psnrs).collect::<Result<_, _>>().map_err(|_| wrong())?;
        Ok(Self { log, views })
    }

    /// The rows whose loss has arrived.
    pub(crate) fn rows(&self) -> &[MetricsRow] {
        self.log.rows()
    }

    /// The PSNR of a view at each measurement.
    pub(crate) fn curve(&self, view: usize) -> Vec<f64> {
        self.views.iter().filter_map(|psnrs| psnrs.get(view).copied()).collect()
    }
}

impl Observer for Trajectory {
    fn wants_quality(&mut self, progress: &Progress) -> bool {
        self.log.wants_quality(progress)
    }

    fn on_step(&mut self, progress: &Progress) -> Control {
        self.views.extend(progress.quality.as_ref().map(|quality| quality.views.clone()));
        self.log.on_step(progress)
    }

    fn on_losses(&mut self, first_step: u32, losses: &[f32]) {
        self.log.on_losses(first_step, losses);
    }

    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        let line = |psnrs: &Vec<f64>| psnrs.iter().map(|psnr| format!("{psnr},")).collect::<String>() + "\n";
        checkpoint.metadata.insert(KEY.to_owned(), self.views.iter().map(line).collect());
        self.log.on_checkpoint(checkpoint)
    }
}

#[cfg(test)]
mod tests {
    use gs_core::{Parameterization, SplatsState};

    use super::*;

    #[test]
    fn curves_come_back_from_a_checkpoint_bit_for_bit() {
        let views = vec![vec![100.0 / 3.0, f64::INFINITY], vec![], vec![0.1 + 0.2, 7.0]];
        let mut trajectory = Trajectory { views, ..Trajectory::begun(100) };
        let state = SplatsState::new(Parameterization::CovarianceFactor);
        let mut checkpoint = Checkpoint { state: state.into(), metadata: [("step".to_owned(), "7".to_owned())].into() };
        trajectory.on_checkpoint(&mut checkpoint).unwrap();
        assert_eq!(Trajectory::resumed(100, &checkpoint.metadata).unwrap(), trajectory);
        assert_eq!(trajectory.curve(1), [f64::INFINITY, 7.0]);
        checkpoint.metadata.insert(KEY.to_owned(), "1.0,x".to_owned());
        let error = Trajectory::resumed(100, &checkpoint.metadata).unwrap_err().to_string();
        assert!(error.contains("its `study-views` are not curves"), "{error}");
    }
}
