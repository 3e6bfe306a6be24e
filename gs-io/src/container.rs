//! The container of scene files and checkpoints: a safetensors file with one metadata entry, `gs`,
//! which is a JSON object of format, version, program and content.
//!
//! There is one entry because safetensors writes several in random order, and equal scenes must
//! give equal bytes. Memory is allocated only after the header has been checked against the file's
//! length.

use std::{
    collections::HashMap,
    fs::File,
    io::{self, Read, Write},
    path::{Path, PathBuf},
};

use safetensors::{
    Dtype,
    tensor::{Metadata, TensorInfo},
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::{
    atomic::{open, read_exactly},
    error::Error,
};

/// The longest header that is read or written, bytes. It has room for a hundred thousand tensors.
const MAX_HEADER_BYTES: u64 = 16 << 20;

/// Length of the header's length, a little-endian u64 at the start of the file.
const LENGTH_BYTES: u64 = 8;

/// Bytes that are written at once.
const CHUNK_BYTES: usize = 1 << 18;

/// The metadata entry that holds [`Head`].
const HEAD_KEY: &str = "gs";

/// A kind of file in this container.
#[derive(Debug)]
pub(crate) struct FileKind {
    /// The format's name in the head.
    pub(crate) format: &'static str,
    /// The version that is written, and the newest that can be read.
    pub(crate) version: u32,
    /// The kind for messages: "a scene file".
    pub(crate) what: &'static str,
}

#[derive(Serialize, Deserialize)]
struct Head<C> {
    format: String,
    version: u32,
    program: String,
    content: C,
}

/// Passes the bits of all values to its argument, piece by piece.
type Pass<'a> = dyn FnOnce(&mut dyn FnMut(&[u32])) + 'a;

/// A tensor to be written. Its numbers are made while they are written, so that they are in memory
/// once.
pub(crate) struct TensorWords<'a> {
    dtype: Dtype,
    shape: Vec<usize>,
    /// Number of values, of 4 bytes each.
    len: usize,
    pass: Box<Pass<'a>>,
}

impl<'a> TensorWords<'a> {
    /// The values must be as many as the shape says.
    pub(crate) fn f32(shape: &[usize], values: impl Iterator<Item = f32> + 'a) -> Self {
        Self::new(Dtype::F32, shape, |to| values.for_each(|value| to(&[value.to_bits()])))
    }

    /// `pass` must pass as many values as the shape says.
    pub(crate) fn new(dtype: Dtype, shape: &[usize], pass: impl FnOnce(&mut dyn FnMut(&[u32])) + 'a) -> Self {
        Self { dtype, shape: shape.to_vec(), len: shape.iter().product(), pass: Box::new(pass) }
    }

    fn write(self, file: &mut dyn Write) -> io::Result<()> {
        let mut chunk = Vec::with_capacity(CHUNK_BYTES);
        let (mut written, mut values) = (Ok(()), 0);
        (self.pass)(&mut |bits| {
            values += bits.len();
            chunk.extend(bits.iter().flat_map(|bits| bits.to_le_bytes()));
            if chunk.len() >= CHUNK_BYTES {
                if written.is_ok() {
                    written = file.write_all(&chunk);
                }
                chunk.clear();
            }
        });
        written?;
        if values != self.len {
            return Err(io::Error::other(format!("{values} values in a shape of {:?}", self.shape)));
        }
        file.write_all(&chunk)
    }
}

/// A file of this container that is about to be written: the bytes of [`safetensors::serialize`],
/// without holding them in memory.
pub(crate) struct Encoded<'a> {
    header: Vec<u8>,
    tensors: Vec<(String, TensorWords<'a>)>,
}

