//! The optimiser's settings: Adam (Kingma & Ba 2015) with rates of its own for every group of parameters.

use serde::{Deserialize, Serialize};

use crate::{
    constants::{MAX_SCALE_PX, MIN_SCALE_PX},
    error::Error,
};

/// In which coordinates the optimiser moves a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Parameterization {
    /// Mean in px, ln-scale, angle (or quaternion): as the paper and 3DGS do.
    #[default]
    ScaleRotation,
    /// The Gaussian's own whitened coordinates, Σ = L Lᵀ: μ ← μ + L ξ, L ← L (I + η + η²/2) with η symmetric. A step means the same
    /// fraction of its extent for every Gaussian, however small or thin. In space: [`covariance_factor`](crate::covariance_factor).
    #[serde(alias = "local-frame")]
    CovarianceFactor,
}

impl Parameterization {
    /// As settings files and flags have it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ScaleRotation => "scale-rotation",
            Self::CovarianceFactor => "covariance-factor",
        }
    }
}

/// How a learning rate changes over a run, as a factor of its first value.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Schedule {
    /// 1.
    #[default]
    Constant,
    /// From 1 to `to` along half a cosine.
    Cosine {
        /// Last factor.
        to: f32,
    },
    /// From 1 to `to` geometrically (3DGS's decay of the position's rate).
    Exponential {
        /// Last factor, positive.
        to: f32,
    },
}

impl Schedule {
    /// The factor at `progress` in 0..=1 of the run.
    pub fn factor(self, progress: f32) -> f32 {
        let p = progress.clamp(0.0, 1.0);
        match self {
            Self::Constant => 1.0,
            Self::Cosine { to } => to + (1.0 - to) * 0.5 * (1.0 + (std::f32::consts::PI * p).cos()),
            Self::Exponential { to } => to.powf(p),
        }
    }
}

/// Adam's numbers for one group of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Group {
    /// Step size, in the parameter's own unit (in [`Parameterization::CovarianceFactor`]: in standard deviations).
    pub learning_rate: f32,
    /// Decay of the first moment, 0..1.
    pub beta1: f32,
    /// Decay of the second moment, 0..1.
    pub beta2: f32,
    /// How the rate changes over the run.
    pub schedule: Schedule,
}

impl Default for Group {
    fn default() -> Self {
        Self { learning_rate: 1e-2, beta1: 0.9, beta2: 0.999, schedule: Schedule::Constant }
    }
}

impl Group {
    /// A constant rate with the usual betas (0.9, 0.999).
    pub fn constant(learning_rate: f32) -> Self {
        Self { learning_rate, ..Self::default() }
    }
}

/// Which Gaussians an Adam step moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Participants {
    /// All: the moments of those out of view decay, and still move them (3DGS).
    #[default]
    All,
    /// Those that some tile of this step's factor lists; of the others nothing changes, step counts included (*source:* sparse Adam, as in
    /// Taming 3DGS, Mallick et al. 2024). A step then costs what is in view.
    Visible,
}

/// What pulls every Gaussian to be fainter and smaller, beside the loss (*source:* 3DGS-MCMC, Kheradmand et al. 2024): with it, Gaussians
/// that the pictures do not need vanish, and can be put elsewhere. It adds opacity · (mean of all opacities) + scale · (mean of all scales, in
/// the scene's unit) to what is minimised, but not to the loss that is told. 3D scenes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Penalty {
    /// Weight of the mean opacity, not negative; 0.01 in the source.
    pub opacity: f32,
    /// Weight of the mean scale, not negative; 0.01 in the source.
    pub scale: f32,
}

impl Penalty {
    /// Nothing pulls.
    pub const NONE: Self = Self { opacity: 0.0, scale: 0.0 };
}

/// Adam's settings. Bias correction counts each Gaussian's own steps, so that one born late starts as the first did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Adam {
    /// Mean: px (3D scenes: world units), or ξ in the covariance factor.
    pub mean: Group,
    /// ln-scale, or η in the covariance factor.
    pub scale: Group,
    /// Rotation, rad; unused in the covariance factor, where η turns the axes.
    pub rotation: Group,
    /// Opacity logit.
    pub opacity: Group,
    /// Colour; of 3D scenes the SH coefficient of degree 0.
    pub color: Group,
    /// SH coefficients above degree 0. 3D scenes.
    pub color_rest: Group,
    /// Added to √v̂, against division by zero.
    pub epsilon: f32,
    /// No scale shrinks below this, px (3D scenes: world units).
    pub min_scale: f32,
    /// No scale grows above this, px (3D scenes: world units).
    pub max_scale: f32,
    /// Which Gaussians a step moves.
    pub participants: Participants,
    /// What pulls beside the loss. 3D scenes.
    pub penalty: Penalty,
}

impl Default for Adam {
    fn default() -> Self {
        Self {
            mean: Group::constant(0.2),
            scale: Group::constant(0.02),
            rotation: Group::constant(0.02),
            opacity: Group::constant(0.05),
            color: Group::constant(0.01),
            color_rest: Group::constant(0.01 / 20.0),
            epsilon: 1e-15,
            min_scale: MIN_SCALE_PX,
            max_scale: MAX_SCALE_PX,
            participants: Participants::All,
            penalty: Penalty::NONE,
        }
    }
}

/// One group's numbers at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Step size now.
    pub learning_rate: f32,
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
}

