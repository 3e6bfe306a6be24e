//! Settings of the optimizer: Adam (Kingma & Ba 2015) with learning rates for each group of
//! parameters.

use serde::{Deserialize, Serialize};

use crate::{
    constants::{MAX_SCALE_PX, MIN_SCALE_PX},
    error::Error,
};

crate::impl_with!(Adam, Group);

crate::choices! {
    /// Coordinates in which the optimizer moves a Gaussian.
    #[derive(Default)]
    pub enum Parameterization {
        /// Mean in px (world units), ln-scale, angle (quaternion), as in the paper and in 3DGS.
        #[default]
        ScaleRotation = "scale-rotation": "Position, ln-scale and rotation (3DGS)",
        /// The Gaussian's own whitened coordinates, Σ = L Lᵀ: μ ← μ + L ξ, L ← L (I + η + η²/2) with η
        /// symmetric.
        ///
        /// A step is the same fraction of its extent for every Gaussian, however small or thin. For 2D
        /// scenes only: in 3D, longer steps of [`Self::ScaleRotation`] gain as much.
        CovarianceFactor = "covariance-factor":
            "The Gaussian's own coordinates, where a step is the same fraction of every Gaussian",
    }
}

impl Parameterization {
    /// Checks that 3D scenes can be held in these coordinates.
    ///
    /// # Errors
    /// [`Error::Setting`] unless they are [`Self::ScaleRotation`].
    pub fn check_3d(self) -> Result<(), Error> {
        match self {
            Self::ScaleRotation => Ok(()),
            Self::CovarianceFactor => {
                Err(Error::setting("parameterization of a 3D scene", self.name(), "scale-rotation"))
            }
        }
    }
}

/// Change of a learning rate over a run, as a factor of its first value.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Schedule {
    /// A factor of 1 in every step.
    #[default]
    Constant,
    /// A factor from 1 to `to` along half a cosine.
    Cosine {
        /// Last factor.
        to: f32,
    },
    /// A factor from 1 to `to`, geometrically (3DGS's decay of the position's rate).
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

/// Settings of Adam for one group of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Group {
    /// Step size, in the parameter's own unit (in [`Parameterization::CovarianceFactor`]: in
    /// standard deviations).
    pub learning_rate: f32,
    /// Decay of the first moment, 0..1.
    pub beta1: f32,
    /// Decay of the second moment, 0..1.
    pub beta2: f32,
    /// Change of the rate over the run.
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

crate::choices! {
    /// The Gaussians that an Adam step moves. Exhaustive: a backend must handle each value.
    #[derive(Default)]
    pub enum Participants {
        /// All: the moments of Gaussians out of view decay, and still move them (3DGS).
        #[default]
        All = "all": "All (3DGS)",
        /// Gaussians that some tile of this step's view lists. The others do not change, and their
        /// steps are not counted. A step then costs time in proportion to what is in view. *Source:*
        /// sparse Adam, as in Taming 3DGS, Mallick et al. 2024.
        Visible = "visible": "Gaussians in sight of the step's view",
    }
}

/// Format in which a backend holds Adam's moments of the SH coefficients above degree 0. 3D scenes.
/// Exhaustive: a backend must handle each value or refuse it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MomentFormat {
    /// 32-bit floats.
    #[default]
    F32,
    /// The upper 16 bits of 32-bit floats, rounded up or down at random, so that the mean over many
    /// steps is exact. Rounding to the nearest would hold a second moment for ever, whose changes
    /// per step are smaller than its last digit.
    ///
    /// Saves 192 of the 512 bytes of moments of a Gaussian of degree 3 on the CPU, and 180 of 480 on
    /// a GPU. The random numbers follow from index and step count
    /// ([`packed_moments`](crate::math::packed_moments)).
    Bf16,
}

impl MomentFormat {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Regularisation that makes every Gaussian fainter and smaller. 3D scenes.
///
/// It adds opacity · (mean of all opacities) + scale · (mean of all scales, in the scene's unit) to
/// what is minimised, but not to the loss that is reported. Gaussians that the images do not need
/// vanish and can be placed elsewhere. *Source:* 3DGS-MCMC, Kheradmand et al. 2024. Exhaustive: a
/// backend must apply each field.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Penalty {
    /// Weight of the mean opacity, not negative; 0.01 in the source.
    pub opacity: f32,
    /// Weight of the mean scale, not negative; 0.01 in the source.
    pub scale: f32,
}

