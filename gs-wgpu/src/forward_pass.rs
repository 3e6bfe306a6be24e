//! Forward passes and gradients on the device.

use std::{fmt, sync::Arc};

use gs_core::{CameraGradient, Culled, Error, Image, RenderSettings};

use crate::{
    gpu::Gpu,
    kind::Kind,
    layout::Status,
    splats::Splats,
    workspace::{Pool, Workspace},
};

/// A forward pass on the device: the image, and what its backward pass needs.
pub struct ForwardPass<S: Kind> {
    /// `Some` until dropped.
    pub(crate) workspace: Option<Workspace<S>>,
    pub(crate) status: Status,
    pub(crate) pool: Arc<Pool<S>>,
}

impl<S: Kind> ForwardPass<S> {
    pub(crate) fn workspace(&self) -> &Workspace<S> {
        self.workspace.as_ref().expect("a forward pass has its workspace until it is dropped")
    }

    pub(crate) async fn image(&self, gpu: &Gpu) -> Result<Image, Error> {
        let tiles = &self.workspace().tiles;
        let [width, height] = tiles.size;
        let pixels: Vec<[f32; 4]> = gpu.read(&tiles.image.buffer, width as usize * height as usize).await?;
        Image::from_pixels(width, height, pixels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect())
    }

    pub(crate) fn culled(&self) -> Culled {
        self.status.culled()
    }

    /// Number of entries in all tiles' lists: one per Gaussian and tile of 16×16 px that it
    /// touches.
    pub fn entries(&self) -> usize {
        self.status.entries as usize
    }
}

impl<S: Kind> Drop for ForwardPass<S> {
    fn drop(&mut self) {
        if let Some(workspace) = self.workspace.take() {
            self.pool.give(workspace);
        }
    }
}

impl<S: Kind> fmt::Debug for ForwardPass<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ForwardPass").field("status", &self.status).finish_non_exhaustive()
    }
}

/// The gradients of a backward pass, `[N]`, on the device.
#[derive(Debug)]
pub struct Gradients<S: Kind> {
    pub(crate) buffers: Vec<wgpu::Buffer>,
    pub(crate) len: usize,
    /// The view of the forward pass, which the uniform of an Adam step needs.
    pub(crate) view: S::View,
    pub(crate) settings: RenderSettings,
    /// The gradient by the camera, if the forward pass asked for it.
    pub(crate) by_camera: Option<CameraGradient>,
}

impl<S: Kind> Gradients<S> {
    /// Fails unless the gradients belong to as many Gaussians as there are splats.
    pub(crate) fn check_len(&self, splats: &Splats<S>) -> Result<(), Error> {
        if self.len == splats.len {
            return Ok(());
        }
        Err(Error::State(format!("gradients of {} Gaussians do not fit splats of {}", self.len, splats.len)))
    }
}
