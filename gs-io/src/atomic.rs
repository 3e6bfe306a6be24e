//! Atomic writing of files, and opening files to read.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    io::{self, BufWriter, Read, Write},
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use crate::error::Error;

/// Writes a file so that it is there complete or not at all. `content` writes into a temporary file
/// in the same folder, which is then renamed to `path`. After a failure, the temporary file is
/// removed and the file at `path` is unchanged.
///
/// A file that is replaced keeps its permissions; symbolic links are followed. Devices and pipes
/// are written to directly.
///
/// A power cut soon afterwards may lose the file, and the replaced one too. Use [`write_durably`]
/// for files that cannot be made again.
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
/// [`Error::NoFolder`], [`Error::NotAFile`] for a folder, [`Error::Write`] with the error of
/// `content` or of the operating system.
pub fn write_atomically(
    path: impl AsRef<Path>,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Error> {
    write(path.as_ref(), &mut once(content), Durability::Usual)
}

/// Writes a file as [`write_atomically`] does, but a power cut leaves either the old file or the
/// new one. The file is synchronised to the disk before it replaces the old one, and the folder,
/// where the system supports it, before this returns. That takes milliseconds per file.
///
/// # Errors
/// Those of [`write_atomically`].
pub fn write_durably(
    path: impl AsRef<Path>,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Error> {
    write(path.as_ref(), &mut once(content), Durability::PowerCut)
}

/// What a written file must survive.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Durability {
    /// The end of the process.
    Usual,
    /// The end of the machine.
    PowerCut,
}

/// The content of a file, called once. A trait object, so that [`write`] is compiled once.
type Content<'a> = dyn FnMut(&mut dyn Write) -> io::Result<()> + 'a;

fn once(content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> impl FnMut(&mut dyn Write) -> io::Result<()> {
    let mut content = Some(content);
    move |file| content.take().expect("a file is written once")(file)
}

fn write(path: &Path, content: &mut Content<'_>, durability: Durability) -> Result<(), Error> {
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
    // Renaming onto a link would replace the link instead of the file that it leads to.
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

/// Synchronises a folder to the disk. Some file systems do not support this; the file itself is
/// safe anyway.
#[cfg(unix)]
fn sync_folder(folder: &Path) {
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
}

#[cfg(not(unix))]
fn sync_folder(_: &Path) {}

/// Creates a folder, checks that files can be written into it, and removes leftovers as
/// [`remove_leftovers`] does.
///
/// # Errors
/// [`Error::Write`] where the folder cannot be created or written to.
pub fn prepare_folder(folder: &Path) -> Result<(), Error> {
    let made = fs::create_dir_all(folder).and_then(|()| Temporary::new(folder));
    made.map_err(|source| Error::write(folder, source))?;
    remove_leftovers(folder);
    Ok(())
}

/// Removes the temporary files of processes that were killed while writing. Those of running
/// processes are locked and stay. Files that cannot be removed are ignored.
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

/// Cancels all writes in progress, in all threads, for a program that exits at once, such as on a
/// second Ctrl-C. Their temporary files are removed. Threads never return from a cancelled write,
/// nor from one that begins later.
pub fn abandon_writes() {
    let mut under_way = under_way();
    while let Some(path) = under_way.pop_first() {
        // Nothing more can be done about a file that cannot be removed.
        let _ = fs::remove_file(path);
    }
    // Threads that begin or end a write wait for this lock.
    std::mem::forget(under_way);
}

/// The existing temporary files of this process.
fn under_way() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    static PATHS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    PATHS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A temporary file that is registered for [`abandon_writes`]; removed when dropped.
struct Temporary {
    file: tempfile::NamedTempFile,
    known: Known,
}

/// A registered path in [`under_way`].
struct Known(PathBuf);

impl Temporary {
    fn new(folder: &Path) -> io::Result<Self> {
        let mut under_way = under_way();
        let file = loop {
            let file = new_temporary(folder)?;
            // Another process may have removed the file before it was locked.
            let locked = file.as_file().lock();
            if locked.is_err() || file.path().exists() {
                break file;
            }
        };
        let known = Known(file.path().to_owned());
        under_way.insert(known.0.clone());
        Ok(Self { file, known })
    }

    /// Renames the file to its final name.
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

fn fill(file: &File, content: &mut Content<'_>) -> io::Result<()> {
    let mut writer = BufWriter::new(file);
    content(&mut writer)?;
    writer.flush()
}

/// Names of temporary files: prefix, number of random letters and digits, suffix.
const TEMPORARY: (&str, usize, &str) = (".gs-", 6, ".tmp");

/// Whether this is the name of a temporary file of [`write_atomically`].
pub(crate) fn is_temporary(name: &str) -> bool {
    let (prefix, drawn, suffix) = TEMPORARY;
    let middle = name.strip_prefix(prefix).and_then(|name| name.strip_suffix(suffix));
    middle.is_some_and(|middle| middle.len() == drawn && middle.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

/// A temporary folder in another, with the name of a temporary file.
#[cfg(feature = "write")]
pub(crate) fn new_temporary_folder(folder: &Path) -> io::Result<tempfile::TempDir> {
    let (prefix, drawn, suffix) = TEMPORARY;
    tempfile::Builder::new().prefix(prefix).rand_bytes(drawn).suffix(suffix).tempdir_in(folder)
}

fn new_temporary(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    let (prefix, drawn, suffix) = TEMPORARY;
    builder.prefix(prefix).rand_bytes(drawn).suffix(suffix);
    // The user's umask decides who may read it, as for any new file; temporary files are private
    // otherwise.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

/// Reads a regular file; `wanted` names its kind: "an image file".
pub(crate) fn read_file(path: &Path, wanted: &'static str) -> Result<Vec<u8>, Error> {
    let (mut file, metadata) = open(path, wanted)?;
    read_exactly(&mut file, metadata.len()).map_err(|source| Error::read(path, source))
}

/// Reads exactly `bytes` bytes. Running out of memory is an error.
pub(crate) fn read_exactly(file: &mut impl Read, bytes: u64) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    let len = usize::try_from(bytes).map_err(|_| io::ErrorKind::OutOfMemory)?;
    content.try_reserve_exact(len).map_err(|_| io::ErrorKind::OutOfMemory)?;
    file.take(bytes).read_to_end(&mut content)?;
    if content.len() < len {
        return Err(io::ErrorKind::UnexpectedEof.into()); // it shrank since its length was read
    }
    Ok(content)
}

/// Opens a regular file to read; `wanted` names its kind: "an image file".
pub(crate) fn open(path: &Path, wanted: &'static str) -> Result<(File, fs::Metadata), Error> {
    // Checked before opening, because opening a pipe without a writer waits forever.
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
        // The umask decides who may read a new file, as with `File::create`.
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
