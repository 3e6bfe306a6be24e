//! Adam in `f64` on the covariance factors of 3D Gaussians.
//!
//! [`Parameterization::CovarianceFactor`](gs_core::Parameterization::CovarianceFactor) defines it:
//! Σ = M Mᵀ, μ ← μ + M ξ, M ← M (I + η + η²/2). The axes of M come from the eigenvectors of Σ, and
//! gradients by η from those by Σ.

use glam::{DMat3, DQuat, DVec3};
use gs_core::{
    adam::{AdamRates, Rate},
    constants::{MAX_ETA, MAX_XI},
};

use super::parameters::{OPACITY_3D, OracleScene, Parameters, QUATERNION, SH_3D};

/// Count of the numbers that move the geometry: ξ, and η₀₀, η₀₁, η₀₂, η₁₁, η₁₂, η₂₂.
const STEPS: usize = 9;

/// Row and column in η of each of its six numbers.
const ENTRIES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// A 3D Gaussian with its covariance factor and moments.
#[derive(Debug, Clone, PartialEq)]
pub struct FactoredReference {
    /// μ.
    pub mean: DVec3,
    /// M.
    pub factor: DMat3,
    /// The opacity's logit, then the SH coefficients, each R, G, B.
    pub rest: Vec<f64>,
    /// First moments: by ξ 3, η 6, opacity, SH.
    pub first: Vec<f64>,
    /// Second moments.
    pub second: Vec<f64>,
    /// Number of steps.
    pub steps: i32,
}

impl FactoredReference {
    /// A Gaussian from a row of a scene, with zero moments.
    pub fn new(row: &Parameters) -> Self {
        let scales = DVec3::from_slice(&row[3..QUATERNION]).map(f64::exp);
        let factor = rotation(row) * DMat3::from_diagonal(scales);
        let rest = row[OPACITY_3D..].to_vec();
        let zeros = vec![0.0; STEPS + rest.len()];
        Self { mean: DVec3::from_slice(row), factor, rest, first: zeros.clone(), second: zeros, steps: 0 }
    }

    /// The Gaussian as a row of a scene.
    ///
    /// Ln-scales and quaternion come from Σ's eigenvectors, in the order nearest to M's columns.
    pub fn row(&self) -> Parameters {
        let (axes, variances) = eigenvectors(self.factor * self.factor.transpose());
        let q = DQuat::from_mat3(&axes);
        let shape = variances.map(|variance| 0.5 * variance.max(0.0).ln());
        let geometry = self.mean.to_array().into_iter().chain(shape.to_array()).chain([q.w, q.x, q.y, q.z]);
        geometry.chain(self.rest.iter().copied()).collect()
    }

    /// Moves by one step along `gradient`.
    ///
    /// The gradient is by the numbers of `row`, a row of this Gaussian with any order and sign of
    /// axes.
    pub fn step(&mut self, row: &Parameters, gradient: &Parameters, rates: &AdamRates) {
        self.steps += 1;
        let by_xi = self.factor.transpose() * DVec3::from_slice(gradient);
        let by_eta = self.by_eta(row, gradient);
        let slopes = by_xi.to_array().into_iter().chain(by_eta).chain(gradient[OPACITY_3D..].iter().copied());
        let moved: Vec<f64> = slopes.enumerate().map(|(i, slope)| self.moved(i, slope, rates)).collect();
        let most = f64::from(MAX_XI);
        self.mean -= self.factor * DVec3::from_slice(&moved).map(|entry| entry.clamp(-most, most));
        let mut eta = [[0.0; 3]; 3];
        for (k, (i, j)) in ENTRIES.into_iter().enumerate() {
            let entry = (-moved[3 + k]).clamp(-f64::from(MAX_ETA), f64::from(MAX_ETA));
            (eta[i][j], eta[j][i]) = (entry, entry);
        }
        let eta = DMat3::from_cols_array_2d(&eta);
        self.factor *= DMat3::IDENTITY + eta + eta * eta * 0.5;
        self.bound(f64::from(rates.min_scale), f64::from(rates.max_scale));
        self.rest.iter_mut().zip(&moved[STEPS..]).for_each(|(value, moved)| *value -= moved);
    }

