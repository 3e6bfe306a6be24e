//! What density control needs of Gaussians and scenes: all that differs between 2D and 3D. Policies
//! and actions are written once, on top of this.

use std::fmt::Debug;

use glam::{Mat3, Vec2, Vec3};
use gs_core::{Gaussian2d, Gaussian3d, Scene, Scene2d, Scene3d};
use rand_distr::{Distribution, StandardNormal};

use super::Rng;

/// A Gaussian whose density can be controlled. Lengths are in the scene's unit: px, or world units.
pub trait DensityGaussian: Clone + Debug + PartialEq {
    /// Whether all parameters and the covariance are finite. The opacity logit may be ±∞: opaque or
    /// invisible.
    fn is_finite(&self) -> bool;

    /// Opacity logit.
    fn opacity_logit(&self) -> f32;

    /// Changes the opacity logit.
    fn set_opacity_logit(&mut self, logit: f32);

    /// Changes the colour (in 3D each SH coefficient) by a linear map.
    fn map_color(&mut self, map: impl Fn(Vec3) -> Vec3);

    /// Largest scale: the standard deviation along the longest axis.
    fn largest_scale(&self) -> f32;

    /// Product of the scales.
    fn volume(&self) -> f32;

    /// Adds `ln_factor` to the ln of all scales.
    fn resize(&mut self, ln_factor: f32);

    /// Multiplies the scale along the longest axis (the first of equals) by `along`, and the others
    /// by `across`.
    fn reshape(&mut self, along: f32, across: f32);

    /// Returns this Gaussian at a point drawn from it.
    #[must_use]
    fn drawn(&self, rng: &mut Rng) -> Self;

    /// Returns this Gaussian, moved along its longest axis by `scales` times its largest scale.
    #[must_use]
    fn moved_along(&self, scales: f32) -> Self;

    /// Returns this Gaussian, moved by this vector; in 2D by its first two components.
    #[must_use]
    fn moved_by(&self, offset: Vec3) -> Self;

    /// L with Σ = L Lᵀ, whose columns are the axes; `None` for 2D Gaussians and where it is not
    /// finite.
    fn axes(&self) -> Option<Mat3>;
}

/// A scene whose density can be controlled.
pub trait DensityScene: Scene<Gaussian: DensityGaussian> {
    /// Whether Gaussians have opacities; without them they are opaque and are summed.
    fn has_opacity(&self) -> bool;

    /// Opacity logit of Gaussian `index`.
    ///
    /// # Panics
    /// Where there is no such Gaussian.
    fn opacity_logit(&self, index: usize) -> f32;

    /// Factor of Σ η for [`Noise`](crate::Noise) of this strength in a scene of this extent.
    fn noise_factor(strength: f32, extent: f32) -> f32;
}

impl DensityGaussian for Gaussian2d {
    fn is_finite(&self) -> bool {
        self.mean.is_finite()
            && self.log_scale.is_finite()
            && self.rotation.is_finite()
            && !self.opacity_logit.is_nan()
            && self.color.is_finite()
            && self.covariance().is_finite()
    }

    fn opacity_logit(&self) -> f32 {
        self.opacity_logit
    }

    fn set_opacity_logit(&mut self, logit: f32) {
        self.opacity_logit = logit;
    }

    fn map_color(&mut self, map: impl Fn(Vec3) -> Vec3) {
        self.color = map(self.color);
    }

    fn largest_scale(&self) -> f32 {
        self.log_scale.max_element().exp()
    }

    fn volume(&self) -> f32 {
        self.log_scale.element_sum().exp()
    }

    fn resize(&mut self, ln_factor: f32) {
        self.log_scale += ln_factor;
    }

    fn reshape(&mut self, along: f32, across: f32) {
        let factors = if is_first_longer(self) { Vec2::new(along, across) } else { Vec2::new(across, along) };
        self.log_scale += factors.map(f32::ln);
    }

    fn drawn(&self, rng: &mut Rng) -> Self {
        Self { mean: self.mean + self.factor() * normal2(rng), ..*self }
    }

