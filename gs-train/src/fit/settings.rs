//! Settings of a 2D fit: everything that it depends on besides the image and the backend.

use gs_core::{
    Adam, Blend, Error, Image, Loss, Parameterization, RenderSettings, constants::MAX_GAUSSIANS, effects::Background,
};
use gs_density::Policy;
use serde::{Deserialize, Serialize};

use super::{flat::flat_color, init::Init, presets::Preset, tune::Tune};
use crate::run::{Recovery, Rounds, in_a_file};

gs_core::impl_with!(FitSettings, ColorSolve);
in_a_file!(FitSettings);
/// Learning rate of opacity logits where a fit is switched to [`Blend::Over`].
const OPACITY_RATE: f32 = 0.05;
/// Learning rate in standard deviations where a fit is switched to
/// [`Parameterization::CovarianceFactor`].
const COVARIANCE_FACTOR_RATE: f32 = 0.15;

/// Least default number of Gaussians, unless an image has fewer pixels.
///
/// At the share of larger images, an image of 8x12 px would have 2 Gaussians and end at 18.1 dB,
/// one of 16x24 px at 19.5 dB, one of 32x48 px at 23.9 dB. With 256 or one per pixel they end at
/// 66.1, 64.0 and 39.7 dB, and one of 64x96 px at 31.8 instead of 28.5 dB, in a tenth of a second.
/// Noise needs one Gaussian per pixel: 3x2 px end at 67.9 dB with 6 and at 33.0 dB with 4, 16x16 px
/// at 67.6 dB with 256 and at 44.3 dB with 128.
const ENOUGH_GAUSSIANS: u64 = 256;

/// Default number of Gaussians for an image of this size (columns, rows): 9,000 per 768x512 px, the
/// size of the Kodak test set, and at least 256 unless it has fewer pixels.
pub(crate) fn gaussians_for((width, height): (u32, u32)) -> u32 {
    let pixels = u64::from(width) * u64::from(height);
    let count = (pixels * 9_000 / (768 * 512)).max(ENOUGH_GAUSSIANS.min(pixels));
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// Settings of a 2D fit. Fits with equal settings, target and backend give equal results, bit for
/// bit.
///
/// Missing fields of a serialised form take the value of [`FitSettings::default`]; unknown ones are
/// an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct FitSettings {
    /// Largest number of Gaussians, at least 1.
    pub gaussians: u32,
    /// Whether the fit ends with exactly as many Gaussians as [`Self::gaussians`] says, along a
    /// schedule ([`CountSchedule`](gs_density::CountSchedule)), under any policy. Default false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub exactly: bool,
    /// Number of Gaussians at the start.
    pub initial: InitialCount,
    /// Number of steps; 0 leaves the initial scene as it is.
    pub iterations: u32,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Coordinates in which the optimizer moves.
    pub parameterization: Parameterization,
    /// Blending, background and accuracy. The policy decides about its `effects.statistics`.
    pub render: RenderSettings,
    /// Loss to minimise.
    pub loss: Loss,
    /// The measure that the fit is tuned for, by weighting its pixels. Default [`Tune::Psnr`].
    #[serde(skip_serializing_if = "Tune::is_default")]
    pub tune: Tune,
    /// Settings of the optimizer.
    pub adam: Adam,
    /// Initialiser.
    pub init: Init,
    /// Policy of density control.
    pub policy: Policy,
    /// Rounds of density control.
    pub rounds: Rounds,
    /// Steps from one set of new lists of which Gaussian touches which pixels to the next, at
    /// least 1.
    ///
    /// Lists are also new after each round of density control, and in each of as many last steps.
    /// Between, training ignores pixels that a Gaussian has moved to. 4 saves time without visible
    /// loss, provided that the last steps are exact (otherwise a single Gaussian of strong colour
    /// that drifted in the last steps has cost 1.8 dB).
    pub rebin_every: u32,
    /// What happens to a diverging fit.
    #[serde(skip_serializing_if = "Recovery::is_default")]
    pub recovery: Recovery,
    /// Least-squares colours; used only under [`Blend::Sum`](gs_core::Blend::Sum), where the image
    /// is linear in them.
    pub color_solve: ColorSolve,
}