    /// Clamps the scales to their bounds, with the same axes.
    fn bound(&mut self, floor: f64, ceiling: f64) {
        let (axes, variances) = eigenvectors(self.factor * self.factor.transpose());
        let scales = variances.map(f64::sqrt);
        let within = scales.clamp(DVec3::splat(floor), DVec3::splat(ceiling));
        if within != scales {
            self.factor = axes * DMat3::from_diagonal(within / scales) * axes.transpose() * self.factor;
        }
    }

    /// The change of number `i` in a step along `slope`.
    fn moved(&mut self, i: usize, slope: f64, rates: &AdamRates) -> f64 {
        let Rate { learning_rate, beta1, beta2 } = *rate_of(i, rates);
        let [rate, beta1, beta2] = [learning_rate, beta1, beta2].map(f64::from);
        let (first, second) = (&mut self.first[i], &mut self.second[i]);
        *first = beta1 * *first + (1.0 - beta1) * slope;
        *second = beta2 * *second + (1.0 - beta2) * slope * slope;
        let (m, v) = (*first / (1.0 - beta1.powi(self.steps)), *second / (1.0 - beta2.powi(self.steps)));
        rate * m / (v.sqrt() + f64::from(rates.epsilon))
    }

    /// 2 Mᵀ (∂L/∂Σ) M, with ∂L/∂Σ from the gradient by ln-scales and quaternion.
    fn by_eta(&self, row: &Parameters, gradient: &Parameters) -> [f64; 6] {
        let axes = rotation(row);
        let [a, b, c] = [3, 4, 5].map(|i| (2.0 * row[i]).exp());
        let [by_a, by_b, by_c] = [3, 4, 5].map(|i| gradient[i]);
        // d(ln s) changes s² along its axis by 2 s². A rotation about an axis changes Σ by the
        // difference of the other two variances.
        let turn = axes.transpose() * by_turn(row, gradient);
        let (xy, yz, zx) = (turn.z / (a - b), turn.x / (b - c), turn.y / (c - a));
        let by_sigma = DMat3::from_cols_array_2d(&[
            [by_a / (2.0 * a), xy / 2.0, zx / 2.0],
            [xy / 2.0, by_b / (2.0 * b), yz / 2.0],
            [zx / 2.0, yz / 2.0, by_c / (2.0 * c)],
        ]);
        let seen = axes.transpose() * self.factor;
        let by_eta = (seen.transpose() * by_sigma * seen * 2.0).to_cols_array_2d();
        ENTRIES.map(|(i, j)| by_eta[i][j])
    }
}

/// The Gaussians as a scene.
pub fn factored_scene(gaussians: &[FactoredReference]) -> OracleScene {
    OracleScene { gaussians: gaussians.iter().map(FactoredReference::row).collect() }
}

/// The rate of number `i` of a step.
fn rate_of(i: usize, rates: &AdamRates) -> &Rate {
    match i {
        0..3 => &rates.mean,
        3..STEPS => &rates.scale,
        STEPS => &rates.opacity,
        _ if i < STEPS + SH_3D + 3 - OPACITY_3D => &rates.color,
        _ => &rates.color_rest,
    }
}

fn quaternion(row: &Parameters) -> DQuat {
    DQuat::from_xyzw(row[QUATERNION + 1], row[QUATERNION + 2], row[QUATERNION + 3], row[QUATERNION])
}

fn rotation(row: &Parameters) -> DMat3 {
    DMat3::from_quat(quaternion(row).normalize())
}

/// The gradient by a rotation about the world's axes: each moves q along ½ (0, axis) q.
fn by_turn(row: &Parameters, gradient: &Parameters) -> DVec3 {
    let (q, by_q) = (quaternion(row), quaternion(gradient));
    DVec3::from_array(DVec3::AXES.map(|axis| 0.5 * by_q.dot(DQuat::from_xyzw(axis.x, axis.y, axis.z, 0.0) * q)))
}

