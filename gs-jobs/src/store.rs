//! Where the files of jobs are: records, claims, checkpoints and pictures, in a folder on a file
//! system that all processes see.
//!
//! Claims build on three properties: only one process can create a file, a written file appears
//! whole, and one clock sets the times of all files.

use std::{
    fs::{self, File},
    io::{self, BufWriter, ErrorKind, Read, Seek, SeekFrom, Write},
    path::PathBuf,
    time::SystemTime,
};

use crate::{error::Error, system};

/// Longest file that is read with its time, bytes.
const MOST_BYTES: u64 = 4096;

/// The place of the files of jobs. Names are relative to its folder, with `/`.
#[derive(Debug, Clone)]
pub struct JobStore {
    path: PathBuf,
}

/// The content of a file, called once.
pub type Content<'a> = dyn FnMut(&mut dyn Write) -> io::Result<()> + 'a;

/// What a written file must survive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// The end of the process.
    AfterCrash,
    /// The end of the machine.
    AfterPowerCut,
}

/// Whether a process holds the lock of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Locked {
    /// This process holds it.
    Yes,
    /// It does not, or the file system has no locks.
    No,
}

/// A small file of any process.
#[derive(Debug)]
pub(crate) struct Seen {
    /// The content.
    pub(crate) content: Vec<u8>,
    /// When it was last written, by the clock of [`JobStore::now`]; `None` where that is not known.
    pub(crate) written: Option<SystemTime>,
    /// The open file, where it can be opened.
    file: Option<File>,
}

impl Seen {
    /// Whether nobody holds the lock of the file.
    pub(crate) fn is_free(&self) -> bool {
        self.file.as_ref().is_some_and(|file| file.try_lock_shared().is_ok())
    }
}

