//! The buffers of one pass through the stages. They are pooled, so that a warm iteration allocates
//! nothing.

use std::sync::{Mutex, PoisonError};

use crate::tiles::Tiles;

/// Inputs and results of a pass. `O` is the type of the buffers that only one kind of scene needs.
#[derive(Debug, Default)]
pub struct Workspace<O> {
    pub(crate) tiles: Tiles,
    /// Buffers of the stages that only this kind of scene has.
    pub(crate) buffers: O,
    /// Number of Gaussians.
    pub(crate) len: usize,
    /// The version of the splats that the lists were made for.
    pub(crate) version: Option<u64>,
}

/// Workspaces that are not in use.
#[derive(Debug, Default)]
pub(crate) struct Pool<O>(Mutex<Vec<Workspace<O>>>);

impl<O: Default> Pool<O> {
    /// A workspace whose lists are invalid, so that no step with `Binning::Reuse` uses another's
    /// lists.
    pub(crate) fn take(&self) -> Workspace<O> {
        let taken = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        Workspace { version: None, ..taken }
    }
}

impl<O> Pool<O> {
    /// Frees the workspaces that are not in use.
    pub(crate) fn clear(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Takes a workspace back.
    pub(crate) fn give(&self, workspace: Workspace<O>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }
}
