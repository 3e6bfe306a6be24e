//! What passes leave behind on the device: frames, gradients, and the pool that their buffers go back to.

use std::{
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

use glam::{Vec2, Vec3};
use gs_core::{Chart, Error, Image, PlanarScene, effects::Statistics, statistics::Culled, whitened::WhitenedGradient};

use crate::{
    cloud::PlanarCloud,
    gpu::Gpu,
    layout::{Gaussian, Gradient, Status},
    workspace::Workspace,
};

/// Workspaces that are not in use.
#[derive(Debug, Default)]
pub(crate) struct Pool(Mutex<Vec<Workspace>>);

impl Pool {
    pub(crate) fn take(&self, gpu: &Gpu) -> Result<Workspace, Error> {
        match self.0.lock().unwrap_or_else(PoisonError::into_inner).pop() {
            Some(workspace) => Ok(workspace),
            None => Workspace::new(gpu),
        }
    }

    pub(crate) fn give(&self, workspace: Workspace) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }
}

/// One forward pass on the device: the image, and what its backward pass needs.
pub struct PlanarFrame {
    /// `Some` until dropped.
    pub(crate) workspace: Option<Workspace>,
    pub(crate) status: Status,
    pub(crate) pool: Arc<Pool>,
}

impl PlanarFrame {
    pub(crate) fn workspace(&self) -> &Workspace {
        self.workspace.as_ref().expect("a frame has its workspace until it is dropped")
    }

    pub(crate) fn image(&self, gpu: &Gpu) -> Result<Image, Error> {
        let workspace = self.workspace();
        let (width, height) = (workspace.canvas.width, workspace.canvas.height);
        let pixels: Vec<[f32; 4]> = gpu.read(&workspace.image.buffer, width as usize * height as usize)?;
        Image::from_pixels(width, height, pixels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect())
    }

    pub(crate) fn culled(&self) -> Culled {
        let Status { not_finite, degenerate, transparent, outside, .. } = self.status;
        Culled { not_finite, near: 0, degenerate, transparent, outside }
    }

    /// Entries of all tiles' lists: one per Gaussian and tile of 16×16 px that it touches.
    pub fn entries(&self) -> usize {
        self.status.entries as usize
    }
}

impl Drop for PlanarFrame {
    fn drop(&mut self) {
        if let Some(workspace) = self.workspace.take() {
            self.pool.give(workspace);
        }
    }
}

impl fmt::Debug for PlanarFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PlanarFrame").field("status", &self.status).finish_non_exhaustive()
    }
}

/// The gradients of one backward pass, `[N]`, on the device.
#[derive(Debug)]
pub struct PlanarGradients {
    pub(crate) buffer: wgpu::Buffer,
    pub(crate) len: usize,
    /// What the frame's effects ask to be collected.
    pub(crate) statistics: Statistics,
    pub(crate) opaque: bool,
}

impl PlanarGradients {
    /// Fails unless the gradients are of as many Gaussians as the cloud has.
    pub(crate) fn check_len(&self, cloud: &PlanarCloud) -> Result<(), Error> {
        if self.len == cloud.len {
            return Ok(());
        }
        Err(Error::State(format!("gradients of {} Gaussians do not fit a cloud of {}", self.len, cloud.len)))
    }

    /// As a scene of derivatives: with respect to mean (px⁻¹), log-scale, rotation (rad⁻¹), opacity logit and colour.
    pub(crate) fn as_scene(&self, gpu: &Gpu, cloud: &PlanarCloud) -> Result<PlanarScene, Error> {
        let gradients: Vec<Gradient> = gpu.read(&self.buffer, self.len)?;
        let mut scene = PlanarScene::default();
        for (gradient, gaussian) in gradients.iter().zip(cloud.download_gaussians(gpu)?) {
            let (mean, [x, y, angle]) = match gradient.visible {
                0 => (Vec2::ZERO, [0.0; 3]),
                _ => by_scale_rotation(cloud, &gaussian, gradient),
            };
            scene.means.push(mean);
            scene.log_scales.push(Vec2::new(x, y));
            scene.rotations.push(angle);
            scene.colors.push(Vec3::from_array(gradient.color));
            if cloud.has_opacity {
                scene.opacity_logits.push(gradient.opacity_logit);
            }
        }
        Ok(scene)
    }
}

fn by_scale_rotation(cloud: &PlanarCloud, gaussian: &Gaussian, gradient: &Gradient) -> (Vec2, [f32; 3]) {
    let whitened = WhitenedGradient { xi: Vec2::from_array(gradient.xi), eta: gradient.eta };
    let l = cloud.frame(gaussian);
    let (l, log_ratio, whitened) = match cloud.chart {
        Chart::ScaleRotation => (l, gaussian.shape[0] - gaussian.shape[1], whitened),
        Chart::LocalFrame => whitened.in_axes(l),
    };
    whitened.by_scale_rotation(l, log_ratio)
}