/// Adam's numbers at one step: [`Adam`] with its schedules evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdamRates {
    /// Mean.
    pub mean: Rate,
    /// ln-scale.
    pub scale: Rate,
    /// Rotation.
    pub rotation: Rate,
    /// Opacity logit.
    pub opacity: Rate,
    /// Colour, or the SH coefficient of degree 0.
    pub color: Rate,
    /// SH coefficients above degree 0.
    pub color_rest: Rate,
    /// Added to √v̂.
    pub epsilon: f32,
    /// Floor of every scale.
    pub min_scale: f32,
    /// Ceiling of every scale.
    pub max_scale: f32,
    /// Which Gaussians move.
    pub participants: Participants,
    /// What pulls beside the loss.
    pub penalty: Penalty,
}

impl AdamRates {
    /// The same with all learning rates multiplied by `factor`.
    #[must_use]
    pub fn times(mut self, factor: f32) -> Self {
        let Self { mean, scale, rotation, opacity, color, color_rest, .. } = &mut self;
        for rate in [mean, scale, rotation, opacity, color, color_rest] {
            rate.learning_rate *= factor;
        }
        self
    }

    /// Fails where a number is outside its range: backends check what they are given before they move anything.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        let not_negative = |what, value: f32| {
            let right = value >= 0.0 && value.is_finite();
            if right { Ok(()) } else { Err(Error::setting(what, value, "finite and not negative")) }
        };
        let groups = [
            ("the learning rate of means", self.mean),
            ("the learning rate of scales", self.scale),
            ("the learning rate of rotations", self.rotation),
            ("the learning rate of opacities", self.opacity),
            ("the learning rate of colours", self.color),
            ("the learning rate of SH coefficients above degree 0", self.color_rest),
        ];
        for (what, rate) in groups {
            not_negative(what, rate.learning_rate)?;
            for (what, beta) in [("beta1 of Adam", rate.beta1), ("beta2 of Adam", rate.beta2)] {
                if !(0.0..1.0).contains(&beta) {
                    return Err(Error::setting(what, beta, "at least 0 and below 1"));
                }
            }
        }
        // Where no gradient has ever been, a step is 0/ε.
        if !(self.epsilon >= f32::MIN_POSITIVE && self.epsilon.is_finite()) {
            return Err(Error::setting("epsilon", self.epsilon, "finite and at least 1.2e-38"));
        }
        if !(self.min_scale >= 0.0 && self.min_scale < f32::INFINITY) {
            return Err(Error::setting("min-scale", self.min_scale, "finite and not negative"));
        }
        if !(self.max_scale > 0.0 && self.max_scale >= self.min_scale) {
            return Err(Error::setting("max-scale", self.max_scale, "positive and no less than min-scale"));
        }
        not_negative("penalty on opacities", self.penalty.opacity)?;
        not_negative("penalty on scales", self.penalty.scale)
    }
}

impl Adam {
    /// Fails where a number is outside its range: a schedule's, or one that [`AdamRates::validate`] refuses.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender.
    pub fn validate(&self) -> Result<(), Error> {
        for group in [self.mean, self.scale, self.rotation, self.opacity, self.color, self.color_rest] {
            let (Schedule::Cosine { to } | Schedule::Exponential { to }) = group.schedule else { continue };
            if !(to > 0.0 && to.is_finite()) {
                return Err(Error::setting("the last factor of a schedule", to, "positive and finite"));
            }
        }
        self.at(0.0).validate()
    }

    /// The numbers at `progress` in 0..=1 of the run.
    pub fn at(&self, progress: f32) -> AdamRates {
        let rate = |g: &Group| Rate {
            learning_rate: g.learning_rate * g.schedule.factor(progress),
            beta1: g.beta1,
            beta2: g.beta2,
        };
        AdamRates {
            mean: rate(&self.mean),
            scale: rate(&self.scale),
            rotation: rate(&self.rotation),
            opacity: rate(&self.opacity),
            color: rate(&self.color),
            color_rest: rate(&self.color_rest),
            epsilon: self.epsilon,
            min_scale: self.min_scale,
            max_scale: self.max_scale,
            participants: self.participants,
            penalty: self.penalty,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_that_would_make_what_is_not_a_number_are_refused() {
        let good = Adam::default();
        good.validate().unwrap();
        Adam { min_scale: 0.0, max_scale: f32::INFINITY, ..good }.at(0.0).validate().unwrap();
        let wrong = [
            Adam { mean: Group::constant(f32::NAN), ..good },
            Adam { opacity: Group::constant(f32::INFINITY), ..good },
            Adam { color: Group { beta1: 1.0, ..good.color }, ..good },
            Adam { scale: Group { beta2: f32::NAN, ..good.scale }, ..good },
            Adam { epsilon: 0.0, ..good },
            Adam { min_scale: 3.0, max_scale: 2.0, ..good },
            Adam { max_scale: f32::NAN, ..good },
            Adam { penalty: Penalty { opacity: -1.0, ..Penalty::NONE }, ..good },
        ];
        for adam in wrong {
            for refused in [adam.at(0.0).validate(), adam.validate()] {
                assert!(matches!(refused, Err(Error::Setting { .. })), "{adam:?}");
            }
        }
        for schedule in [Schedule::Cosine { to: 0.0 }, Schedule::Exponential { to: f32::INFINITY }] {
            assert!(Adam { mean: Group { schedule, ..good.mean }, ..good }.validate().is_err(), "{schedule:?}");
        }
    }

    #[test]
    fn schedules_start_at_one_and_end_where_they_say() {
        for (schedule, end) in [
            (Schedule::Constant, 1.0),
            (Schedule::Cosine { to: 0.05 }, 0.05),
            (Schedule::Exponential { to: 0.01 }, 0.01),
        ] {
            assert!((schedule.factor(0.0) - 1.0).abs() < 1e-6);
            assert!((schedule.factor(1.0) - end).abs() < 1e-6);
            assert!(schedule.factor(0.25) >= schedule.factor(0.75));
        }
    }
}
