//! The output folder of a study: a file per run, named by the run's address and written atomically,
//! and the tables, plots and report.

use std::{
    collections::{BTreeMap, HashSet},
    fs,
    ops::Deref,
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant},
};

use gs_core::Image;
use gs_io::{FolderClaim, Inputs, OutputFolder, read_image, write_durably, write_png};

use serde::{Deserialize, Serialize};

use crate::{
    claims::{Claims, State},
    error::Error,
    export::TABLES,
    machine::Machine,
    plan::{Plan, Run, VERSION},
    queue::Queue,
    record::Record,
    report::{PAGE, PLOTS},
    run_files::{self, Listing},
    tables::Results,
    work::WorkSettings,
};

const STUDY: &str = "study.toml";
const IMAGES: &str = "images.json";
const MACHINE: &str = "machine.json";
const RUNS: &str = "runs";
const PICTURES: &str = "pictures";

/// Longest time to wait for another process that prepares the folder or writes its report.
const PATIENCE: Duration = Duration::from_secs(120);

/// What to do if the folder already holds results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Existing {
    /// Fail.
    Refuse,
    /// Reuse the results; runs that failed are tried again.
    Resume,
}

/// Which files a study must not replace.
#[derive(Debug, Clone, Default)]
pub struct Safety {
    /// Files that the caller reads. The images of the study need not be listed.
    pub inputs: Vec<PathBuf>,
    /// Whether files that no run wrote may be replaced.
    pub overwrite: bool,
}

/// The output folder of a study. Any number of processes may do its runs at the same time.
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    /// The files of tables and report, which one process at a time writes.
    results: FolderClaim,
}

/// What the results in a folder come from, in `machine.json`.
#[derive(Debug, Serialize, Deserialize)]
struct Origin {
    #[serde(flatten)]
    machine: Machine,
    /// The version of the program; `None` in folders of earlier versions.
    #[serde(default)]
    version: Option<String>,
    /// Digests of the images by their names in the study.
    #[serde(default)]
    images: BTreeMap<String, String>,
}

/// A run that a process has claimed.
#[derive(Debug, Clone, PartialEq)]
pub struct RunningRun {
    /// The row of the run.
    pub row: usize,
    /// The process; `None` where its claim cannot be read.
    pub worker: Option<String>,
    /// Time since the process has last shown that it is alive, by the file server's clock; `None` if
    /// it is dead.
    pub age: Option<Duration>,
}

impl StudyFolder {
    /// Creates the folder for a plan, or opens it to resume. The study file is stored in it, so
    /// that rows can be replayed.
    ///
    /// When a study is resumed, runs that failed and records that were cut short are removed, so
    /// that they are done again.
    ///
    /// # Errors
    /// [`Error::Folder`] where the folder holds another study, or this one and `existing` is
    /// [`Existing::Refuse`], or cannot be written to; [`Error::Io`] where a file that no run wrote
    /// would be replaced, or another process writes tables or a report there for minutes.
    pub fn prepare(path: &Path, plan: &Plan, existing: Existing) -> Result<Self, Error> {
        Self::prepare_with(path, plan, existing, &Safety::default())
    }

