//! The folder that a run writes its results into. One run at a time uses it, and it replaces only
//! files that runs of gs wrote.

mod index;

use std::{
    collections::BTreeSet,
    fs::{self, File, TryLockError},
    io,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use index::Index;

use crate::{
    atomic::{is_temporary, remove_leftovers, write_atomically},
    error::Error,
    inputs::Inputs,
};

/// The lock file of the folder. It remains there; the lock ends with its process.
const LOCK: &str = ".gs-lock";

/// Names the files that a run is going to write into a folder.
///
/// A folder has an index of the files that runs of gs wrote into it (`.gs-files.json`). A run
/// replaces and removes only these. [`check`](Self::check) and [`begin`](Self::begin) fail if a
/// result has the name of another file, so that a command can fail before it computes. Inputs of
/// the run are never replaced.
///
/// ```
/// use gs_io::{FolderClaim, Inputs};
/// # let place = tempfile::tempdir().unwrap();
/// # let (photo, out) = (place.path().join("photo.png"), place.path().join("out"));
/// # std::fs::write(&photo, "").unwrap();
/// # std::fs::create_dir(&out).unwrap();
/// std::fs::write(out.join("notes.txt"), "mine")?;
/// let inputs = Inputs::from_iter([&photo]);
/// let claim = FolderClaim { inputs, ..FolderClaim::new(&out, ["scene.ply"]) };
/// let folder = claim.begin()?;
/// gs_io::write_atomically(folder.file("scene.ply"), |file| file.write_all(b"ply\n"))?;
/// drop(folder);
///
/// assert!(FolderClaim::new(&out, ["scene.ply"]).begin().is_ok());
/// assert!(FolderClaim::new(&out, ["notes.txt"]).begin().is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct FolderClaim {
    /// The folder, which need not exist.
    pub path: PathBuf,
    /// Files that the run may write or remove, by their paths in the folder, with `/`.
    pub files: Vec<String>,
    /// Subfolders for files whose names are not known yet; [`OutputFolder::claim`] adds the names. They
    /// must not contain files that no run of gs wrote.
    pub folders: Vec<String>,
    /// The files that the run reads.
    pub inputs: Inputs,
    /// Whether files that no run of gs wrote may be replaced and removed, except inputs.
    pub overwrite: bool,
}

impl FolderClaim {
    /// A claim to these files in the folder at `path`.
    pub fn new<N: Into<String>>(path: impl Into<PathBuf>, files: impl IntoIterator<Item = N>) -> Self {
        let files = files.into_iter().map(Into::into).collect();
        Self { path: path.into(), files, folders: Vec::new(), inputs: Inputs::default(), overwrite: false }
    }

    /// Whether the run may write or remove the file at this path.
    pub fn claims(&self, path: &Path) -> bool {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let same = |a: &Path, b: &Path| {
            a == b || fs::canonicalize(a).ok().is_some_and(|a| fs::canonicalize(b).ok() == Some(a))
        };
        let name = path.file_name().and_then(|name| name.to_str());
        same(folder, &self.path) && self.files.iter().any(|file| Some(file.as_str()) == name)
    }

    /// Checks whether the run may begin, without changing anything.
    ///
    /// # Errors
    /// [`Error::InTheWay`] for a file that no run of gs wrote, [`Error::IsInput`] for an input of
    /// this run, [`Error::NotAFile`] where a result has the name of a folder, [`Error::Busy`] where
    /// another run uses the folder, [`Error::Write`] where the path is not a folder.
    pub fn check(&self) -> Result<(), Error> {
        match fs::metadata(&self.path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(Error::write(&self.path, error)),
            Ok(found) if !found.is_dir() => {
                return Err(Error::write(&self.path, io::ErrorKind::NotADirectory.into()));
            }
            Ok(_) => {}
        }
        if let Ok(lock) = File::options().write(true).open(self.path.join(LOCK)) {
            self.acquire(&lock)?;
        }
        self.refuse_what_is_in_the_way(&Index::of(&self.path))
    }