/// The eigenvectors of a symmetric matrix, a rotation's columns, and its eigenvalues, by Jacobi's
/// method.
fn eigenvectors(mut matrix: DMat3) -> (DMat3, DVec3) {
    let mut axes = DMat3::IDENTITY;
    for _ in 0..60 {
        let m = matrix.to_cols_array_2d();
        let weight = |i: usize, j: usize| m[i][j].abs() / (m[i][i] * m[j][j]).abs().sqrt().max(f64::MIN_POSITIVE);
        let (i, j) = [(0, 1), (0, 2), (1, 2)]
            .into_iter()
            .max_by(|&a, &b| weight(a.0, a.1).total_cmp(&weight(b.0, b.1)))
            .unwrap_or((0, 1));
        if !(weight(i, j) > 1e-15) {
            break;
        }
        let angle = 0.5 * (2.0 * m[i][j]).atan2(m[i][i] - m[j][j]);
        // Two rotations make the entry 0. The smaller one keeps the order of the axes.
        let quarter = std::f64::consts::FRAC_PI_2;
        let angle = if angle.abs() > 0.5 * quarter { angle - quarter.copysign(angle) } else { angle };
        let (sin, cos) = angle.sin_cos();
        let mut turn = DMat3::IDENTITY.to_cols_array_2d();
        (turn[i][i], turn[i][j], turn[j][i], turn[j][j]) = (cos, sin, -sin, cos);
        let turn = DMat3::from_cols_array_2d(&turn);
        matrix = turn.transpose() * matrix * turn;
        axes *= turn;
    }
    (axes, DVec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference() -> FactoredReference {
        let row = [0.3, -0.2, 0.9, -1.0, -2.5, -0.4, 0.5, -0.4, 0.3, 0.7, 0.2, 0.1, 0.2, 0.3].to_vec();
        let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1);
        let mut reference = FactoredReference::new(&row);
        reference.factor *= turn;
        reference
    }

    #[test]
    fn a_row_is_the_same_covariance() {
        let reference = reference();
        let sigma = |g: &FactoredReference| g.factor * g.factor.transpose();
        let again = FactoredReference::new(&reference.row());
        assert!(sigma(&again).abs_diff_eq(sigma(&reference), 1e-14));
        assert!((rotation(&again.row()).determinant() - 1.0).abs() < 1e-14);
    }

    /// The gradient by η of any smooth function of Σ equals central differences.
    #[test]
    fn gradients_by_eta_are_central_differences() {
        let weights =
            DMat3::from_cols(DVec3::new(0.4, 0.1, -0.3), DVec3::new(0.1, 0.7, 0.2), DVec3::new(-0.3, 0.2, 0.5));
        let loss = |g: &FactoredReference| {
            let m = weights * g.factor * g.factor.transpose();
            m.x_axis.x + m.y_axis.y + m.z_axis.z
        };
        let of_row = |row: &Parameters| loss(&FactoredReference::new(row));
        let reference = reference();
        let row = reference.row();
        let h = 1e-6;
        let nudged = |i: usize, by: f64| {
            let mut row = row.clone();
            row[i] += by;
            row
        };
        let gradient = (0..row.len()).map(|i| (of_row(&nudged(i, h)) - of_row(&nudged(i, -h))) / (2.0 * h)).collect();
        let found = reference.by_eta(&row, &gradient);
        for (k, (i, j)) in ENTRIES.into_iter().enumerate() {
            let stretched = |by: f64| {
                let mut eta = DMat3::ZERO.to_cols_array_2d();
                eta[i][j] += by;
                if i != j {
                    eta[j][i] += by;
                }
                let factor = reference.factor * (DMat3::IDENTITY + DMat3::from_cols_array_2d(&eta));
                loss(&FactoredReference { factor, ..reference.clone() })
            };
            let numeric = (stretched(h) - stretched(-h)) / (2.0 * h) / if i == j { 1.0 } else { 2.0 };
            assert!((found[k] - numeric).abs() < 1e-8, "{k}: {} {numeric}", found[k]);
        }
    }
}
