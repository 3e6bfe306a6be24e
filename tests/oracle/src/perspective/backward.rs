//! The vector-Jacobian product of `perspective`, with its legend, derived by hand.

use gs_core::Output;

use crate::{
    parameters::SH_3D,
    rounded::{Matrix, Rounded, applied, dot, product, transposed},
    spherical_harmonics,
    splat::{COLOR_SHARE, OPACITY_SHARE},
};

/// Intermediate results of `perspective` that the derivatives need.
#[derive(Debug, Clone)]
pub(super) struct Chain {
    /// W.
    pub(super) world: Matrix<3, 3>,
    /// t.
    pub(super) translation: [Rounded; 3],
    /// μ.
    pub(super) mean: [Rounded; 3],
    pub(super) focal: [Rounded; 2],
    /// tx, ty, clamped.
    pub(super) slopes: [Rounded; 2],
    pub(super) clamped: [bool; 2],
    pub(super) jacobian: Matrix<2, 3>,
    /// q/|q|.
    pub(super) quaternion: [Rounded; 4],
    pub(super) quaternion_length: Rounded,
    pub(super) scales: [Rounded; 3],
    /// R S.
    pub(super) factor: Matrix<3, 3>,
    /// N.
    pub(super) seen: Matrix<3, 3>,
    /// M′.
    pub(super) footprint: Matrix<2, 3>,
    /// sigmoid(logit).
    pub(super) opacity: Rounded,
    /// √(det Σ / det Σ′), or 1.
    pub(super) compensation: Rounded,
    /// ∂(compensation)/∂Σ, where uv stands for both entries.
    pub(super) compensation_slope: [Rounded; 3],
    /// Unit vector from the camera.
    pub(super) direction: [Rounded; 3],
    pub(super) distance: Rounded,
    /// Evaluated coefficients, `[k][channel]`.
    pub(super) sh: Vec<[f64; 3]>,
    /// Number of stored coefficients.
    pub(super) sh_len: usize,
    /// Channels whose colour is not clamped at 0.
    pub(super) shows: [bool; 3],
    pub(super) output: Output,
}

/// ∂L/∂ what a Gaussian's parameters and the camera have in common.
struct Shared {
    /// v_N.
    seen: Matrix<3, 3>,
    /// v_J.
    jacobian: Matrix<2, 3>,
    /// v_p.
    point: [Rounded; 3],
    /// By the SH coefficients, `[k][channel]`.
    sh: Vec<[Rounded; 3]>,
    /// By the vector from the camera to the mean, through the direction.
    away: [Rounded; 3],
}

impl Chain {
    /// ∂L/∂(parameters) from ∂L/∂(u, v, Σ′uu, Σ′uv, Σ′vv, opacity, red, green, blue).
    pub(super) fn vjp(&self, v: [Rounded; 9], point: [Rounded; 3]) -> Vec<Rounded> {
        let Shared { seen: v_seen, point: v_point, sh: v_sh, away: v_away, .. } = self.shared(&v, point);
        // N = W R S
        let v_frame = product(&transposed(&self.world), &v_seen);
        let v_log_scale: [Rounded; 3] =
            std::array::from_fn(|k| (0..3).map(|i| v_frame[i][k] * self.factor[i][k]).sum());
        let v_rotation: Matrix<3, 3> = std::array::from_fn(|i| std::array::from_fn(|k| v_frame[i][k] * self.scales[k]));
        let v_unit = rotation_vjp(&self.quaternion, &v_rotation);
        let along = dot(&self.quaternion, &v_unit);
        let v_quaternion: [Rounded; 4] =
            std::array::from_fn(|i| (v_unit[i] - self.quaternion[i] * along) / self.quaternion_length);
        let of_point = applied(&transposed(&self.world), &v_point);
        let v_mean: [Rounded; 3] = std::array::from_fn(|i| of_point[i] + v_away[i]);
        let v_logit = v[OPACITY_SHARE] * self.compensation * self.opacity * (Rounded::ONE - self.opacity);
        let mut all = Vec::with_capacity(SH_3D + 3 * self.sh_len);
        all.extend(v_mean);
        all.extend(v_log_scale);
        all.extend(v_quaternion);
        all.push(v_logit);
        all.extend(v_sh.into_iter().flatten());
        all
    }