impl<'a> Encoded<'a> {
    /// Fails where there are too many names and metadata for a header.
    pub(crate) fn new<C: Serialize>(
        kind: &'static FileKind,
        content: &C,
        mut tensors: Vec<(String, TensorWords<'a>)>,
    ) -> Result<Self, gs_core::Error> {
        let impossible = gs_core::Error::State;
        let program = concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_owned();
        let head = Head { format: kind.format.to_owned(), version: kind.version, program, content };
        let head = serde_json::to_string(&head).map_err(|e| impossible(e.to_string()))?;
        // The order of safetensors.
        tensors.sort_by(|(left_name, left), (right_name, right)| {
            right.dtype.cmp(&left.dtype).then_with(|| left_name.cmp(right_name))
        });
        let mut end = 0;
        let infos = tensors.iter().map(|(name, TensorWords { dtype, shape, len, .. })| {
            let start = end;
            end += 4 * len;
            (name.clone(), TensorInfo { dtype: *dtype, shape: shape.clone(), data_offsets: (start, end) })
        });
        let metadata = HashMap::from([(HEAD_KEY.to_owned(), head)]);
        let header = Metadata::new(Some(metadata), infos.collect()).map_err(|e| impossible(e.to_string()))?;
        let mut header = serde_json::to_vec(&header).map_err(|e| impossible(e.to_string()))?;
        header.resize(header.len().next_multiple_of(LENGTH_BYTES as usize), b' ');
        let header_bytes = header.len() as u64;
        if header_bytes > MAX_HEADER_BYTES {
            return Err(impossible(format!(
                "its metadata and tensor names take {header_bytes} bytes, more than {MAX_HEADER_BYTES}"
            )));
        }
        Ok(Self { header, tensors })
    }

    pub(crate) fn write(self, file: &mut dyn Write) -> io::Result<()> {
        file.write_all(&(self.header.len() as u64).to_le_bytes())?;
        file.write_all(&self.header)?;
        self.tensors.into_iter().try_for_each(|(name, tensor)| {
            tensor.write(file).map_err(|error| match error.kind() {
                io::ErrorKind::Other => io::Error::other(format!("tensor `{name}` has {error}")),
                _ => error,
            })
        })
    }
}

/// A file of this container.
#[derive(Debug)]
pub(crate) struct Container<C> {
    /// The content of its head.
    pub(crate) content: C,
    path: PathBuf,
    kind: &'static FileKind,
    header: Metadata,
    data: Vec<u8>,
}

/// Reads a file of this kind.
pub(crate) fn read<C: DeserializeOwned>(path: &Path, kind: &'static FileKind) -> Result<Container<C>, Error> {
    let (file, metadata) = open(path, kind.what)?;
    read_from(file, metadata.len(), path, kind)
}

/// Reads a file of this kind, of so many bytes; `path` names it for errors.
pub(crate) fn read_from<C: DeserializeOwned>(
    mut file: impl Read,
    file_bytes: u64,
    path: &Path,
    kind: &'static FileKind,
) -> Result<Container<C>, Error> {
    let damaged = |byte: u64, expected: String, found: String| Error::Damaged {
        path: path.to_owned(),
        what: kind.what,
        place: format!("byte {byte}"),
        expected,
        found,
    };
    let cut_short = |expected: u64| damaged(file_bytes, format!("{expected} bytes"), "the end of the file".to_owned());
    let mut read = |bytes| read_exactly(&mut file, bytes).map_err(|source| Error::read(path, source));

    if file_bytes < LENGTH_BYTES {
        return Err(cut_short(LENGTH_BYTES));
    }
    let length = read(LENGTH_BYTES)?;
    let header_bytes = length.first_chunk().map_or(0, |length| u64::from_le_bytes(*length));
    if header_bytes > MAX_HEADER_BYTES {
        return Err(damaged(0, "the length of a safetensors header".to_owned(), Error::found(&length)));
    }
    let data_start = LENGTH_BYTES + header_bytes;
    if file_bytes < data_start {
        return Err(cut_short(data_start));
    }
    let in_header = |expected: &str, e: serde_json::Error| {
        let column = if e.line() == 1 { e.column().saturating_sub(1) as u64 } else { 0 };
        damaged(LENGTH_BYTES + column, expected.to_owned(), e.to_string())
    };
    // `SafeTensors::deserialize` adds the lengths that a header claims without checking for
    // overflow.
    let header: Metadata = serde_json::from_slice(&read(header_bytes)?)
        .map_err(|e| in_header("the JSON header of a safetensors file", e))?;

    let head = header.metadata().as_ref().and_then(|entries| entries.get(HEAD_KEY));
    let Some(head) = head else {
        return Err(damaged(LENGTH_BYTES, format!("metadata `{HEAD_KEY}`"), "none".to_owned()));
    };
    let expected_head = format!("metadata `{HEAD_KEY}` of format {}", kind.format);
    let head: Head<serde_json::Value> =
        serde_json::from_str(head).map_err(|e| damaged(LENGTH_BYTES, expected_head.clone(), e.to_string()))?;
    if head.format != kind.format {
        return Err(damaged(LENGTH_BYTES, expected_head, format!("format {:?}", head.format)));
    }
    if head.version > kind.version {
        return Err(Error::too_new(path, kind.what, kind.version, head.version));
    }
    let content =
        serde_json::from_value(head.content).map_err(|e| damaged(LENGTH_BYTES, expected_head, e.to_string()))?;

    let data_bytes = header.data_len() as u64;
    match data_start.checked_add(data_bytes) {
        Some(end) if end == file_bytes => {}
        Some(end) if end < file_bytes => {
            return Err(damaged(end, "the end of the file".to_owned(), format!("{} more bytes", file_bytes - end)));
        }
        _ => return Err(cut_short(data_start.saturating_add(data_bytes))),
    }
    let data = read(data_bytes)?;
    Ok(Container { content, path: path.to_owned(), kind, header, data })
}

/// The format in the head of a file; `None` for a file of another kind.
pub(crate) fn format_of(path: &Path) -> Option<String> {
    let mut file = File::open(path).ok()?;
    let header_bytes = u64::from_le_bytes(*read_exactly(&mut file, LENGTH_BYTES).ok()?.first_chunk()?);
    if header_bytes > MAX_HEADER_BYTES {
        return None;
    }
    let header: Metadata = serde_json::from_slice(&read_exactly(&mut file, header_bytes).ok()?).ok()?;
    let head = header.metadata().as_ref()?.get(HEAD_KEY)?;
    Some(serde_json::from_str::<Head<serde_json::Value>>(head).ok()?.format)
}

impl<C> Container<C> {
    /// The names of all tensors.
    pub(crate) fn names(&self) -> Vec<String> {
        self.header.offset_keys()
    }

