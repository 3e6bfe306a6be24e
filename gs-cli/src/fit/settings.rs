//! From flags to the settings of a fit: a preset or a file is the start, flags replace parts of it, and what depends on a
//! replaced part follows.

use gs_core::{Blend, effects::Background};
use gs_density::Policy;
use gs_train::{FitSettings, Init, Preset, mean_color};

use crate::{
    chosen::ChosenSettings,
    chosen_machine::ChosenMachine,
    failure::Failure,
    fit::{
        arguments::{BlendName, PresetName, SettingsArgs},
        target::Target,
    },
    settings_file::{parse_toml, read_settings_text},
    training_arguments::name_of,
    values::Color,
};

/// What the file of settings holds, if there is one. It is read once: it may be a pipe.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Given {
    /// No file is named.
    Nothing,
    /// All settings of a fit.
    Fit(Box<FitSettings>),
    /// What `gs frontier` has chosen.
    Chosen(Box<ChosenSettings>),
}

impl Given {
    /// Reads the file that the flags name.
    ///
    /// # Errors
    /// Where it cannot be read, or a number in it is not possible.
    pub(crate) fn read(args: &SettingsArgs) -> Result<Self, Failure> {
        let Some(file) = args.settings.as_deref() else { return Ok(Self::Nothing) };
        let text = read_settings_text(file)?;
        if let Some(chosen) = ChosenSettings::parse_if_chosen(&text, file)? {
            return Ok(Self::Chosen(Box::new(chosen)));
        }
        let settings: FitSettings = parse_toml(&text, file, "compare it with the settings.toml that a fit writes")?;
        settings.validate().map_err(|error| Failure::usage(error).at(file.display()))?;
        Ok(Self::Fit(Box::new(settings)))
    }

    /// The colour that transparent pixels of the target are seen on: the flag's, or else that of the settings if they have one.
    pub(crate) fn background(&self, args: &SettingsArgs) -> Option<Color> {
        args.background.or_else(|| match self {
            Self::Fit(settings) if settings.render.effects.background == Background::Solid => {
                Some(Color(settings.render.background))
            }
            _ => None,
        })
    }

    /// What computes, if that was chosen.
    pub(crate) fn machine(&self) -> Option<&ChosenMachine> {
        match self {
            Self::Chosen(chosen) => Some(&chosen.machine),
            Self::Nothing | Self::Fit(_) => None,
        }
    }
}

/// The settings that the flags and the file ask for, for this target.
///
/// # Errors
/// Where the settings are not possible.
pub(crate) fn resolve(args: &SettingsArgs, given: &Given, target: &Target) -> Result<FitSettings, Failure> {
    let mut settings = match given {
        Given::Fit(settings) => {
            let gaussians = args.gaussians.unwrap_or(settings.gaussians);
            let iterations = args.iterations.unwrap_or(settings.iterations);
            settings.as_ref().clone().with_gaussians(gaussians).with_iterations(iterations)
        }
        _ => {
            let preset = args.preset.map_or(target.preset(), Preset::from);
            FitSettings::from_preset(preset, target.image.size(), args.gaussians, args.iterations)
        }
    };
    if let Given::Chosen(chosen) = given {
        settings.render.accuracy = chosen.accuracy;
    }
    if let Some(loss) = args.loss {
        settings.loss = loss.into();
    }
    if let Some(parameterization) = args.parameterization {
        settings = settings.with_parameterization(parameterization.into());
    }
    if let Some(blend) = args.blend {
        // What the target's transparent pixels show, so that the settings, which do not hold the target, put them on the same
        // colour when they are used again; or else the mean colour.
        let behind = target.behind.map_or_else(|| mean_color(&target.image), |color| color.0);
        settings = settings.with_blend(blend.into(), behind);
    }
    if let Some(antialias) = args.antialias {
        settings.render.effects.antialias = antialias.into();
    }
    if let Some(color) = args.background {
        settings.render = settings.render.on(color.0);
    }
    if let Some(policy) = args.policy {
        settings = settings.with_policy(Policy::from_name(&name_of(&policy))?);
    }
    if let Some(init) = args.init {
        settings.init = Init::from_name(&name_of(&init), settings.render.effects.blend)?;
    }
    settings.seed = args.seed.unwrap_or(settings.seed);
    if !matches!(given, Given::Fit(_)) {
        settings = before_flat_color(settings, target);
    }
    settings.validate()?;
    Ok(settings)
}

/// A target that is of one colour but for details is fitted before that colour. Not where its transparent pixels show another one: whoever
/// uses these settings again would see them on this.
fn before_flat_color(settings: FitSettings, target: &Target) -> FitSettings {
    let before = settings.clone().before_flat_color(&target.image);
    match target.behind {
        Some(behind) if before.render.background_color() != behind.0 => settings,
        _ => before,
    }
}

impl From<PresetName> for Preset {
    fn from(name: PresetName) -> Self {
        match name {
            PresetName::Paper => Self::Paper,
            PresetName::Quick => Self::Quick,
            PresetName::Standard => Self::Standard,
            PresetName::Best => Self::Best,
        }
    }
}

