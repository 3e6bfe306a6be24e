//! The output folder of a study: a file per run, named by the run's address and written atomically,
//! and the tables, plots and report.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use gs_core::Image;
use gs_io::{FolderClaim, Inputs, OutputFolder, read_image, write_durably, write_png};

use crate::{
    error::Error,
    export::TABLES,
    machine::Machine,
    plan::{Plan, Run},
    record::{Record, RunOutcome},
    report::{PAGE, PLOTS},
    target::StudyTarget,
    task::PICTURED_VIEWS,
};

const STUDY: &str = "study.toml";
const IMAGES: &str = "images.json";
const MACHINE: &str = "machine.json";
const RUNS: &str = "runs";
const PICTURES: &str = "pictures";

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

/// The output folder of a study.
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    /// Locks the folder; `None` where the folder is only read.
    output: Option<OutputFolder>,
}

impl StudyFolder {
    /// Creates the folder for a plan, or opens it to resume. The study file is stored in it, so
    /// that rows can be replayed. The folder is locked until this value is dropped.
    ///
    /// # Errors
    /// [`Error::Folder`] where the folder holds another study, or this one and `existing` is
    /// [`Existing::Refuse`], or cannot be written to; [`Error::Io`] where a file that no run wrote
    /// would be replaced, or another process uses the folder.
    pub fn prepare(path: &Path, plan: &Plan, existing: Existing) -> Result<Self, Error> {
        Self::prepare_with(path, plan, existing, &Safety::default())
    }

    /// Prepares the folder as [`Self::prepare`] does, with further files to protect, or with
    /// permission to replace files.
    ///
    /// # Errors
    /// As [`Self::prepare`].
    pub fn prepare_with(path: &Path, plan: &Plan, existing: Existing, safety: &Safety) -> Result<Self, Error> {
        let wrong = |what: String, mend: &'static str| Error::Folder { folder: path.to_owned(), what, mend };
        let study = path.join(STUDY);
        let is_held = study.exists();
        if is_held && existing == Existing::Refuse {
            let mend = "go on with it with --resume, or choose another folder with --output";
            return Err(wrong("holds a study already".to_owned(), mend));
        }
        if is_held {
            let held = fs::read_to_string(&study).ok().and_then(|text| name_of(&text));
            if held.as_ref() != Some(&plan.study.name) {
                let held = held.map_or_else(|| "one that cannot be read".to_owned(), |name| format!("`{name}`"));
                let what = format!("holds another study than `{}`: {held}", plan.study.name);
                return Err(wrong(what, "choose another folder with --output"));
            }
        }
        let read = plan.targets.iter().flat_map(StudyTarget::files);
        let inputs = Inputs::from_iter(read.chain(safety.inputs.iter().cloned()));
        // When a study is resumed from the file in its own folder, that file stays as it is.
        let is_input = inputs.contain(&study);
        // Earlier versions kept no index of their files; the study file identifies their folders.
        let is_of_older_version = is_held && !FolderClaim::is_indexed(path);
        let claim = FolderClaim::new(path)
            .files((!is_input).then_some(STUDY))
            .files(files_of(plan))
            .folders([PLOTS])
            .inputs(inputs)
            .overwriting(safety.overwrite || is_of_older_version);
        let output = claim.begin().map_err(|error| match error {
            gs_io::Error::Write { source, .. } => {
                wrong(format!("cannot be written to: {source}"), "choose another folder with --output")
            }
            error => error.into(),
        })?;
        if is_of_older_version {
            let there = files_of(plan).chain([STUDY.to_owned()]).filter(|name| path.join(name).exists());
            output.adopt(there.collect::<Vec<_>>())?;
        }
        let folder = Self { path: path.to_owned(), output: Some(output) };
        for part in [folder.file(RUNS), folder.file(PICTURES)] {
            fs::create_dir_all(&part).map_err(|source| Error::Path { path: part, source })?;
        }
        let canonical = |path: &PathBuf| fs::canonicalize(path).unwrap_or_else(|_| path.clone());
        let found: BTreeMap<_, _> = plan.places().into_iter().map(|(name, path)| (name, canonical(path))).collect();
        let found = serde_json::to_string_pretty(&found).unwrap_or_default();
        folder.write(IMAGES, &(found + "\n"))?;
        let machine = serde_json::to_string_pretty(&plan.machine).unwrap_or_default();
        folder.write(MACHINE, &(machine + "\n"))?;
        if !is_input {
            folder.write(STUDY, &plan.study.to_toml()?)?;
        }
        Ok(folder)
    }

