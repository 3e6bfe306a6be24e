//! Fits of images: the target, and the settings that flags ask for.

pub(crate) mod batch;
mod fit_image;

use std::path::PathBuf;

use clap::{Args, builder::TypedValueParser};
use gs_core::{
    Blend, Loss, Parameterization,
    effects::{Antialias, Background},
};
use gs_density::Policy;
use gs_train::{FitSettings, Init, InitKind, Preset, SettingsFile as _, Tune, mean_color};

pub(crate) use self::fit_image::FitImage;
use crate::{
    failure::Failure,
    files::text_file::read_settings_text,
    flags::values::{Color, by_name, whole},
    training::arguments::policy_by_name,
};

/// The settings of a fit: a preset or a settings file, and changes to it.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Settings")]
pub(crate) struct FitSettingsArgs {
    /// The settings to start from [default: standard, or paper without an image]
    #[arg(long, value_parser = by_name::<Preset>(), value_name = "PRESET")]
    pub(crate) preset: Option<Preset>,
    /// Settings file, such as the settings.toml of a fit; flags override it
    #[arg(long, value_name = "FILE.toml", conflicts_with = "preset")]
    pub(crate) settings: Option<PathBuf>,
    /// The most Gaussians [default: 9000 for each 768x512 px; 600 with preset paper]
    #[arg(short = 'n', long, value_name = "N", value_parser = whole::<u32>(1..))]
    pub(crate) gaussians: Option<u32>,
    /// End with exactly the number of Gaussians that --gaussians sets, under any policy
    #[arg(long)]
    pub(crate) exactly: bool,
    /// Steps of the optimizer; 0 keeps the initial Gaussians
    #[arg(short, long, value_name = "K", value_parser = whole::<u32>(0..))]
    pub(crate) iterations: Option<u32>,
    /// Density control: which Gaussians grow and which are removed
    #[arg(long, value_parser = policy(), value_name = "POLICY")]
    pub(crate) policy: Option<Policy>,
    /// Placement of the initial Gaussians
    #[arg(long, value_parser = by_name::<InitKind>(), value_name = "INIT")]
    pub(crate) init: Option<InitKind>,
    /// Loss to minimise
    #[arg(long, value_parser = by_name::<Loss>(), value_name = "LOSS")]
    pub(crate) loss: Option<Loss>,
    /// The measure to tune for; ssim needs loss l2 or l1
    #[arg(long, value_parser = by_name::<Tune>(), value_name = "MEASURE")]
    pub(crate) tune: Option<Tune>,
    /// How the Gaussians at a pixel become its colour
    #[arg(long, value_parser = by_name::<Blend>(), value_name = "BLEND")]
    pub(crate) blend: Option<Blend>,
    /// Treatment of Gaussians narrower than a pixel
    #[arg(long, value_parser = by_name::<Antialias>(), value_name = "ANTIALIAS")]
    pub(crate) antialias: Option<Antialias>,
    /// Coordinates of the optimizer
    #[arg(long, value_parser = by_name::<Parameterization>(), value_name = "NAME")]
    pub(crate) parameterization: Option<Parameterization>,
    /// Background colour, each part from 0 to 1, such as 1,1,1 for white; with --resume, for
    /// transparent pixels only [default: white for transparent pixels; with --blend over, the image's mean
    /// colour for the scene]
    #[arg(long, value_name = "R,G,B")]
    pub(crate) background: Option<Color>,
    /// Seed of all random numbers; the same seed gives the same bits on the same SIMD level or GPU
    #[arg(long, value_name = "S", value_parser = whole::<u32>(0..))]
    pub(crate) seed: Option<u32>,
}

/// A parser of the policies for images.
fn policy() -> impl TypedValueParser<Value = Policy> {
    policy_by_name(|policy| {
        // It moves Gaussians by their opacities, which sums do not have.
        let needs_over = matches!(policy, Policy::Mcmc(_));
        policy.validate_2d().is_ok().then_some(if needs_over { "; needs --blend over" } else { "" })
    })
}

impl FitSettingsArgs {
    /// The settings in the file, if there is one. It is read once, as it may be a pipe.
    pub(crate) fn read_file(&self) -> Result<Option<FitSettings>, Failure> {
        let Some(file) = self.settings.as_deref() else { return Ok(None) };
        let settings = FitSettings::from_toml(&read_settings_text(file)?, file)
            .map_err(|error| Failure::usage(error).hint("compare it with the settings.toml that a fit writes"))?;
        settings.validate().map_err(|error| Failure::usage(error).at(file.display()))?;
        Ok(Some(settings))
    }

    /// The colour behind transparent pixels of the target: the flag's, or that of the file.
    pub(crate) fn behind(&self, file: Option<&FitSettings>) -> Option<Color> {
        let solid = file.filter(|settings| settings.render.effects.background == Background::Solid);
        self.background.or(solid.map(|settings| Color(settings.render.background)))
    }
}

