//! Gaussians in the image plane (paper §3.2).

use glam::{Mat2, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use super::{Scene, check_finite, check_len, check_logit};
use crate::{error::Error, view::Canvas};

/// N 2D Gaussians.
///
/// Plane coordinates are pixels of the image the scene was made for: the origin is its top-left
/// corner, y points down, and the centre of pixel (i, j) is (i + ½, j + ½).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Scene2d {
    /// Means μ, `[N, 2]`, px.
    pub means: Vec<Vec2>,
    /// ln of the scales (standard deviations along the two axes), `[N, 2]`, ln(px).
    pub log_scales: Vec<Vec2>,
    /// Rotation of the first axis, `[N]`, rad, from +x towards +y.
    pub rotations: Vec<f32>,
    /// Opacity logits, `[N]`; or empty where every Gaussian is opaque, as under
    /// [`Blend::Sum`](crate::effects::Blend).
    pub opacity_logits: Vec<f32>,
    /// Colours, `[N, 3]`, RGB as in the image file; may lie outside 0..=1.
    pub colors: Vec<Vec3>,
}

/// One 2D Gaussian; units as in [`Scene2d`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gaussian2d {
    /// Mean μ, px.
    pub mean: Vec2,
    /// ln of the scales along the two axes, ln(px).
    pub log_scale: Vec2,
    /// Rotation of the first axis, rad, from +x towards +y.
    pub rotation: f32,
    /// Opacity logit; +∞ is opaque.
    pub opacity_logit: f32,
    /// Colour, RGB.
    pub color: Vec3,
}

impl Gaussian2d {
    /// Covariance factor L = R(θ) S, so that Σ = L Lᵀ (paper eq. 7). Unit: px.
    pub fn factor(&self) -> Mat2 {
        let (sin, cos) = self.rotation.sin_cos();
        let s = self.log_scale.map(f32::exp);
        Mat2::from_cols(Vec2::new(cos, sin) * s.x, Vec2::new(-sin, cos) * s.y)
    }

    /// Covariance Σ = R S Sᵀ Rᵀ (paper eq. 7). Unit: px².
    pub fn covariance(&self) -> Mat2 {
        let l = self.factor();
        l * l.transpose()
    }

    /// ln-scales and rotation of Σ = L Lᵀ, the larger scale first; the rotation lies in (−π/2,
    /// π/2].
    ///
    /// Computed in `f64`, from the singular values of L itself, so that needles keep their short
    /// axis.
    pub fn shape_of_factor(l: Mat2) -> (Vec2, f32) {
        let [a, c] = l.x_axis.as_dvec2().to_array(); // first column
        let [b, d] = l.y_axis.as_dvec2().to_array(); // second column
        let (e, f) = ((a + d) * 0.5, (a - d) * 0.5);
        let (g, h) = ((c + b) * 0.5, (c - b) * 0.5);
        let (q, r) = (e.hypot(h), f.hypot(g));
        let large = q + r;
        let small = if large > 0.0 { ((a * d - b * c) / large).abs() } else { 0.0 };
        let mut angle = 0.5 * (h.atan2(e) + g.atan2(f));
        if angle > std::f64::consts::FRAC_PI_2 {
            angle -= std::f64::consts::PI;
        } else if angle <= -std::f64::consts::FRAC_PI_2 {
            angle += std::f64::consts::PI;
        }
        (Vec2::new(large.ln() as f32, small.ln() as f32), angle as f32)
    }
}

impl Scene2d {
    /// Whether opacities are stored; without them every Gaussian is opaque.
    pub fn has_opacity(&self) -> bool {
        !self.opacity_logits.is_empty()
    }

    /// All Gaussians in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Gaussian2d> + '_ {
        (0..self.len()).map(|i| self.gaussian(i))
    }
}

impl FromIterator<Gaussian2d> for Scene2d {
    fn from_iter<T: IntoIterator<Item = Gaussian2d>>(gaussians: T) -> Self {
        let mut scene = Self::default();
        gaussians.into_iter().for_each(|g| scene.push(g));
        scene
    }
}