    /// Opens the folder of a study to read it.
    ///
    /// # Errors
    /// [`Error::Folder`] where there is no study in it.
    pub fn open(path: &Path) -> Result<Self, Error> {
        match path.join(STUDY).is_file() {
            true => Ok(Self { path: path.to_owned(), output: None }),
            false => Err(Error::Folder {
                folder: path.to_owned(),
                what: format!("holds no study: there is no {STUDY} in it"),
                mend: "name the --output of a gs study",
            }),
        }
    }

    /// The folder's path.
    pub fn path(&self) -> &Path {
        &self.path
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

    /// Whether the run is finished and need not be done again.
    pub fn is_finished(&self, run: &Run) -> bool {
        self.record(run).is_some_and(|record| matches!(record.outcome, RunOutcome::Finished(_)))
    }

    /// Stores the record of a run. It is on the disk before this returns, so that a power cut does
    /// not lose it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn store(&self, run: &Run, record: &Record) -> Result<(), Error> {
        let json = serde_json::to_vec(record).map_err(std::io::Error::other);
        Ok(write_durably(self.file_to_write(&record_name(run)), |file| file.write_all(&json?))?)
    }

    /// Stores a picture of a run's scene, without waiting for the disk: the first, or of a 3D scene
    /// one more for each view that is shown. The report leaves out pictures that are missing.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn store_picture(&self, run: &Run, index: usize, picture: &Image) -> Result<(), Error> {
        Ok(write_png(self.file_to_write(&picture_name(run, index)), picture)?)
    }

    /// A stored picture of a run's scene, counted from 0.
    pub fn picture(&self, run: &Run, index: usize) -> Option<Image> {
        Some(read_image(self.file(&picture_name(run, index))).ok()?.image)
    }

    /// Writes a text file into the folder.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, name: &str, text: &str) -> Result<(), Error> {
        Ok(gs_io::write_atomically(self.file_to_write(name), |file| file.write_all(text.as_bytes()))?)
    }

    /// Claims files whose names depend on the results, before they are written.
    pub(crate) fn claim(&self, names: impl IntoIterator<Item = String>) -> Result<(), Error> {
        Ok(self.output.as_ref().map_or(Ok(()), |output| output.claim(names))?)
    }

    /// The path of a file that is about to be written; it is added to the folder's index.
    pub(crate) fn file_to_write(&self, name: &str) -> PathBuf {
        self.output.as_ref().map_or_else(|| self.file(name), |output| output.file(name))
    }
}

fn record_name(run: &Run) -> String {
    format!("{RUNS}/{}.json", run.address)
}

fn picture_name(run: &Run, index: usize) -> String {
    let number = if index == 0 { String::new() } else { format!("-{}", index + 1) };
    format!("{PICTURES}/{}{number}.png", run.address)
}

/// All files of a plan whose names are known in advance, except the study file.
fn files_of(plan: &Plan) -> impl Iterator<Item = String> {
    let pictures = if plan.study.is_of_scenes() { PICTURED_VIEWS } else { 1 };
    let names = move |run| (0..pictures).map(move |index| picture_name(run, index)).chain([record_name(run)]);
    let runs = plan.runs.iter().flat_map(names);
    [IMAGES, MACHINE, PAGE].into_iter().chain(TABLES).map(str::to_owned).chain(runs)
}

/// The name of the study in a study file.
fn name_of(text: &str) -> Option<String> {
    let table: toml::Table = text.parse().ok()?;
    Some(table.get("name")?.as_str()?.to_owned())
}
