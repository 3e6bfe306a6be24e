//! The buffers that only 3D scenes need.

use gs_core::CameraGradient;

use super::{camera_sum::CameraSum, depth_sort::DepthSort, project::Eye, splats::pitch_of};
use crate::{splat::Share, workspace::Workspace};

/// The buffers that only 3D scenes need.
#[derive(Debug, Default)]
pub struct Buffers3d {
    pub(crate) eye: Option<Eye>,
    pub(crate) depth_sort: DepthSort,
    /// Gradients by index; each row is laid out as the splats' parameters, up to the evaluated SH.
    /// Unspecified for Gaussians that no tile lists.
    pub(crate) gradients: Vec<f32>,
    /// Contributions of this step to the statistic, by index. Unspecified for Gaussians that no
    /// tile lists.
    pub(crate) shares: Vec<Share>,
    /// Sums over chunks of Gaussians.
    pub(crate) camera_sums: Vec<CameraSum>,
    /// The gradient by the camera; `None` before a backward pass and where none was asked for.
    pub(crate) camera_gradient: Option<CameraGradient>,
}

impl Buffers3d {
    /// Numbers in a row of gradients. Later numbers in a row of parameters do not move.
    pub(crate) fn gradient_pitch(&self) -> usize {
        pitch_of(self.eye.map_or(0, |eye| eye.degree))
    }

    /// The gradient of a Gaussian that some tile lists.
    #[inline(always)]
    pub(crate) fn gradient(&self, index: usize) -> &[f32] {
        let pitch = self.gradient_pitch();
        &self.gradients[index * pitch..][..pitch]
    }
}

impl Workspace<Buffers3d> {
    /// Sets the gradient by the camera, if it was asked for, from the sum over all Gaussians.
    pub(crate) fn set_camera_gradient(&mut self, sum: CameraSum) {
        self.buffers.camera_gradient = self.tiles.settings.camera_gradient.then(|| sum.gradient());
    }
}
