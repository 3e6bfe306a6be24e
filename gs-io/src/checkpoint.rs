//! Checkpoints of a training run: the whole state of the splats, bit for bit including NaN, so that
//! a resumed run ends as if it had never stopped.
//!
//! Checkpoints use the container of scene files. Tensors of the state are named `state.` and their
//! name, with type F32 or U32. The metadata entry `gs` is `{"format": "gs-checkpoint", "version":
//! 1, "program": …, "content": {"parameterization": …, "metadata": {…}}}`.

use std::{
    collections::BTreeMap,
    io::{self, Write},
    path::Path,
};

use gs_core::{Parameterization, SavedState, SavedTensor, SplatsState, Tensor, TensorData, TensorType};
use safetensors::Dtype;
use serde::{Deserialize, Serialize};

use crate::{
    atomic::write_durably,
    container::{self, Container, Encoded, FileKind, TensorWords},
    error::Error,
};

const KIND: FileKind = FileKind { format: "gs-checkpoint", version: 1, what: "a checkpoint" };
const PREFIX: &str = "state.";

/// The state of a training run.
///
/// A checkpoint in memory holds a [`SplatsState`]; one that is only written may hold a
/// [`SavedState`], which takes no memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint<S = SplatsState> {
    /// The state of the splats.
    pub state: S,
    /// All other state by name, as the trainer writes it: step, settings, random generator.
    pub metadata: BTreeMap<String, String>,
}

#[derive(Serialize, Deserialize)]
struct Content {
    parameterization: Parameterization,
    metadata: BTreeMap<String, String>,
}

/// Writes a checkpoint losslessly and atomically: a crash leaves the previous one. Equal
/// checkpoints give equal bytes.
///
/// # Errors
/// Those of [`write_durably`](crate::write_durably), also where a tensor's shape does not fit its
/// numbers.
pub fn write_checkpoint<'a, S>(path: impl AsRef<Path>, checkpoint: &'a Checkpoint<S>) -> Result<(), Error>
where
    &'a S: Into<SavedState<'a>>,
{
    let encoded = encoded(checkpoint);
    let encoded = encoded.map_err(|source| Error::Content { path: path.as_ref().to_owned(), source })?;
    write_durably(path, |file| encoded.write(file))
}

/// Writes the bytes of the file that [`write_checkpoint`] writes.
///
/// # Errors
/// Those of the writer; [`io::ErrorKind::Other`] where a tensor's shape does not fit its numbers.
pub fn encode_checkpoint<'a, S>(to: &mut dyn Write, checkpoint: &'a Checkpoint<S>) -> io::Result<()>
where
    &'a S: Into<SavedState<'a>>,
{
    encoded(checkpoint).map_err(io::Error::other)?.write(to)
}

fn encoded<'a, S>(checkpoint: &'a Checkpoint<S>) -> Result<Encoded<'a>, gs_core::Error>
where
    &'a S: Into<SavedState<'a>>,
{
    let SavedState { parameterization, tensors } = (&checkpoint.state).into();
    let words = |tensor: SavedTensor<'a>| {
        let dtype = match tensor.numbers {
            TensorType::F32 => Dtype::F32,
            TensorType::U32 => Dtype::U32,
        };
        let shape = tensor.shape.clone();
        (format!("{PREFIX}{}", tensor.name), TensorWords::new(dtype, &shape, move |to| tensor.pass(to)))
    };
    let content = Content { parameterization, metadata: checkpoint.metadata.clone() };
    Encoded::new(&KIND, &content, tensors.into_iter().map(words).collect())
}

/// Whether a file is a checkpoint. Only its header is read, so the rest may be damaged.
pub(crate) fn is_checkpoint(path: impl AsRef<Path>) -> bool {
    container::format_of(path.as_ref()).is_some_and(|format| format == KIND.format)
}

/// Reads what [`write_checkpoint`] wrote: the same state, bit for bit. The backend that restores
/// the state checks whether it is complete.
///
/// # Errors
/// [`Error::Missing`], [`Error::NotAFile`] or [`Error::Read`]; [`Error::Damaged`] for a truncated
/// file or another kind of file, [`Error::Unusable`] for one of a later version and for a tensor that
/// is not part of a state.
pub fn read_checkpoint(path: impl AsRef<Path>) -> Result<Checkpoint, Error> {
    state_of(container::read::<Content>(path.as_ref(), &KIND)?)
}

/// Reads the bytes of a file that [`write_checkpoint`] wrote; `name` is its name for errors.
///
/// # Errors
/// Those of [`read_checkpoint`] that concern the content.
pub fn decode_checkpoint(bytes: &[u8], name: &Path) -> Result<Checkpoint, Error> {
    state_of(container::read_from::<Content>(bytes, bytes.len() as u64, name, &KIND)?)
}

fn state_of(file: Container<Content>) -> Result<Checkpoint, Error> {
    let mut state = SplatsState::new(file.content.parameterization);
    for full_name in file.names() {
        let Some(name) = full_name.strip_prefix(PREFIX) else {
            return Err(file.tensor_error(&full_name, format!("a name that starts with `{PREFIX}`")));
        };
        let shape = file.shape(&full_name).unwrap_or_default().to_vec();
        let data = match file.dtype(&full_name) {
            Some(Dtype::U32) => TensorData::U32(file.u32(&full_name, &shape)?),
            Some(Dtype::F32) => TensorData::F32(file.f32(&full_name, &shape)?),
            _ => return Err(file.tensor_error(&full_name, "F32 or U32".to_owned())),
        };
        state.tensors.insert(name.to_owned(), Tensor { shape, data });
    }
    Ok(Checkpoint { state, metadata: file.content.metadata })
}