impl JobStore {
    /// A store in a folder, which need not exist yet.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { path: folder.into() }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Creates a file; `None` where there is one of this name. Of all processes that try, one
    /// succeeds. `content` is told whether the file is locked, as far as the file system has locks; a
    /// call must not give the same bytes as any other.
    pub(crate) fn create(&self, name: &str, content: impl Fn(Locked) -> Vec<u8>) -> Result<Option<OwnFile>, Error> {
        let path = self.file(name);
        // Atomic on local file systems, and on NFS since version 3.
        let file = match File::options().read(true).write(true).create_new(true).open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(None),
            Err(source) => return Err(cannot_write(path, source)),
        };
        // Locked before the content says so. Where there are no locks, times alone decide.
        let locked = if file.try_lock().is_ok() { Locked::Yes } else { Locked::No };
        let own = OwnFile { file, locked };
        own.rewrite(&content(locked)).map_err(|source| cannot_write(path, source))?;
        Ok(Some(own))
    }

    /// Whether there is a file of this name.
    pub fn has(&self, name: &str) -> bool {
        fs::symlink_metadata(self.file(name)).is_ok()
    }

    /// A small file with its time; `None` where there is none.
    pub(crate) fn look(&self, name: &str) -> Option<Seen> {
        // Opening the file makes an NFS client ask the server for its time and content.
        let opened = File::open(self.file(name)).and_then(|file| {
            let written = Some(file.metadata()?.modified()?);
            let mut content = Vec::new();
            (&file).take(MOST_BYTES).read_to_end(&mut content)?;
            Ok(Seen { content, written, file: Some(file) })
        });
        match opened {
            Ok(seen) => Some(seen),
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            // Windows lets nobody read a locked file.
            Err(_) => Some(Seen { content: Vec::new(), written: None, file: None }),
        }
    }

    /// The content of a file; `None` where there is none.
    ///
    /// # Errors
    /// [`Error::Path`].
    pub fn read(&self, name: &str) -> Result<Option<Vec<u8>>, Error> {
        unless_missing(fs::read(self.file(name)), || self.file(name))
    }

    /// The last bytes of a file, or all of a shorter one; `None` where there is none.
    ///
    /// # Errors
    /// [`Error::Path`].
    pub fn end(&self, name: &str, bytes: usize) -> Result<Option<Vec<u8>>, Error> {
        let read = || {
            let mut file = File::open(self.file(name))?;
            let start = file.metadata()?.len().saturating_sub(bytes as u64);
            file.seek(SeekFrom::Start(start))?;
            let mut end = Vec::new();
            file.read_to_end(&mut end)?;
            Ok(end)
        };
        unless_missing(read(), || self.file(name))
    }

    /// Writes a file, or replaces it whole: a temporary file is renamed.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write(&self, name: &str, keep: Keep, content: &mut Content<'_>) -> Result<(), Error> {
        let path = self.file(name);
        let folder = path.parent().unwrap_or(&self.path);
        let mut written = || {
            if !folder.is_dir() {
                let what = format!("there is no folder {}", folder.display());
                return Err(io::Error::new(ErrorKind::NotFound, what));
            }
            let mut file = tempfile::Builder::new().prefix(".gs-").suffix(".tmp").tempfile_in(folder)?;
            let mut buffered = BufWriter::new(file.as_file_mut());
            content(&mut buffered)?;
            buffered.flush()?;
            drop(buffered);
            if keep == Keep::AfterPowerCut {
                file.as_file().sync_all()?;
            }
            file.persist(&path)?;
            if keep == Keep::AfterPowerCut {
                // Not all systems can synchronise a folder; the file itself is safe anyway.
                let _ = File::open(folder).and_then(|folder| folder.sync_all());
            }
            Ok(())
        };
        written().map_err(|source| cannot_write(path.clone(), source))
    }

    /// Removes a file, if there is one.
    ///
    /// # Errors
    /// [`Error::Path`].
    pub fn remove(&self, name: &str) -> Result<(), Error> {
        unless_missing(fs::remove_file(self.file(name)), || self.file(name)).map(drop)
    }

    /// The names of the files in a folder, without the folder.
    ///
    /// # Errors
    /// [`Error::Path`].
    pub fn names(&self, folder: &str) -> Result<Vec<String>, Error> {
        let path = self.file(folder);
        let list = || fs::read_dir(&path)?.map(|entry| Ok(entry?.file_name().into_string().ok())).collect();
        let names: io::Result<Vec<Option<String>>> = list();
        // Names that are not text are not of jobs.
        Ok(names.map_err(|source| Error::Path { path, source })?.into_iter().flatten().collect())
    }

    /// The time of a file that is written now, by the clock that sets the times of files. A time that
    /// is too early makes claims seem younger, so none expires too soon.
    pub(crate) fn now(&self, folder: &str) -> Result<SystemTime, Error> {
        let path = self.file(folder).join(format!("{}.now", system::token()));
        let made = File::create_new(&path).and_then(|mut file| {
            file.write_all(b"now")?;
            flush_to_server(&file)?;
            file.metadata()?.modified()
        });
        let _ = fs::remove_file(&path);
        made.map_err(|source| cannot_write(path, source))
    }

    /// Names those processes that see each other's locks.
    pub(crate) fn system(&self) -> String {
        system::identity(&self.path)
    }
}

/// A file that this process has created, and that no other writes to. It is locked, where it can be,
/// until this is dropped.
#[derive(Debug)]
pub(crate) struct OwnFile {
    file: File,
    locked: Locked,
}

impl OwnFile {
    /// Whether it is locked.
    pub(crate) fn locked(&self) -> Locked {
        self.locked
    }

    /// Replaces the content by one of the same length, which also renews the file's time: in place,
    /// with one write, so that others always find a whole content.
    pub(crate) fn rewrite(&self, content: &[u8]) -> io::Result<()> {
        let mut writer = &self.file;
        writer.seek(SeekFrom::Start(0))?;
        writer.write_all(content)?;
        flush_to_server(&self.file)
    }
}

/// Makes an NFS client send what was written, so that other machines see it. Closing a descriptor
/// does this, while synchronising would also wait for the disk.
fn flush_to_server(file: &File) -> io::Result<()> {
    file.try_clone().map(drop)
}

fn unless_missing<T>(result: io::Result<T>, path: impl Fn() -> PathBuf) -> Result<Option<T>, Error> {
    match result {
        Ok(found) => Ok(Some(found)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(source) => Err(Error::Path { path: path(), source }),
    }
}

fn cannot_write(path: PathBuf, source: io::Error) -> Error {
    Error::Write { path, source }
}