    /// ∂L/∂(a twist on the left of the pose, focal length, principal point) from the same.
    ///
    /// W and t stand in p = W μ + t, in N = W R S, and in the vector from the camera, μ + Wᵀ t. The
    /// twist (v, ω) moves them by dW = ω × W, column by column, and dt = ω × t + v.
    pub(super) fn camera_vjp(&self, v: [Rounded; 9], point: [Rounded; 3]) -> [Rounded; 10] {
        let Self { world, translation, mean, factor, focal, slopes, clamped, .. } = self;
        let Shared { seen: v_seen, jacobian: v_jacobian, point: v_point, away: v_away, .. } = self.shared(&v, point);
        let of_seen = product(&v_seen, &transposed(factor));
        let v_world: Matrix<3, 3> = std::array::from_fn(|i| {
            std::array::from_fn(|j| of_seen[i][j] + v_point[i] * mean[j] + translation[i] * v_away[j])
        });
        let of_away = applied(world, &v_away);
        let v_translation: [Rounded; 3] = std::array::from_fn(|i| v_point[i] + of_away[i]);
        let mut v_turn = cross(translation, &v_translation);
        for (column, v_column) in transposed(world).iter().zip(&transposed(&v_world)) {
            let of_column = cross(column, v_column);
            v_turn = std::array::from_fn(|i| v_turn[i] + of_column[i]);
        }
        let [x, y, z] = point;
        let (mut v_focal, mut v_center) = ([Rounded::ZERO; 2], [v[0], v[1]]);
        for (i, at) in [x, y].into_iter().enumerate() {
            let (diagonal, last) = (v_jacobian[i][i], v_jacobian[i][2]);
            v_focal[i] = v[i] * at / z + diagonal / z - last * slopes[i] / z;
            if clamped[i] {
                // The bound is (a constant − c)/f.
                let v_bound = -(last * focal[i] / z);
                v_focal[i] = v_focal[i] - v_bound * slopes[i] / focal[i];
                v_center[i] = v_center[i] - v_bound / focal[i];
            }
        }
        let mut all = [Rounded::ZERO; 10];
        all[0..3].copy_from_slice(&v_translation);
        all[3..6].copy_from_slice(&v_turn);
        all[6..8].copy_from_slice(&v_focal);
        all[8..10].copy_from_slice(&v_center);
        all
    }

    fn shared(&self, v: &[Rounded; 9], [x, y, z]: [Rounded; 3]) -> Shared {
        let [fx, fy] = self.focal;
        let v_opacity = v[OPACITY_SHARE];
        // Antialiasing adds a constant to Σ, and the compensation depends on it.
        let [uu, uv, vv]: [Rounded; 3] =
            std::array::from_fn(|i| v[2 + i] + v_opacity * self.opacity * self.compensation_slope[i]);
        // Σ = M′ M′ᵀ
        let v_spread = [[uu, 0.5 * uv], [0.5 * uv, vv]];
        let v_footprint = product(&v_spread, &self.footprint).map(|row| row.map(|v| 2.0 * v));
        // M′ = J N
        let v_jacobian = product(&v_footprint, &transposed(&self.seen));
        let v_seen = product(&transposed(&self.jacobian), &v_footprint);

        // u = fx x/z + cx; J = (fx/z, 0, −fx tx/z; 0, fy/z, −fy ty/z), tx = x/z unless clamped.
        let mut v_point = [Rounded::ZERO; 3];
        for (i, (f, at)) in [(fx, x), (fy, y)].into_iter().enumerate() {
            let (diagonal, last) = (v_jacobian[i][i], v_jacobian[i][2]);
            v_point[i] = v[i] * f / z;
            v_point[2] =
                v_point[2] - v[i] * f * at / (z * z) - diagonal * f / (z * z) + last * f * self.slopes[i] / (z * z);
            if !self.clamped[i] {
                v_point[i] = v_point[i] - last * f / (z * z);
                v_point[2] = v_point[2] + last * f * at / (z * z * z);
            }
        }
        if self.output == Output::InverseDepth {
            // 1/z in each channel.
            let v_inverse: Rounded = v[COLOR_SHARE..].iter().copied().sum();
            v_point[2] = v_point[2] - v_inverse / (z * z);
        }

        let mut v_direction = [Rounded::ZERO; 3];
        let mut v_sh = vec![[Rounded::ZERO; 3]; self.sh_len];
        for (k, coefficients) in self.sh.iter().enumerate() {
            let (value, slope) =
                (spherical_harmonics::basis(k, &self.direction), spherical_harmonics::gradient(k, &self.direction));
            for channel in (0..3).filter(|&channel| self.shows[channel]) {
                let v_channel = v[COLOR_SHARE + channel];
                v_sh[k][channel] = value * v_channel;
                let weighted = Rounded::exact(coefficients[channel]) * v_channel;
                v_direction = std::array::from_fn(|i| v_direction[i] + weighted * slope[i]);
            }
        }
        let mut v_away = [Rounded::ZERO; 3];
        if self.distance.value > 0.0 {
            let along = dot(&self.direction, &v_direction);
            v_away = std::array::from_fn(|i| (v_direction[i] - self.direction[i] * along) / self.distance);
        }
        Shared { seen: v_seen, jacobian: v_jacobian, point: v_point, sh: v_sh, away: v_away }
    }
}

fn cross(a: &[Rounded; 3], b: &[Rounded; 3]) -> [Rounded; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// ∂L/∂(w, x, y, z) of the rotation of a unit quaternion from v_R, as if the four were free.
fn rotation_vjp(&[w, x, y, z]: &[Rounded; 4], v: &Matrix<3, 3>) -> [Rounded; 4] {
    // Off the diagonal, only the antisymmetric and symmetric parts of v_R matter.
    let turn = [v[2][1] - v[1][2], v[0][2] - v[2][0], v[1][0] - v[0][1]];
    let [yz, zx, xy] = [v[2][1] + v[1][2], v[0][2] + v[2][0], v[1][0] + v[0][1]];
    [
        2.0 * (x * turn[0] + y * turn[1] + z * turn[2]),
        2.0 * (w * turn[0] + y * xy + z * zx - 2.0 * x * (v[1][1] + v[2][2])),
        2.0 * (w * turn[1] + x * xy + z * yz - 2.0 * y * (v[0][0] + v[2][2])),
        2.0 * (w * turn[2] + x * zx + y * yz - 2.0 * z * (v[0][0] + v[1][1])),
    ]
}