impl Penalty {
    /// No regularisation.
    pub const NONE: Self = Self { opacity: 0.0, scale: 0.0 };
}

/// Settings of Adam.
///
/// Bias correction counts each Gaussian's own steps, so that a Gaussian added late starts as the
/// first ones did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct Adam {
    /// Mean, px (3D scenes: world units); ξ in [`Parameterization::CovarianceFactor`].
    pub mean: Group,
    /// ln-scale; η in [`Parameterization::CovarianceFactor`].
    pub scale: Group,
    /// Rotation, rad; unused in [`Parameterization::CovarianceFactor`], where η turns the axes.
    pub rotation: Group,
    /// Opacity logit.
    pub opacity: Group,
    /// Colour; in 3D scenes the SH coefficient of degree 0.
    pub color: Group,
    /// SH coefficients above degree 0. 3D scenes.
    pub color_rest: Group,
    /// Format of the moments of SH coefficients above degree 0. 3D scenes.
    #[serde(skip_serializing_if = "MomentFormat::is_default")]
    pub color_rest_moments: MomentFormat,
    /// Number added to √v̂, against division by zero.
    pub epsilon: f32,
    /// Lower bound of every scale, px (3D scenes: world units).
    pub min_scale: f32,
    /// Upper bound of every scale, px (3D scenes: world units).
    pub max_scale: f32,
    /// The Gaussians that a step moves.
    pub participants: Participants,
    /// Regularisation added to the loss. 3D scenes.
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
            color_rest_moments: MomentFormat::F32,
            epsilon: 1e-15,
            min_scale: MIN_SCALE_PX,
            max_scale: MAX_SCALE_PX,
            participants: Participants::All,
            penalty: Penalty::NONE,
        }
    }
}

/// Settings of one group at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Step size.
    pub learning_rate: f32,
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
}

/// Settings of Adam at one step: [`Adam`] with its schedules evaluated. Exhaustive: a backend must
/// apply each field.
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
    /// Format of the moments of SH coefficients above degree 0.
    pub color_rest_moments: MomentFormat,
    /// Number added to √v̂.
    pub epsilon: f32,
    /// Lower bound of every scale.
    pub min_scale: f32,
    /// Upper bound of every scale.
    pub max_scale: f32,
    /// The Gaussians that move.
    pub participants: Participants,
    /// Regularisation added to the loss.
    pub penalty: Penalty,
    /// Number of Gaussians, the first of the scene, that no step moves: their parameters, moments, step
    /// counts and statistics stay as they are. They are drawn as all others.
    pub fixed: u32,
}

impl AdamRates {
    /// Returns these rates with all learning rates multiplied by `factor`.
    #[must_use]
    pub fn times(mut self, factor: f32) -> Self {
        let Self { mean, scale, rotation, opacity, color, color_rest, .. } = &mut self;
        for rate in [mean, scale, rotation, opacity, color, color_rest] {
            rate.learning_rate *= factor;
        }
        self
    }

    /// Checks the ranges. Backends call it before they move anything.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub fn validate(&self) -> Result<(), Error> {
        let not_negative = |what, value| Error::within(what, value, 0.0..=f32::MAX, "finite and not negative");
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
                Error::within(what, beta, 0.0..1.0, "at least 0 and below 1")?;
            }
        }
        // A parameter that never had a gradient makes a step of 0/ε.
        Error::within("epsilon", self.epsilon, f32::MIN_POSITIVE..=f32::MAX, "finite and at least 1.2e-38")?;
        not_negative("min-scale", self.min_scale)?;
        let least = self.min_scale.max(f32::MIN_POSITIVE);
        Error::within("max-scale", self.max_scale, least.., "positive and no less than min-scale")?;
        not_negative("penalty on opacities", self.penalty.opacity)?;
        not_negative("penalty on scales", self.penalty.scale)
    }
}

