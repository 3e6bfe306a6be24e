//! The files of jobs in a folder, on a file system that all processes see.

use std::{
    fs::{self, File},
    io::{self, BufWriter, ErrorKind, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    time::SystemTime,
};

use super::{Content, JobStore, Keep, Locked, OwnFile, Seen};
use crate::{error::Error, system};

/// Longest file that is read with its time, bytes.
const MOST_BYTES: u64 = 4096;

/// A folder.
#[derive(Debug)]
pub struct FolderStore {
    path: PathBuf,
}

impl FolderStore {
    /// A store in a folder, which need not exist yet.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned() }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }
}

impl JobStore for FolderStore {
    fn create(&self, name: &str, content: &dyn Fn(Locked) -> Vec<u8>) -> Result<Option<Box<dyn OwnFile>>, Error> {
        let path = self.file(name);
        // Atomic on local file systems, and on NFS since version 3.
        let file = match File::options().read(true).write(true).create_new(true).open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(None),
            Err(source) => return Err(cannot_write(path, source)),
        };
        // Locked before the content says so. Where there are no locks, times alone decide.
        let locked = if file.try_lock().is_ok() { Locked::Yes } else { Locked::No };
        let own = OpenFile { file, locked };
        own.rewrite(&content(locked)).map_err(|source| cannot_write(path, source))?;
        Ok(Some(Box::new(own)))
    }

    fn has(&self, name: &str) -> Result<bool, Error> {
        Ok(fs::symlink_metadata(self.file(name)).is_ok())
    }

    fn look(&self, name: &str) -> Result<Option<Seen>, Error> {
        // Opening the file makes an NFS client ask the server for its time and content.
        let opened = File::open(self.file(name)).and_then(|file| {
            let written = Some(file.metadata()?.modified()?);
            let mut content = Vec::new();
            (&file).take(MOST_BYTES).read_to_end(&mut content)?;
            Ok(Seen { content, written, file: Some(file) })
        });
        match opened {
            Ok(seen) => Ok(Some(seen)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            // Windows lets nobody read a locked file.
            Err(_) => Ok(Some(Seen { content: Vec::new(), written: None, file: None })),
        }
    }

    fn read(&self, name: &str) -> Result<Option<Vec<u8>>, Error> {
        unless_missing(fs::read(self.file(name)), || self.file(name))
    }

    fn end(&self, name: &str, bytes: usize) -> Result<Option<Vec<u8>>, Error> {
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

    /// Into a temporary file, which is then renamed.
    fn write(&self, name: &str, keep: Keep, content: &mut Content<'_>) -> Result<(), Error> {
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

    fn remove(&self, name: &str) -> Result<(), Error> {
        unless_missing(fs::remove_file(self.file(name)), || self.file(name)).map(drop)
    }

    fn names(&self, folder: &str) -> Result<Vec<String>, Error> {
        let path = self.file(folder);
        let list = || fs::read_dir(&path)?.map(|entry| Ok(entry?.file_name().into_string().ok())).collect();
        let names: io::Result<Vec<Option<String>>> = list();
        // Names that are not text are not of jobs.
        Ok(names.map_err(|source| Error::Path { path, source })?.into_iter().flatten().collect())
    }

    /// The time of a file that is written now.
    fn now(&self, folder: &str) -> Result<SystemTime, Error> {
        let path = self.file(folder).join(format!("{}.now", system::token()));
        let made = File::create_new(&path).and_then(|mut file| {
            file.write_all(b"now")?;
            flush_to_server(&file)?;
            file.metadata()?.modified()
        });
        let _ = fs::remove_file(&path);
        made.map_err(|source| cannot_write(path, source))
    }

    fn system(&self) -> Option<String> {
        Some(system::identity(&self.path))
    }
}

/// A file that stays open.
#[derive(Debug)]
struct OpenFile {
    file: File,
    locked: Locked,
}

impl OwnFile for OpenFile {
    fn locked(&self) -> Locked {
        self.locked
    }

    /// In place, with one write, so that others always find a whole content.
    fn rewrite(&self, content: &[u8]) -> io::Result<()> {
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
