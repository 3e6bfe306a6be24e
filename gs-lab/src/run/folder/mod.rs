//! The output folder of a study: a file per run, named by the run's address and written atomically,
//! and the tables, plots and report.

mod locked_results;
mod origin;
mod run_files;

use std::{
    collections::{BTreeMap, HashSet},
    fs,
    path::{Path, PathBuf},
};

use gs_core::Image;
use gs_io::{FolderClaim, Inputs, OutputFolder, png_bytes};
use gs_jobs::{
    Claims, Holder, JobStore, Keep, Listing, Queue, WorkSettings,
    files::{self, RUNS},
};
use serde::Serialize;

use self::{
    locked_results::{begin, results_claim},
    origin::Origin,
    run_files::PICTURES,
};
use super::record::{Record, RunOutcome};
use crate::{
    error::Error,
    study::{Machine, Plan, Run, StudyTarget},
};

const STUDY: &str = "study.toml";
const IMAGES: &str = "images.json";
const MACHINE: &str = "machine.json";

/// What to do if the folder already holds results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Existing {
    /// Fail.
    Refuse,
    /// Reuse the results; runs that failed are tried again.
    Resume,
}

/// How the folder of a study is prepared.
#[derive(Debug, Clone)]
pub struct Preparation {
    /// What to do if the folder already holds results.
    pub existing: Existing,
    /// Files that the caller reads, which must not be replaced. The images of the study need not be listed.
    pub inputs: Vec<PathBuf>,
    /// Whether files that no run wrote may be replaced.
    pub overwrite: bool,
}

impl From<Existing> for Preparation {
    fn from(existing: Existing) -> Self {
        Self { existing, inputs: Vec::new(), overwrite: false }
    }
}

/// The output folder of a study. Any number of processes may do its runs at the same time.
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    /// The files of tables and report, which one process at a time writes.
    results: FolderClaim,
    /// The files of the runs.
    store: JobStore,
}

impl StudyFolder {
    /// Creates the folder for a plan, or opens it to resume. The study file is stored in it.
    ///
    /// When a study is resumed, runs that failed and records that were cut short are removed, so
    /// that they are done again.
    ///
    /// # Errors
    /// [`Error::Folder`] where the folder holds another study, or this one and `existing` is
    /// [`Existing::Refuse`], or cannot be written to; [`Error::Io`] where a file that no run wrote
    /// would be replaced, or another process writes tables or a report there for minutes.
    pub fn prepare(path: &Path, plan: &Plan, how: impl Into<Preparation>) -> Result<Self, Error> {
        let Preparation { existing, inputs, overwrite } = how.into();
        let is_held = refuse_held(path, plan, existing)?;
        let read = plan.targets.iter().flat_map(StudyTarget::files);
        let inputs = Inputs::from_iter(read.chain(inputs));
        // When a study is resumed from the file in its own folder, that file stays as it is.
        let is_input = inputs.contain(&path.join(STUDY));
        let results = FolderClaim { inputs, overwrite, ..results_claim(path) };
        let mut claim = results.clone();
        claim.files.extend([IMAGES, MACHINE].into_iter().chain((!is_input).then_some(STUDY)).map(str::to_owned));
        let output = begin(claim)?;
        if !is_held {
            // Another process may have prepared the folder since.
            refuse_held(path, plan, existing)?;
        }
        let folder = Self { path: path.to_owned(), results, store: JobStore::new(path) };
        for part in [folder.file(RUNS), folder.file(PICTURES)] {
            fs::create_dir_all(&part).map_err(|source| Error::Path { path: part, source })?;
        }
        let canonical = |path: &PathBuf| fs::canonicalize(path).unwrap_or_else(|_| path.clone());
        let found: BTreeMap<_, _> = plan.places().into_iter().map(|(name, path)| (name, canonical(path))).collect();
        output.write(IMAGES, json(&found))?;
        output.write(MACHINE, json(&Origin::of(plan)))?;
        if !is_input {
            output.write(STUDY, plan.study.to_toml()?)?;
        }
        folder.sweep()?;
        run_files::remove_unfinished(&folder.store)?;
        Ok(folder)
    }