    /// The shape of a tensor, if it exists.
    pub(crate) fn shape(&self, name: &str) -> Option<&[usize]> {
        self.header.info(name).map(|info| info.shape.as_slice())
    }

    /// The type of a tensor, if it exists.
    pub(crate) fn dtype(&self, name: &str) -> Option<Dtype> {
        self.header.info(name).map(|info| info.dtype)
    }

    /// The values of an F32 tensor of this shape.
    pub(crate) fn f32(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Error> {
        Ok(self.words(name, Dtype::F32, shape)?.iter().map(|&word| f32::from_le_bytes(word)).collect())
    }

    /// The values of a U32 tensor of this shape.
    pub(crate) fn u32(&self, name: &str, shape: &[usize]) -> Result<Vec<u32>, Error> {
        Ok(self.words(name, Dtype::U32, shape)?.iter().map(|&word| u32::from_le_bytes(word)).collect())
    }

    /// An error about a tensor; `expected` is its type and shape in words.
    pub(crate) fn tensor_error(&self, name: &str, expected: String) -> Error {
        let found = match self.header.info(name) {
            Some(TensorInfo { dtype, shape, .. }) => format!("{dtype:?} {shape:?}"),
            None => "none".to_owned(),
        };
        let problem = format!("tensor `{name}`: expected {expected}, found {found}");
        Error::unusable(&self.path, problem, format!("write {} again", self.kind.what))
    }

    fn words(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<&[[u8; 4]], Error> {
        self.header
            .info(name)
            .filter(|info| info.dtype == dtype && info.shape == shape)
            .and_then(|info| self.data.get(info.data_offsets.0..info.data_offsets.1))
            .map(|bytes| bytes.as_chunks::<4>().0)
            .ok_or_else(|| self.tensor_error(name, format!("{dtype:?} {shape:?}")))
    }
}