impl Scene for Scene2d {
    type View = Canvas;
    type Gaussian = Gaussian2d;

    fn len(&self) -> usize {
        self.means.len()
    }

    fn gaussian(&self, index: usize) -> Gaussian2d {
        Gaussian2d {
            mean: self.means[index],
            log_scale: self.log_scales[index],
            rotation: self.rotations[index],
            opacity_logit: if self.has_opacity() { self.opacity_logits[index] } else { f32::INFINITY },
            color: self.colors[index],
        }
    }

    /// Appends one Gaussian. The scene stores opacities from the first Gaussian on that is not
    /// opaque.
    fn push(&mut self, g: Gaussian2d) {
        if self.has_opacity() || g.opacity_logit != f32::INFINITY {
            self.opacity_logits.resize(self.means.len(), f32::INFINITY);
            self.opacity_logits.push(g.opacity_logit);
        }
        self.means.push(g.mean);
        self.log_scales.push(g.log_scale);
        self.rotations.push(g.rotation);
        self.colors.push(g.color);
    }

    fn check_lengths(&self) -> Result<(), Error> {
        let n = self.len();
        check_len("log_scales", n, self.log_scales.len())?;
        check_len("rotations", n, self.rotations.len())?;
        check_len("colors", n, self.colors.len())?;
        if self.has_opacity() {
            check_len("opacity_logits", n, self.opacity_logits.len())?;
        }
        Ok(())
    }

    fn validate(&self) -> Result<(), Error> {
        self.check_lengths()?;
        for (i, g) in self.iter().enumerate() {
            check_finite("mean", i, &g.mean.to_array())?;
            check_finite("log-scale", i, &g.log_scale.to_array())?;
            check_finite("rotation", i, &[g.rotation])?;
            check_logit(i, g.opacity_logit)?;
            check_finite("colour", i, &g.color.to_array())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shape_of_factor_inverts_factor() {
        for (ls, angle) in [((1.0, -0.5), 0.3), ((2.0, -6.0), -1.2), ((0.5, 0.4), 1.5)] {
            let g = Gaussian2d {
                mean: Vec2::ZERO,
                log_scale: Vec2::new(ls.0, ls.1),
                rotation: angle,
                opacity_logit: 0.0,
                color: Vec3::ZERO,
            };
            let (log_scale, rotation) = Gaussian2d::shape_of_factor(g.factor());
            assert!((log_scale - g.log_scale).abs().max_element() < 2e-4, "{log_scale} {}", g.log_scale);
            assert!((rotation - angle).abs() < 1e-5, "{rotation} {angle}");
        }
    }

    #[test]
    fn opacity_appears_with_the_first_translucent_gaussian() {
        let opaque = Gaussian2d {
            mean: Vec2::ONE,
            log_scale: Vec2::ZERO,
            rotation: 0.0,
            opacity_logit: f32::INFINITY,
            color: Vec3::ONE,
        };
        let mut scene: Scene2d = [opaque, opaque].into_iter().collect();
        assert!(!scene.has_opacity());
        scene.push(Gaussian2d { opacity_logit: -1.0, ..opaque });
        assert_eq!(scene.opacity_logits, [f32::INFINITY, f32::INFINITY, -1.0]);
        scene.validate().unwrap();
    }

    #[test]
    fn validate_names_the_offender() {
        let mut scene = Scene2d { means: vec![Vec2::ZERO], ..Default::default() };
        assert_eq!(scene.validate(), Err(Error::Length { what: "log_scales", expected: 1, found: 0 }));
        scene.log_scales.push(Vec2::new(0.0, f32::INFINITY));
        scene.rotations.push(0.0);
        scene.colors.push(Vec3::ZERO);
        assert!(matches!(scene.validate(), Err(Error::NotFinite { what: "log-scale", index: 0, .. })));
    }
}
