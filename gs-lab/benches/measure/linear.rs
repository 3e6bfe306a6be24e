//! A least-squares fit of a cost as a linear function of two sizes.

use glam::{DMat3, DVec3};

/// cost ≈ fixed + first · x + second · y.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LinearModel {
    /// Constant cost.
    pub(crate) fixed: f64,
    /// Cost per x.
    pub(crate) first: f64,
    /// Cost per y.
    pub(crate) second: f64,
    /// The largest relative deviation of a measured cost from the model.
    pub(crate) worst: f64,
}

impl LinearModel {
    /// Minimises the relative squares for `[x, y, cost]`; `None` where they do not determine the
    /// model (fewer than three points, or x and y in one proportion).
    pub(crate) fn of(measured: &[[f64; 3]]) -> Option<Self> {
        // Scales both sizes to 1, so that the matrix is well conditioned.
        let largest = |k: usize| measured.iter().map(|m| m[k]).fold(f64::MIN_POSITIVE, f64::max);
        let scale = DVec3::new(1.0, 1.0 / largest(0), 1.0 / largest(1));
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for &[x, y, cost] in measured {
            let row = DVec3::new(1.0, x, y) * scale / cost;
            matrix += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
            right += row;
        }
        let size = matrix.x_axis.x * matrix.y_axis.y * matrix.z_axis.z;
        let determined = measured.len() >= 3 && matrix.determinant() > 1e-9 * size;
        if !determined {
            return None;
        }
        let [fixed, first, second] = (matrix.inverse() * right * scale).to_array();
        let deviation = |&[x, y, cost]: &[f64; 3]| ((fixed + first * x + second * y) / cost - 1.0).abs();
        let worst = measured.iter().map(deviation).fold(0.0, f64::max);
        Some(Self { fixed, first, second, worst })
    }
}
