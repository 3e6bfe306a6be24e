//! The settings and the initial Gaussians that the flags of a training ask for.

use gs_train::SettingsFile as _;
use std::path::Path;

use gs_core::{Choice as _, counted, effects::Antialias};
use gs_io::dataset::{Dataset, Split};
use gs_train::{
    TrainPreset, TrainSettings,
    train::{Resolution, Start, StartName},
};

use super::arguments::TrainSettingsArgs;
use crate::{
    failure::Failure,
    files::{scene, text_file::read_settings_text},
};

/// The settings that the flags ask for, for this data set.
pub(crate) fn settings(args: &TrainSettingsArgs, dataset: &Dataset) -> Result<TrainSettings, Failure> {
    let settings = match &args.settings {
        Some(file) => {
            let settings = TrainSettings::from_toml(&read_settings_text(file)?, file).map_err(|error| {
                Failure::usage(error).hint("compare it with the settings.toml that a training writes")
            })?;
            settings.validate().map_err(|error| Failure::usage(error).at(file.display()))?;
            settings
        }
        None => {
            let preset = args.preset.unwrap_or(TrainPreset::Standard);
            let cameras = dataset.views_of(Split::Train).map(|view| &view.camera);
            preset.settings_for(args.iterations, dataset.kind, cameras)
        }
    };
    with_flags(args, settings)
}

/// These settings with the values of the flags.
pub(super) fn with_flags(args: &TrainSettingsArgs, mut settings: TrainSettings) -> Result<TrainSettings, Failure> {
    if let Some(policy) = &args.policy {
        settings = settings.with_policy(policy.clone());
    }
    if let Some(gaussians) = args.gaussians {
        settings = settings.with_gaussians(gaussians);
    }
    settings.exactly |= args.exactly;
    settings.loss = args.loss.unwrap_or(settings.loss);
    settings.seed = args.seed.unwrap_or(settings.seed);
    let effects = &mut settings.render.effects;
    effects.sh_degree = args.sh_degree.unwrap_or(effects.sh_degree);
    effects.order = args.order.unwrap_or(effects.order);
    effects.antialias = args.antialias.unwrap_or(effects.antialias);
    if let Some(color) = args.background {
        settings = settings.on(color.0);
    }
    if let Some(from) = args.coarse {
        settings.resolution = Resolution::from_coarse(from);
    }
    settings.exposure = args.exposure.unwrap_or(settings.exposure);
    settings.refine_poses = args.refine_poses.unwrap_or(settings.refine_poses);
    settings.adam.participants = args.participants.unwrap_or(settings.adam.participants);
    settings.validate()?;
    Ok(settings)
}

/// The initial Gaussians, and what they are in words where that is known before the images are
/// searched. Those of a scene keep its antialiasing unless the flags or a settings file give another.
pub(super) fn initial(
    args: &TrainSettingsArgs,
    dataset: &Dataset,
    settings: &mut TrainSettings,
) -> Result<(Start, String), Failure> {
    let named = match args.start.as_deref() {
        None => Some(StartName::usual_for(dataset, settings)),
        Some(name) => StartName::from_name(name),
    };
    match (named, &args.start) {
        (Some(start), _) => {
            let initial = start
                .of(dataset)
                .map_err(|error| Failure::usage(format_args!("--start: {error}")).hint("use --start images"))?;
            let description = match start {
                StartName::Points => counted(dataset.points.len(), "point"),
                StartName::Random => "random points".to_owned(),
                _ => String::new(),
            };
            Ok((initial, description))
        }
        (None, file) => {
            let file = file.as_deref().unwrap_or_default();
            let mut read = scene::read_3d(Path::new(file))?;
            read.move_to(dataset.frame);
            if args.antialias.is_none() && args.settings.is_none() {
                settings.render.effects.antialias = read.trained_with.antialias.unwrap_or(Antialias::Dilate);
            }
            Ok((Start::Scene(read.scene), format!("the Gaussians of {file}")))
        }
    }
}
