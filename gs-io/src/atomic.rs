//! Writing a file so that it is there complete or not at all, and opening one to read.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use crate::error::Error;

/// Writes a file through `content`, which is handed a buffered writer, into a temporary file in the same folder, and renames
/// that to `path` when all of it is written. After a failure the temporary file is gone and what stood at `path` is as before.
///
/// A file that is replaced keeps its permissions; a symbolic link is followed. A device or a pipe, which cannot be replaced,
/// is written to directly.
///
/// ```
/// # let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("curve.csv");
/// gs_io::write_atomically(&path, |file| writeln!(file, "step,loss"))?;
/// assert_eq!(std::fs::read_to_string(&path).unwrap(), "step,loss\n");
/// # Ok::<(), gs_io::Error>(())
/// ```
///
/// # Errors
/// [`Error::NoFolder`], [`Error::NotAFile`] for a folder, [`Error::Write`] with the error of `content` or of the operating system.
pub fn write_atomically(
    path: impl AsRef<Path>,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Error> {
    let path = path.as_ref();
    let failed = |source| Error::write(path, source);
    let replaced = fs::metadata(path).ok();
    match &replaced {
        Some(old) if old.is_dir() => {
            return Err(Error::NotAFile { path: path.to_owned(), found: "a folder", wanted: "a file inside it" });
        }
        Some(old) if !old.is_file() => {
            return File::options().write(true).open(path).and_then(|device| fill(&device, content)).map_err(failed);
        }
        _ => {}
    }
    // Renaming onto a link would replace the link, not the file that it names.
    let target = if replaced.is_some() { fs::canonicalize(path).map_err(failed)? } else { path.to_owned() };
    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return Err(Error::NoFolder { path: path.to_owned(), folder: folder.to_owned() });
    }
    let temporary = Temporary::new(folder).map_err(failed)?;
    fill(temporary.file.as_file(), content).map_err(failed)?;
    if let Some(old) = replaced {
        temporary.file.as_file().set_permissions(old.permissions()).map_err(failed)?;
    }
    temporary.persist(&target).map_err(failed)
}

/// Ends every [`write_atomically`] that is under way, in any thread, as if it had failed: its temporary file is removed, and the
/// thread never returns from it; nor from one that it begins later. For a program that is about to exit at once, such as on a
/// second Ctrl-C: without it, the temporary files would stay behind.
pub fn abandon_writes() {
    let mut under_way = under_way();
    while let Some(path) = under_way.pop_first() {
        // What cannot be removed now cannot be removed at all.
        let _ = fs::remove_file(path);
    }
    // Whoever wants to begin or end a write waits for this lock.
    std::mem::forget(under_way);
}

/// The temporary files that are there.
fn under_way() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    static PATHS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    PATHS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A temporary file that [`abandon_writes`] knows of; removed when dropped.
struct Temporary {
    file: tempfile::NamedTempFile,
    known: Known,
}

/// A path among those of [`under_way`].
struct Known(PathBuf);

impl Temporary {
    fn new(folder: &Path) -> io::Result<Self> {
        let mut under_way = under_way();
        let file = new_temporary(folder)?;
        let known = Known(file.path().to_owned());
        under_way.insert(known.0.clone());
        Ok(Self { file, known })
    }

    /// Gives the file its name.
    fn persist(self, target: &Path) -> io::Result<()> {
        let Self { file, known } = self;
        let not_abandoned = under_way();
        let result = file.persist(target);
        drop(not_abandoned);
        drop(known);
        result.map(drop).map_err(|error| error.error)
    }
}

impl Drop for Known {
    fn drop(&mut self) {
        under_way().remove(&self.0);
    }
}

fn fill(file: &File, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut writer = BufWriter::new(file);
    content(&mut writer)?;
    writer.flush()
}

fn new_temporary(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".gs-").suffix(".tmp");
    // As for any new file, the user's umask decides who may read it; temporary files are private otherwise.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

/// Opens a regular file to read; `wanted` names its kind: "an image file".
pub(crate) fn open(path: &Path, wanted: &'static str) -> Result<(File, fs::Metadata), Error> {
    // Before opening it: opening a pipe without a writer would wait for ever.
    let kind = fs::metadata(path).map_err(|source| Error::read(path, source))?;
    if !kind.is_file() {
        let found = if kind.is_dir() { "a folder" } else { "a pipe or a device" };
        return Err(Error::NotAFile { path: path.to_owned(), found, wanted });
    }
    let file = File::open(path).map_err(|source| Error::read(path, source))?;
    Ok((file, kind))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_in(folder: &Path) -> Vec<std::ffi::OsString> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect()
    }

    #[test]
    fn a_failure_halfway_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, "old").unwrap();
        let error = write_atomically(&path, |file| {
            file.write_all(&[0; 100_000])?;
            Err(io::Error::other("out of ideas"))
        })
        .unwrap_err();
        assert!(error.to_string().contains("out of ideas"), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names_in(folder.path()), ["a"]);
    }

    #[test]
    fn an_old_file_is_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        for text in ["a long first version", "short"] {
            write_atomically(&path, |file| file.write_all(text.as_bytes())).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(names_in(folder.path()), ["a"]);
    }

    #[test]
    fn folders_in_the_way_or_missing_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let nothing = |_: &mut dyn Write| Ok(());
        let error = write_atomically(folder.path(), nothing).unwrap_err();
        assert!(matches!(error, Error::NotAFile { found: "a folder", .. }), "{error}");
        let error = write_atomically(folder.path().join("no/such/file"), nothing).unwrap_err();
        assert!(matches!(&error, Error::NoFolder { folder, .. } if folder.ends_with("no/such")), "{error}");
        assert!(names_in(folder.path()).is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn permissions_and_links_are_kept() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("a"), folder.path().join("link"));
        fs::write(&path, "old").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        write_atomically(&link, |file| file.write_all(b"new")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
        // A new file may be read by whom the umask lets, as one made by `File::create`.
        let (new, plain) = (folder.path().join("new"), folder.path().join("plain"));
        write_atomically(&new, |_| Ok(())).unwrap();
        fs::write(&plain, "").unwrap();
        assert_eq!(fs::metadata(new).unwrap().permissions(), fs::metadata(plain).unwrap().permissions());
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_to_and_stays_a_device() {
        write_atomically("/dev/null", |file| file.write_all(b"gone")).unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }
}