    /// Creates the folder if necessary, locks it until the [`OutputFolder`] is dropped, and removes
    /// temporary files of killed runs. A file is added to the index when [`OutputFolder::file`]
    /// returns its path.
    ///
    /// # Errors
    /// Those of [`Self::check`], and [`Error::Write`] where the folder cannot be written to.
    pub fn begin(self) -> Result<OutputFolder, Error> {
        self.check()?;
        fs::create_dir_all(&self.path).map_err(|error| Error::write(&self.path, error))?;
        let lock = File::options().create(true).truncate(false).write(true).open(self.path.join(LOCK));
        let lock = lock.map_err(|error| Error::write(&self.path, error))?;
        self.acquire(&lock)?;
        let parts = self.files.iter().filter_map(|name| Path::new(name).parent().and_then(Path::to_str));
        let mut parts: Vec<&str> = parts.chain([""]).chain(self.folders.iter().map(String::as_str)).collect();
        parts.sort_unstable();
        parts.dedup();
        parts.iter().for_each(|part| remove_leftovers(&self.path.join(part)));
        // Another run may have ended since the check.
        let index = Index::of(&self.path);
        self.refuse_what_is_in_the_way(&index)?;
        let claimed = Mutex::new(self.files.iter().cloned().collect());
        let folder = OutputFolder { claim: self, claimed, index: Mutex::new(index), _lock: lock };
        folder.index().store(folder.path())?;
        Ok(folder)
    }

    fn acquire(&self, lock: &File) -> Result<(), Error> {
        match lock.try_lock() {
            Err(TryLockError::WouldBlock) => Err(Error::Busy { folder: self.path.clone() }),
            // Some file systems have no locks. Results matter more than protection against starting
            // twice.
            Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
        }
    }

    fn refuse_what_is_in_the_way(&self, index: &Index) -> Result<(), Error> {
        self.files.iter().try_for_each(|name| self.refuse(name, index))?;
        for folder in &self.folders {
            let path = self.path.join(folder);
            if path.exists() && !path.is_dir() {
                return Err(Error::write(&path, io::ErrorKind::NotADirectory.into()));
            }
            let entries = fs::read_dir(path).into_iter().flatten().flatten();
            // Temporary files of killed runs are removed when the run begins.
            let names =
                entries.filter_map(|entry| entry.file_name().into_string().ok()).filter(|name| !is_temporary(name));
            let mut names: Vec<String> = names.map(|name| format!("{folder}/{name}")).collect();
            names.sort();
            names.iter().try_for_each(|name| self.refuse(name, index))?;
        }
        Ok(())
    }

    /// Fails if the name belongs to a file that must not be replaced.
    fn refuse(&self, name: &str, index: &Index) -> Result<(), Error> {
        let path = self.path.join(name);
        let Ok(found) = fs::symlink_metadata(&path) else { return Ok(()) };
        self.inputs.guard(&path)?;
        if found.is_dir() {
            return Err(Error::NotAFile { path, found: "a folder", wanted: "another folder for the results" });
        }
        if self.overwrite || index.0.contains(name) { Ok(()) } else { Err(Error::InTheWay { path }) }
    }
}

/// An output folder in use by a run; made by [`FolderClaim::begin`].
#[derive(Debug)]
pub struct OutputFolder {
    claim: FolderClaim,
    /// The files that this run may write. The index has only those that it began to write.
    claimed: Mutex<BTreeSet<String>>,
    index: Mutex<Index>,
    _lock: File,
}

impl OutputFolder {
    /// The folder's path.
    pub fn path(&self) -> &Path {
        &self.claim.path
    }

    /// The path of a claimed file that is about to be written; adds it to the index.
    pub fn file(&self, name: &str) -> PathBuf {
        let mut index = self.index();
        debug_assert!(index.0.contains(name) || self.claims(name), "{name} is written without having been claimed");
        if index.0.insert(name.to_owned()) {
            index.update(self.path());
        }
        self.path().join(name)
    }

    /// Adds claimed files that are about to be written to the index, which is then written once instead of
    /// once for each file. As everywhere, an index that cannot be written is no error.
    pub fn announce(&self, names: impl IntoIterator<Item = String>) {
        let names: Vec<String> = names.into_iter().collect();
        debug_assert!(names.iter().all(|name| self.claims(name)), "not claimed: {names:?}");
        let mut index = self.index();
        let before = index.0.len();
        index.0.extend(names);
        if index.0.len() > before {
            index.update(self.path());
        }
    }

    fn claims(&self, name: &str) -> bool {
        self.lock_claimed().contains(name)
    }