/// The settings that the flags and the file ask for, for this target.
pub(crate) fn settings(
    args: &FitSettingsArgs,
    file: Option<&FitSettings>,
    target: &FitImage,
) -> Result<FitSettings, Failure> {
    let mut settings = match file {
        Some(settings) => {
            let gaussians = args.gaussians.unwrap_or(settings.gaussians);
            let iterations = args.iterations.unwrap_or(settings.iterations);
            settings.clone().with_gaussians(gaussians).with_iterations(iterations)
        }
        None => {
            let preset = args.preset.unwrap_or(target.preset());
            FitSettings::from_preset(preset, target.image.size(), args.gaussians, args.iterations)
        }
    };
    settings.exactly |= args.exactly;
    settings.loss = args.loss.unwrap_or(settings.loss);
    settings.tune = args.tune.unwrap_or(settings.tune);
    if let Some(parameterization) = args.parameterization {
        settings = settings.with_parameterization(parameterization);
    }
    if let Some(blend) = args.blend {
        // The colour behind transparent pixels. The settings do not hold the target, so this puts
        // them on the same colour when they are used again.
        let behind = target.behind.map_or_else(|| mean_color(&target.image), |color| color.0);
        settings = settings.with_blend(blend, behind);
    }
    if let Some(antialias) = args.antialias {
        settings.render.effects.antialias = antialias;
    }
    if let Some(color) = args.background {
        settings.render = settings.render.on(color.0);
    }
    if let Some(policy) = &args.policy {
        settings = settings.with_policy(policy.clone());
    }
    if let Some(init) = args.init {
        settings.init = Init::of_kind(init, settings.render.effects.blend);
    }
    settings.seed = args.seed.unwrap_or(settings.seed);
    if file.is_none() {
        settings = before_flat_color(settings, target);
    }
    settings.validate()?;
    Ok(settings)
}

/// A target of one flat colour, except for details, is fitted before that colour. If its
/// transparent pixels show another colour, it is not: these settings, used again, would put them on
/// the flat colour.
fn before_flat_color(settings: FitSettings, target: &FitImage) -> FitSettings {
    let before = settings.clone().before_flat_color(&target.image);
    match target.behind {
        Some(behind) if before.render.background_color() != behind.0 => settings,
        _ => before,
    }
}

#[cfg(test)]
mod tests {
    use gs_core::Image;

    use super::*;

    fn target() -> FitImage {
        let image = Image::from_fn(64, 48, |x, _| [x as f32 / 63.0, 0.5, 0.25]).unwrap();
        FitImage { image, file: Some("picture.png".into()), behind: None, remarks: Vec::new() }
    }

    fn resolved(args: &FitSettingsArgs) -> FitSettings {
        settings(args, None, &target()).unwrap()
    }

    /// The names of the policies that are offered.
    fn offered() -> Vec<String> {
        policy().possible_values().unwrap().map(|value| value.get_name().to_owned()).collect()
    }

    #[test]
    fn every_preset_and_every_override_is_read_from_its_toml() {
        for preset in Preset::ALL {
            for name in offered() {
                for init in InitKind::ALL {
                    let (preset, policy, init) = (Some(preset), Policy::from_name(&name).ok(), Some(init));
                    let settings = resolved(&FitSettingsArgs { preset, policy, init, ..FitSettingsArgs::default() });
                    let text = settings.to_toml().unwrap();
                    assert_eq!(FitSettings::from_toml(&text, "a".as_ref()).unwrap(), settings, "{text}");
                    assert!(text.contains("alpha-max = 0.999\n"), "meaningless digits: {text}");
                }
            }
        }
    }

    #[test]
    fn the_colour_of_a_flat_picture_becomes_its_background() {
        let flat = |behind| FitImage { image: Image::filled(9, 7, [1.0; 3]).unwrap(), behind, ..target() };
        let background = |args: &FitSettingsArgs, target: &FitImage| {
            let settings = super::settings(args, None, target).unwrap();
            (settings.render.effects.background == Background::Solid).then_some(settings.render.background)
        };
        let usual = FitSettingsArgs::default();
        assert_eq!(background(&usual, &flat(None)), Some([1.0; 3]));
        assert_eq!(background(&usual, &flat(Some(Color([1.0; 3])))), Some([1.0; 3]));
        assert_eq!(background(&usual, &flat(Some(Color([0.0; 3])))), None);
        assert_eq!(background(&usual, &target()), None);
        let black = FitSettingsArgs { background: Some(Color([0.0; 3])), ..FitSettingsArgs::default() };
        assert_eq!(background(&black, &flat(None)), Some([0.0; 3]));
        let file = FitSettings::standard(9);
        assert_eq!(settings(&usual, Some(&file), &flat(None)).unwrap().render.effects.background, Background::None);
    }

    #[test]
    fn the_offered_policies_are_those_that_can_fit_images() {
        let offered = offered();
        for name in Policy::NAMES {
            let fits = Policy::from_name(name).unwrap().validate_2d().is_ok();
            assert_eq!(offered.iter().any(|offered| offered == name), fits, "{name}");
        }
        for value in policy().possible_values().unwrap() {
            let (name, blend) = (value.get_name(), Some(Blend::Over));
            let policy = Policy::from_name(name).ok();
            let settings = resolved(&FitSettingsArgs { policy, blend, ..FitSettingsArgs::default() });
            assert_eq!(settings.policy.name(), name);
            let help = value.get_help().unwrap().to_string();
            assert_eq!(help.contains("needs --blend over"), name == "mcmc", "{help}");
        }
    }
}
