//! From flags to the settings of a fit: a preset or a file is the start, flags replace parts of it, and what depends on a
//! replaced part follows.

use std::path::Path;

use clap::ValueEnum;
use gs_core::{Adam, Blend, Image, Loss, Parameterization, RenderSettings, adam::Group, effects::Background};
use gs_density::Policy;
use gs_train::{
    FitSettings, Init, InitialCount, Preset,
    init::{Colors, Grid, Guided, Periphery, Random},
};
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    chosen::{ChosenMachine, ChosenSettings},
    failure::Failure,
    fit::{
        arguments::{BlendName, InitName, LossName, ParameterizationName, PolicyName, PresetName, SettingsArgs},
        target::Target,
    },
    text_file::read_text,
    values::Color,
};

/// What helps where there is no file of settings.
const MEND_FILE: &str = "name a file of settings";
/// Step size of opacity logits where a preset without opacities is blended front to back.
const OPACITY_RATE: f32 = 0.05;
/// Step size in standard deviations where a preset for pixels is moved to the covariance factor.
const LOCAL_FRAME_RATE: f32 = 0.15;

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
        let text = read_text(file, MEND_FILE)?;
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
            FitSettings { gaussians, ..(**settings).clone() }.with_iterations(iterations)
        }
        _ => from_preset(args, target.image.size(), args.preset.map_or(target.preset(), Preset::from)),
    };
    if let Given::Chosen(chosen) = given {
        settings.render.accuracy = chosen.accuracy;
    }
    if let InitialCount::Fixed(count) = &mut settings.initial {
        *count = (*count).min(settings.gaussians);
    }
    if let Some(loss) = args.loss {
        settings.loss = loss.into();
    }
    if let Some(parameterization) = args.parameterization {
        move_to_parameterization(&mut settings, parameterization.into());
    }
    if let Some(blend) = args.blend {
        blend_by(&mut settings, blend.into(), target);
    }
    if let Some(antialias) = args.antialias {
        settings.render.effects.antialias = antialias.into();
    }
    if let Some(color) = args.background {
        settings.render = settings.render.on(color.0);
    }
    if let Some(policy) = args.policy {
        control_by(&mut settings, policy)?;
    }
    if let Some(init) = args.init {
        settings.init = initialiser(init, &settings);
    }
    settings.seed = args.seed.unwrap_or(settings.seed);
    if !matches!(given, Given::Fit(_)) {
        settings = before_flat_color(settings, target);
    }
    settings.validate()?;
    Ok(settings)
}

/// The settings as TOML, for [`SettingsArgs::settings`] to read. Numbers have as many digits as tell them apart as `f32`.
///
/// # Errors
/// Where they cannot be written as TOML.
pub(crate) fn to_toml(settings: &impl Serialize) -> Result<String, Failure> {
    let failed = |error| Failure::failed(error).at("settings");
    let mut value = toml::Value::try_from(settings).map_err(failed)?;
    shorten(&mut value);
    toml::to_string(&value).map_err(failed)
}

/// Every number of the settings is an `f32`, which a wider type shows with digits that mean nothing.
fn shorten(value: &mut toml::Value) {
    match value {
        toml::Value::Float(number) => *number = (*number as f32).to_string().parse().unwrap_or(*number),
        toml::Value::Array(values) => values.iter_mut().for_each(shorten),
        toml::Value::Table(table) => table.iter_mut().for_each(|(_, value)| shorten(value)),
        _ => {}
    }
}

/// Reads a file of settings of any kind; `mend` is what helps where its content is wrong.
///
/// # Errors
/// Where it cannot be read, or is not of this kind.
pub(crate) fn read_toml<T: DeserializeOwned>(file: &Path, mend: &str) -> Result<T, Failure> {
    parse_toml(&read_text(file, MEND_FILE)?, file, mend)
}

/// The same of the text of a file that was read.
///
/// # Errors
/// Where it is not of this kind.
pub(crate) fn parse_toml<T: DeserializeOwned>(text: &str, file: &Path, mend: &str) -> Result<T, Failure> {
    toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
        Failure::usage(format_args!("line {line}: {}", error.message())).mend(mend).at(file.display())
    })
}

fn from_preset(args: &SettingsArgs, size: (u32, u32), preset: Preset) -> FitSettings {
    let settings = match preset {
        Preset::Paper => FitSettings::paper(),
        _ => preset.settings(gaussians_for(size), size),
    };
    let gaussians = args.gaussians.unwrap_or(settings.gaussians);
    match (preset, args.iterations) {
        (Preset::Paper, iterations) => {
            FitSettings { gaussians, ..settings }.with_iterations(iterations.unwrap_or(FitSettings::paper().iterations))
        }
        (_, Some(iterations)) => FitSettings::for_image(gaussians, size, iterations),
        (_, None) => preset.settings(gaussians, size),
    }
}

/// Images of fewer pixels have a Gaussian for each by default, and larger ones so many at least.
///
/// By the share of larger images, a photograph of 8x12 px has 2 Gaussians and ends at 18.1 dB, one of 16x24 px at 19.5 dB, one of 32x48 px
/// at 23.9 dB. With 256 at most they end at 66.1, 64.0 and 39.7 dB, and one of 64x96 px at 31.8 instead of 28.5 dB, in a tenth of a second.
/// Noise takes one Gaussian a pixel: 3x2 px end at 67.9 dB with 6 and at 33.0 dB with 4, 16x16 px at 67.6 dB with 256 and at 44.3 dB with 128.
const ENOUGH_GAUSSIANS: u64 = 256;

