//! Reading the scene of a saved state without a backend.

use glam::{Mat2, Vec2, Vec3};

use super::SplatsState;
use crate::{
    adam::Parameterization,
    error::Error,
    math::sh::coefficients,
    scene::{Gaussian2d, Scene, Scene2d, Scene3d},
};

impl SplatsState {
    /// Whether the state belongs to a 3D scene: only 3D scenes have spherical harmonics.
    pub fn is_3d(&self) -> bool {
        self.contains("sh")
    }

    /// The 2D scene of the state: the same values as those of a backend that restores the state and
    /// downloads its scene. They may be NaN.
    ///
    /// # Errors
    /// [`Error::State`] for tensors that are missing or of another type, [`Error::Length`] where
    /// they hold different numbers of Gaussians.
    pub fn scene_2d(&self) -> Result<Scene2d, Error> {
        let (log_scales, rotations) = match self.parameterization {
            Parameterization::ScaleRotation => {
                let scales = self.rows::<2>("log_scale")?.into_iter().map(Vec2::from_array).collect();
                (scales, self.rows::<1>("rotation")?.into_iter().flatten().collect())
            }
            Parameterization::CovarianceFactor => {
                let factors = self.rows::<4>("factor")?;
                factors.iter().map(|factor| Gaussian2d::shape_of_factor(Mat2::from_cols_array(factor))).unzip()
            }
        };
        let scene = Scene2d {
            means: self.rows::<2>("mean")?.into_iter().map(Vec2::from_array).collect(),
            log_scales,
            rotations,
            opacity_logits: match self.contains("opacity_logit") {
                true => self.rows::<1>("opacity_logit")?.into_iter().flatten().collect(),
                false => Vec::new(),
            },
            colors: self.rows::<3>("color")?.into_iter().map(Vec3::from_array).collect(),
        };
        scene.check_lengths()?;
        Ok(scene)
    }

    /// The SH degree of the 3D scene of the state.
    ///
    /// # Errors
    /// [`Error::State`] where the tensor `sh` is missing or of no degree.
    pub fn sh_degree(&self) -> Result<u8, Error> {
        let (columns, _) = self.matrix("sh")?;
        (0..=3)
            .find(|&degree| 3 * coefficients(degree) == columns)
            .ok_or_else(|| Error::State(format!("tensor `sh` has {columns} columns, not 3, 12, 27 or 48")))
    }

    /// The 3D scene of the state; as [`Self::scene_2d`].
    ///
    /// # Errors
    /// Those of [`Self::scene_2d`].
    pub fn scene_3d(&self) -> Result<Scene3d, Error> {
        let (sh_degree, (_, sh)) = (self.sh_degree()?, self.matrix("sh")?);
        let scene = Scene3d {
            means: self.rows::<3>("mean")?.into_iter().map(Vec3::from_array).collect(),
            log_scales: self.rows::<3>("log_scale")?.into_iter().map(Vec3::from_array).collect(),
            rotations: self.rows::<4>("rotation")?,
            opacity_logits: self.rows::<1>("opacity_logit")?.into_iter().flatten().collect(),
            sh_degree,
            sh: sh.as_chunks::<3>().0.iter().map(|&c| Vec3::from_array(c)).collect(),
        };
        scene.check_lengths()?;
        Ok(scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    #[test]
    fn a_2d_scene_is_read_in_either_parameterization() {
        let mut state = SplatsState::new(Parameterization::ScaleRotation);
        state.insert("mean", [[1.0, 2.0], [3.0, 4.0]]);
        state.insert("log_scale", [[0.1, 0.2], [0.3, 0.4]]);
        state.insert("rotation", [[0.5], [0.6]]);
        state.insert("color", [[0.7, 0.8, 0.9], [1.0, 1.1, -1.2]]);
        let scene = state.scene_2d().unwrap();
        assert!(!state.is_3d() && !scene.has_opacity());
        assert_eq!(scene.gaussian(1).color, Vec3::new(1.0, 1.1, -1.2));
        assert_eq!((scene.gaussian(1).log_scale, scene.gaussian(1).rotation), (Vec2::new(0.3, 0.4), 0.6));

        state.parameterization = Parameterization::CovarianceFactor;
        assert!(state.scene_2d().is_err(), "there is no factor");
        state.insert("factor", scene.iter().map(|g| g.factor().to_cols_array()));
        state.insert("opacity_logit", [[1.5], [-1.5]]);
        let factored = state.scene_2d().unwrap();
        for (a, b) in scene.iter().zip(factored.iter()) {
            assert!(a.covariance().abs_diff_eq(b.covariance(), 1e-5));
        }
        assert_eq!(factored.opacity_logits, [1.5, -1.5]);
        state.insert("color", [[0.7, 0.8, 0.9]]);
        assert!(matches!(state.scene_2d(), Err(Error::Length { .. })));
    }

    #[test]
    fn a_3d_scene_is_read() {
        let mut state = SplatsState::new(Parameterization::ScaleRotation);
        state.insert("mean", [[1.0, 2.0, 3.0]]);
        state.insert("log_scale", [[0.1, 0.2, 0.3]]);
        state.insert("rotation", [[0.8, 0.0, 0.6, 0.0]]);
        state.insert("opacity_logit", [[0.25]]);
        state.insert_matrix("sh", 12, (0..12).map(|v| v as f32).collect());
        let scene = state.scene_3d().unwrap();
        assert!(state.is_3d());
        assert_eq!((scene.sh_degree, scene.sh[3]), (1, Vec3::new(9.0, 10.0, 11.0)));
        state.insert_matrix("sh", 5, vec![0.0; 5]);
        assert!(state.scene_3d().unwrap_err().to_string().contains("5 columns"));
    }
}
