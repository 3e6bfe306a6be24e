//! Gaussians in 3D (paper §2.1).

use glam::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

use super::{Scene, check_finite, check_len, check_logit};
use crate::{
    error::Error,
    math::{perspective::Ellipsoid, sh::coefficients},
    view::Camera,
};

/// N 3D Gaussians.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Scene3d {
    /// Means μ, `[N, 3]`, world units.
    pub means: Vec<Vec3>,
    /// ln of the scales along the three axes, `[N, 3]`, ln(world units).
    pub log_scales: Vec<Vec3>,
    /// Rotations as quaternions (w, x, y, z), `[N, 4]`, of any length but 0.
    pub rotations: Vec<[f32; 4]>,
    /// Opacity logits, `[N]`; ±∞ is legitimate.
    pub opacity_logits: Vec<f32>,
    /// SH degree d, 0 to 3.
    pub sh_degree: u8,
    /// SH coefficients, `[N, K, 3]` with K = (d + 1)²; colour = ½ + SH(direction), clamped at 0.
    pub sh: Vec<Vec3>,
}

/// One 3D Gaussian; units as in [`Scene3d`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gaussian3d {
    /// Mean μ, world units.
    pub mean: Vec3,
    /// ln of the scales along the three axes, ln(world units).
    pub log_scale: Vec3,
    /// Rotation as a quaternion (w, x, y, z), of any length but 0.
    pub rotation: [f32; 4],
    /// Opacity logit; +∞ is opaque.
    pub opacity_logit: f32,
    /// SH coefficients, `[K, 3]`.
    pub sh: Vec<Vec3>,
}

impl Gaussian3d {
    /// Covariance factor M = R(q) S, so that Σ = M Mᵀ (paper eq. 5). `None` where q is too short to
    /// have a direction ([`MIN_QUATERNION_NORM2`](crate::constants::MIN_QUATERNION_NORM2)).
    pub fn factor(&self) -> Option<Mat3> {
        let Self { mean, log_scale, rotation, opacity_logit, .. } = *self;
        Ellipsoid { mean, log_scale, rotation, opacity_logit }.factor()
    }

    /// Returns this Gaussian with another SH degree: coefficients beyond it are dropped, missing
    /// ones are 0.
    #[must_use]
    pub fn with_degree(mut self, sh_degree: u8) -> Self {
        self.sh.resize(coefficients(sh_degree), Vec3::ZERO);
        self
    }

    /// Covariance Σ = R S Sᵀ Rᵀ (paper eq. 5), world units²; `None` as for [`Self::factor`].
    pub fn covariance(&self) -> Option<Mat3> {
        self.factor().map(|m| m * m.transpose())
    }
}

impl Scene3d {
    /// Number of SH coefficients per Gaussian and channel, K = (d + 1)².
    pub fn sh_len(&self) -> usize {
        coefficients(self.sh_degree)
    }

    /// Returns the scene with another SH degree, 0 to 3: coefficients beyond it are dropped, missing ones are 0.
    #[must_use]
    pub fn with_degree(self, sh_degree: u8) -> Self {
        let (before, after) = (self.sh_len(), coefficients(sh_degree));
        let shared = before.min(after);
        let mut sh = vec![Vec3::ZERO; self.len() * after];
        sh.chunks_exact_mut(after).zip(self.sh.chunks_exact(before)).for_each(|(to, from)| {
            to[..shared].copy_from_slice(&from[..shared]);
        });
        Self { sh_degree, sh, ..self }
    }

    /// Makes room for further Gaussians of the scene's degree.
    pub fn reserve(&mut self, additional: usize) {
        let coefficients = additional * self.sh_len();
        self.means.reserve(additional);
        self.log_scales.reserve(additional);
        self.rotations.reserve(additional);
        self.opacity_logits.reserve(additional);
        self.sh.reserve(coefficients);
    }

    /// Appends the Gaussians of another scene. Both get the higher of their SH degrees.
    pub fn append(&mut self, other: Self) {
        let degree = self.sh_degree.max(other.sh_degree);
        if self.sh_degree != degree {
            *self = std::mem::take(self).with_degree(degree);
        }
        let other = if other.sh_degree == degree { other } else { other.with_degree(degree) };
        let Self { means, log_scales, rotations, opacity_logits, sh_degree: _, sh } = other;
        self.means.extend(means);
        self.log_scales.extend(log_scales);
        self.rotations.extend(rotations);
        self.opacity_logits.extend(opacity_logits);
        self.sh.extend(sh);
    }
}

/// The scene has the highest degree of its Gaussians; missing coefficients are 0.
impl FromIterator<Gaussian3d> for Scene3d {
    fn from_iter<T: IntoIterator<Item = Gaussian3d>>(gaussians: T) -> Self {
        let gaussians: Vec<Gaussian3d> = gaussians.into_iter().collect();
        let most = gaussians.iter().map(|g| g.sh.len()).max().unwrap_or(0);
        let sh_degree = (0..3).find(|&degree| coefficients(degree) >= most).unwrap_or(3);
        let mut scene = Self { sh_degree, ..Self::default() };
        gaussians.into_iter().for_each(|g| scene.push(g.with_degree(sh_degree)));
        scene
    }
}

impl Scene for Scene3d {
    type View = Camera;
    type Gaussian = Gaussian3d;

