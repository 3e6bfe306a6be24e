//! The densification statistics of one step by the definitions of
//! [`Statistics`](gs_core::effects::Statistics).

use gs_core::{Error, Image, Loss};

use super::{Lean, Oracle, OracleScene, OracleView, loss};

/// The contribution of one step to each statistic, `[N]` each.
#[derive(Debug, Clone, PartialEq)]
pub struct StepStatistics {
    /// ‖(∂L/∂u · W/2, ∂L/∂v · H/2)‖, normalised device units.
    pub mean_gradient: Vec<f64>,
    /// ‖(Σ|share of ∂L/∂u| · W/2, Σ|share of ∂L/∂v| · H/2)‖ over the pixels, normalised device
    /// units.
    pub absolute_gradient: Vec<f64>,
    /// Σ T α e over the pixels, px.
    pub pixel_error: Vec<f64>,
}

impl<V: OracleView> Oracle<V> {
    /// The statistics of one training step.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] if the target does not have the view's size.
    pub fn statistics(&self, scene: &OracleScene, target: &Image, loss: &Loss) -> Result<StepStatistics, Error> {
        self.check_target(target)?;
        let count = scene.gaussians.len();
        let pixels = self.blend(scene, Lean::Exact);
        let rendering = self.rendering(scene, &pixels);
        let width = rendering.width as usize;
        let at = loss::evaluate(loss, width, &rendering.pixels, &rendering.rounding, target, 0.0);
        let (mut signed, mut absolute) = (vec![[0.0; 2]; count], vec![[0.0; 2]; count]);
        let mut pixel_error = vec![0.0; count];
        for (p, pixel) in pixels.iter().enumerate() {
            for (index, share) in pixel.gradients(at.v_color[p]) {
                for axis in 0..2 {
                    signed[index][axis] += share[axis];
                    absolute[index][axis] += share[axis].abs();
                }
            }
            let wanted = target.pixels()[p].map(f64::from);
            let error = (0..3).map(|k| (pixel.color[k] - wanted[k]).abs()).sum::<f64>() / 3.0;
            for (index, shown) in pixel.shown() {
                pixel_error[index] += shown * error;
            }
        }
        let device = self.view.device_units();
        let norms = |sums: &[[f64; 2]]| sums.iter().map(|s| (s[0] * device[0]).hypot(s[1] * device[1])).collect();
        Ok(StepStatistics { mean_gradient: norms(&signed), absolute_gradient: norms(&absolute), pixel_error })
    }
}
