//! The files of a SOG: in a ZIP archive or in a folder.

use std::{
    collections::BTreeMap,
    io::{self, Read, Write},
    path::{Component, Path, PathBuf},
};

use flate2::read::DeflateDecoder;
use rawzip::{CompressionMethod, ZipArchive, ZipArchiveWriter};

use super::meta::META;
use crate::{error::Error, scene3d::source::Source};

/// Whether a file starts like a ZIP archive whose first file is one of a SOG. The name stands at
/// byte 30.
pub(crate) fn recognises_bundle(start: &[u8]) -> bool {
    const NAMES: [&[u8]; 4] = [b"meta.json", b"means_", b"scales.", b"sh0."];
    let name = start.get(30..).unwrap_or_default();
    start.starts_with(b"PK\x03\x04") && NAMES.iter().any(|known| name.starts_with(known))
}

/// Where the files of a SOG are.
pub(super) struct Files<'a> {
    source: &'a Source<'a>,
    /// Position and length of each file in the archive; `None` in a folder.
    archived: Option<BTreeMap<String, Entry<'a>>>,
    /// Files that were read from the folder, with their sizes.
    pub(super) read: BTreeMap<PathBuf, u64>,
    /// Bytes of all files that were opened so far.
    bytes: u64,
}

/// A file in an archive.
#[derive(Debug, Clone, Copy)]
struct Entry<'a> {
    content: &'a [u8],
    /// Its size when it is decompressed.
    size: u64,
    method: CompressionMethod,
}

impl<'a> Files<'a> {
    pub(super) fn of(source: &'a Source<'a>) -> Result<Self, Error> {
        let archived = source.bytes.starts_with(b"PK").then(|| entries(source)).transpose()?;
        Ok(Self { source, archived, read: BTreeMap::new(), bytes: source.bytes.len() as u64 })
    }

    /// The text of `meta.json`.
    pub(super) fn meta(&mut self) -> Result<Vec<u8>, Error> {
        if self.archived.is_some() { self.get(META) } else { Ok(self.source.bytes.to_vec()) }
    }

    /// The content of a file.
    pub(super) fn get(&mut self, name: &str) -> Result<Vec<u8>, Error> {
        let Some(archived) = &self.archived else { return self.beside_meta(name) };
        let missing = || self.source.damaged(0, format!("a file {name:?} in the archive"), "none");
        let Entry { content, size, method } = *archived.get(name).ok_or_else(missing)?;
        self.source.check_claim(self.bytes, size)?;
        let mut bytes = Vec::new();
        let read = match method {
            CompressionMethod::STORE => {
                bytes.extend(content);
                Ok(bytes.len())
            }
            CompressionMethod::DEFLATE => DeflateDecoder::new(content).take(size).read_to_end(&mut bytes),
            _ => Err(io::Error::other("a compression that is not read")),
        };
        match read {
            Ok(len) if len as u64 == size => Ok(bytes),
            Ok(len) => Err(self.source.damaged(0, format!("{size} bytes of {name:?}"), len.to_string())),
            Err(error) => Err(self.source.damaged(0, format!("{name:?} in the archive"), error.to_string())),
        }
    }

    fn beside_meta(&mut self, name: &str) -> Result<Vec<u8>, Error> {
        let mut parts = Path::new(name).components();
        let flat = matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None));
        if !flat || name.contains(['\0', ':', '\\']) {
            let found = format!("{:?}", name.chars().take(60).collect::<String>());
            return Err(self.source.damaged(0, "names of images in the folder of meta.json", found));
        }
        let path = self.source.path.with_file_name(name);
        let bytes = self.source.read_beside(&path, "an image of a SOG")?;
        if self.read.insert(path, bytes.len() as u64).is_none() {
            self.bytes = self.bytes.saturating_add(bytes.len() as u64);
        }
        Ok(bytes)
    }

    /// An error about a file's content.
    pub(super) fn damaged(&self, expected: String, found: impl Into<String>) -> Error {
        self.source.damaged(0, expected, found)
    }

    /// Fails if what the files claim to hold is more than their size justifies.
    pub(super) fn check_claim(&self, claimed: u64) -> Result<(), Error> {
        self.source.check_claim(self.bytes, claimed)
    }
}

fn entries<'a>(source: &Source<'a>) -> Result<BTreeMap<String, Entry<'a>>, Error> {
    let damaged = |error: rawzip::Error| source.damaged(0, "a ZIP archive", error.to_string());
    let archive = ZipArchive::from_slice(source.bytes).map_err(damaged)?;
    let mut entries = archive.entries();
    let mut found = BTreeMap::new();
    while let Some(entry) = entries.next_entry().map_err(damaged)? {
        let name = String::from_utf8_lossy(entry.file_path().as_bytes()).into_owned();
        let data = archive.get_entry(entry.wayfinder()).map_err(damaged)?;
        let (start, end) = data.compressed_data_range();
        let content = source.slice(start as usize, end.saturating_sub(start), "a file of the archive")?;
        found.insert(name, Entry { content, size: entry.uncompressed_size_hint(), method: entry.compression_method() });
    }
    Ok(found)
}

/// An archive of files, which are stored as they are: WebP images do not shrink.
pub(super) fn bundled(files: &[(&'static str, Vec<u8>)]) -> io::Result<Vec<u8>> {
    let mut archive = ZipArchiveWriter::new(Vec::new());
    for (name, content) in files {
        let (mut entry, config) = archive.new_file(*name).start().map_err(io::Error::other)?;
        let mut writer = config.wrap(&mut entry);
        writer.write_all(content)?;
        let (_, descriptor) = writer.finish().map_err(io::Error::other)?;
        entry.finish(descriptor).map_err(io::Error::other)?;
    }
    archive.finish().map_err(io::Error::other)
}