/// Number of Gaussians that a fit starts with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub enum InitialCount {
    /// A number, 1 to the budget.
    Fixed(u32),
    /// A fraction of the budget, above 0 and at most 1, rounded, but at least one Gaussian.
    Fraction(f32),
}

impl InitialCount {
    /// The number of Gaussians for a budget of `gaussians`.
    pub fn resolve(self, gaussians: u32) -> u32 {
        match self {
            Self::Fixed(count) => count.clamp(1, gaussians.max(1)),
            Self::Fraction(part) => {
                ((f64::from(part) * f64::from(gaussians)).round() as u32).clamp(1, gaussians.max(1))
            }
        }
    }
}

/// Conjugate-gradient iterations of [`Optimizer::solve_colors`](gs_core::Optimizer::solve_colors).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[non_exhaustive]
pub struct ColorSolve {
    /// Iterations before the first step.
    pub at_start: u32,
    /// Iterations after each round of density control.
    pub after_edit: u32,
}

impl FitSettings {
    /// The settings of a preset for an image of `size` (columns, rows), with another number of
    /// Gaussians or steps if given.
    ///
    /// The default number of Gaussians is 9,000 per 768×512 px, at least 256 or one per pixel; for
    /// [`Preset::Paper`] the paper's.
    pub fn from_preset(preset: Preset, size: (u32, u32), gaussians: Option<u32>, iterations: Option<u32>) -> Self {
        match (preset, iterations) {
            (Preset::Paper, _) => {
                let paper = Self::paper();
                let (gaussians, iterations) =
                    (gaussians.unwrap_or(paper.gaussians), iterations.unwrap_or(paper.iterations));
                paper.with_iterations(iterations).with_gaussians(gaussians)
            }
            (_, Some(iterations)) => {
                Self::for_image(gaussians.unwrap_or_else(|| gaussians_for(size)), size, iterations)
            }
            (_, None) => preset.settings(gaussians.unwrap_or_else(|| gaussians_for(size)), size),
        }
    }

    /// Returns this fit with at most this many Gaussians, also at the start.
    #[must_use]
    pub fn with_gaussians(mut self, gaussians: u32) -> Self {
        self.gaussians = gaussians;
        if let InitialCount::Fixed(count) = &mut self.initial {
            *count = (*count).min(gaussians);
        }
        self
    }

    /// Returns this fit with steps in another parameterization. Learning rates of mean and shape,
    /// which have other units there, get default values.
    #[must_use]
    pub fn with_parameterization(mut self, parameterization: Parameterization) -> Self {
        if self.parameterization == parameterization {
            return self;
        }
        self.parameterization = parameterization;
        let usual = Adam::default();
        let rates = match parameterization {
            Parameterization::ScaleRotation => {
                [usual.mean, usual.scale, usual.rotation].map(|group| group.learning_rate)
            }
            Parameterization::CovarianceFactor => [COVARIANCE_FACTOR_RATE; 3],
        };
        let Adam { mean, scale, rotation, .. } = &mut self.adam;
        for (group, rate) in [mean, scale, rotation].into_iter().zip(rates) {
            group.learning_rate = rate;
        }
        self
    }

    /// Returns this fit with another blending.
    ///
    /// [`Blend::Over`] gets this background, as uncovered pixels need a colour, a learning rate for
    /// opacities, and no other effects.
    #[must_use]
    pub fn with_blend(mut self, blend: Blend, background: [f32; 3]) -> Self {
        if self.render.effects.blend == blend {
            return self;
        }
        match blend {
            Blend::Sum => self.render.effects.blend = blend,
            Blend::Over => {
                let accuracy = self.render.accuracy;
                self.render = RenderSettings::blended(blend).with(|s| s.accuracy = accuracy).on(background);
                self.adam.opacity.learning_rate = OPACITY_RATE;
            }
        }
        self
    }

