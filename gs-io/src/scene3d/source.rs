//! The bytes of a scene file with bounds-checked reading.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::{atomic::read_file, error::Error};

/// Claimed size below which a file's claim is never refused: small scenes may compress by any
/// factor.
const FREE_BYTES: u64 = 64 << 20;

/// Largest claimed size of larger files relative to their own. Trained scenes shrink to a tenth at
/// best, a gzip stream of zeros to a thousandth.
const MAX_EXPANSION: u64 = 100;

/// A file's content.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Source<'a> {
    /// The file, for errors and for files that it refers to.
    pub(crate) path: &'a Path,
    /// The file's kind: "an SPZ file".
    pub(crate) what: &'static str,
    /// The whole content.
    pub(crate) bytes: &'a [u8],
    /// The files that it refers to, by their paths, if they are in memory and not on a disk.
    pub(crate) beside: Option<&'a FilesInMemory>,
}

/// The contents of files by their paths.
pub type FilesInMemory = BTreeMap<PathBuf, Vec<u8>>;

impl<'a> Source<'a> {
    /// An error about the content at a byte.
    pub(crate) fn damaged(&self, byte: usize, expected: impl Into<String>, found: impl Into<String>) -> Error {
        let (path, what) = (self.path.to_owned(), self.what);
        Error::Damaged { path, what, place: format!("byte {byte}"), expected: expected.into(), found: found.into() }
    }

    /// The whole content of a file that it refers to; `wanted` names its kind.
    pub(crate) fn read_beside(&self, path: &Path, wanted: &'static str) -> Result<Vec<u8>, Error> {
        match self.beside {
            Some(files) => files.get(path).cloned().ok_or_else(|| Error::Missing { path: path.to_owned() }),
            None => read_file(path, wanted),
        }
    }

    /// `len` bytes from `start`.
    pub(crate) fn slice(&self, start: usize, len: u64, name: &str) -> Result<&'a [u8], Error> {
        let end = usize::try_from(len).ok().and_then(|len| start.checked_add(len));
        end.and_then(|end| self.bytes.get(start..end)).ok_or_else(|| {
            let there = self.bytes.len().saturating_sub(start);
            self.damaged(start, format!("{len} bytes of {name}"), format!("{there} until the end of the file"))
        })
    }

    /// `N` bytes as an array.
    pub(crate) fn array<const N: usize>(&self, start: usize, name: &str) -> Result<[u8; N], Error> {
        let mut array = [0; N];
        array.copy_from_slice(self.slice(start, N as u64, name)?);
        Ok(array)
    }

    /// A little-endian u32.
    pub(crate) fn u32(&self, start: usize, name: &str) -> Result<u32, Error> {
        self.array(start, name).map(u32::from_le_bytes)
    }

    /// A little-endian u64.
    pub(crate) fn u64(&self, start: usize, name: &str) -> Result<u64, Error> {
        self.array(start, name).map(u64::from_le_bytes)
    }

    /// Fails if a file of this size, with the files it refers to, claims to contain too much.
    pub(crate) fn check_claim(&self, file_bytes: u64, claimed_bytes: u64) -> Result<(), Error> {
        if claimed_bytes <= FREE_BYTES.saturating_add(file_bytes.saturating_mul(MAX_EXPANSION)) {
            return Ok(());
        }
        let claim = format!("its {file_bytes} bytes declare {claimed_bytes} of content, more than its size allows");
        Err(Error::unusable(self.path, claim, "fetch it again"))
    }
}