    /// Opens the folder of a study. Its tables and report replace files that no run wrote only if
    /// `overwrite` says so.
    ///
    /// # Errors
    /// [`Error::Folder`] where there is no study in it.
    pub fn open(path: &Path, overwrite: bool) -> Result<Self, Error> {
        let study = path.join(STUDY);
        if !study.is_file() {
            return Err(Error::Folder {
                folder: path.to_owned(),
                what: format!("holds no study: there is no {STUDY} in it"),
                hint: "name the --output of a gs study",
            });
        }
        let inputs = Inputs::from_iter([&study]);
        let results = FolderClaim { inputs, overwrite, ..results_claim(path) };
        Ok(Self { path: path.to_owned(), results, store: JobStore::new(path) })
    }

    /// Fails where a plan's runs are not those that the folder was prepared for: where this is
    /// another version of the program, or an image or the machine differs.
    ///
    /// # Errors
    /// [`Error::Folder`] with the difference.
    pub fn check(&self, plan: &Plan) -> Result<(), Error> {
        let missing =
            || (format!("{MACHINE} is missing or damaged"), "prepare the study again, with gs study prepare --resume");
        let checked = self.origin().ok_or_else(missing).and_then(|origin| origin.check(plan));
        checked.map_err(|(what, hint)| Error::Folder { folder: self.path.clone(), what, hint })
    }

    /// The queue of a plan's runs in this folder.
    pub(crate) fn queue<'a>(&self, plan: &'a Plan, settings: &'a WorkSettings) -> Queue<'a> {
        Queue::new(plan.runs.iter().map(|run| run.address.as_str()).collect(), self.store.clone(), settings)
    }

    fn claims(&self) -> Claims {
        let settings = WorkSettings::default();
        Claims::new(self.store.clone(), settings.worker, settings.lease)
    }

    /// Who is doing each run of a plan; `None` for runs that have ended, that were given up, and that nobody has claimed.
    ///
    /// # Errors
    /// [`Error::Jobs`] where the folder cannot be read.
    pub fn running(&self, plan: &Plan) -> Result<Vec<Option<Holder>>, Error> {
        Ok(self.claims().holders(plan.runs.iter().map(|run| run.address.as_str()))?)
    }

