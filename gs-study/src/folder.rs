//! The folder of a study: one file per run, named by its address, each complete or not there; and what is made of them.

use std::{
    collections::BTreeMap,
    fs::{self, File, TryLockError},
    path::{Path, PathBuf},
};

use gs_core::Image;
use gs_io::{read_image, write_atomically, write_png};

use crate::{
    error::Error,
    machine::Machine,
    plan::{Plan, Run},
    record::{Outcome, Record},
};

const STUDY: &str = "study.toml";
const IMAGES: &str = "images.json";
const MACHINE: &str = "machine.json";
/// Locked as long as someone works in the folder. It stays there; a lock goes with its process, whatever ends that.
const LOCK: &str = ".lock";
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

/// A study's folder.
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    /// Kept from others as long as this is open; nothing where the folder is only read.
    _lock: Option<File>,
}

impl StudyFolder {
    /// Makes the folder for a plan, or opens it to go on. The study is stored in it, so that its rows can be replayed. Until the folder is
    /// dropped, nobody else can prepare it.
    ///
    /// # Errors
    /// [`Error::Folder`] where it holds a study of another name, or any and `existing` refuses it, where someone else works in it, or where
    /// it cannot be written to; [`Error::Io`].
    pub fn prepare(path: &Path, plan: &Plan, existing: Existing) -> Result<Self, Error> {
        let wrong = |what: String, mend: &'static str| Error::Folder { folder: path.to_owned(), what, mend };
        let unwritable =
            |source| wrong(format!("cannot be written to: {source}"), "choose another folder with --output");
        let found = path.join(STUDY);
        if existing == Existing::Refuse && found.exists() {
            let mend = "go on with it with --resume, or choose another folder with --output";
            return Err(wrong("holds a study already".to_owned(), mend));
        }
        if found.exists() {
            let held = fs::read_to_string(&found).ok().and_then(|text| name_of(&text));
            if held.as_ref() != Some(&plan.study.name) {
                let held = held.map_or_else(|| "one that cannot be read".to_owned(), |name| format!("`{name}`"));
                let what = format!("holds another study than `{}`: {held}", plan.study.name);
                return Err(wrong(what, "choose another folder with --output"));
            }
        }
        fs::create_dir_all(path).map_err(unwritable)?;
        let lock = File::create(path.join(LOCK)).map_err(unwritable)?;
        match lock.try_lock() {
            Err(TryLockError::WouldBlock) => {
                let what = "another gs study is at work in it".to_owned();
                return Err(wrong(what, "wait for it, or choose another folder with --output"));
            }
            // Some file systems know no locks. A study is worth more than a guard against starting it twice.
            Ok(()) | Err(TryLockError::Error(_)) => {}
        }
        let folder = Self { path: path.to_owned(), _lock: Some(lock) };
        for part in [folder.file(RUNS), folder.file(PICTURES)] {
            fs::create_dir_all(&part).map_err(unwritable)?;
            sweep(&part);
        }
        let images = plan.targets.iter().filter_map(|target| Some((&target.name, target.file.as_ref()?)));
        let found: BTreeMap<&String, PathBuf> =
            images.map(|(name, file)| (name, fs::canonicalize(file).unwrap_or_else(|_| file.clone()))).collect();
        let found = serde_json::to_string_pretty(&found).unwrap_or_default();
        folder.write(IMAGES, &(found + "\n"))?;
        let machine = serde_json::to_string_pretty(&plan.machine).unwrap_or_default();
        folder.write(MACHINE, &(machine + "\n"))?;
        folder.write(STUDY, &to_toml(plan)?)?;
        Ok(folder)
    }

    /// The folder of a study that has been run, to read it.
    ///
    /// # Errors
    /// [`Error::Folder`] where there is none.
    pub fn open(path: &Path) -> Result<Self, Error> {
        match path.join(STUDY).is_file() {
            true => Ok(Self { path: path.to_owned(), _lock: None }),
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
        let text = fs::read(self.record_file(run)).ok()?;
        let record: Record = serde_json::from_slice(&text).ok()?;
        (record.address == run.address).then_some(record)
    }

    /// Whether the run needs not be done again.
    pub fn is_finished(&self, run: &Run) -> bool {
        self.record(run).is_some_and(|record| matches!(record.outcome, Outcome::Finished(_)))
    }

    /// Stores what came of a run.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn store(&self, run: &Run, record: &Record) -> Result<(), Error> {
        let json = serde_json::to_vec(record).map_err(std::io::Error::other);
        Ok(write_atomically(self.record_file(run), |file| file.write_all(&json?))?)
    }

    /// Stores the picture of a run's scene.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn store_picture(&self, run: &Run, picture: &Image) -> Result<(), Error> {
        Ok(write_png(self.picture_file(run), picture)?)
    }

    /// The picture of a run's scene, where it was stored.
    pub fn picture(&self, run: &Run) -> Option<Image> {
        Some(read_image(self.picture_file(run)).ok()?.image)
    }

    /// Writes a text into it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, name: &str, text: &str) -> Result<(), Error> {
        Ok(write_atomically(self.file(name), |file| file.write_all(text.as_bytes()))?)
    }

    fn record_file(&self, run: &Run) -> PathBuf {
        self.file(RUNS).join(format!("{}.json", run.address))
    }

    fn picture_file(&self, run: &Run) -> PathBuf {
        self.file(PICTURES).join(format!("{}.png", run.address))
    }
}

fn to_toml(plan: &Plan) -> Result<String, Error> {
    toml::to_string(&plan.study).map_err(|error| plan.study.wrong(error.to_string(), "leave it out"))
}

/// The name of a study, by its file.
fn name_of(text: &str) -> Option<String> {
    let table: toml::Table = text.parse().ok()?;
    Some(table.get("name")?.as_str()?.to_owned())
}

/// Takes away what a killed program was writing. What cannot be taken away does no harm.
fn sweep(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.path().extension().is_some_and(|extension| extension == "tmp") {
            let _ = fs::remove_file(entry.path());
        }
    }
}