    /// Prepares the folder as [`Self::prepare`] does, with further files to protect, or with
    /// permission to replace files.
    ///
    /// # Errors
    /// As [`Self::prepare`].
    pub fn prepare_with(path: &Path, plan: &Plan, existing: Existing, safety: &Safety) -> Result<Self, Error> {
        let is_held = refuse_held(path, plan, existing)?;
        let images = plan.targets.iter().filter_map(|target| Some((&target.name, target.file.as_ref()?)));
        let inputs = Inputs::from_iter(images.clone().map(|(_, file)| file).chain(&safety.inputs));
        // When a study is resumed from the file in its own folder, that file stays as it is.
        let is_input = inputs.contain(&path.join(STUDY));
        // Earlier versions kept no index of their files; the study file identifies their folders.
        let is_of_older_version = is_held && !FolderClaim::is_indexed(path);
        let results = results_claim(path).inputs(inputs).overwriting(safety.overwrite || is_of_older_version);
        let claim = results.clone().files([IMAGES, MACHINE]).files((!is_input).then_some(STUDY));
        let output = begin(claim)?;
        if !is_held {
            // Another process may have prepared the folder since.
            refuse_held(path, plan, existing)?;
        }
        if is_of_older_version {
            let names = [STUDY, IMAGES, MACHINE, PAGE].into_iter().chain(TABLES);
            output.adopt(names.filter(|name| path.join(name).exists()).collect::<Vec<_>>())?;
        }
        let folder = Self { path: path.to_owned(), results };
        for part in [folder.file(RUNS), folder.file(PICTURES)] {
            fs::create_dir_all(&part).map_err(|source| Error::Path { path: part, source })?;
        }
        let found: BTreeMap<&String, PathBuf> =
            images.map(|(name, file)| (name, fs::canonicalize(file).unwrap_or_else(|_| file.clone()))).collect();
        write(&output, IMAGES, &json(&found))?;
        let digests = plan.targets.iter().map(|target| (target.name.clone(), target.digest.clone())).collect();
        let origin = Origin { machine: plan.machine.clone(), version: Some(VERSION.to_owned()), images: digests };
        write(&output, MACHINE, &json(&origin))?;
        if !is_input {
            write(&output, STUDY, &to_toml(plan)?)?;
        }
        run_files::sweep(&folder.file(RUNS), &folder.claims(&WorkSettings::default()))?;
        run_files::remove_unfinished(&folder.file(RUNS))?;
        Ok(folder)
    }

    /// Opens the folder of a study.
    ///
    /// # Errors
    /// [`Error::Folder`] where there is no study in it.
    pub fn open(path: &Path) -> Result<Self, Error> {
        Self::open_with(path, &Safety::default())
    }

    /// Opens the folder of a study as [`Self::open`] does, to write its tables and report with
    /// further files to protect, or with permission to replace files.
    ///
    /// # Errors
    /// [`Error::Folder`] where there is no study in it.
    pub fn open_with(path: &Path, safety: &Safety) -> Result<Self, Error> {
        let study = path.join(STUDY);
        if !study.is_file() {
            return Err(Error::Folder {
                folder: path.to_owned(),
                what: format!("holds no study: there is no {STUDY} in it"),
                mend: "name the --output of a gs study",
            });
        }
        let inputs = Inputs::from_iter(safety.inputs.iter().chain([&study]));
        Ok(Self { path: path.to_owned(), results: results_claim(path).inputs(inputs).overwriting(safety.overwrite) })
    }

    /// Fails where a plan's runs are not those that the folder was prepared for: where this is
    /// another version of the program, or an image or the machine differs.
    ///
    /// # Errors
    /// [`Error::Folder`] with the difference.
    pub fn check(&self, plan: &Plan) -> Result<(), Error> {
        let differs = |what: String, mend| Err(Error::Folder { folder: self.path.clone(), what, mend });
        let Some(origin) = self.origin() else {
            return differs(format!("{MACHINE} is missing or damaged"), "prepare the study again, with gs study --resume");
        };
        if origin.version.as_deref() != Some(VERSION) {
            let theirs = origin.version.as_deref().unwrap_or("an earlier one");
            let mend = "use that version, or begin again with this one in another folder";
            return differs(format!("is a study by version {theirs} of gs, but this is {VERSION}"), mend);
        }
        if origin.machine.name != plan.machine.name {
            let what = format!("is a study on {}, but this is {}", origin.machine.name, plan.machine.name);
            return differs(what, "a study has one backend and SIMD level for all machines: leave out the flags that choose another");
        }
        for image in &plan.targets {
            if origin.images.get(&image.name).is_some_and(|digest| *digest != image.digest) {
                let place = image.file.as_ref().map_or_else(String::new, |file| format!(" ({})", file.display()));
                let what = format!("image {}{place} is not the one that the study began with", image.name);
                return differs(what, "name the folder of the right one with --data or GS_DATA");
            }
        }
        Ok(())
    }

    /// The queue of a plan's runs in this folder.
    pub(crate) fn queue<'a>(&self, plan: &'a Plan, settings: &'a WorkSettings) -> Queue<'a> {
        Queue::new(plan.runs.iter().map(|run| run.address.as_str()).collect(), self.file(RUNS), settings)
    }

    fn claims(&self, settings: &WorkSettings) -> Claims {
        Claims::new(self.file(RUNS), settings.worker.clone(), settings.lease)
    }