    /// Removes what processes that died have left in the folder, and the records of those of `unread` that
    /// are damaged, such as cut short, so that the runs are done again. Returns their rows. `unread` are
    /// runs of which no record could be read.
    ///
    /// # Errors
    /// [`Error::Jobs`] where a file cannot be removed.
    pub fn remove_damaged<'r>(&self, unread: impl IntoIterator<Item = &'r Run>) -> Result<Vec<usize>, Error> {
        self.sweep()?;
        let mut rows = Vec::new();
        for run in unread {
            let name = files::record(&run.address);
            // It may have been stored since the results were read.
            if self.store.has(&name) && self.record(run)?.is_none() {
                self.store.remove(&name)?;
                rows.push(run.row);
            }
        }
        Ok(rows)
    }

    /// Removes what processes that died have left in the folder.
    ///
    /// # Errors
    /// [`Error::Path`] and [`Error::Io`] where the folder cannot be read or written to.
    pub(crate) fn sweep(&self) -> Result<(), Error> {
        Ok(self.claims().sweep()?)
    }

    /// Locks the folder's tables and report to write them. Waits where another process has them.
    pub(crate) fn lock_results(&self) -> Result<OutputFolder, Error> {
        begin(self.results.clone())
    }

    /// The folder's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The files of the runs.
    pub(crate) fn store(&self) -> &JobStore {
        &self.store
    }

    /// The path of a file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Where the study found its images or data sets, for [`Places::remembered`](crate::Places::remembered);
    /// empty if that was not stored.
    pub fn images(&self) -> BTreeMap<String, PathBuf> {
        fs::read(self.file(IMAGES)).ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
    }

    /// The machine that last conducted the study, if it was stored.
    pub fn machine(&self) -> Option<Machine> {
        Some(self.origin()?.machine)
    }

    /// What the results in the folder come from, if that was stored.
    fn origin(&self) -> Option<Origin> {
        serde_json::from_slice(&fs::read(self.file(MACHINE)).ok()?).ok()
    }

    /// The path of the study file.
    pub fn study_file(&self) -> PathBuf {
        self.file(STUDY)
    }

    /// The stored record of a run. One that is damaged, or of another run, counts as missing.
    ///
    /// # Errors
    /// [`Error::Jobs`] where it cannot be read.
    pub(crate) fn record(&self, run: &Run) -> Result<Option<Record>, Error> {
        let Some(text) = self.store.read(&files::record(&run.address))? else { return Ok(None) };
        let Ok(mut record) = serde_json::from_slice::<Record>(&text) else { return Ok(None) };
        if let RunOutcome::Finished(finished) = &mut record.outcome {
            // A report holds the trajectories of all runs.
            finished.trajectory.shrink_to_fit();
        }
        Ok((record.address == run.address).then_some(record))
    }

    /// Addresses of the runs that have ended.
    ///
    /// # Errors
    /// [`Error::Path`] where the folder cannot be read.
    pub fn ended(&self) -> Result<HashSet<String>, Error> {
        Ok(Listing::of(&self.store)?.ended)
    }

    /// Stores the record of a run. It is on the disk before this returns, so that a power cut does
    /// not lose it. If the run has been finished by another process, which takes over from one that
    /// seems dead, the first record stays.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::TwoResults`] where the other process came to another result.
    pub(crate) fn store_record(&self, plan: &Plan, run: &Run, record: &Record) -> Result<(), Error> {
        let held = self.record(run)?;
        if let Some(first) = held.as_ref().and_then(|held| held.outcome.finished()) {
            return match record.outcome.finished() {
                Some(second) if json(&first.without_clock()) != json(&second.without_clock()) => {
                    Err(Error::TwoResults {
                        row: run.row,
                        run: plan.describe(run),
                        recorded: first.scene.clone(),
                        found: second.scene.clone(),
                    })
                }
                _ => Ok(()),
            };
        }
        let name = files::record(&run.address);
        Ok(self.store.write(&name, Keep::AfterPowerCut, &mut |file| Ok(serde_json::to_writer(file, record)?))?)
    }

    /// Stores a picture of a run's scene, without waiting for the disk: the first, or of a 3D scene
    /// one more for each view that is shown. The report leaves out pictures that are missing.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Jobs`].
    pub(crate) fn store_picture(&self, run: &Run, index: usize, picture: &Image) -> Result<(), Error> {
        let name = run_files::picture(&run.address, index);
        Ok(self.store.write(&name, Keep::AfterCrash, &mut |file| file.write_all(&png_bytes(picture)))?)
    }

    /// A stored picture of a run's scene, counted from 0.
    pub(crate) fn picture(&self, run: &Run, index: usize) -> Option<Image> {
        let bytes = self.store.read(&run_files::picture(&run.address, index)).ok()??;
        let picture = image::load_from_memory(&bytes).ok()?.into_rgb8();
        let (width, height) = picture.dimensions();
        let pixels = picture.pixels().map(|pixel| pixel.0.map(|value| f32::from(value) / 255.0));
        Image::from_pixels(width, height, pixels.collect()).ok()
    }
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).unwrap_or_default() + "\n"
}

/// Whether the folder holds the plan's study. Fails where it must not, or holds another study.
fn refuse_held(path: &Path, plan: &Plan, existing: Existing) -> Result<bool, Error> {
    let wrong = |what: String, hint: &'static str| Err(Error::Folder { folder: path.to_owned(), what, hint });
    let study = path.join(STUDY);
    if !study.exists() {
        return Ok(false);
    }
    if existing == Existing::Refuse {
        let hint = "go on with it with --resume, or choose another folder with --output";
        return wrong("holds a study already".to_owned(), hint);
    }
    let held = fs::read_to_string(&study).ok().and_then(|text| name_of(&text));
    if held.as_ref() != Some(&plan.study.name) {
        let held = held.map_or_else(|| "one that cannot be read".to_owned(), |name| format!("`{name}`"));
        let what = format!("holds another study than `{}`: {held}", plan.study.name);
        return wrong(what, "choose another folder with --output");
    }
    Ok(true)
}

/// The name of the study in a study file.
fn name_of(text: &str) -> Option<String> {
    let table: toml::Table = text.parse().ok()?;
    Some(table.get("name")?.as_str()?.to_owned())
}