impl Adam {
    /// Checks the ranges of schedules and of the rates at the start ([`AdamRates::validate`]).
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub fn validate(&self) -> Result<(), Error> {
        for group in [self.mean, self.scale, self.rotation, self.opacity, self.color, self.color_rest] {
            let (Schedule::Cosine { to } | Schedule::Exponential { to }) = group.schedule else { continue };
            Error::within("the last factor of a schedule", to, f32::MIN_POSITIVE..=f32::MAX, "positive and finite")?;
        }
        self.at(0.0).validate()
    }

    /// These settings for steps that each stand for `steps` (at least 1) of a longer run, of which the
    /// others show nothing of these Gaussians. Out of view, moments decay and still move the Gaussian:
    /// each gradient moves it further by √`steps`, as the second moment is a mean over all steps. So
    /// learning rates are multiplied by √`steps`, decays taken to the power of `steps`, and penalties,
    /// which act out of view, too, multiplied by `steps`. Nothing changes for [`Participants::Visible`], which counts no steps out of view. *Source:* the same rule
    /// is known for batches: Grendel, Zhao et al. 2024.
    #[must_use]
    pub fn standing_for(mut self, steps: f32) -> Self {
        if self.participants == Participants::Visible {
            return self;
        }
        let Self { mean, scale, rotation, opacity, color, color_rest, .. } = &mut self;
        for group in [mean, scale, rotation, opacity, color, color_rest] {
            group.learning_rate *= steps.sqrt();
            group.beta1 = group.beta1.powf(steps);
            group.beta2 = group.beta2.powf(steps);
        }
        self.penalty.opacity *= steps;
        self.penalty.scale *= steps;
        self
    }

    /// The settings at `progress` in 0..=1 of the run, with no Gaussian fixed.
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
            color_rest_moments: self.color_rest_moments,
            epsilon: self.epsilon,
            min_scale: self.min_scale,
            max_scale: self.max_scale,
            participants: self.participants,
            penalty: self.penalty,
            fixed: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_outside_their_ranges_are_refused() {
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
    fn steps_that_stand_for_several_move_as_far_as_these() {
        // One parameter under Adam, with a gradient of random size every so many steps.
        let moved = |group: Group, every: u32, steps: u32| {
            let (mut place, mut first, mut second) = (0.0, 0.0, 0.0);
            for step in 1..=steps {
                let size = 1.0 + (f64::from(step / every) * 0.618).fract();
                let gradient = if step % every == 0 { size } else { 0.0 };
                let [beta1, beta2] = [group.beta1, group.beta2].map(f64::from);
                first = beta1 * first + (1.0 - beta1) * gradient;
                second = beta2 * second + (1.0 - beta2) * gradient * gradient;
                let corrected = |moment: f64, beta: f64| moment / (1.0 - beta.powi(step as i32));
                let change = corrected(first, beta1) / (corrected(second, beta2).sqrt() + 1e-15);
                place += f64::from(group.learning_rate) * change;
            }
            place
        };
        let adam = Adam::default();
        let whole = moved(adam.mean, 4, 4_000);
        let ratio = |adam: Adam| moved(adam.mean, 1, 1_000) / whole;
        assert!((ratio(adam) - 0.5).abs() < 0.03, "{}", ratio(adam));
        assert!((ratio(adam.standing_for(4.0)) - 1.0).abs() < 0.03, "{}", ratio(adam.standing_for(4.0)));
        assert_eq!(adam.standing_for(1.0), adam);
        let penalty = Penalty { opacity: 0.01, scale: 0.02 };
        assert_eq!(Adam { penalty, ..adam }.standing_for(4.0).penalty, Penalty { opacity: 0.04, scale: 0.08 });
        let of_visible = Adam { participants: Participants::Visible, ..adam };
        assert_eq!(of_visible.standing_for(4.0), of_visible);
    }

    #[test]
    fn schedules_start_at_one_and_end_at_their_last_factor() {
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

    #[test]
    fn settings_at_their_defaults_are_left_out() {
        let keys = |adam: Adam| serde_json::to_string(&adam).unwrap();
        assert!(!keys(Adam::default()).contains("color-rest-"));
        let other = Adam { color_rest_moments: MomentFormat::Bf16, ..Adam::default() };
        let text = keys(other);
        assert!(text.contains(r#""color-rest-moments":"bf16""#), "{text}");
        assert_eq!(serde_json::from_str::<Adam>(&text).unwrap(), other);
    }
}