    /// The rows of a plan that have no record but a claim, in their order; runs that were given up
    /// are not among them.
    ///
    /// # Errors
    /// [`Error::Path`] and [`Error::Io`] where the folder cannot be read.
    pub fn running(&self, plan: &Plan) -> Result<Vec<RunningRun>, Error> {
        let listing = Listing::of(&self.file(RUNS))?;
        let claims = self.claims(&WorkSettings::default());
        let claimed = plan.runs.iter().filter(|run| !listing.ended.contains(&run.address));
        let claimed = claimed.filter_map(|run| Some((run, *listing.claimed.get(&run.address)?)));
        let mut running = Vec::new();
        for (run, generation) in claimed {
            let (note, age) = match claims.state(&self.file(RUNS).join(run_files::claim(&run.address, generation)))? {
                State::Live { note, age } => (note, Some(age)),
                State::Expired { note } => (note, None),
                State::Released | State::Gone => continue,
            };
            running.push(RunningRun { row: run.row, worker: note.map(|note| note.worker), age });
        }
        Ok(running)
    }

    /// Removes records of a plan's runs that are damaged, such as cut short, so that the runs are
    /// done again. Returns their rows. `results` is what was read.
    ///
    /// # Errors
    /// [`Error::Path`] where a file cannot be removed.
    pub fn remove_damaged(&self, results: &Results<'_>) -> Result<Vec<usize>, Error> {
        let mut rows = Vec::new();
        for (run, _) in results.rows().filter(|(_, record)| record.is_none()) {
            let path = self.file(&record_name(run));
            // It may have been stored since the results were read.
            if path.exists() && self.record(run).is_none() {
                fs::remove_file(&path).map_err(|source| Error::Path { path, source })?;
                rows.push(run.row);
            }
        }
        Ok(rows)
    }

    /// Removes what processes that died have left in the folder.
    ///
    /// # Errors
    /// [`Error::Path`] and [`Error::Io`] where the folder cannot be read or written to.
    pub fn sweep(&self) -> Result<(), Error> {
        run_files::sweep(&self.file(RUNS), &self.claims(&WorkSettings::default()))
    }

    /// Locks the folder's tables and report to write them. Waits where another process has them.
    pub(crate) fn lock_results(&self) -> Result<LockedResults<'_>, Error> {
        Ok(LockedResults { folder: self, output: begin(self.results.clone())? })
    }

    /// The folder's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The path of a file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Where the study found its images, for [`Places::remembered`](crate::Places::remembered);
    /// empty if that was not stored.
    pub fn images(&self) -> BTreeMap<String, PathBuf> {
        fs::read(self.file(IMAGES)).ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
    }

    /// The machine that last conducted the study, if it was stored.
    pub fn machine(&self) -> Option<Machine> {
        Some(self.origin()?.machine)
    }

    fn origin(&self) -> Option<Origin> {
        serde_json::from_slice(&fs::read(self.file(MACHINE)).ok()?).ok()
    }

    /// The path of the study file.
    pub fn study_file(&self) -> PathBuf {
        self.file(STUDY)
    }

    /// The stored record of a run. A file with another run's address counts as missing.
    pub fn record(&self, run: &Run) -> Option<Record> {
        let text = fs::read(self.file(&record_name(run))).ok()?;
        let record: Record = serde_json::from_slice(&text).ok()?;
        (record.address == run.address).then_some(record)
    }

    /// Addresses of the runs that have ended.
    ///
    /// # Errors
    /// [`Error::Path`] where the folder cannot be read.
    pub fn ended(&self) -> Result<HashSet<String>, Error> {
        Ok(Listing::of(&self.file(RUNS))?.ended)
    }

    /// Stores the record of a run. It is on the disk before this returns, so that a power cut does
    /// not lose it. If the run has been finished by another process, which takes over from one that
    /// seems dead, the first record stays.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::TwoResults`] where the other process came to another result.
    pub(crate) fn store(&self, plan: &Plan, run: &Run, record: &Record) -> Result<(), Error> {
        let held = self.record(run);
        if let Some(first) = held.as_ref().and_then(|held| held.outcome.finished()) {
            return match record.outcome.finished() {
                Some(second) if json(&first.without_clock()) != json(&second.without_clock()) => Err(Error::TwoResults {
                    row: run.row,
                    run: plan.describe(run),
                    recorded: first.scene.clone(),
                    found: second.scene.clone(),
                }),
                _ => Ok(()),
            };
        }
        let json = serde_json::to_vec(record).map_err(std::io::Error::other);
        Ok(write_durably(self.file(&record_name(run)), |file| file.write_all(&json?))?)
    }

    /// Stores the picture of a run's scene, without waiting for the disk. The report leaves out
    /// pictures that are missing.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn store_picture(&self, run: &Run, picture: &Image) -> Result<(), Error> {
        Ok(write_png(self.file(&picture_name(run)), picture)?)
    }

    /// The stored picture of a run's scene.
    pub fn picture(&self, run: &Run) -> Option<Image> {
        Some(read_image(self.file(&picture_name(run))).ok()?.image)
    }
}

