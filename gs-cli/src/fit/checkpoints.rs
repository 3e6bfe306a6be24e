//! Where the state of a fit or a training is stored as it goes on, and how it ends with what is stored: a checkpoint that cannot be written is
//! told, but takes neither the work nor its results with it.

use std::{
    fs, iter,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use gs_io::{Checkpoint, FolderClaim, Inputs, prepare_folder, read_checkpoint, write_checkpoint};
use gs_train::{Error, Observer, Outcome, Progress};

use crate::{
    failure::Failure,
    fit::{progress::Voice, quoted},
    output_folder::{OutputFolder, OverwriteArgs, folder_of},
    training_arguments::CheckpointArgs,
};

/// The most work that is lost where nobody said how often to store.
const AT_MOST: Duration = Duration::from_secs(120);

/// Refuses a file for checkpoints that would be lost to them: an input of the run, but for the checkpoint that it goes on from, or
/// something else than a checkpoint; before any work is spent on what would go there.
pub(crate) fn check_checkpoint_file<P: AsRef<Path>>(
    args: &CheckpointArgs,
    inputs: impl IntoIterator<Item = P>,
    overwrite: OverwriteArgs,
    results: &FolderClaim,
) -> Result<(), Failure> {
    let Some(file) = &args.checkpoint else { return Ok(()) };
    let another = "name another file with --checkpoint";
    if results.claims(file) {
        let message = "is the name of a result, which would replace the checkpoint";
        return Err(Failure::usage(message).at(file.display()).mend(another));
    }
    if file.is_dir() {
        let mend = "name a file with --checkpoint";
        return Err(Failure::usage("is a folder, not a file for checkpoints").at(file.display()).mend(mend));
    }
    if inputs.into_iter().collect::<Inputs>().contain(file) {
        let message = "is an input of this run, which no checkpoint replaces";
        return Err(Failure::usage(message).at(file.display()).mend(another));
    }
    if file.is_file() && !overwrite.overwrite && read_checkpoint(file).is_err() {
        let mend = format_args!("{another}, or replace it with --overwrite");
        return Err(Failure::failed("is in the way: it is no checkpoint").at(file.display()).mend(mend));
    }
    Ok(())
}

/// The file among the results for checkpoints that no flag names a file for. Nobody asked for it, so it takes the place of no other run's
/// checkpoint: only of that from which this run goes on.
fn unnamed_file(output: &Path, resumed: Option<&Path>) -> PathBuf {
    let resumed = resumed.and_then(|file| fs::canonicalize(file).ok());
    let is_free = |file: &PathBuf| match fs::canonicalize(file) {
        Ok(file) => resumed.as_ref() == Some(&file),
        Err(_) => fs::symlink_metadata(file).is_err(),
    };
    let numbered = (2u64..).map(|number| output.join(format!("checkpoint-{number}.safetensors")));
    let file = iter::once(output.join("checkpoint.safetensors")).chain(numbered).find(is_free);
    file.expect("there are more numbers than files")
}

/// Where checkpoints go, how often, and what has become of them; each takes the place of the one before.
#[derive(Debug)]
pub(crate) struct Checkpoints {
    /// Where.
    pub(crate) file: PathBuf,
    /// Every so many steps; never where there is none.
    pub(crate) every: Option<u32>,
    /// Where that has not come about for so long; never where there is none.
    pub(crate) at_most: Option<Duration>,
    /// Whether this run has stored one.
    pub(crate) stored: bool,
    /// The file that the run began from.
    pub(crate) resumed: Option<PathBuf>,
    /// Why the last one that was due could not be stored.
    pub(crate) failure: Option<Failure>,
}

impl Checkpoints {
    /// Where the flags say, in a folder that is known to take them; `unasked` is how often where no flag says so.
    ///
    /// # Errors
    /// Where the folder takes no files.
    pub(crate) fn prepare(
        args: &CheckpointArgs,
        folder: &OutputFolder,
        iterations: u32,
        unasked: Option<u32>,
        resumed: Option<&Path>,
    ) -> Result<Self, Failure> {
        let CheckpointArgs { checkpoint, checkpoint_every } = args;
        let file = checkpoint.clone().unwrap_or_else(|| unnamed_file(folder.path(), resumed));
        prepare_folder(folder_of(&file))
            .map_err(|error| Failure::from(error).mend("choose another with --checkpoint"))?;
        let at_most = checkpoint_every.is_none().then_some(AT_MOST);
        let tenth = checkpoint.as_ref().map(|_| (iterations / 10).max(1));
        let every = checkpoint_every.or(tenth).or(unasked);
        Ok(Self { file, every, at_most, stored: false, resumed: resumed.map(Path::to_owned), failure: None })
    }

    /// Removes what was stored without being asked for, once the results are there. What stays behind is no harm.
    pub(crate) fn remove_unasked(&self, outcome: Outcome, args: &CheckpointArgs) {
        if outcome == Outcome::Finished && self.stored && !args.are_asked_for() {
            let _ = fs::remove_file(&self.file);
        }
    }

    /// Stores one; where it cannot be, [`Self::failure`] says why until another is stored.
    pub(crate) fn store(&mut self, checkpoint: &Checkpoint) {
        self.failure = write_checkpoint(&self.file, checkpoint).err().map(Failure::from);
        self.stored |= self.failure.is_none();
    }

    /// The last one there is, from an earlier run where this one has stored none.
    fn last(&self) -> Option<&Path> {
        if self.stored { Some(&self.file) } else { self.resumed.as_deref() }
    }

    /// Adds to a failure under way how to go on: from the last checkpoint, which is as it was. Nothing to another failure.
    pub(crate) fn with_way_on(&self, failure: Failure, resuming: impl Fn(&Path) -> String) -> Failure {
        if !failure.is_of_backend() && !failure.is_divergence() {
            return failure;
        }
        let way = match (self.last(), &self.failure) {
            (Some(file), _) if failure.is_divergence() => {
                format!("the last good checkpoint is {}, from which it would end the same", quoted(file))
            }
            (Some(file), _) => to_go_on(resuming(file)),
            (None, Some(_)) => "no checkpoint could be stored".to_owned(),
            (None, None) => {
                "no checkpoint was stored yet; --checkpoint FILE stores some as the work goes on".to_owned()
            }
        };
        failure.mend(way)
    }

    /// How a run ends that has its results, after so many steps: a checkpoint that somebody needs and that could not be stored is told last.
    ///
    /// # Errors
    /// That one, and the interruption where Ctrl-C stopped the run.
    pub(crate) fn conclude(
        &self,
        outcome: Outcome,
        step: u32,
        args: &CheckpointArgs,
        resuming: impl Fn(&Path) -> String,
    ) -> Result<(), Failure> {
        match (outcome, &self.failure) {
            (Outcome::Finished, Some(failure)) if args.are_asked_for() => {
                Err(failure.clone().mend("all results are written; name another file with --checkpoint"))
            }
            (Outcome::Finished, _) => Ok(()),
            (Outcome::Stopped, None) => {
                let way = resuming(&self.file);
                Err(Failure::interrupted(format_args!("stopped after step {step}; to go on: {way}")))
            }
            (Outcome::Stopped, Some(failure)) => {
                let way =
                    self.last().map_or_else(|| "there is none to go on from".to_owned(), |f| to_go_on(resuming(f)));
                let stopped = format!("stopped after step {step} with results, but without this checkpoint; {way}");
                Err(failure.clone().mend(stopped))
            }
        }
    }
}

fn to_go_on(resuming: String) -> String {
    format!("to go on from the last checkpoint: {resuming}")
}

/// Stores checkpoints as the work goes on. It stands behind the observers that add to them.
#[derive(Debug)]
pub(crate) struct Storing<'a> {
    checkpoints: &'a mut Checkpoints,
    voice: Voice,
    /// When the last one was stored, or the work began.
    last: Instant,
}

