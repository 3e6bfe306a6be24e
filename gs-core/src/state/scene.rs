//! The scene in a saved state, read without a backend.

use glam::{Mat2, Mat3, Vec2, Vec3};

use super::CloudState;
use crate::{
    adam::Chart,
    error::Error,
    scene::{PlanarGaussian, PlanarScene, SpatialGaussian, SpatialScene},
    sh::coefficients,
};

impl CloudState {
    /// Whether the state is that of a 3D scene: only those have spherical harmonics.
    pub fn is_spatial(&self) -> bool {
        self.contains("sh")
    }

    /// The 2D scene of the state: the same values as a backend that restores the state and downloads its scene. They may be NaN.
    ///
    /// # Errors
    /// [`Error::State`] for tensors that are missing or of another type, [`Error::Length`] where they hold different numbers of
    /// Gaussians.
    pub fn planar_scene(&self) -> Result<PlanarScene, Error> {
        let (log_scales, rotations) = match self.chart {
            Chart::ScaleRotation => {
                let scales = self.rows::<2>("log_scale")?.into_iter().map(Vec2::from_array).collect();
                (scales, self.rows::<1>("rotation")?.into_iter().flatten().collect())
            }
            Chart::LocalFrame => {
                let frames = self.rows::<4>("frame")?;
                frames.iter().map(|frame| PlanarGaussian::shape_of_frame(Mat2::from_cols_array(frame))).unzip()
            }
        };
        let scene = PlanarScene {
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

    /// The 3D scene of the state; as [`Self::planar_scene`].
    ///
    /// # Errors
    /// Those of [`Self::planar_scene`].
    pub fn spatial_scene(&self) -> Result<SpatialScene, Error> {
        let (columns, sh) = self.matrix("sh")?;
        let Some(sh_degree) = (0..=3).find(|&degree| 3 * coefficients(degree) == columns) else {
            return Err(Error::State(format!("tensor `sh` has {columns} columns, not 3, 12, 27 or 48")));
        };
        let (log_scales, rotations) = match self.chart {
            Chart::ScaleRotation => {
                let scales = self.rows::<3>("log_scale")?.into_iter().map(Vec3::from_array).collect();
                (scales, self.rows::<4>("rotation")?)
            }
            Chart::LocalFrame => {
                let frames = self.rows::<9>("frame")?;
                frames.iter().map(|frame| SpatialGaussian::shape_of_frame(Mat3::from_cols_array(frame))).unzip()
            }
        };
        let scene = SpatialScene {
            means: self.rows::<3>("mean")?.into_iter().map(Vec3::from_array).collect(),
            log_scales,
            rotations,
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
    fn a_2d_scene_is_read_in_either_chart() {
        let mut state = CloudState::new(Chart::ScaleRotation);
        state.insert("mean", [[1.0, 2.0], [3.0, 4.0]]);
        state.insert("log_scale", [[0.1, 0.2], [0.3, 0.4]]);
        state.insert("rotation", [[0.5], [0.6]]);
        state.insert("color", [[0.7, 0.8, 0.9], [1.0, 1.1, -1.2]]);
        let scene = state.planar_scene().unwrap();
        assert!(!state.is_spatial() && !scene.has_opacity());
        assert_eq!(scene.gaussian(1).color, Vec3::new(1.0, 1.1, -1.2));
        assert_eq!((scene.gaussian(1).log_scale, scene.gaussian(1).rotation), (Vec2::new(0.3, 0.4), 0.6));

        state.chart = Chart::LocalFrame;
        assert!(state.planar_scene().is_err(), "there is no frame");
        state.insert("frame", scene.iter().map(|g| g.frame().to_cols_array()));
        state.insert("opacity_logit", [[1.5], [-1.5]]);
        let framed = state.planar_scene().unwrap();
        for (a, b) in scene.iter().zip(framed.iter()) {
            assert!(a.covariance().abs_diff_eq(b.covariance(), 1e-5));
        }
        assert_eq!(framed.opacity_logits, [1.5, -1.5]);
        state.insert("color", [[0.7, 0.8, 0.9]]);
        assert!(matches!(state.planar_scene(), Err(Error::Length { .. })));
    }

    #[test]
    fn a_3d_scene_is_read_in_either_chart() {
        let mut state = CloudState::new(Chart::ScaleRotation);
        state.insert("mean", [[1.0, 2.0, 3.0]]);
        state.insert("log_scale", [[0.1, 0.2, 0.3]]);
        state.insert("rotation", [[0.8, 0.0, 0.6, 0.0]]);
        state.insert("opacity_logit", [[0.25]]);
        state.insert_matrix("sh", 12, (0..12).map(|v| v as f32).collect());
        let scene = state.spatial_scene().unwrap();
        assert!(state.is_spatial());
        assert_eq!((scene.sh_degree, scene.sh[3]), (1, Vec3::new(9.0, 10.0, 11.0)));
        state.chart = Chart::LocalFrame;
        let covariance = scene.gaussian(0).covariance().unwrap();
        state.insert("frame", [scene.gaussian(0).frame().unwrap().to_cols_array()]);
        let framed = state.spatial_scene().unwrap();
        assert!(framed.gaussian(0).covariance().unwrap().abs_diff_eq(covariance, 1e-5));
        state.insert_matrix("sh", 5, vec![0.0; 5]);
        assert!(state.spatial_scene().unwrap_err().to_string().contains("5 columns"));
    }
}
