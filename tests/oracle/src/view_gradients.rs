//! Gradients by the numbers of a view.

use super::rounded::F32_ROUNDING;

/// ∂L/∂ the numbers of a view, and their uncertainties.
///
/// The numbers of a camera are, in order, a twist (v, ω) on the left of its world-to-camera pose, by
/// which a point p in camera coordinates goes to exp(ω×) p + v; fx, fy; cx, cy. A canvas has none.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ViewGradients {
    /// The gradients.
    pub values: Vec<f64>,
    /// Uncertainty of each in `f32`, in roundings.
    pub rounding: Vec<f64>,
    /// Change of each by decisions within rounding.
    pub flip: Vec<f64>,
}

impl ViewGradients {
    pub(crate) fn zeros(numbers: usize) -> Self {
        Self { values: vec![0.0; numbers], rounding: vec![0.0; numbers], flip: vec![0.0; numbers] }
    }

    /// Adds the gradients through one Gaussian, and their uncertainties.
    ///
    /// Those of different Gaussians have separate causes, so their squares are added: the sum of
    /// their magnitudes would be a tolerance that hides faults.
    pub(crate) fn add(&mut self, values: &[f64], roundings: &[f64]) {
        for (i, (value, rounding)) in values.iter().zip(roundings).enumerate() {
            self.values[i] += value;
            self.rounding[i] = self.rounding[i].hypot(rounding + F32_ROUNDING * value.abs());
        }
    }
}