impl<'a> Storing<'a> {
    /// Stores what comes from now on; `voice` says what could not be stored.
    pub(crate) fn new(checkpoints: &'a mut Checkpoints, voice: Voice) -> Self {
        Self { checkpoints, voice, last: Instant::now() }
    }
}

impl Observer for Storing<'_> {
    fn wants_checkpoint(&mut self, progress: &Progress) -> bool {
        let Checkpoints { every, at_most, .. } = *self.checkpoints;
        every.is_some_and(|every| progress.step.is_multiple_of(every))
            // After the last step come the results.
            || at_most.is_some_and(|most| self.last.elapsed() >= most) && !progress.is_last()
    }

    /// A full disk is no reason to lose the work: the next one may find room, and the end says it again.
    fn on_checkpoint(&mut self, checkpoint: &mut Checkpoint) -> Result<(), Error> {
        let known = self.checkpoints.failure.take();
        self.checkpoints.store(checkpoint);
        self.last = Instant::now();
        if let Some(failure) = self.checkpoints.failure.as_ref().filter(|failure| known.as_ref() != Some(failure)) {
            self.voice.say(format_args!("note: no checkpoint was stored: {}; the work goes on", failure.message()));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use pollster::FutureExt as _;
    use std::process::ExitCode;

    use gs_core::Image;
    use gs_cpu::{CpuRasterizer, CpuSettings};
    use gs_train::{Preset, Trainer};

    use super::*;
    use crate::output_folder::tests::begun;

    fn checkpoints(stored: bool, resumed: Option<&str>) -> Checkpoints {
        let resumed = resumed.map(Into::into);
        Checkpoints { file: "new".into(), every: Some(1), at_most: None, stored, resumed, failure: None }
    }

    #[test]
    fn checkpoints_come_by_the_clock_too_and_change_nothing() {
        let place = tempfile::tempdir().unwrap();
        let cpu = CpuRasterizer::new(CpuSettings { threads: Some(1), level: None }).unwrap();
        let image = Image::from_fn(24, 20, |x, y| [x as f32 / 24.0, if y > 9 { 0.8 } else { 0.1 }, 0.5]).unwrap();
        let settings = Preset::Standard.settings(60, image.size()).with_iterations(40);
        let file = place.path().join("state");
        let fitted = |at_most| {
            let mut stored = Checkpoints { file: file.clone(), every: None, at_most, ..checkpoints(false, None) };
            let mut trainer = Trainer::new(&cpu, &image, settings.clone()).block_on().unwrap();
            trainer.run(&mut Storing::new(&mut stored, Voice::above(None))).block_on().unwrap();
            (trainer.scene().block_on().unwrap(), stored.stored)
        };
        let (scene, stored) = fitted(None);
        assert!(!stored);
        assert_eq!(fitted(Some(AT_MOST)), (scene.clone(), false), "it takes no two minutes");
        assert_eq!(fitted(Some(Duration::ZERO)), (scene.clone(), true));
        let mut resumed = Trainer::resume(&cpu, &image, read_checkpoint(&file).unwrap()).unwrap();
        assert!((1..40).contains(&resumed.step()));
        resumed.run(&mut ()).block_on().unwrap();
        assert_eq!(resumed.scene().block_on().unwrap(), scene);
    }

    #[test]
    fn a_file_for_checkpoints_is_none_that_would_be_missed() {
        let place = tempfile::tempdir().unwrap();
        let [photo, notes] = ["photo.png", "notes.txt"].map(|name| place.path().join(name));
        [&photo, &notes].iter().for_each(|file| fs::write(file, "mine").unwrap());
        let line = |file: &Path, overwrite| {
            let args = CheckpointArgs { checkpoint: Some(file.to_owned()), checkpoint_every: None };
            let results = FolderClaim::new(place.path()).files(["scene.ply"]);
            let checked = check_checkpoint_file(&args, [&photo], OverwriteArgs { overwrite }, &results);
            checked.err().map(|failure| failure.line().unwrap())
        };
        assert!(line(&photo, true).unwrap().contains("photo.png: is an input of this run"));
        assert!(line(&notes, false).unwrap().contains("notes.txt: is in the way: it is no checkpoint: name another"));
        assert!(line(&place.path().join("scene.ply"), true).unwrap().contains("scene.ply: is the name of a result"));
        assert_eq!((line(&notes, true), line(&place.path().join("new"), false)), (None, None));
    }

    #[test]
    fn what_nobody_asked_for_goes_when_the_run_is_done() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("state");
        let unasked = CheckpointArgs { checkpoint: None, checkpoint_every: None };
        let asked = CheckpointArgs { checkpoint_every: Some(5), ..unasked.clone() };
        let stored = Checkpoints { file: file.clone(), ..checkpoints(true, None) };
        fs::write(&file, "").unwrap();
        stored.remove_unasked(Outcome::Stopped, &unasked);
        stored.remove_unasked(Outcome::Finished, &asked);
        assert!(file.exists());
        stored.remove_unasked(Outcome::Finished, &unasked);
        assert!(!file.exists());
    }

    fn command(file: &Path) -> String {
        format!("gs fit --resume {}", quoted(file))
    }

    #[test]
    fn no_other_runs_checkpoint_is_replaced_unasked() {
        let place = tempfile::tempdir().unwrap();
        let folder = begun(place.path(), &[]);
        let unasked = CheckpointArgs { checkpoint: None, checkpoint_every: None };
        let name = |args: &CheckpointArgs, resumed: Option<&Path>| {
            let file = Checkpoints::prepare(args, &folder, 100, None, resumed).unwrap().file;
            file.file_name().unwrap().to_str().unwrap().to_owned()
        };
        assert_eq!(name(&unasked, None), "checkpoint.safetensors");
        let [first, second] =
            ["checkpoint.safetensors", "checkpoint-2.safetensors"].map(|name| place.path().join(name));
        fs::write(&first, "of an earlier run").unwrap();
        assert_eq!(name(&unasked, None), "checkpoint-2.safetensors");
        assert_eq!(name(&unasked, Some(&first)), "checkpoint.safetensors");
        fs::create_dir(&second).unwrap();
        assert_eq!(name(&unasked, None), "checkpoint-3.safetensors");
        let asked = CheckpointArgs { checkpoint: Some(first.clone()), ..unasked };
        assert_eq!(name(&asked, None), "checkpoint.safetensors");
    }

    #[test]
    fn the_way_on_begins_from_the_last_checkpoint_there_is() {
        let lost = Failure::from(gs_core::Error::Backend { backend: "wgpu", message: "lost".to_owned() });
        let way_on = |stored, resumed: Option<&str>| {
            checkpoints(stored, resumed).with_way_on(lost.clone(), command).line().unwrap()
        };
        assert!(way_on(false, None).contains("no checkpoint was stored yet; --checkpoint FILE"));
        assert!(way_on(true, None).ends_with(": gs fit --resume new"));
        assert!(way_on(false, Some("old")).ends_with("--resume old"));
        assert!(way_on(true, Some("old")).ends_with("--resume new"));
        let unstored = Checkpoints { failure: Some(Failure::failed("full")), ..checkpoints(false, None) };
        assert!(unstored.with_way_on(lost.clone(), command).line().unwrap().ends_with("no checkpoint could be stored"));
    }

    #[test]
    fn after_a_divergence_the_last_good_checkpoint_is_named() {
        let line = |error: gs_train::Error, stored| {
            let nothing_gained = |_: &Path| unreachable!("nothing is gained by going on");
            checkpoints(stored, None).with_way_on(error.into(), nothing_gained).line().unwrap()
        };
        let diverged = || gs_train::Error::Diverged { step: 7, loss: f32::NAN, suspect: None };
        assert!(line(diverged(), true).contains("at step 7") && line(diverged(), true).contains("checkpoint is new,"));
        assert!(line(diverged(), false).contains("no checkpoint was stored yet"));
        assert_eq!(line(gs_train::Error::Checkpoint("x".to_owned()), true), "error: the checkpoint cannot be used: x");
    }

    #[test]
    fn a_checkpoint_that_somebody_needs_is_missed_at_the_end() {
        let unasked = CheckpointArgs { checkpoint: None, checkpoint_every: None };
        let asked = CheckpointArgs { checkpoint_every: Some(5), ..unasked.clone() };
        let full = |stored| Checkpoints { failure: Some(Failure::failed("full")), ..checkpoints(stored, None) };
        let line = |checkpoints: Checkpoints, outcome, args: &CheckpointArgs| {
            let ended = checkpoints.conclude(outcome, 9, args, command);
            ended.err().map(|failure| (failure.line().unwrap(), failure.status()))
        };
        let failed = ExitCode::FAILURE;
        assert_eq!(line(full(true), Outcome::Finished, &unasked), None, "it would be removed now");
        assert_eq!(line(checkpoints(true, None), Outcome::Finished, &asked), None);
        let (told, status) = line(full(true), Outcome::Finished, &asked).unwrap();
        assert!(told.starts_with("error: full: all results are written") && status == failed, "{told}");
        let (told, status) = line(full(true), Outcome::Stopped, &unasked).unwrap();
        assert!(told.contains("stopped after step 9 with results") && status == failed, "{told}");
        assert!(told.ends_with("to go on from the last checkpoint: gs fit --resume new"), "{told}");
        assert!(line(full(false), Outcome::Stopped, &unasked).unwrap().0.ends_with("none to go on from"));
        let (told, status) = line(checkpoints(true, None), Outcome::Stopped, &unasked).unwrap();
        assert_eq!(
            (told.as_str(), status),
            ("stopped after step 9; to go on: gs fit --resume new", ExitCode::from(130))
        );
    }
}
