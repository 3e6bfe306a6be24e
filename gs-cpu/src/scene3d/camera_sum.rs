//! Sums of gradients by the camera, in 64 bits and in the order of the Gaussians.

use gs_core::CameraGradient;

use super::lanes_vjp::CameraLanes;

/// A sum over some of the Gaussians.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CameraSum([f64; 10]);

impl CameraSum {
    pub(crate) const ZERO: Self = Self([0.0; 10]);

    /// Adds the first `count` lanes.
    #[inline(always)]
    pub(crate) fn add(&mut self, lanes: &CameraLanes, count: usize) {
        for (sum, row) in self.0.iter_mut().zip(lanes) {
            *sum += f64::from(row[..count].iter().sum::<f32>());
        }
    }

    /// The sum over these Gaussians and those after them.
    pub(crate) fn plus(mut self, after: Self) -> Self {
        self.0.iter_mut().zip(after.0).for_each(|(sum, by)| *sum += by);
        self
    }

    pub(crate) fn gradient(self) -> CameraGradient {
        CameraGradient::from_array(self.0.map(|v| v as f32))
    }
}
