//! The buffers of a glTF: in the second chunk of a `.glb`, in the JSON as base64, or in a separate
//! file.

use std::{
    borrow::Cow,
    collections::BTreeMap,
    io::Read,
    path::{Component, Path, PathBuf},
};

use base64::{Engine, engine::general_purpose::STANDARD};

use super::document::{Buffer, Document};
use crate::{atomic::open, error::Error, scene3d::source::Source, text::percent_decoded};

pub(super) const GLB_MAGIC: [u8; 4] = *b"glTF";
pub(super) const GLB_VERSION: u32 = 2;
pub(super) const JSON_CHUNK: [u8; 4] = *b"JSON";
pub(super) const BINARY_CHUNK: [u8; 4] = *b"BIN\0";
const GLB_HEAD_BYTES: usize = 12;
const CHUNK_HEAD_BYTES: usize = 8;

/// Position of the JSON, the JSON, and the binary chunk of a `.glb`.
pub(super) type Parts<'a> = (usize, &'a [u8], Option<&'a [u8]>);

/// The parts of a glTF of either kind.
pub(super) fn split<'a>(source: &Source<'a>) -> Result<Parts<'a>, Error> {
    if !source.bytes.starts_with(&GLB_MAGIC) {
        // A byte-order mark is not valid in JSON.
        let start = if source.bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        return Ok((start, &source.bytes[start..], None));
    }
    let version = source.u32(4, "the head")?;
    if version != GLB_VERSION {
        return Err(source.damaged(4, "version 2 of glTF", version.to_string()));
    }
    let total = u64::from(source.u32(8, "the head")?);
    let file = Source { bytes: source.slice(0, total, "a .glb")?, ..*source };
    let json = chunk(&file, GLB_HEAD_BYTES, JSON_CHUNK)?;
    let json_start = GLB_HEAD_BYTES + CHUNK_HEAD_BYTES;
    let next = json_start + json.len();
    let binary = if next < file.bytes.len() { Some(chunk(&file, next, BINARY_CHUNK)?) } else { None };
    Ok((json_start, json, binary))
}

fn chunk<'a>(file: &Source<'a>, start: usize, kind: [u8; 4]) -> Result<&'a [u8], Error> {
    let len = u64::from(file.u32(start, "a chunk's length")?);
    let found: [u8; 4] = file.array(start + 4, "a chunk's kind")?;
    if found != kind {
        let name = |kind: &[u8]| String::from_utf8_lossy(kind).trim_end_matches('\0').escape_debug().to_string();
        return Err(file.damaged(start + 4, format!("a chunk {}", name(&kind)), name(&found)));
    }
    file.slice(start + CHUNK_HEAD_BYTES, len, "a chunk")
}

/// All buffers of a document.
#[derive(Debug)]
pub(super) struct Buffers<'a> {
    contents: Vec<Cow<'a, [u8]>>,
    /// Sizes of the separate files, each once.
    pub(super) files: BTreeMap<PathBuf, u64>,
}

impl<'a> Buffers<'a> {
    pub(super) fn read(source: &Source<'a>, document: &Document, binary: Option<&'a [u8]>) -> Result<Self, Error> {
        let (mut contents, mut files) = (Vec::new(), BTreeMap::new());
        for (number, buffer) in document.buffers.iter().enumerate() {
            let bytes = match &buffer.uri {
                Some(uri) => of_uri(source, uri, buffer, &mut files)?.into(),
                None => binary.filter(|_| number == 0).map(Cow::Borrowed).ok_or_else(|| {
                    source.damaged(0, format!("a uri for buffer {number}"), "none, nor a binary chunk for it")
                })?,
            };
            if (bytes.len() as u64) < buffer.byte_length {
                let expected = format!("{} bytes in buffer {number}", buffer.byte_length);
                return Err(source.damaged(0, expected, bytes.len().to_string()));
            }
            contents.push(bytes);
        }
        Ok(Self { contents, files })
    }

    pub(super) fn get(&self, number: usize) -> Option<&[u8]> {
        self.contents.get(number).map(AsRef::as_ref)
    }

    /// Total size of buffers that are not part of the file as they are.
    pub(super) fn decoded_bytes(&self) -> u64 {
        self.contents.iter().filter(|b| matches!(b, Cow::Owned(_))).map(|b| b.len() as u64).sum()
    }
}

fn of_uri(
    source: &Source<'_>,
    uri: &str,
    buffer: &Buffer,
    files: &mut BTreeMap<PathBuf, u64>,
) -> Result<Vec<u8>, Error> {
    if let Some(data) = uri.strip_prefix("data:") {
        let bytes = data.split_once(";base64,").and_then(|(_, text)| STANDARD.decode(text).ok());
        return bytes.ok_or_else(|| source.damaged(0, "a data uri in base64", "one that is not"));
    }
    let path = beside(source.path, uri).ok_or_else(|| {
        let what = format!("the buffer {:?}, which is no file beside it", uri.chars().take(60).collect::<String>());
        Error::unsupported(source.path, what, "put the buffer beside the glTF, or convert it to .glb")
    })?;
    let (file, metadata) = open(&path, "a glTF's buffer")?;
    let mut bytes = Vec::new();
    file.take(buffer.byte_length).read_to_end(&mut bytes).map_err(|error| Error::read(&path, error))?;
    files.insert(path, metadata.len());
    Ok(bytes)
}

/// The path of a file in the glTF's folder or a subfolder.
fn beside(gltf: &Path, uri: &str) -> Option<PathBuf> {
    let name = percent_decoded(uri)?;
    let inside = Path::new(&name).components().all(|part| matches!(part, Component::Normal(_)));
    (inside && !name.is_empty() && !name.contains(':')).then(|| gltf.with_file_name(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_are_files_in_the_folder_and_no_others() {
        let gltf = Path::new("scenes/a.gltf");
        assert_eq!(beside(gltf, "a%20b.bin"), Some(PathBuf::from("scenes/a b.bin")));
        assert_eq!(beside(gltf, "parts/a.bin"), Some(PathBuf::from("scenes/parts/a.bin")));
        for uri in ["../a.bin", "/etc/passwd", "https://x.org/a.bin", "", "%2e%2e/a", "a%2", "a%zz", "%00"] {
            assert_eq!(beside(gltf, uri), None, "{uri}");
        }
    }
}
