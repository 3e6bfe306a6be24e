//! Where the files of jobs are: records, claims, checkpoints and pictures.
//!
//! This is all that jobs need of the place, and all that claims build
//! on: a file that only one process can create, files that appear whole, and times that one clock has set.

mod address;
mod folder;
#[cfg(feature = "object-store")]
mod objects;
#[cfg(feature = "object-store-tests")]
pub mod test_server;
#[cfg(all(test, feature = "object-store-tests"))]
mod tests;

use std::{
    fmt,
    fs::File,
    io::{self, Write},
    path::Path,
    sync::Arc,
    time::SystemTime,
};

pub use self::address::StoreAddress;
pub use self::folder::FolderStore;
use crate::error::Error;

/// The place of the files of jobs. Names are relative to it, with `/`.
pub trait JobStore: fmt::Debug + Send + Sync {
    /// Creates a file; `None` where there is one of this name. Of all processes that try, one
    /// succeeds. `content` is told whether the file is locked, as far as the store has locks; a call
    /// must not give the same bytes as any other.
    fn create(&self, name: &str, content: &dyn Fn(Locked) -> Vec<u8>) -> Result<Option<Box<dyn OwnFile>>, Error>;

    /// Whether there is a file of this name.
    fn has(&self, name: &str) -> Result<bool, Error>;

    /// A small file with its time; `None` where there is none.
    fn look(&self, name: &str) -> Result<Option<Seen>, Error>;

    /// The content of a file; `None` where there is none.
    fn read(&self, name: &str) -> Result<Option<Vec<u8>>, Error>;

    /// The last bytes of a file, or all of a shorter one; `None` where there is none.
    fn end(&self, name: &str, bytes: usize) -> Result<Option<Vec<u8>>, Error>;

    /// Writes a file, or replaces it whole.
    fn write(&self, name: &str, keep: Keep, content: &mut Content<'_>) -> Result<(), Error>;

    /// Removes a file, if there is one.
    fn remove(&self, name: &str) -> Result<(), Error>;

    /// The names of the files in a folder, without the folder.
    fn names(&self, folder: &str) -> Result<Vec<String>, Error>;

    /// The time of the clock that sets the times of files, or a little before. A time that is too
    /// early makes claims seem younger, so none expires too soon.
    fn now(&self, folder: &str) -> Result<SystemTime, Error>;

    /// Names those processes that see each other's locks; `None` where there are no locks.
    fn system(&self) -> Option<String>;

    /// Requests that are worth making at the same time; `None` for as many as there are processors.
    fn width(&self) -> Option<usize> {
        None
    }
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
pub enum Locked {
    /// This process holds it.
    Yes,
    /// It does not, or the store has no locks.
    No,
}

/// A file that this process has created, and that no other writes to. It is locked, where it can be,
/// until this is dropped.
pub trait OwnFile: fmt::Debug + Send + Sync {
    /// Whether it is locked.
    fn locked(&self) -> Locked;

    /// Replaces the content by one of the same length, which also renews the file's time.
    fn rewrite(&self, content: &[u8]) -> io::Result<()>;
}

/// A small file of any process.
#[derive(Debug)]
pub struct Seen {
    /// The content.
    pub content: Vec<u8>,
    /// When it was last written, by the clock of [`JobStore::now`]; `None` where that is not known.
    pub written: Option<SystemTime>,
    /// The open file, where there are locks.
    file: Option<File>,
}

impl Seen {
    /// Whether nobody holds the lock of the file.
    pub fn is_free(&self) -> bool {
        self.file.as_ref().is_some_and(|file| file.try_lock_shared().is_ok())
    }
}

/// The store of jobs in a folder: the folder itself, or that of an address.
///
/// # Errors
/// [`Error::Store`] where a store cannot be used by this program or in this environment.
pub fn open(folder: &Path, address: Option<&StoreAddress>) -> Result<Arc<dyn JobStore>, Error> {
    address.map_or_else(|| Ok(Arc::new(FolderStore::new(folder)) as Arc<dyn JobStore>), open_objects)
}

/// Fails where a store cannot be reached, or cannot protect claims.
///
/// # Errors
/// [`Error::Store`].
#[cfg(feature = "object-store")]
pub fn check(address: &StoreAddress) -> Result<(), Error> {
    objects::ObjectRuns::check(address)
}

#[cfg(feature = "object-store")]
fn open_objects(address: &StoreAddress) -> Result<Arc<dyn JobStore>, Error> {
    Ok(Arc::new(objects::ObjectRuns::open(address)?))
}

/// Fails: this program has no object stores.
///
/// # Errors
/// [`Error::Store`].
#[cfg(not(feature = "object-store"))]
pub fn check(address: &StoreAddress) -> Result<(), Error> {
    open_objects(address).map(drop)
}

#[cfg(not(feature = "object-store"))]
fn open_objects(address: &StoreAddress) -> Result<Arc<dyn JobStore>, Error> {
    let what = "this gs is built without object stores: build it with \
                cargo install --path gs-cli --features object-store";
    Err(Error::Store { place: address.to_string(), what: what.to_owned() })
}
