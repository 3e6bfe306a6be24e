//! Checkpoints of a run: where they are stored, how often, and how the program ends if one could
//! not be stored. Such a failure is printed, but neither the run nor its results are lost.

use std::{
    fs, iter,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use gs_core::SavedState;
use gs_io::{Checkpoint, FolderClaim, Inputs, prepare_folder, read_checkpoint, write_checkpoint};
use gs_train::{Error, Observer, Outcome, Progress};

use crate::{
    failure::Failure,
    files::output_folder::{OutputFolder, folder_of},
    terminal::{output::quoted, progress_bar::Printer},
};

/// The default time between checkpoints.
const DEFAULT_INTERVAL: Duration = Duration::from_secs(120);

/// Where checkpoints are stored, and when, as far as flags say it.
#[derive(Debug, Clone, Default)]
pub(crate) struct CheckpointPlan {
    /// The file that a flag names.
    pub(crate) file: Option<PathBuf>,
    /// Steps between checkpoints.
    pub(crate) every: Option<u32>,
    /// The checkpoint that the run resumes.
    pub(crate) resumed: Option<PathBuf>,
}

impl CheckpointPlan {
    /// Refuses a file for checkpoints that must not be replaced: an input of the run other than the
    /// checkpoint that it resumes, a result, or any file that is not a checkpoint.
    pub(super) fn check(&self, inputs: &[PathBuf], overwrite: bool, results: &FolderClaim) -> Result<(), Failure> {
        let Some(file) = &self.file else { return Ok(()) };
        let another = "name another file with --checkpoint";
        if results.claims(file) {
            let message = "is the name of a result, which would replace the checkpoint";
            return Err(Failure::usage(message).at(file.display()).hint(another));
        }
        if file.is_dir() {
            let message = "is a folder, not a file for checkpoints";
            return Err(Failure::usage(message).at(file.display()).hint("name a file with --checkpoint"));
        }
        if inputs.iter().collect::<Inputs>().contain(file) {
            let message = "is an input of this run, which no checkpoint replaces";
            return Err(Failure::usage(message).at(file.display()).hint(another));
        }
        if file.is_file() && !overwrite && read_checkpoint(file).is_err() {
            let hint = format_args!("{another}, or replace it with --overwrite");
            return Err(Failure::failed("is in the way: it is not a checkpoint").at(file.display()).hint(hint));
        }
        Ok(())
    }
}

/// The default file for checkpoints. It replaces no other run's checkpoint, only the one that this
/// run resumes.
fn default_file(output: &Path, resumed: Option<&Path>) -> PathBuf {
    let resumed = resumed.and_then(|file| fs::canonicalize(file).ok());
    let is_free = |file: &PathBuf| match fs::canonicalize(file) {
        Ok(file) => resumed.as_ref() == Some(&file),
        Err(_) => fs::symlink_metadata(file).is_err(),
    };
    let numbered = (2u64..).map(|number| output.join(format!("checkpoint-{number}.safetensors")));
    let file = iter::once(output.join("checkpoint.safetensors")).chain(numbered).find(is_free);
    file.expect("there are more numbers than files")
}

/// The checkpoints of a run. Each replaces the one before.
#[derive(Debug)]
pub(crate) struct Checkpoints {
    file: PathBuf,
    /// Steps between checkpoints; `None` is never.
    every: Option<u32>,
    /// The longest time between checkpoints; `None` has no limit.
    interval: Option<Duration>,
    /// Whether a flag asks for checkpoints.
    requested: bool,
    /// Whether this run has stored a checkpoint.
    stored: bool,
    /// The checkpoint that the run resumed.
    resumed: Option<PathBuf>,
    /// The command that resumes the run, without its flag `--resume`.
    command: String,
    /// Why the last checkpoint could not be stored.
    pub(crate) failure: Option<Failure>,
}

impl Checkpoints {
    /// Prepares for checkpoints of a run of `iterations` steps. `every` is the default number of
    /// steps between them, `command` the command that resumes the run, without its flag `--resume`.
    pub(super) fn prepare(
        plan: &CheckpointPlan,
        folder: &OutputFolder,
        iterations: u32,
        every: Option<u32>,
        command: String,
    ) -> Result<Self, Failure> {
        let CheckpointPlan { file: named, every: asked, resumed } = plan;
        let file = named.clone().unwrap_or_else(|| default_file(folder.path(), resumed.as_deref()));
        prepare_folder(folder_of(&file))
            .map_err(|error| Failure::from(error).hint("choose another with --checkpoint"))?;
        let tenth = named.as_ref().map(|_| (iterations / 10).max(1));
        Ok(Self {
            file,
            every: asked.or(tenth).or(every),
            interval: asked.is_none().then_some(DEFAULT_INTERVAL),
            requested: named.is_some() || asked.is_some(),
            stored: false,
            resumed: resumed.clone(),
            command,
            failure: None,
        })
    }

    /// Removes the checkpoint of a finished run unless a flag asks for it. Errors are ignored.
    pub(crate) fn remove_unrequested(&self, outcome: Outcome) {
        if outcome == Outcome::Finished && self.stored && !self.requested {
            let _ = fs::remove_file(&self.file);
        }
    }

    /// Stores a checkpoint. If that fails, [`Self::failure`] says why until another one is stored.
    pub(crate) fn store(&mut self, checkpoint: &Checkpoint<SavedState<'_>>) {
        self.failure = write_checkpoint(&self.file, checkpoint).err().map(Failure::from);
        self.stored |= self.failure.is_none();
    }

    /// The last checkpoint that there is: of this run, or the one that it resumed.
    fn last(&self) -> Option<&Path> {
        if self.stored { Some(&self.file) } else { self.resumed.as_deref() }
    }

    fn resume_command(&self, file: &Path) -> String {
        format!("{} --resume {}", self.command, quoted(file))
    }

    fn resume_hint(&self, file: &Path) -> String {
        format!("to go on from the last checkpoint: {}", self.resume_command(file))
    }

    /// Adds to a failure how to go on from the checkpoint that was stored because of it.
    pub(super) fn with_stored(&self, failure: Failure) -> Failure {
        if self.failure.is_none() { failure.hint(self.resume_hint(&self.file)) } else { failure }
    }

    /// Adds the last checkpoint to a failure of the backend or a divergence. Other failures stay as
    /// they are.
    pub(crate) fn with_resume_hint(&self, failure: Failure) -> Failure {
        if !failure.is_of_backend() && !failure.is_divergence() {
            return failure;
        }
        let hint = match (self.last(), &self.failure) {
            (Some(file), _) if failure.is_divergence() => {
                format!("the last good checkpoint is {}, but resuming from it would diverge again", quoted(file))
            }
            (Some(file), _) => self.resume_hint(file),
            (None, Some(_)) => "no checkpoint could be stored".to_owned(),
            (None, None) => "no checkpoint was stored yet; --checkpoint FILE stores some during the run".to_owned(),
        };
        failure.hint(hint)
    }

    /// Ends a run of `step` steps that has written its results.
    pub(crate) fn finish(&self, outcome: Outcome, step: u32) -> Result<(), Failure> {
        match (outcome, &self.failure) {
            (Outcome::Finished, Some(failure)) if self.requested => {
                Err(failure.clone().hint("all results are written; name another file with --checkpoint"))
            }
            (Outcome::Finished, _) => Ok(()),
            (Outcome::Stopped, None) => {
                let command = self.resume_command(&self.file);
                Err(Failure::interrupted(format_args!("stopped after step {step}; to go on: {command}")))
            }
            (Outcome::Stopped, Some(failure)) => {
                let hint = self.last().map(|file| self.resume_hint(file));
                let hint = hint.unwrap_or_else(|| "there is none to go on from".to_owned());
                let stopped = format!("stopped after step {step} with results, but without this checkpoint; {hint}");
                Err(failure.clone().hint(stopped))
            }
        }
    }
}

/// The observer that stores checkpoints. It comes after the observers that add to them.
#[derive(Debug)]
pub(crate) struct StoreCheckpoints<'a> {
    checkpoints: &'a mut Checkpoints,
    printer: Printer,
    /// Time at which the last checkpoint was stored, or the run began.
    last: Instant,
}