/// How many Gaussians an image has by default: 9,000 for each 768x512 px, the size of the Kodak test set, but enough for tiny images
/// ([`ENOUGH_GAUSSIANS`]).
fn gaussians_for((width, height): (u32, u32)) -> u32 {
    let pixels = u64::from(width) * u64::from(height);
    let count = (pixels * 9_000 / (768 * 512)).max(ENOUGH_GAUSSIANS.min(pixels));
    u32::try_from(count).unwrap_or(u32::MAX)
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

/// Step sizes have other units in the other parameterization.
fn move_to_parameterization(settings: &mut FitSettings, parameterization: Parameterization) {
    if settings.parameterization == parameterization {
        return;
    }
    settings.parameterization = parameterization;
    let adam = &mut settings.adam;
    let usual = Adam::default();
    let rates = match parameterization {
        Parameterization::ScaleRotation => {
            [usual.mean, usual.scale, usual.rotation].map(|group: Group| group.learning_rate)
        }
        Parameterization::CovarianceFactor => [LOCAL_FRAME_RATE; 3],
    };
    for (group, rate) in [&mut adam.mean, &mut adam.scale, &mut adam.rotation].into_iter().zip(rates) {
        group.learning_rate = rate;
    }
}

/// Front to back, something must be behind, and opacities must move. Behind is what the target's transparent pixels show, so that
/// the settings, which do not hold the target, put them on the same colour when they are used again; or else the mean colour.
fn blend_by(settings: &mut FitSettings, blend: Blend, target: &Target) {
    if settings.render.effects.blend == blend {
        return;
    }
    match blend {
        Blend::Sum => settings.render.effects.blend = blend,
        Blend::Over => {
            let accuracy = settings.render.accuracy;
            let behind = target.behind.map_or_else(|| mean_color(&target.image), |color| color.0);
            settings.render = RenderSettings { accuracy, ..RenderSettings::blended(blend) }.on(behind);
            settings.adam.opacity.learning_rate = OPACITY_RATE;
        }
    }
}

fn mean_color(image: &Image) -> [f32; 3] {
    let count = image.pixels().len() as f64;
    let sum = image
        .pixels()
        .iter()
        .fold([0.0; 3], |sum: [f64; 3], pixel| std::array::from_fn(|channel| sum[channel] + f64::from(pixel[channel])));
    sum.map(|channel| (channel / count) as f32)
}

fn control_by(settings: &mut FitSettings, name: PolicyName) -> Result<(), Failure> {
    let name = name.to_possible_value().expect("no policy is skipped");
    settings.policy = Policy::from_name(name.get_name())?;
    match &mut settings.policy {
        Policy::Residual(growth) => {
            let first = settings.initial.resolve(settings.gaussians) as f32;
            growth.start_fraction = first / settings.gaussians as f32;
        }
        Policy::ImageGs(addition) => settings.initial = InitialCount::Fraction(addition.start_fraction),
        // What cannot grow must be there from the start.
        Policy::None => settings.initial = InitialCount::Fraction(1.0),
        _ => {}
    }
    Ok(())
}

fn initialiser(name: InitName, settings: &FitSettings) -> Init {
    // Added up, colours that know nothing of the image would have to be unlearnt first.
    let colors = match settings.render.effects.blend {
        Blend::Sum => Colors::Target,
        Blend::Over => Colors::Random,
    };
    match name {
        InitName::Random => Init::Random(Random { colors, ..Random::default() }),
        InitName::Periphery => Init::Periphery(Periphery { colors, ..Periphery::default() }),
        InitName::Grid => Init::Grid(Grid::default()),
        InitName::Gradient => Init::Gradient(Guided::default()),
        InitName::Error => Init::Error(Guided::default()),
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

impl From<LossName> for Loss {
    fn from(name: LossName) -> Self {
        match name {
            LossName::L2 => Self::L2,
            LossName::L1 => Self::L1,
            LossName::L1Dssim => Self::PAPER,
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

impl From<ParameterizationName> for Parameterization {
    fn from(name: ParameterizationName) -> Self {
        match name {
            ParameterizationName::ScaleRotation => Self::ScaleRotation,
            ParameterizationName::CovarianceFactor => Self::CovarianceFactor,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn the_number_of_gaussians_follows_the_image_unless_it_is_given() {
        assert_eq!(gaussians_for((768, 512)), 9_000);
        assert_eq!([(1, 1), (3, 2), (16, 16), (32, 32), (106, 106)].map(gaussians_for), [1, 6, 256, 256, 257]);
        assert_eq!(gaussians_for((16_384, 16_384)), 6_144_000);
        let few = resolved(&SettingsArgs {
            preset: Some(PresetName::Paper),
            gaussians: Some(7),
            iterations: Some(250),
            ..SettingsArgs::default()
        });
        assert_eq!((few.gaussians, few.initial.resolve(7), few.iterations), (7, 7, 250));
        assert!(few.rounds.last(250) <= 250);
    }

    #[test]
    fn front_to_back_has_a_background_and_moving_opacities() {
        let over = resolved(&SettingsArgs { blend: Some(BlendName::Over), ..SettingsArgs::default() });
        assert_eq!(over.render.effects.blend, Blend::Over);
        assert_eq!(over.render.effects.background, Background::Solid);
        assert!((over.render.background[0] - 0.5).abs() < 1e-3 && (over.render.background[2] - 0.25).abs() < 1e-6);
        assert_eq!(over.adam.opacity.learning_rate, OPACITY_RATE);
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
    fn step_sizes_follow_the_chart() {
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
