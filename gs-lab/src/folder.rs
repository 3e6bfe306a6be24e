//! The folder of a study: one file per run, named by its address, each complete or not there; and what is made of them.

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
    record::{Outcome, Record},
    report::{PAGE, PLOTS},
};

const STUDY: &str = "study.toml";
const IMAGES: &str = "images.json";
const MACHINE: &str = "machine.json";
const RUNS: &str = "runs";
const PICTURES: &str = "pictures";

/// What is to be done about results that are there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// They are those of another study, or of this one and forgotten about: an error.
    Refuse,
    /// They are taken over; runs that failed are tried again.
    Resume,
}

/// What a study must leave as it is, besides files that no run wrote.
#[derive(Debug, Clone, Default)]
pub struct Safety {
    /// Files that are read; the images of the study are among them anyhow.
    pub inputs: Vec<PathBuf>,
    /// Whether files are replaced that no run wrote and that have the name of a result.
    pub overwrite: bool,
}

/// A study's folder.
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    /// Kept from others as long as this is open; nothing where the folder is only read.
    output: Option<OutputFolder>,
}

impl StudyFolder {
    /// Makes the folder for a plan, or opens it to go on. The study is stored in it, so that its rows can be replayed. Until the folder is
    /// dropped, nobody else can prepare it.
    ///
    /// # Errors
    /// [`Error::Folder`] where it holds a study of another name, or any and `existing` refuses it, or where it cannot be written to;
    /// [`Error::Io`] where a file is in the way, where someone else works in the folder, and for files.
    pub fn prepare(path: &Path, plan: &Plan, existing: Existing) -> Result<Self, Error> {
        Self::prepare_with(path, plan, existing, &Safety::default())
    }

    /// The same, with further files that must stay as they are, or with less care.
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
        let images = plan.targets.iter().filter_map(|target| Some((&target.name, target.file.as_ref()?)));
        let inputs = Inputs::from_iter(images.clone().map(|(_, file)| file).chain(&safety.inputs));
        // A study that is taken from its own folder is there already.
        let is_input = inputs.contain(&study);
        // Until there were indices, the study's file told whose the other files are.
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
        let found: BTreeMap<&String, PathBuf> =
            images.map(|(name, file)| (name, fs::canonicalize(file).unwrap_or_else(|_| file.clone()))).collect();
        let found = serde_json::to_string_pretty(&found).unwrap_or_default();
        folder.write(IMAGES, &(found + "\n"))?;
        let machine = serde_json::to_string_pretty(&plan.machine).unwrap_or_default();
        folder.write(MACHINE, &(machine + "\n"))?;
        if !is_input {
            folder.write(STUDY, &to_toml(plan)?)?;
        }
        Ok(folder)
    }

    /// The folder of a study that has been run, to read it.
    ///
    /// # Errors
    /// [`Error::Folder`] where there is none.
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

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A file in it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Where the study found its images, for [`Places::remembered`](crate::Places::remembered); nothing where it does not say.
    pub fn images(&self) -> BTreeMap<String, PathBuf> {
        fs::read(self.file(IMAGES)).ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
    }

    /// What the study was last conducted on; nothing where it does not say.
    pub fn machine(&self) -> Option<Machine> {
        serde_json::from_slice(&fs::read(self.file(MACHINE)).ok()?).ok()
    }

    /// The file of the study itself.
    pub fn study_file(&self) -> PathBuf {
        self.file(STUDY)
    }

    /// What is stored of a run. A file that is not this run's record is as good as none.
    pub fn record(&self, run: &Run) -> Option<Record> {
        let text = fs::read(self.file(&record_name(run))).ok()?;
        let record: Record = serde_json::from_slice(&text).ok()?;
        (record.address == run.address).then_some(record)
    }

    /// Whether the run needs not be done again.
    pub fn is_finished(&self, run: &Run) -> bool {
        self.record(run).is_some_and(|record| matches!(record.outcome, Outcome::Finished(_)))
    }

    /// Stores what came of a run so that it outlasts a power cut: it takes seconds or minutes to compute, and milliseconds to have on
    /// the disk.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn store(&self, run: &Run, record: &Record) -> Result<(), Error> {
        let json = serde_json::to_vec(record).map_err(std::io::Error::other);
        Ok(write_durably(self.file_to_write(&record_name(run)), |file| file.write_all(&json?))?)
    }

    /// Stores the picture of a run's scene. A power cut may take it: the report then leaves it out.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn store_picture(&self, run: &Run, picture: &Image) -> Result<(), Error> {
        Ok(write_png(self.file_to_write(&picture_name(run)), picture)?)
    }

    /// The picture of a run's scene, where it was stored.
    pub fn picture(&self, run: &Run) -> Option<Image> {
        Some(read_image(self.file(&picture_name(run))).ok()?.image)
    }

    /// Writes a text into it.
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

    /// A file that is about to be written, which the folder's index has from now on.
    pub(crate) fn file_to_write(&self, name: &str) -> PathBuf {
        self.output.as_ref().map_or_else(|| self.file(name), |output| output.file(name))
    }
}

fn record_name(run: &Run) -> String {
    format!("{RUNS}/{}.json", run.address)
}

fn picture_name(run: &Run) -> String {
    format!("{PICTURES}/{}.png", run.address)
}

/// All files of a plan whose names are known before it is conducted, but that of the study itself.
fn files_of(plan: &Plan) -> impl Iterator<Item = String> {
    let runs = plan.runs.iter().flat_map(|run| [record_name(run), picture_name(run)]);
    [IMAGES, MACHINE, PAGE].into_iter().chain(TABLES).map(str::to_owned).chain(runs)
}

fn to_toml(plan: &Plan) -> Result<String, Error> {
    toml::to_string(&plan.study).map_err(|error| plan.study.wrong(error.to_string(), "leave it out"))
}

/// The name of a study, by its file.
fn name_of(text: &str) -> Option<String> {
    let table: toml::Table = text.parse().ok()?;
    Some(table.get("name")?.as_str()?.to_owned())
}
