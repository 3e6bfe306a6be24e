//! What density control asks of a Gaussian and does to it: all that differs between Gaussians in 2D and in 3D. Policies and
//! actions are written once, on top of this.

use std::fmt::Debug;

use glam::{Vec2, Vec3};
use gs_core::{Error, Gaussian2d, Gaussian3d, Scene, Scene2d, Scene3d};
use rand_distr::{Distribution, StandardNormal};

use crate::observation::Rng;

/// A Gaussian whose density can be controlled. Lengths are in the scene's unit: px, or world units.
pub trait DensityGaussian: Clone + Debug + PartialEq {
    /// Whether all parameters, and the covariance made of them, are finite. The opacity's logit may be ±∞: opaque, vanishing.
    fn is_finite(&self) -> bool;

    /// The opacity's logit.
    fn opacity_logit(&self) -> f32;

    /// Gives it another opacity.
    fn set_opacity_logit(&mut self, logit: f32);

    /// Changes its colour (in 3D each of its SH coefficients), a linear map of it.
    fn map_color(&mut self, map: impl Fn(Vec3) -> Vec3);

    /// The largest of its scales (the standard deviation along its longest axis).
    fn largest_scale(&self) -> f32;

    /// Adds to the ln of all scales.
    fn resize(&mut self, ln_factor: f32);

    /// Multiplies the scale along its longest axis, and those across it. Of equal axes the first counts as the longest.
    fn reshape(&mut self, along: f32, across: f32);

    /// The same at a point drawn from it.
    #[must_use]
    fn drawn(&self, rng: &mut Rng) -> Self;

    /// The same, moved so many of its largest scales along its longest axis.
    #[must_use]
    fn moved_along(&self, scales: f32) -> Self;
}

/// A scene whose density can be controlled.
pub trait DensityScene: Scene<Gaussian: DensityGaussian> {
    /// Whether Gaussians have opacities; without them they are summed, and every one is opaque.
    fn has_opacity(&self) -> bool;

    /// The opacity's logit of Gaussian `index`.
    ///
    /// # Panics
    /// When there is no such Gaussian.
    fn opacity_logit(&self, index: usize) -> f32;

    /// Gaussian `index` without its colour: where it is, its shape and its opacity. For what looks at all Gaussians often.
    ///
    /// # Panics
    /// When there is no such Gaussian.
    fn shape(&self, index: usize) -> Self::Gaussian;

    /// Fails unless all arrays describe the same number of Gaussians. Their values may be anything, NaN too.
    ///
    /// # Errors
    /// [`Error::Length`] naming the first that does not.
    fn check_lengths(&self) -> Result<(), Error>;

    /// What [`Noise`](crate::Noise) of this strength multiplies Σ η with in a scene of this extent.
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
}

impl DensityScene for Scene2d {
    fn has_opacity(&self) -> bool {
        Self::has_opacity(self)
    }

    fn opacity_logit(&self, index: usize) -> f32 {
        if self.has_opacity() { self.opacity_logits[index] } else { f32::INFINITY }
    }

    fn shape(&self, index: usize) -> Gaussian2d {
        self.gaussian(index)
    }

    fn check_lengths(&self) -> Result<(), Error> {
        let expected = self.means.len();
        let opacity_logits = if self.has_opacity() { self.opacity_logits.len() } else { expected };
        check_lengths(
            expected,
            [
                ("log_scales", self.log_scales.len()),
                ("rotations", self.rotations.len()),
                ("opacity_logits", opacity_logits),
                ("colors", self.colors.len()),
            ],
        )
    }

    /// strength / extent, so that pictures of any size behave alike.
    fn noise_factor(strength: f32, extent: f32) -> f32 {
        strength / extent
    }
}

impl DensityGaussian for Gaussian3d {
    /// Also whether the rotation has a direction: without one, nothing is finite that is made of it.
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
}

impl DensityScene for Scene3d {
    fn has_opacity(&self) -> bool {
        true
    }

    fn opacity_logit(&self, index: usize) -> f32 {
        self.opacity_logits[index]
    }

    fn shape(&self, index: usize) -> Gaussian3d {
        Gaussian3d {
            mean: self.means[index],
            log_scale: self.log_scales[index],
            rotation: self.rotations[index],
            opacity_logit: self.opacity_logits[index],
            sh: Vec::new(),
        }
    }

    fn check_lengths(&self) -> Result<(), Error> {
        let expected = self.means.len();
        check_lengths(
            expected,
            [
                ("log_scales", self.log_scales.len()),
                ("rotations", self.rotations.len()),
                ("opacity_logits", self.opacity_logits.len()),
            ],
        )?;
        check_lengths(expected * self.sh_len(), [("sh", self.sh.len())])
    }

    /// strength · extent: the code of 3DGS-MCMC multiplies by the position's learning rate, which grows with the extent.
    fn noise_factor(strength: f32, extent: f32) -> f32 {
        strength * extent
    }
}

/// Fails unless all these lengths are as expected.
pub(crate) fn check_lengths<const N: usize>(expected: usize, lengths: [(&'static str, usize); N]) -> Result<(), Error> {
    match lengths.into_iter().find(|&(_, found)| found != expected) {
        Some((what, found)) => Err(Error::Length { what, expected, found }),
        None => Ok(()),
    }
}

fn is_first_longer(gaussian: &Gaussian2d) -> bool {
    gaussian.log_scale.x >= gaussian.log_scale.y
}

/// The index of the longest axis, the first of equals.
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