    /// Returns this fit with another policy. It starts with as many Gaussians as the policy needs:
    /// with all if it adds none.
    #[must_use]
    pub fn with_policy(mut self, mut policy: Policy) -> Self {
        match &mut policy {
            Policy::Residual(growth) => {
                let first = self.initial.resolve(self.gaussians) as f32;
                growth.start_fraction = first / self.gaussians as f32;
            }
            Policy::ImageGs(addition) => self.initial = InitialCount::Fraction(addition.start_fraction),
            Policy::None => self.initial = InitialCount::Fraction(1.0),
            _ => {}
        }
        self.policy = policy;
        self
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range, and what is allowed.
    pub fn validate(&self) -> Result<(), Error> {
        Error::within("the number of Gaussians", self.gaussians, 1..=MAX_GAUSSIANS, "1 to 100,000,000")?;
        match self.initial {
            InitialCount::Fixed(count) => {
                let allowed = "1 to the number of Gaussians";
                Error::within("the initial number of Gaussians", count, 1..=self.gaussians, allowed)?;
            }
            InitialCount::Fraction(part) => {
                let range = f32::MIN_POSITIVE..=1.0;
                Error::within("the initial part of the Gaussians", part, range, "above 0 and at most 1")?;
            }
        }
        Error::within("rebin-every", self.rebin_every, 1.., "at least 1")?;
        if self.tune != Tune::Psnr && !self.loss.is_pointwise() {
            return Err(Error::setting("the loss under tune = \"ssim\"", self.loss, "l2 or l1"));
        }
        self.init.validate()?;
        self.policy.validate_2d()?;
        self.rounds.validate()?;
        self.render.validate()?;
        self.loss.validate()?;
        self.adam.validate()
    }

    /// Returns this fit with the colour of nine tenths of the target's pixels as background, if
    /// they have one colour, Gaussians are summed, and there is no background yet.
    #[must_use]
    pub fn before_flat_color(mut self, target: &Image) -> Self {
        let effects = &self.render.effects;
        if effects.blend == Blend::Sum
            && effects.background == Background::None
            && let Some(color) = flat_color(target)
            && color != [0.0; 3]
        {
            self.render = self.render.on(color);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_valid_and_come_back_from_json_unchanged() {
        for preset in Preset::ALL {
            let settings = preset.settings(9_000, (768, 512));
            settings.validate().unwrap();
            for settings in [FitSettings { recovery: Recovery::Never, ..settings.clone() }, settings] {
                let json = serde_json::to_string(&settings).unwrap();
                assert_eq!(serde_json::from_str::<FitSettings>(&json).unwrap(), settings, "{json}");
            }
        }
    }

    #[test]
    fn a_partial_form_is_filled_up_and_an_unknown_field_is_refused() {
        let settings: FitSettings = serde_json::from_str(r#"{ "iterations": 7, "initial": { "fixed": 3 } }"#).unwrap();
        assert_eq!(settings, FitSettings { iterations: 7, initial: InitialCount::Fixed(3), ..FitSettings::default() });
        assert!(serde_json::from_str::<FitSettings>(r#"{ "iteration": 7 }"#).is_err());
    }

    #[test]
    fn invalid_settings_are_refused() {
        type Spoil = fn(&mut FitSettings);
        let cases: [(&str, Spoil); 9] = [
            ("number of Gaussians", |s| s.gaussians = 0),
            ("initial number", |s| s.initial = InitialCount::Fixed(0)),
            ("initial number", |s| s.initial = InitialCount::Fixed(s.gaussians + 1)),
            ("initial part", |s| s.initial = InitialCount::Fraction(f32::NAN)),
            ("rebin-every", |s| s.rebin_every = 0),
            ("density control", |s| s.rounds = Rounds { every: 10, from: 20, until: 10 }),
            ("learning rate of means", |s| s.adam.mean.learning_rate = f32::INFINITY),
            ("beta2", |s| s.adam.color.beta2 = 1.0),
            ("lambda", |s| s.loss = Loss::L1Dssim { lambda: 2.0 }),
        ];
        for (expected, spoil) in cases {
            let mut settings = FitSettings::default();
            spoil(&mut settings);
            let message = settings.validate().unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn a_fraction_is_never_nothing() {
        assert_eq!(InitialCount::Fraction(0.08).resolve(9_000), 720);
        assert_eq!(InitialCount::Fraction(0.08).resolve(1), 1);
        assert_eq!(InitialCount::Fixed(20).resolve(600), 20);
    }

    #[test]
    fn the_number_of_gaussians_follows_the_image_unless_it_is_given() {
        assert_eq!(gaussians_for((768, 512)), 9_000);
        assert_eq!([(1, 1), (3, 2), (16, 16), (32, 32), (106, 106)].map(gaussians_for), [1, 6, 256, 256, 257]);
        assert_eq!(gaussians_for((16_384, 16_384)), 6_144_000);
        let few = FitSettings::from_preset(Preset::Paper, (64, 48), Some(7), Some(250));
        assert_eq!((few.gaussians, few.initial, few.iterations), (7, InitialCount::Fixed(7), 250));
        few.validate().unwrap();
    }

    #[test]
    fn changes_of_settings_are_consistent_and_idempotent() {
        let standard = || FitSettings::standard(1000);
        let over = standard().with_blend(Blend::Over, [0.5, 0.25, 1.0]);
        assert_eq!(over.render.background_color(), [0.5, 0.25, 1.0]);
        assert_eq!(over.adam.opacity.learning_rate, OPACITY_RATE);
        assert_eq!(over.clone().with_blend(Blend::Over, [0.0; 3]), over);
        let pixels = standard().with_parameterization(Parameterization::ScaleRotation);
        assert_eq!(pixels.adam.mean.learning_rate, Adam::default().mean.learning_rate);
        assert_eq!(standard().with_parameterization(Parameterization::CovarianceFactor), standard());
        for name in Policy::NAMES {
            let changed = standard().with_policy(Policy::from_name(name).unwrap());
            assert_eq!(changed.policy.name(), name);
            let refused = changed.validate().err().map(|e| e.to_string());
            assert_eq!(
                refused.is_some(),
                ["fastgs", "taming", "improved-gs", "steep-gs", "mrnf"].contains(&name),
                "{name}"
            );
            assert!(refused.is_none_or(|message| message.contains(name)), "{name}");
        }
        assert_eq!(standard().with_policy(Policy::None).initial.resolve(1000), 1000);
        let half = standard().with_policy(Policy::from_name("image-gs").unwrap());
        assert_eq!(half.initial.resolve(1000), 500);
    }

    #[test]
    fn only_a_sum_before_nothing_gets_a_background() {
        let white = Image::filled(4, 4, [1.0; 3]).unwrap();
        let settings = FitSettings::standard(10);
        assert_eq!(settings.clone().before_flat_color(&white).render.background_color(), [1.0; 3]);
        let given = FitSettings { render: settings.render.on([0.5; 3]), ..settings.clone() };
        assert_eq!(given.clone().before_flat_color(&white), given);
        let grey = Image::filled(4, 4, [0.25; 3]).unwrap();
        assert_eq!(FitSettings::paper().before_flat_color(&grey), FitSettings::paper());
        let black = Image::filled(4, 4, [0.0; 3]).unwrap();
        assert_eq!(settings.clone().before_flat_color(&black), settings, "nothing is black already");
        let ramp = Image::from_fn(16, 1, |x, _| [x as f32 / 15.0; 3]).unwrap();
        assert_eq!(settings.clone().before_flat_color(&ramp), settings);
    }
}
