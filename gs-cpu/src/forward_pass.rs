//! Forward passes and gradients: workspaces that are lent to the caller and go back to their pool.

use std::{fmt, sync::Arc};

use gs_core::{Error, Image};

use crate::{
    kind::Kind,
    workspace::{Pool, Workspace},
};

/// A workspace that goes back to its pool when it is dropped.
struct Lent<S: Kind> {
    /// `Some` until dropped.
    workspace: Option<Workspace<S::Buffers>>,
    pool: Arc<Pool<S::Buffers>>,
}

impl<S: Kind> Lent<S> {
    fn get(&self) -> &Workspace<S::Buffers> {
        self.workspace.as_ref().expect("the workspace is there until it is dropped")
    }
}

impl<S: Kind> Drop for Lent<S> {
    fn drop(&mut self) {
        if let Some(workspace) = self.workspace.take() {
            self.pool.give(workspace);
        }
    }
}

/// A forward pass on the CPU: the image, and what its backward pass needs.
pub struct ForwardPass<S: Kind>(Lent<S>);

/// The gradients of a backward pass on the CPU.
pub struct Gradients<S: Kind>(Lent<S>);

impl<S: Kind> ForwardPass<S> {
    pub(crate) fn new(workspace: Workspace<S::Buffers>, pool: &Arc<Pool<S::Buffers>>) -> Self {
        Self(Lent { workspace: Some(workspace), pool: Arc::clone(pool) })
    }

    pub(crate) fn workspace(&self) -> &Workspace<S::Buffers> {
        self.0.get()
    }

    pub(crate) fn workspace_mut(&mut self) -> &mut Workspace<S::Buffers> {
        self.0.workspace.as_mut().expect("the workspace is there until it is dropped")
    }

    /// The gradients that the workspace now holds.
    pub(crate) fn into_gradients(self) -> Gradients<S> {
        Gradients(self.0)
    }

    pub(crate) fn image(&self) -> Result<Image, Error> {
        let tiles = &self.workspace().tiles;
        tiles.grid.image_of(&tiles.rows)
    }
}

impl<S: Kind> Gradients<S> {
    pub(crate) fn workspace(&self) -> &Workspace<S::Buffers> {
        self.0.get()
    }
}

impl<S: Kind> fmt::Debug for ForwardPass<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tiles = &self.workspace().tiles;
        f.debug_struct("ForwardPass").field("grid", &tiles.grid).field("culled", &tiles.culled()).finish()
    }
}

impl<S: Kind> fmt::Debug for Gradients<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Gradients").field("len", &self.workspace().len).finish()
    }
}
