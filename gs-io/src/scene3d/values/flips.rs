//! Flips axes, bit-exactly, for files with y up or z back.

use glam::{DMat3, DVec3, Vec3};
use gs_core::{Scene, Scene3d};

/// The axes along which each of 3DGS's SH is odd: 1 for x, 2 for y, 4 for z. Degrees 0 to 3.
const ODD_AXES: [u8; 16] = [0, 2, 4, 1, 3, 6, 0, 5, 0, 2, 7, 2, 4, 1, 4, 1];

/// The sign of each axis, 1 or −1; a reflection if one or three are flipped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Flips([f32; 3]);

impl Flips {
    /// Flips with these signs, each 1 or −1.
    pub(crate) const fn new(signs: [f32; 3]) -> Self {
        Self(signs)
    }

    /// The flips that a matrix performs, if it is one of flips.
    pub(crate) fn of_matrix(matrix: DMat3) -> Option<Self> {
        let signs = DVec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z);
        let is = matrix == DMat3::from_diagonal(signs) && signs.abs() == DVec3::ONE;
        is.then(|| Self(signs.as_vec3().to_array()))
    }

    pub(crate) fn mean(self, mean: Vec3) -> Vec3 {
        mean * Vec3::from(self.0)
    }

    /// Flips a quaternion (w, x, y, z): F R F, whose axes are those of F R up to their signs.
    pub(crate) fn rotation(self, [w, x, y, z]: [f32; 4]) -> [f32; 4] {
        let [a, b, c] = self.0;
        [w, x * (b * c), y * (c * a), z * (a * b)]
    }

    /// The factor of SH coefficient `k`.
    pub(crate) fn sign_of_coefficient(self, k: usize) -> f32 {
        (0..3).filter(|axis| ODD_AXES[k] >> axis & 1 == 1).map(|axis| self.0[axis]).product()
    }

    /// Flips a whole scene.
    pub(crate) fn apply(self, scene: &mut Scene3d) {
        if self.0 == [1.0; 3] {
            return;
        }
        scene.means.iter_mut().for_each(|m| *m = self.mean(*m));
        scene.rotations.iter_mut().for_each(|q| *q = self.rotation(*q));
        let signs: Vec<f32> = (0..scene.sh_len()).map(|k| self.sign_of_coefficient(k)).collect();
        debug_assert_eq!(scene.sh.len(), scene.len() * signs.len());
        scene.sh.iter_mut().zip(signs.iter().cycle()).for_each(|(c, sign)| *c *= *sign);
    }
}