    fn len(&self) -> usize {
        self.means.len()
    }

    fn gaussian(&self, index: usize) -> Gaussian3d {
        let k = self.sh_len();
        Gaussian3d {
            mean: self.means[index],
            log_scale: self.log_scales[index],
            rotation: self.rotations[index],
            opacity_logit: self.opacity_logits[index],
            sh: self.sh[index * k..][..k].to_vec(),
        }
    }

    /// Appends one Gaussian.
    ///
    /// # Panics
    /// Where it does not have [`sh_len`](Scene3d::sh_len) coefficients; see
    /// [`Gaussian3d::with_degree`].
    fn push(&mut self, g: Gaussian3d) {
        let (found, degree) = (g.sh.len(), self.sh_degree);
        assert_eq!(found, self.sh_len(), "a Gaussian of SH degree {degree} has {} coefficients", self.sh_len());
        self.sh.extend(g.sh);
        self.means.push(g.mean);
        self.log_scales.push(g.log_scale);
        self.rotations.push(g.rotation);
        self.opacity_logits.push(g.opacity_logit);
    }

    fn check_lengths(&self) -> Result<(), Error> {
        let n = self.len();
        Error::within("sh_degree", self.sh_degree, ..=3, "0 to 3")?;
        check_len("log_scales", n, self.log_scales.len())?;
        check_len("rotations", n, self.rotations.len())?;
        check_len("opacity_logits", n, self.opacity_logits.len())?;
        check_len("sh", n * self.sh_len(), self.sh.len())
    }

    fn validate(&self) -> Result<(), Error> {
        self.check_lengths()?;
        for i in 0..self.len() {
            check_finite("mean", i, &self.means[i].to_array())?;
            check_finite("log-scale", i, &self.log_scales[i].to_array())?;
            check_finite("rotation", i, &self.rotations[i])?;
            check_logit(i, self.opacity_logits[i])?;
        }
        for (i, c) in self.sh.iter().enumerate() {
            check_finite("SH coefficient", i / self.sh_len(), &c.to_array())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussians_are_collected_at_the_highest_of_their_degrees() {
        let gaussian = |coefficients: usize| Gaussian3d {
            mean: Vec3::splat(coefficients as f32),
            log_scale: Vec3::ZERO,
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 0.5,
            sh: vec![Vec3::ONE; coefficients],
        };
        let scene: Scene3d = [gaussian(1), gaussian(9), gaussian(4)].into_iter().collect();
        scene.validate().unwrap();
        assert_eq!((scene.len(), scene.sh_degree), (3, 2));
        assert_eq!(scene.gaussian(0), gaussian(1).with_degree(2));
        assert_eq!(scene.gaussian(1), gaussian(9));
        assert_eq!(std::iter::empty::<Gaussian3d>().collect::<Scene3d>(), Scene3d::default());
    }

    #[test]
    fn scenes_of_different_degrees_are_put_together() {
        for [first, second] in [[0, 1], [1, 0], [2, 2]] {
            let scene = |degree: u8| -> Scene3d {
                let sh = (0..coefficients(degree)).map(|k| Vec3::splat(1.0 + k as f32)).collect();
                [Gaussian3d { sh, ..of_degree_0() }].into_iter().collect()
            };
            let mut both = scene(first);
            both.append(scene(second));
            both.validate().unwrap();
            assert_eq!((both.len(), both.sh_degree), (2, first.max(second)));
            for (index, degree) in [first, second].into_iter().enumerate() {
                assert_eq!(both.gaussian(index), scene(degree).gaussian(0).with_degree(both.sh_degree));
            }
        }
    }

    #[test]
    fn covariance_follows_the_rotation_of_any_length() {
        let quarter_turn_about_z = [2.0, 0.0, 0.0, 2.0];
        let g = Gaussian3d {
            mean: Vec3::ZERO,
            log_scale: Vec3::new(2f32.ln(), 0.0, 0.0),
            rotation: quarter_turn_about_z,
            opacity_logit: 0.0,
            sh: vec![Vec3::ZERO],
        };
        let expected = Mat3::from_diagonal(Vec3::new(1.0, 4.0, 1.0));
        assert!(g.covariance().unwrap().abs_diff_eq(expected, 1e-5));
        assert_eq!(Gaussian3d { rotation: [0.0; 4], ..g }.covariance(), None);
    }

    #[test]
    fn a_gaussian_of_another_degree_is_converted_first() {
        let mut scene = Scene3d { sh_degree: 1, ..Default::default() };
        scene.push(of_degree_0().with_degree(1));
        scene.validate().unwrap();
        assert_eq!(scene.gaussian(0).sh, [Vec3::ONE, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO]);
        assert_eq!(scene.gaussian(0).with_degree(0), of_degree_0());
    }

    #[test]
    #[should_panic(expected = "a Gaussian of SH degree 1 has 4 coefficients")]
    fn a_gaussian_of_another_degree_is_not_taken() {
        Scene3d { sh_degree: 1, ..Default::default() }.push(of_degree_0());
    }

    fn of_degree_0() -> Gaussian3d {
        Gaussian3d {
            mean: Vec3::ZERO,
            log_scale: Vec3::ZERO,
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: f32::INFINITY,
            sh: vec![Vec3::ONE],
        }
    }
}
