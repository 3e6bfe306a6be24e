//! Camera poses: converts the conventions of data sets to world-to-camera.

use glam::{DMat3, DQuat, DVec3, dvec3};

use crate::{WorldFrame, dataset::Skip};

/// Tolerance of a rotation matrix, for any element of MᵀM − 1. Text with six digits and `f32`
/// arithmetic stay well below.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// A pose: x_camera = rotation · x_world + translation, with camera axes right, down, forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pose {
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
}

impl Pose {
    /// The pose of COLMAP's world-to-camera form, with a quaternion of any length but 0.
    ///
    /// # Errors
    /// [`Skip::PoseNotFinite`], [`Skip::BadPose`].
    pub(crate) fn world_to_camera(rotation: DQuat, translation: DVec3) -> Result<Self, Skip> {
        let norm = rotation.length();
        if !norm.is_finite() || !translation.is_finite() {
            return Err(Skip::PoseNotFinite);
        }
        if !(norm > 1e-6) || !translation.as_vec3().is_finite() {
            return Err(Skip::BadPose);
        }
        Ok(Self { rotation: DMat3::from_quat(rotation / norm), translation })
    }

    /// The pose of Blender's and Nerfstudio's form: 3 or 4 rows of a camera-to-world matrix with
    /// camera axes right, up, back (OpenGL). A uniform scale, as of a scaled camera object in
    /// Blender, does not change the picture and is ignored.
    ///
    /// # Errors
    /// [`Skip::PoseNotFinite`]; [`Skip::BadPose`] if the matrix is anything but rotation, translation
    /// and uniform scale.
    pub(crate) fn camera_to_world(rows: &[Vec<f64>]) -> Result<Self, Skip> {
        if rows.iter().flatten().any(|value| !value.is_finite()) {
            return Err(Skip::PoseNotFinite);
        }
        let (linear, position) = affine(rows).ok_or(Skip::BadPose)?;
        let scale = linear.determinant().cbrt();
        if !(scale > 1e-9) || !position.as_vec3().is_finite() {
            return Err(Skip::BadPose);
        }
        let turned = linear * (1.0 / scale);
        if !(turned.transpose() * turned).abs_diff_eq(DMat3::IDENTITY, ROTATION_TOLERANCE) {
            return Err(Skip::BadPose);
        }
        // Orthonormalises the matrix, then converts (right, up, back) to (right, down, forward).
        let turned = DMat3::from_quat(DQuat::from_mat3(&turned).normalize());
        let rotation = DMat3::from_cols(turned.x_axis, -turned.y_axis, -turned.z_axis).transpose();
        Ok(Self { rotation, translation: -(rotation * position) })
    }

    /// Position of the camera in the world.
    pub(crate) fn position(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// The pose relative to a frame: x_camera / unit = rotation · x_frame + translation.
    pub(crate) fn in_frame(&self, frame: &WorldFrame) -> Self {
        Self { translation: (self.translation + self.rotation * frame.origin) / frame.unit, ..*self }
    }
}

/// The linear part and the translation of a 3×4 or 4×4 matrix by rows; `None` for another shape, a
/// last row other than (0, 0, 0, 1), or numbers that are not finite.
pub(crate) fn affine(rows: &[Vec<f64>]) -> Option<(DMat3, DVec3)> {
    let finite = rows.iter().all(|row| row.len() == 4 && row.iter().all(|v| v.is_finite()));
    let last = rows.get(3).is_none_or(|row| row[..] == [0.0, 0.0, 0.0, 1.0]);
    if !(3..=4).contains(&rows.len()) || !finite || !last {
        return None;
    }
    let column = |j: usize| dvec3(rows[0][j], rows[1][j], rows[2][j]);
    Some((DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(matrix: [[f64; 4]; 4]) -> Vec<Vec<f64>> {
        matrix.map(Vec::from).into()
    }

    const ABOVE: [[f64; 4]; 4] = [[1., 0., 0., 2.], [0., 1., 0., 3.], [0., 0., 1., 5.], [0., 0., 0., 1.]];

    #[test]
    fn an_opengl_camera_looks_along_minus_z_with_y_up() {
        let pose = Pose::camera_to_world(&rows(ABOVE)).unwrap();
        let seen = |x, y, z| pose.rotation * dvec3(x, y, z) + pose.translation;
        assert_eq!(seen(2.0, 3.0, 5.0), DVec3::ZERO);
        assert_eq!(seen(2.0, 3.0, 4.0), dvec3(0.0, 0.0, 1.0), "what lies towards -z is ahead");
        assert_eq!(seen(3.0, 4.0, 4.0), dvec3(1.0, -1.0, 1.0), "right stays right, up is minus down");
    }

    #[test]
    fn a_scaled_camera_stands_where_it_stood() {
        let mut scaled = ABOVE;
        (0..3).for_each(|i| scaled[i][i] = 7.0);
        assert_eq!(Pose::camera_to_world(&rows(scaled)), Pose::camera_to_world(&rows(ABOVE)));
    }

    #[test]
    fn invalid_poses_are_refused() {
        let spoilt = |i: usize, j: usize, value: f64| {
            let mut matrix = ABOVE;
            matrix[i][j] = value;
            Pose::camera_to_world(&rows(matrix))
        };
        for (i, j, value) in [(0, 0, -1.0), (0, 0, 2.0), (0, 1, 0.1), (1, 3, f64::NAN), (0, 0, 0.0), (3, 0, 1.0)] {
            let why = if value.is_nan() { Skip::PoseNotFinite } else { Skip::BadPose };
            assert_eq!(spoilt(i, j, value), Err(why), "{value} at ({i}, {j})");
        }
        assert_eq!(spoilt(2, 3, 1e300), Err(Skip::BadPose), "beyond f32");
        assert_eq!(Pose::camera_to_world(&rows(ABOVE)[..2]), Err(Skip::BadPose));
        assert_eq!(Pose::camera_to_world(&[vec![1.0], vec![], vec![]]), Err(Skip::BadPose));
        assert_eq!(Pose::world_to_camera(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ZERO), Err(Skip::BadPose));
        assert_eq!(
            Pose::world_to_camera(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0), DVec3::ZERO),
            Err(Skip::PoseNotFinite)
        );
        assert_eq!(Pose::world_to_camera(DQuat::IDENTITY, DVec3::splat(f64::INFINITY)), Err(Skip::PoseNotFinite));
        let doubled = Pose::world_to_camera(DQuat::IDENTITY * 2.0, DVec3::ONE).unwrap();
        assert_eq!(doubled.rotation, DMat3::IDENTITY);
    }
}