    fn moved_along(&self, scales: f32) -> Self {
        let factor = self.factor();
        let axis = if is_first_longer(self) { factor.x_axis } else { factor.y_axis };
        Self { mean: self.mean + scales * axis, ..*self }
    }

    fn moved_by(&self, offset: Vec3) -> Self {
        Self { mean: self.mean + offset.truncate(), ..*self }
    }

    fn axes(&self) -> Option<Mat3> {
        None
    }
}

impl DensityScene for Scene2d {
    fn has_opacity(&self) -> bool {
        Self::has_opacity(self)
    }

    fn opacity_logit(&self, index: usize) -> f32 {
        if self.has_opacity() { self.opacity_logits[index] } else { f32::INFINITY }
    }

    /// strength / extent, so that images of any size behave alike.
    fn noise_factor(strength: f32, extent: f32) -> f32 {
        strength / extent
    }
}

impl DensityGaussian for Gaussian3d {
    /// Whether all parameters are usable: also false where the quaternion has no direction.
    fn is_finite(&self) -> bool {
        self.mean.is_finite()
            && self.log_scale.is_finite()
            && self.rotation.iter().all(|v| v.is_finite())
            && !self.opacity_logit.is_nan()
            && self.sh.iter().all(|c| c.is_finite())
            && self.covariance().is_some_and(|covariance| covariance.is_finite())
    }

    fn opacity_logit(&self) -> f32 {
        self.opacity_logit
    }

    fn set_opacity_logit(&mut self, logit: f32) {
        self.opacity_logit = logit;
    }

    fn map_color(&mut self, map: impl Fn(Vec3) -> Vec3) {
        self.sh.iter_mut().for_each(|c| *c = map(*c));
    }

    fn largest_scale(&self) -> f32 {
        self.log_scale.max_element().exp()
    }

    fn volume(&self) -> f32 {
        self.log_scale.element_sum().exp()
    }

    fn resize(&mut self, ln_factor: f32) {
        self.log_scale += ln_factor;
    }

    fn reshape(&mut self, along: f32, across: f32) {
        let mut factors = Vec3::splat(across);
        factors[longest(self)] = along;
        self.log_scale += factors.map(f32::ln);
    }

    fn drawn(&self, rng: &mut Rng) -> Self {
        let offset = self.factor().map_or(Vec3::ZERO, |factor| factor * normal3(rng));
        Self { mean: self.mean + offset, ..self.clone() }
    }

    fn moved_along(&self, scales: f32) -> Self {
        let axis = self.factor().map_or(Vec3::ZERO, |factor| factor.col(longest(self)));
        Self { mean: self.mean + scales * axis, ..self.clone() }
    }

    fn moved_by(&self, offset: Vec3) -> Self {
        Self { mean: self.mean + offset, ..self.clone() }
    }

    fn axes(&self) -> Option<Mat3> {
        self.factor().filter(|factor| factor.is_finite())
    }
}

impl DensityScene for Scene3d {
    fn has_opacity(&self) -> bool {
        true
    }

    fn opacity_logit(&self, index: usize) -> f32 {
        self.opacity_logits[index]
    }

    /// strength · extent: the code of 3DGS-MCMC multiplies by the learning rate of means, which is
    /// in units of the extent.
    fn noise_factor(strength: f32, extent: f32) -> f32 {
        strength * extent
    }
}

fn is_first_longer(gaussian: &Gaussian2d) -> bool {
    gaussian.log_scale.x >= gaussian.log_scale.y
}

/// Index of the longest axis, the first of equals.
fn longest(gaussian: &Gaussian3d) -> usize {
    let [x, y, z] = gaussian.log_scale.to_array();
    if x >= y && x >= z {
        0
    } else if y >= z {
        1
    } else {
        2
    }
}

fn normal2(rng: &mut Rng) -> Vec2 {
    Vec2::new(StandardNormal.sample(rng), StandardNormal.sample(rng))
}

fn normal3(rng: &mut Rng) -> Vec3 {
    Vec3::new(StandardNormal.sample(rng), StandardNormal.sample(rng), StandardNormal.sample(rng))
}
