//! The buffers of one pass through the stages. They are pooled, so that a warm iteration allocates nothing, and lent to passes and
//! gradients.

use std::{
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

use gs_core::{Error, Image, Scene2d, Scene3d};

use crate::{kind::SceneKind, tiles::Tiles, tuning::CpuTuning};

/// One pass's inputs and results.
#[derive(Debug)]
pub struct Workspace<S: SceneKind> {
    pub(crate) tiles: Tiles,
    /// What is this kind's own.
    pub(crate) own: S::Own,
    /// Number of Gaussians of the splats.
    pub(crate) len: usize,
    /// The splats' edition that the lists were made for.
    pub(crate) edition: Option<u64>,
}

impl<S: SceneKind> Default for Workspace<S> {
    fn default() -> Self {
        Self { tiles: Tiles::default(), own: S::Own::default(), len: 0, edition: None }
    }
}

impl<S: SceneKind> Workspace<S> {
    /// For work that is gone about like this; lists that were made otherwise are of no use then.
    pub(crate) fn tuned(mut self, tuning: CpuTuning) -> Self {
        if self.tiles.tuning != tuning {
            self.tiles.tuning = tuning;
            self.edition = None;
        }
        self
    }
}

/// Workspaces that are not in use.
#[derive(Debug)]
pub(crate) struct Pool<S: SceneKind>(Mutex<Vec<Workspace<S>>>);

impl<S: SceneKind> Default for Pool<S> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<S: SceneKind> Pool<S> {
    /// One whose lists are nobody's: a step with `Binning::Reuse` takes up none that others left behind.
    pub(crate) fn take(&self) -> Workspace<S> {
        let taken = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        Workspace { edition: None, ..taken }
    }

    pub(crate) fn give(&self, workspace: Workspace<S>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }
}

/// A workspace that goes back to its pool when it is no longer needed.
struct Lent<S: SceneKind> {
    /// `Some` until dropped.
    workspace: Option<Workspace<S>>,
    pool: Arc<Pool<S>>,
}

impl<S: SceneKind> Lent<S> {
    fn get(&self) -> &Workspace<S> {
        self.workspace.as_ref().expect("what is lent is there until it is dropped")
    }
}

impl<S: SceneKind> Drop for Lent<S> {
    fn drop(&mut self) {
        if let Some(workspace) = self.workspace.take() {
            self.pool.give(workspace);
        }
    }
}

/// One forward pass on the CPU: the image, and what its backward pass needs.
pub struct ForwardPass<S: SceneKind>(Lent<S>);

/// The gradients of one backward pass on the CPU.
pub struct Gradients<S: SceneKind>(Lent<S>);

/// A 2D scene's [`ForwardPass`].
pub type ForwardPass2d = ForwardPass<Scene2d>;

/// A 2D scene's [`Gradients`].
pub type Gradients2d = Gradients<Scene2d>;

/// A 3D scene's [`ForwardPass`].
pub type ForwardPass3d = ForwardPass<Scene3d>;

/// A 3D scene's [`Gradients`].
pub type Gradients3d = Gradients<Scene3d>;

impl<S: SceneKind> ForwardPass<S> {
    pub(crate) fn new(workspace: Workspace<S>, pool: &Arc<Pool<S>>) -> Self {
        Self(Lent { workspace: Some(workspace), pool: Arc::clone(pool) })
    }

    pub(crate) fn workspace(&self) -> &Workspace<S> {
        self.0.get()
    }

    pub(crate) fn workspace_mut(&mut self) -> &mut Workspace<S> {
        self.0.workspace.as_mut().expect("what is lent is there until it is dropped")
    }

    /// The gradients that the workspace holds by now.
    pub(crate) fn into_gradients(self) -> Gradients<S> {
        Gradients(self.0)
    }

    pub(crate) fn image(&self) -> Result<Image, Error> {
        let tiles = &self.workspace().tiles;
        tiles.grid.image_of(&tiles.rows)
    }

    /// Pixel–Gaussian pairs that this pass's lists hold, those that a vector covers beyond an ellipse included.
    pub fn pairs(&self) -> u64 {
        self.workspace().tiles.bins.pairs()
    }

    /// Entries of all tiles' lists.
    pub fn entries(&self) -> usize {
        self.workspace().tiles.bins.entries.len()
    }
}

impl<S: SceneKind> Gradients<S> {
    pub(crate) fn workspace(&self) -> &Workspace<S> {
        self.0.get()
    }
}

impl<S: SceneKind> fmt::Debug for ForwardPass<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tiles = &self.workspace().tiles;
        f.debug_struct("ForwardPass").field("grid", &tiles.grid).field("culled", &tiles.culled()).finish()
    }
}

impl<S: SceneKind> fmt::Debug for Gradients<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Gradients").field("len", &self.workspace().len).finish()
    }
}