impl<'a> StoreCheckpoints<'a> {
    /// Stores checkpoints from now on; `printer` prints failures.
    pub(crate) fn new(checkpoints: &'a mut Checkpoints, printer: Printer) -> Self {
        Self { checkpoints, printer, last: Instant::now() }
    }
}

impl Observer for StoreCheckpoints<'_> {
    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        let Checkpoints { every, interval, .. } = *self.checkpoints;
        every.is_some_and(|every| progress.step.is_multiple_of(every))
            // After the last step come the results.
            || interval.is_some_and(|interval| self.last.elapsed() >= interval) && !progress.is_last()
    }

    /// A full disk does not end the run: the next checkpoint may find room, and the failure is
    /// repeated at the end.
    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint<SavedState<'_>>) -> Result<(), Error> {
        let known = self.checkpoints.failure.take();
        self.checkpoints.store(checkpoint);
        self.last = Instant::now();
        if let Some(failure) = self.checkpoints.failure.as_ref().filter(|failure| known.as_ref() != Some(failure)) {
            self.printer
                .print(format_args!("note: no checkpoint was stored: {}; the run continues", failure.message()));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::process::ExitCode;

    use gs_backend::FutureExt as _;
    use gs_core::Image;
    use gs_cpu::{CpuRasterizer, CpuSettings};
    use gs_train::{Preset, Trainer};

    use super::*;
    use crate::files::output_folder::tests::begun;

    fn checkpoints(stored: bool, resumed: Option<&str>) -> Checkpoints {
        Checkpoints {
            file: "new".into(),
            every: Some(1),
            interval: None,
            requested: false,
            stored,
            resumed: resumed.map(Into::into),
            command: "gs fit".to_owned(),
            failure: None,
        }
    }

    #[test]
    fn checkpoints_by_the_clock_do_not_change_the_result() {
        let place = tempfile::tempdir().unwrap();
        let cpu = CpuRasterizer::new(CpuSettings::default().with(|s| {
            s.threads = Some(1);
            s.level = None;
        }))
        .unwrap();
        let image = Image::from_fn(24, 20, |x, y| [x as f32 / 24.0, if y > 9 { 0.8 } else { 0.1 }, 0.5]).unwrap();
        let settings = Preset::Standard.settings(60, image.size()).with_iterations(40);
        let file = place.path().join("state");
        let fitted = |interval| {
            let mut stored = Checkpoints { file: file.clone(), every: None, interval, ..checkpoints(false, None) };
            let mut trainer = Trainer::new(&cpu, &image, settings.clone()).block_on().unwrap();
            trainer.run(&mut StoreCheckpoints::new(&mut stored, Printer::above(None))).block_on().unwrap();
            (trainer.scene().block_on().unwrap(), stored.stored)
        };
        let (scene, stored) = fitted(None);
        assert!(!stored);
        assert_eq!(fitted(Some(DEFAULT_INTERVAL)), (scene.clone(), false), "it takes no two minutes");
        assert_eq!(fitted(Some(Duration::ZERO)), (scene.clone(), true));
        let mut resumed = Trainer::resume(&cpu, &image, read_checkpoint(&file).unwrap()).unwrap();
        assert!((1..40).contains(&resumed.step()));
        resumed.run(&mut ()).block_on().unwrap();
        assert_eq!(resumed.scene().block_on().unwrap(), scene);
    }

    #[test]
    fn checkpoints_replace_no_other_file() {
        let place = tempfile::tempdir().unwrap();
        let [photo, notes] = ["photo.png", "notes.txt"].map(|name| place.path().join(name));
        [&photo, &notes].iter().for_each(|file| fs::write(file, "mine").unwrap());
        let line = |file: &Path, overwrite| {
            let plan = CheckpointPlan { file: Some(file.to_owned()), ..CheckpointPlan::default() };
            let results = FolderClaim::new(place.path(), ["scene.ply"]);
            let checked = plan.check(std::slice::from_ref(&photo), overwrite, &results);
            checked.err().map(|failure| failure.line().unwrap())
        };
        assert!(line(&photo, true).unwrap().contains("photo.png: is an input of this run"));
        assert!(
            line(&notes, false).unwrap().contains("notes.txt: is in the way: it is not a checkpoint: name another")
        );
        assert!(line(&place.path().join("scene.ply"), true).unwrap().contains("scene.ply: is the name of a result"));
        assert_eq!((line(&notes, true), line(&place.path().join("new"), false)), (None, None));
    }

    #[test]
    fn an_unrequested_checkpoint_is_removed_at_the_end() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("state");
        let stored = |requested| Checkpoints { file: file.clone(), requested, ..checkpoints(true, None) };
        fs::write(&file, "").unwrap();
        stored(false).remove_unrequested(Outcome::Stopped);
        stored(true).remove_unrequested(Outcome::Finished);
        assert!(file.exists());
        stored(false).remove_unrequested(Outcome::Finished);
        assert!(!file.exists());
    }

    #[test]
    fn the_default_file_is_no_other_runs_checkpoint() {
        let place = tempfile::tempdir().unwrap();
        let folder = begun(place.path(), &[]);
        let name = |named: Option<&PathBuf>, resumed: Option<&PathBuf>| {
            let plan = CheckpointPlan { file: named.cloned(), every: None, resumed: resumed.cloned() };
            let file = Checkpoints::prepare(&plan, &folder, 100, None, String::new()).unwrap().file;
            file.file_name().unwrap().to_str().unwrap().to_owned()
        };
        assert_eq!(name(None, None), "checkpoint.safetensors");
        let [first, second] =
            ["checkpoint.safetensors", "checkpoint-2.safetensors"].map(|name| place.path().join(name));
        fs::write(&first, "of an earlier run").unwrap();
        assert_eq!(name(None, None), "checkpoint-2.safetensors");
        assert_eq!(name(None, Some(&first)), "checkpoint.safetensors");
        fs::create_dir(&second).unwrap();
        assert_eq!(name(None, None), "checkpoint-3.safetensors");
        assert_eq!(name(Some(&first), None), "checkpoint.safetensors");
    }

    #[test]
    fn the_resume_hint_names_the_last_checkpoint() {
        let lost = Failure::from(gs_core::Error::Backend { backend: "wgpu", message: "lost".to_owned() });
        let hint = |stored, resumed| checkpoints(stored, resumed).with_resume_hint(lost.clone()).line().unwrap();
        assert!(hint(false, None).contains("no checkpoint was stored yet; --checkpoint FILE"));
        assert!(hint(true, None).ends_with(": gs fit --resume new"));
        assert!(hint(false, Some("old")).ends_with("--resume old"));
        assert!(hint(true, Some("old")).ends_with("--resume new"));
        let unstored = Checkpoints { failure: Some(Failure::failed("full")), ..checkpoints(false, None) };
        assert!(unstored.with_resume_hint(lost.clone()).line().unwrap().ends_with("no checkpoint could be stored"));
    }

    #[test]
    fn after_a_divergence_the_last_good_checkpoint_is_named() {
        let line =
            |error: gs_train::Error, stored| checkpoints(stored, None).with_resume_hint(error.into()).line().unwrap();
        let diverged = || gs_train::Error::Diverged { step: 7, loss: f32::NAN, suspect: None };
        assert!(line(diverged(), true).contains("at step 7") && line(diverged(), true).contains("checkpoint is new,"));
        assert!(line(diverged(), false).contains("no checkpoint was stored yet"));
        assert_eq!(line(gs_train::Error::Checkpoint("x".to_owned()), true), "error: the checkpoint cannot be used: x");
    }

    #[test]
    fn a_needed_checkpoint_that_was_not_stored_is_an_error_at_the_end() {
        let full = |stored| Checkpoints { failure: Some(Failure::failed("full")), ..checkpoints(stored, None) };
        let line = |checkpoints: Checkpoints, outcome, requested| {
            let ended = Checkpoints { requested, ..checkpoints }.finish(outcome, 9);
            ended.err().map(|failure| (failure.line().unwrap(), failure.status()))
        };
        let failed = ExitCode::FAILURE;
        assert_eq!(line(full(true), Outcome::Finished, false), None, "it would be removed now");
        assert_eq!(line(checkpoints(true, None), Outcome::Finished, true), None);
        let (message, status) = line(full(true), Outcome::Finished, true).unwrap();
        assert!(message.starts_with("error: full: all results are written") && status == failed, "{message}");
        let (message, status) = line(full(true), Outcome::Stopped, false).unwrap();
        assert!(message.contains("stopped after step 9 with results") && status == failed, "{message}");
        assert!(message.ends_with("to go on from the last checkpoint: gs fit --resume new"), "{message}");
        assert!(line(full(false), Outcome::Stopped, false).unwrap().0.ends_with("none to go on from"));
        let (message, status) = line(checkpoints(true, None), Outcome::Stopped, false).unwrap();
        assert_eq!(
            (message.as_str(), status),
            ("stopped after step 9; to go on: gs fit --resume new", ExitCode::from(130))
        );
    }
}
