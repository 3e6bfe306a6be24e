//! What the formats with levels of detail have in common: chunks of cells, and a file that describes them.

use std::path::Path;

use super::{meta::Node, plan::Plan};
use crate::{
    error::Error,
    scene3d::{Encoded3d, options::ToWrite},
};

/// How a scene with levels of detail is stored.
pub(super) trait Layout {
    /// Which Gaussians are in which chunk.
    fn plan(&self) -> &Plan;

    /// The names of the files of a chunk, with `/`; the first is that which [`encode`](Self::encode) is given.
    fn names(&self, chunk: &str, sh_degree: u8) -> Vec<String>;

    /// Encodes the files of a chunk, the index of which is `file`.
    fn encode(&self, file: usize, to: &ToWrite<'_>) -> Result<Encoded3d, Error>;

    /// The content of the file that describes the others, for these cells in their order.
    fn describe(&self, path: &Path, cells: Vec<Node>) -> Result<Vec<u8>, Error>;
}
