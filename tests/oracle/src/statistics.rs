//! The densification statistics of one step by the definitions of
//! [`Statistics`](gs_core::effects::Statistics).

use gs_core::{Error, Image, Loss, effects::Order};

use super::{Lean, Oracle, OracleScene, Projection, loss, splat::OPACITY_SHARE};

/// The contribution of one step to each statistic, `[N]` each.
#[derive(Debug, Clone, PartialEq)]
pub struct StepStatistics {
    /// ‖(∂L/∂u · W/2, ∂L/∂v · H/2)‖, normalised device units.
    pub mean_gradient: Vec<f64>,
    /// ‖(Σ|share of ∂L/∂u| · W/2, Σ|share of ∂L/∂v| · H/2)‖ over the pixels, normalised device
    /// units.
    pub absolute_gradient: Vec<f64>,
    /// The mean gradient times [`Self::pixels`], and in 3D times
    /// [`statistic_weight`](gs_core::RenderSettings::statistic_weight).
    pub pixel_gradient: Vec<f64>,
    /// Number of pixels in which the Gaussian is blended.
    pub pixels: Vec<u32>,
    /// Σ T α e over the pixels, px.
    pub pixel_error: Vec<f64>,
}

impl Oracle {
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
        let at = loss::slopes(loss, width, &rendering.pixels, &rendering.rounding, target, 0.0);
        let (mut signed, mut absolute) = (vec![[0.0; 2]; count], vec![[0.0; 2]; count]);
        let (mut pixel_error, mut blended) = (vec![0.0; count], vec![0; count]);
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
                blended[index] += 1;
            }
        }
        let device = self.view.device_units();
        let norms = |sums: &[[f64; 2]]| sums.iter().map(|s| (s[0] * device[0]).hypot(s[1] * device[1])).collect();
        let (mean_gradient, absolute_gradient): (Vec<f64>, _) = (norms(&signed), norms(&absolute));
        let pixel_gradient = self
            .near_weights(scene)
            .into_iter()
            .zip(mean_gradient.iter().zip(&blended))
            .map(|(near, (norm, &m))| f64::from(m) * near * norm)
            .collect();
        Ok(StepStatistics { mean_gradient, absolute_gradient, pixel_gradient, pixels: blended, pixel_error })
    }

    /// The splitting matrix of each Gaussian in the image, xx, xy, yy, px⁻²: Σ over the pixels of
    /// α ∂L/∂α · ∂²w/∂μ′² / w, with second differences of the weight w.
    ///
    /// # Errors
    /// [`Error::SizesDiffer`] if the target does not have the view's size.
    pub fn splitting(&self, scene: &OracleScene, target: &Image, loss: &Loss) -> Result<Vec<[f64; 3]>, Error> {
        /// Displacement of the mean, px.
        const STEP: f64 = 1e-3;
        self.check_target(target)?;
        let pixels = self.blend(scene, Lean::Exact);
        let rendering = self.rendering(scene, &pixels);
        let width = rendering.width as usize;
        let at = loss::slopes(loss, width, &rendering.pixels, &rendering.rounding, target, 0.0);
        let projected = self.project(scene);
        let mut sums = vec![[0.0; 3]; scene.gaussians.len()];
        for (p, pixel) in pixels.iter().enumerate() {
            let center = [(p % width) as f64 + 0.5, (p / width) as f64 + 0.5];
            for (index, share) in pixel.gradients(at.v_color[p]) {
                let Projection::Drawable(splat) = &projected[index] else { continue };
                let weight = |x: f64, y: f64| (-splat.sigma([center[0] - x * STEP, center[1] - y * STEP])).exp();
                let seen = splat.appearance();
                let by_weight = share[OPACITY_SHARE] * seen.opacity / seen.opacity_slope / weight(0.0, 0.0);
                let along = |x: f64, y: f64| weight(x, y) - 2.0 * weight(0.0, 0.0) + weight(-x, -y);
                let mixed = 0.25 * (along(1.0, 1.0) - along(1.0, -1.0));
                for (sum, second) in sums[index].iter_mut().zip([along(1.0, 0.0), mixed, along(0.0, 1.0)]) {
                    *sum += by_weight * second / (STEP * STEP);
                }
            }
        }
        Ok(sums)
    }

    /// The weight by depth of each Gaussian's gradient in the pixel-aware gradient.
    fn near_weights(&self, scene: &OracleScene) -> Vec<f64> {
        let full = f64::from(self.settings.full_depth);
        let weight = |depth: f64| if depth < full { (depth / full).powi(2) } else { 1.0 };
        let near = |projection: Projection| match projection {
            Projection::Drawable(splat) if self.view.has_depth() => weight(splat.depth([0.0; 2], Order::Global).value),
            _ => 1.0,
        };
        self.project(scene).into_iter().map(near).collect()
    }
}
