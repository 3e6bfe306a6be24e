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
/// A power cut soon after may take the file with it, the old one included: [`write_durably`] is for what cannot be made again.
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
    write(path.as_ref(), content, Durability::Usual)
}

/// As [`write_atomically`], for files that took long to compute: after a power cut there is the old file or the new one, whole. The
/// new one is on the disk before it replaces the old one, and the folder, where the system lets it, before this returns. That takes
/// milliseconds for each file.
///
/// # Errors
/// Those of [`write_atomically`].
pub fn write_durably(
    path: impl AsRef<Path>,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Error> {
    write(path.as_ref(), content, Durability::PowerCut)
}

/// What a file that has been written outlasts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Durability {
    /// The end of the process, however it comes.
    Usual,
    /// The end of the machine, too.
    PowerCut,
}

fn write(
    path: &Path,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    durability: Durability,
) -> Result<(), Error> {
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
    if durability == Durability::PowerCut {
        temporary.file.as_file().sync_all().map_err(failed)?;
    }
    temporary.persist(&target).map_err(failed)?;
    if durability == Durability::PowerCut {
        sync_folder(folder);
    }
    Ok(())
}

/// Has the names in a folder on the disk. Some file systems cannot; the file itself is there then, too.
#[cfg(unix)]
fn sync_folder(folder: &Path) {
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
}

#[cfg(not(unix))]
fn sync_folder(_: &Path) {}

/// Makes a folder that files are written into later, and finds out whether it takes any; removes what [`remove_leftovers`] does.
///
/// # Errors
/// [`Error::Write`] where it cannot be made or takes no files.
pub fn prepare_folder(folder: &Path) -> Result<(), Error> {
    let made = fs::create_dir_all(folder).and_then(|()| Temporary::new(folder));
    made.map_err(|source| Error::write(folder, source))?;
    remove_leftovers(folder);
    Ok(())
}

/// Removes from a folder the temporary files of processes that were killed while they wrote. Those that a living process is writing
/// stay: they are locked. What cannot be removed does no harm.
pub fn remove_leftovers(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if !entry.file_name().to_str().is_some_and(is_temporary) || !entry.file_type().is_ok_and(|kind| kind.is_file())
        {
            continue;
        }
        let Ok(file) = File::options().write(true).open(entry.path()) else { continue };
        if file.try_lock().is_ok() {
            let _ = fs::remove_file(entry.path());
        }
    }
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
        let file = loop {
            let file = new_temporary(folder)?;
            // Whoever removes leftovers may have met it before it was locked.
            let locked = file.as_file().lock();
            if locked.is_err() || file.path().exists() {
                break file;
            }
        };
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

/// What the names of temporary files begin with, have in between (letters and digits, drawn), and end with.
const TEMPORARY: (&str, usize, &str) = (".gs-", 6, ".tmp");

/// Whether a file name is that of a temporary file of [`write_atomically`].
pub(crate) fn is_temporary(name: &str) -> bool {
    let (prefix, drawn, suffix) = TEMPORARY;
    let middle = name.strip_prefix(prefix).and_then(|name| name.strip_suffix(suffix));
    middle.is_some_and(|middle| middle.len() == drawn && middle.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

fn new_temporary(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    let (prefix, drawn, suffix) = TEMPORARY;
    builder.prefix(prefix).rand_bytes(drawn).suffix(suffix);
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

    #[test]
    fn leftovers_of_the_dead_go_and_those_of_the_living_stay() {
        let folder = tempfile::tempdir().unwrap();
        let (left, path) = (folder.path().join(".gs-dEaD00.tmp"), folder.path().join("a"));
        fs::write(&left, "half").unwrap();
        write_durably(&path, |file| {
            file.write_all(b"whole")?;
            assert_eq!(names_in(folder.path()).len(), 2);
            remove_leftovers(folder.path());
            let names = names_in(folder.path());
            assert!(!left.exists() && names.len() == 1 && is_temporary(names[0].to_str().unwrap()), "{names:?}");
            Ok(())
        })
        .unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "whole");
        assert_eq!(names_in(folder.path()), ["a"]);
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