/// A study's folder whose tables and report this process alone writes.
#[derive(Debug)]
pub(crate) struct LockedResults<'a> {
    folder: &'a StudyFolder,
    output: OutputFolder,
}

impl Deref for LockedResults<'_> {
    type Target = StudyFolder;

    fn deref(&self) -> &StudyFolder {
        self.folder
    }
}

impl LockedResults<'_> {
    /// Writes a text file into the folder.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<(), Error> {
        write(&self.output, name, text)
    }

    /// Claims files whose names depend on the results, before they are written.
    pub(crate) fn claim(&self, names: impl IntoIterator<Item = String>) -> Result<(), Error> {
        Ok(self.output.claim(names)?)
    }

    /// The path of a file that is about to be written; it is added to the folder's index.
    pub(crate) fn file_to_write(&self, name: &str) -> PathBuf {
        self.output.file(name)
    }
}

/// Begins to write into a folder. Waits while another process prepares it or writes its report.
fn begin(claim: FolderClaim) -> Result<OutputFolder, Error> {
    let patient_until = Instant::now() + PATIENCE;
    loop {
        match claim.clone().begin() {
            Err(gs_io::Error::Busy { .. }) if Instant::now() < patient_until => thread::sleep(PATIENCE / 1000),
            Err(gs_io::Error::Write { source, .. }) => {
                let what = format!("cannot be written to: {source}");
                let mend = "choose another folder with --output";
                return Err(Error::Folder { folder: claim.path().to_owned(), what, mend });
            }
            ended => return Ok(ended?),
        }
    }
}

fn write(output: &OutputFolder, name: &str, text: &str) -> Result<(), Error> {
    Ok(gs_io::write_atomically(output.file(name), |file| file.write_all(text.as_bytes()))?)
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).unwrap_or_default() + "\n"
}

/// Whether the folder holds the plan's study. Fails where it must not, or holds another study.
fn refuse_held(path: &Path, plan: &Plan, existing: Existing) -> Result<bool, Error> {
    let wrong = |what: String, mend: &'static str| Err(Error::Folder { folder: path.to_owned(), what, mend });
    let study = path.join(STUDY);
    if !study.exists() {
        return Ok(false);
    }
    if existing == Existing::Refuse {
        let mend = "go on with it with --resume, or choose another folder with --output";
        return wrong("holds a study already".to_owned(), mend);
    }
    let held = fs::read_to_string(&study).ok().and_then(|text| name_of(&text));
    if held.as_ref() != Some(&plan.study.name) {
        let held = held.map_or_else(|| "one that cannot be read".to_owned(), |name| format!("`{name}`"));
        let what = format!("holds another study than `{}`: {held}", plan.study.name);
        return wrong(what, "choose another folder with --output");
    }
    Ok(true)
}

/// A claim to the files of tables and report.
fn results_claim(path: &Path) -> FolderClaim {
    FolderClaim::new(path).files(TABLES).files([PAGE]).folders([PLOTS])
}

fn record_name(run: &Run) -> String {
    format!("{RUNS}/{}", run_files::record(&run.address))
}

fn picture_name(run: &Run) -> String {
    format!("{PICTURES}/{}.png", run.address)
}

fn to_toml(plan: &Plan) -> Result<String, Error> {
    toml::to_string(&plan.study).map_err(|error| plan.study.wrong(error.to_string(), "leave it out"))
}

/// The name of the study in a study file.
fn name_of(text: &str) -> Option<String> {
    let table: toml::Table = text.parse().ok()?;
    Some(table.get("name")?.as_str()?.to_owned())
}