    fn lock_claimed(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.claimed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes a claimed file atomically.
    ///
    /// # Errors
    /// Those of [`write_atomically`].
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> Result<(), Error> {
        write_atomically(self.file(name), |file| file.write_all(content.as_ref()))
    }

    /// Claims further files, whose names were not known at the beginning.
    ///
    /// # Errors
    /// As [`FolderClaim::check`] for these files.
    pub fn claim<N: Into<String>>(&self, names: impl IntoIterator<Item = N>) -> Result<(), Error> {
        let names: Vec<String> = names.into_iter().map(Into::into).collect();
        let index = self.index();
        names.iter().try_for_each(|name| self.claim.refuse(name, &index))?;
        self.lock_claimed().extend(names);
        Ok(())
    }

    /// The claimed and indexed files whose paths in the folder begin with `beginning`.
    pub fn claimed(&self, beginning: &str) -> Vec<String> {
        let mut names: BTreeSet<String> = self.index().0.clone();
        names.extend(self.lock_claimed().iter().cloned());
        names.retain(|name| name.starts_with(beginning));
        names.into_iter().collect()
    }

    /// Removes a file of an earlier run, if it exists.
    ///
    /// # Errors
    /// [`Error::IsInput`], and [`Error::Remove`] where it cannot be removed.
    pub fn remove(&self, name: &str) -> Result<(), Error> {
        debug_assert!(self.claims(name) || self.index().0.contains(name), "{name} has not been claimed");
        let path = self.path().join(name);
        self.claim.inputs.guard(&path)?;
        match fs::remove_file(&path) {
            Err(source) if source.kind() != io::ErrorKind::NotFound => Err(Error::Remove { path, source }),
            _ => Ok(()),
        }
    }

    /// A folder inside for files that are not complete yet, which is removed when it is dropped. Those of
    /// killed runs are removed now: no other run works here.
    #[cfg(feature = "write")]
    pub(crate) fn temporary_folder(&self) -> Result<tempfile::TempDir, Error> {
        let left = fs::read_dir(self.path()).into_iter().flatten().flatten();
        for entry in left.filter(|entry| entry.file_name().to_str().is_some_and(is_temporary)) {
            let _ = fs::remove_dir_all(entry.path());
        }
        crate::atomic::new_temporary_folder(self.path()).map_err(|error| Error::write(self.path(), error))
    }

    /// Removes a folder that was made for this run, which failed, unless there are other files in it.
    #[cfg(feature = "write")]
    pub(crate) fn discard(&self) {
        if !self.index().0.is_empty() {
            return;
        }
        [index::NAME, LOCK].iter().for_each(|name| _ = fs::remove_file(self.path().join(name)));
        let _ = fs::remove_dir(self.path());
    }

    fn index(&self) -> MutexGuard<'_, Index> {
        self.index.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Removes claimed files from the index that were not written.
impl Drop for OutputFolder {
    fn drop(&mut self) {
        self.index().tidy(self.path());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::write_atomically;

    const NONE: [&str; 0] = [];

    fn write(folder: &OutputFolder, name: &str) {
        write_atomically(folder.file(name), |file| file.write_all(b"a run's")).unwrap();
    }

    fn begin(path: &Path, names: &[&str]) -> Result<OutputFolder, Error> {
        FolderClaim::new(path, names.iter().copied()).begin()
    }

    #[test]
    fn half_written_files_of_a_killed_run_do_not_block_a_claim() {
        let place = tempfile::tempdir().unwrap();
        let plots = place.path().join("plots");
        fs::create_dir(&plots).unwrap();
        fs::write(plots.join(".gs-dEaD00.tmp"), "half").unwrap();
        let claim = FolderClaim { folders: vec!["plots".to_owned()], ..FolderClaim::new(place.path(), NONE) };
        claim.check().unwrap();
        fs::write(plots.join("mine.svg"), "mine").unwrap();
        assert!(matches!(claim.begin(), Err(Error::InTheWay { .. })));
    }

    #[test]
    fn a_run_replaces_what_runs_wrote_and_nothing_else() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("made/on/demand");
        let folder = begin(&path, &["scene", "curve"]).unwrap();
        write(&folder, "scene");
        drop(folder);
        // A file that was claimed and never written does not belong to the run.
        let curve = path.join("curve");
        fs::write(&curve, "mine").unwrap();
        assert!(begin(&path, &["scene"]).is_ok());
        let refused = begin(&path, &["scene", "curve"]).unwrap_err();
        assert!(matches!(&refused, Error::InTheWay { path } if *path == curve), "{refused}");
        assert_eq!(fs::read(&curve).unwrap(), b"mine");

        let claim = FolderClaim { overwrite: true, ..FolderClaim::new(&path, ["curve"]) };
        let folder = claim.begin().unwrap();
        folder.remove("curve").unwrap();
        assert!(!curve.exists());
    }

    #[test]
    fn a_killed_run_leaves_no_claim_to_what_it_did_not_begin_to_write() {
        let place = tempfile::tempdir().unwrap();
        let folder = begin(place.path(), &["scene", "curve"]).unwrap();
        write(&folder, "scene");
        // The stored index is what a killed run leaves.
        let stored = Index::of(place.path());
        fs::write(place.path().join("curve"), "mine").unwrap();
        assert_eq!(Index::of(place.path()), stored);
        assert_eq!(stored.0, BTreeSet::from(["scene".to_owned()]));
    }

    #[test]
    fn files_that_were_announced_but_not_written_are_not_claimed() {
        let place = tempfile::tempdir().unwrap();
        let folder = begin(place.path(), &["scene", "curve"]).unwrap();
        folder.announce(["scene", "curve"].map(str::to_owned));
        let stored = || fs::read_to_string(place.path().join(index::NAME)).unwrap();
        assert!(stored().contains("scene") && stored().contains("curve"));
        write(&folder, "scene");
        drop(folder);
        assert!(stored().contains("scene") && !stored().contains("curve"));
    }

    #[test]
    fn a_refusal_leaves_nothing_behind() {
        let place = tempfile::tempdir().unwrap();
        fs::write(place.path().join("scene"), "mine").unwrap();
        begin(place.path(), &["scene"]).unwrap_err();
        FolderClaim::new(place.path().join("scene"), NONE).check().unwrap_err();
        FolderClaim::new(place.path().join("new"), ["scene"]).check().unwrap();
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_input_is_never_replaced() {
        let place = tempfile::tempdir().unwrap();
        let photo = place.path().join("photo");
        let folder = begin(place.path(), &["photo", "views/photo"]).unwrap();
        write(&folder, "photo");
        drop(folder);
        let inputs = Inputs::from_iter([&photo]);
        let claim = FolderClaim { inputs, overwrite: true, ..FolderClaim::new(place.path(), NONE) };
        let refused = FolderClaim { files: vec!["photo".to_owned()], ..claim.clone() }.check().unwrap_err();
        assert!(matches!(refused, Error::IsInput { .. }), "{refused}");
        let folder = claim.begin().unwrap();
        assert!(folder.claim(["photo"]).is_err() && folder.remove("photo").is_err() && photo.exists());
    }

    #[test]
    fn one_run_at_a_time_works_in_a_folder() {
        let place = tempfile::tempdir().unwrap();
        let first = begin(place.path(), &["scene"]).unwrap();
        for refused in [begin(place.path(), &["other"]).map(drop), FolderClaim::new(place.path(), NONE).check()] {
            assert!(matches!(refused, Err(Error::Busy { .. })), "{refused:?}");
        }
        drop(first);
        begin(place.path(), &["other"]).unwrap();
    }

    #[test]
    fn files_of_unknown_names_are_claimed_when_they_are_known() {
        let place = tempfile::tempdir().unwrap();
        let claim = FolderClaim { folders: vec!["plots".to_owned()], ..FolderClaim::new(place.path(), NONE) };
        let folder = claim.clone().begin().unwrap();
        fs::create_dir(place.path().join("plots")).unwrap();
        folder.claim(["plots/a.svg"]).unwrap();
        write(&folder, "plots/a.svg");
        assert_eq!(folder.claimed("plots/"), ["plots/a.svg"]);
        drop(folder);
        claim.check().unwrap();
        fs::write(place.path().join("plots/notes.txt"), "mine").unwrap();
        assert!(claim.check().unwrap_err().to_string().contains("notes.txt"));
        assert!(FolderClaim { overwrite: true, ..claim }.begin().unwrap().claim(["plots/b.svg"]).is_ok());
    }

    #[test]
    fn half_written_files_of_a_killed_run_are_removed() {
        let place = tempfile::tempdir().unwrap();
        fs::create_dir(place.path().join("runs")).unwrap();
        let left = ["runs/.gs-AbC123.tmp", ".gs-x9y8z7.tmp"].map(|name| place.path().join(name));
        let kept = [".gs-notes.tmp", "mine.tmp"].map(|name| place.path().join(name));
        left.iter().chain(&kept).for_each(|path| fs::write(path, "half").unwrap());
        begin(place.path(), &["runs/a.json"]).unwrap();
        assert!(left.iter().all(|path| !path.exists()) && kept.iter().all(|path| path.exists()));
    }

    #[test]
    fn a_folder_in_the_place_of_a_file_is_refused() {
        let place = tempfile::tempdir().unwrap();
        fs::create_dir(place.path().join("scene")).unwrap();
        let claim = FolderClaim { overwrite: true, ..FolderClaim::new(place.path(), ["scene"]) };
        assert!(matches!(claim.check(), Err(Error::NotAFile { found: "a folder", .. })));
    }
}
