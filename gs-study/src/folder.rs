//! The folder of a study: one file per run, named by its address, each complete or not there; and what is made of them.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use gs_core::Image;
use gs_io::{read_image, write_atomically, write_png};

use crate::{
    error::Error,
    plan::{Plan, Run},
    record::{Outcome, Record},
};

const STUDY: &str = "study.toml";
const IMAGES: &str = "images.json";
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
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StudyFolder(PathBuf);

impl StudyFolder {
    /// Makes the folder for a plan, or opens it to go on. The study is stored in it, so that its rows can be replayed.
    ///
    /// # Errors
    /// [`Error::Folder`] where it holds a study and `existing` refuses it, or cannot be written to; [`Error::Io`].
    pub fn prepare(path: &Path, plan: &Plan, existing: Existing) -> Result<Self, Error> {
        let folder = Self(path.to_owned());
        if existing == Existing::Refuse && folder.file(STUDY).exists() {
            let what = "holds a study already".to_owned();
            let mend = "go on with it with --resume, or choose another folder with --output";
            return Err(Error::Folder { folder: folder.0, what, mend });
        }
        for part in [folder.file(RUNS), folder.file(PICTURES)] {
            fs::create_dir_all(&part).map_err(|source| Error::Folder {
                folder: folder.0.clone(),
                what: format!("cannot be written to: {source}"),
                mend: "choose another folder with --output",
            })?;
            sweep(&part);
        }
        let images = plan.targets.iter().filter_map(|target| Some((&target.name, target.file.as_ref()?)));
        let found: BTreeMap<&String, PathBuf> =
            images.map(|(name, file)| (name, fs::canonicalize(file).unwrap_or_else(|_| file.clone()))).collect();
        let found = serde_json::to_string_pretty(&found).unwrap_or_default();
        folder.write(IMAGES, &(found + "\n"))?;
        folder.write(STUDY, &to_toml(plan)?)?;
        Ok(folder)
    }

    /// The folder of a study that has been run.
    ///
    /// # Errors
    /// [`Error::Folder`] where there is none.
    pub fn open(path: &Path) -> Result<Self, Error> {
        match path.join(STUDY).is_file() {
            true => Ok(Self(path.to_owned())),
            false => Err(Error::Folder {
                folder: path.to_owned(),
                what: format!("holds no study: there is no {STUDY} in it"),
                mend: "name the --output of a gs study",
            }),
        }
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// A file in it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Where the study found its images, for [`Places::remembered`](crate::Places::remembered); nothing where it does not say.
    pub fn images(&self) -> BTreeMap<String, PathBuf> {
        fs::read(self.file(IMAGES)).ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default()
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

/// Takes away what a killed program was writing. What cannot be taken away does no harm.
fn sweep(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.path().extension().is_some_and(|extension| extension == "tmp") {
            let _ = fs::remove_file(entry.path());
        }
    }
}
