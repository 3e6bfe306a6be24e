//! Everything that a fit depends on besides the image: one value that can be stored, compared and sent along with a result.

use gs_core::{
    Adam, Error, Loss, Parameterization, RenderSettings, adam::Group, adam::Schedule, constants::MAX_GAUSSIANS,
};
use gs_density::Policy;
use serde::{Deserialize, Serialize};

use crate::{init::Init, recovery::Recovery, rounds::Rounds};

/// The settings of a 2D fit. Two fits with equal settings, target and backend give equal results, bit for bit.
///
/// Missing fields of a serialised form take the value of [`FitSettings::default`]; unknown ones are an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct FitSettings {
    /// The most Gaussians there may be, at least 1.
    pub gaussians: u32,
    /// How many there are at the start.
    pub initial: InitialCount,
    /// Steps of the optimiser; 0 leaves the initial scene as it is.
    pub iterations: u32,
    /// Where all random numbers come from.
    pub seed: u32,
    /// In which coordinates the optimiser moves.
    #[serde(alias = "chart")]
    pub parameterization: Parameterization,
    /// Blending, background and accuracy. Its `effects.statistics` are overruled by what the policy asks for.
    pub render: RenderSettings,
    #[doc(hidden)]
    #[serde(skip_serializing, deserialize_with = "crate::effect_schedule::by_the_clock")]
    pub joining: (),
    /// What is minimised.
    pub loss: Loss,
    /// The optimiser.
    pub adam: Adam,
    /// Where the first Gaussians are put.
    pub init: Init,
    /// Which Gaussians grow and which go.
    pub policy: Policy,
    /// When the policy is asked.
    pub rounds: Rounds,
    /// The lists of which Gaussian touches which pixels are made anew every so many steps, at least 1, after each round of
    /// density control, and in each of so many last steps. Between, a pixel that a Gaussian has newly moved to goes without it,
    /// and training does not see what it does there: 4 saves time for no visible loss, provided that the end is exact (without
    /// that, a single Gaussian of strong colour that drifted in the very last steps has cost 1.8 dB).
    pub rebin_every: u32,
    /// What becomes of a fit that has become worse than it was at first.
    #[serde(skip_serializing_if = "Recovery::is_default")]
    pub recovery: Recovery,
    /// Least-squares colours; without effect unless blending is [`Blend::Sum`](gs_core::Blend::Sum), where the image is linear in
    /// them.
    pub color_solve: ColorSolve,
}

/// How many Gaussians a fit starts with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InitialCount {
    /// So many, 1 to the budget.
    Fixed(u32),
    /// This part of the budget, above 0 and at most 1, rounded; never less than one Gaussian.
    Fraction(f32),
}

impl InitialCount {
    /// The number for a budget of `gaussians`.
    pub fn resolve(self, gaussians: u32) -> u32 {
        match self {
            Self::Fixed(count) => count.clamp(1, gaussians.max(1)),
            Self::Fraction(part) => {
                ((f64::from(part) * f64::from(gaussians)).round() as u32).clamp(1, gaussians.max(1))
            }
        }
    }
}

/// Conjugate-gradient iterations of [`Rasterizer::solve_colors`](gs_core::Rasterizer::solve_colors).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ColorSolve {
    /// Before the first step.
    pub at_start: u32,
    /// After each round of density control.
    pub after_edit: u32,
}

impl FitSettings {
    /// Fails where a setting is out of its range or contradicts another.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first offender, its value and what is allowed.
    pub fn validate(&self) -> Result<(), Error> {
        if self.gaussians == 0 {
            return Err(Error::setting("the number of Gaussians", 0, "at least 1"));
        }
        if self.gaussians > MAX_GAUSSIANS {
            return Err(Error::setting("the number of Gaussians", self.gaussians, "at most 100,000,000"));
        }
        match self.initial {
            InitialCount::Fixed(count) if !(1..=self.gaussians).contains(&count) => {
                return Err(Error::setting("the initial number of Gaussians", count, "1 to the number of Gaussians"));
            }
            InitialCount::Fraction(part) if !(part > 0.0 && part <= 1.0) => {
                return Err(Error::setting("the initial part of the Gaussians", part, "above 0 and at most 1"));
            }
            _ => {}
        }
        if self.rebin_every == 0 {
            return Err(Error::setting("rebin-every", 0, "at least 1"));
        }
        self.init.validate()?;
        self.policy.validate()?;
        self.rounds.validate()?;
        self.render.validate()?;
        self.loss.validate()?;
        validate_adam(&self.adam)
    }
}

pub(crate) fn validate_adam(adam: &Adam) -> Result<(), Error> {
    let groups: [(&'static str, &Group); 6] = [
        ("the learning rate of means", &adam.mean),
        ("the learning rate of scales", &adam.scale),
        ("the learning rate of rotations", &adam.rotation),
        ("the learning rate of opacities", &adam.opacity),
        ("the learning rate of colours", &adam.color),
        ("the learning rate of SH coefficients above degree 0", &adam.color_rest),
    ];
    for (what, group) in groups {
        if !(group.learning_rate >= 0.0 && group.learning_rate.is_finite()) {
            return Err(Error::setting(what, group.learning_rate, "finite and not negative"));
        }
        for (what, beta) in [("beta1 of Adam", group.beta1), ("beta2 of Adam", group.beta2)] {
            if !(0.0..1.0).contains(&beta) {
                return Err(Error::setting(what, beta, "at least 0 and below 1"));
            }
        }
        let (Schedule::Cosine { to } | Schedule::Exponential { to }) = group.schedule else { continue };
        if !(to > 0.0 && to.is_finite()) {
            return Err(Error::setting("the last factor of a schedule", to, "positive and finite"));
        }
    }
    if !(adam.epsilon > 0.0 && adam.epsilon.is_finite()) {
        return Err(Error::setting("epsilon of Adam", adam.epsilon, "positive and finite"));
    }
    for (what, weight) in
        [("the weight of the mean opacity", adam.penalty.opacity), ("the weight of the mean scale", adam.penalty.scale)]
    {
        if !(weight >= 0.0 && weight.is_finite()) {
            return Err(Error::setting(what, weight, "finite and not negative"));
        }
    }
    if !(adam.min_scale > 0.0 && adam.min_scale.is_finite()) {
        return Err(Error::setting("the smallest scale", adam.min_scale, "positive and finite"));
    }
    if !(adam.max_scale >= adam.min_scale && adam.max_scale.is_finite()) {
        return Err(Error::setting("the largest scale", adam.max_scale, "finite and at least the smallest"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::presets::Preset;

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
    fn what_cannot_work_is_refused() {
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
}