impl From<BlendName> for Blend {
    fn from(name: BlendName) -> Self {
        match name {
            BlendName::Sum => Self::Sum,
            BlendName::Over => Self::Over,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;
    use gs_core::{Adam, Image};

    use super::*;
    use crate::{
        fit::arguments::InitName,
        settings_file::to_toml,
        training_arguments::{ParameterizationName, PolicyName},
    };

    fn target() -> Target {
        let image = Image::from_fn(64, 48, |x, _| [x as f32 / 63.0, 0.5, 0.25]).unwrap();
        Target { image, file: Some("picture.png".into()), behind: None, remarks: Vec::new() }
    }

    fn resolved(args: &SettingsArgs) -> FitSettings {
        resolve(args, &Given::Nothing, &target()).unwrap()
    }

    #[test]
    fn every_preset_and_every_override_comes_back_from_its_toml() {
        for &preset in PresetName::value_variants() {
            for &policy in PolicyName::value_variants() {
                for &init in InitName::value_variants() {
                    let (preset, policy, init) = (Some(preset), Some(policy), Some(init));
                    let settings = resolved(&SettingsArgs { preset, policy, init, ..SettingsArgs::default() });
                    let text = to_toml(&settings).unwrap();
                    assert_eq!(toml::from_str::<FitSettings>(&text).unwrap(), settings, "{text}");
                    assert!(text.contains("alpha-max = 0.999\n"), "digits that mean nothing: {text}");
                }
            }
        }
    }

    #[test]
    fn front_to_back_has_a_background_and_moving_opacities() {
        let over = resolved(&SettingsArgs { blend: Some(BlendName::Over), ..SettingsArgs::default() });
        assert_eq!(over.render.effects.blend, Blend::Over);
        assert_eq!(over.render.effects.background, Background::Solid);
        assert!((over.render.background[0] - 0.5).abs() < 1e-3 && (over.render.background[2] - 0.25).abs() < 1e-6);
        assert!(over.adam.opacity.learning_rate > 0.0);
    }

    #[test]
    fn a_flat_picture_is_fitted_before_its_colour_unless_transparent_pixels_show_another() {
        let flat = |behind| Target { image: Image::filled(9, 7, [1.0; 3]).unwrap(), behind, ..target() };
        let background = |args: &SettingsArgs, target: &Target| {
            let settings = resolve(args, &Given::Nothing, target).unwrap();
            (settings.render.effects.background == Background::Solid).then_some(settings.render.background)
        };
        let usual = SettingsArgs::default();
        assert_eq!(background(&usual, &flat(None)), Some([1.0; 3]));
        assert_eq!(background(&usual, &flat(Some(Color([1.0; 3])))), Some([1.0; 3]));
        assert_eq!(background(&usual, &flat(Some(Color([0.0; 3])))), None);
        assert_eq!(background(&usual, &target()), None);
        let black = SettingsArgs { background: Some(Color([0.0; 3])), ..SettingsArgs::default() };
        assert_eq!(background(&black, &flat(None)), Some([0.0; 3]));
        let given = Given::Fit(Box::new(FitSettings::standard(9)));
        assert_eq!(resolve(&usual, &given, &flat(None)).unwrap().render.effects.background, Background::None);
    }

    #[test]
    fn step_sizes_follow_the_parameterization() {
        let pixels = resolved(&SettingsArgs {
            parameterization: Some(ParameterizationName::ScaleRotation),
            ..SettingsArgs::default()
        });
        assert_eq!(pixels.adam.mean.learning_rate, Adam::default().mean.learning_rate);
        let same = resolved(&SettingsArgs {
            parameterization: Some(ParameterizationName::CovarianceFactor),
            ..SettingsArgs::default()
        });
        assert_eq!(same, resolved(&SettingsArgs::default()));
    }

    #[test]
    fn every_policy_of_the_library_has_its_flag() {
        let flags: Vec<_> = PolicyName::value_variants().iter().filter_map(|p| p.to_possible_value()).collect();
        assert_eq!(flags.iter().map(|flag| flag.get_name()).collect::<Vec<_>>(), Policy::NAMES);
        for (policy, name) in PolicyName::value_variants().iter().zip(Policy::NAMES) {
            let settings = resolved(&SettingsArgs { policy: Some(*policy), ..SettingsArgs::default() });
            assert_eq!(settings.policy.name(), name);
        }
    }

    #[test]
    fn what_cannot_grow_is_there_from_the_start() {
        let fixed = resolved(&SettingsArgs { policy: Some(PolicyName::None), ..SettingsArgs::default() });
        assert_eq!(fixed.initial.resolve(fixed.gaussians), fixed.gaussians);
        let half = resolved(&SettingsArgs {
            policy: Some(PolicyName::ImageGs),
            gaussians: Some(1000),
            ..SettingsArgs::default()
        });
        assert_eq!(half.initial.resolve(half.gaussians), 500);
    }
}
