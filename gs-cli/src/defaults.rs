//! Defaults in the help of `gs fit` and `gs train`, read from the presets.

use clap::{Arg, ValueEnum};
use gs_train::{FitSettings, Init, Preset, TrainPreset, TrainSettings};

use crate::{
    commands::train::{ExposureName, ParticipantsName},
    image_fit::{BlendName, InitName, TuneName},
    render_args::{AntialiasName, OrderName},
    training::arguments::{LossName, ParameterizationName, name_of},
};

/// A flag of `gs fit` with its default in each preset.
pub(crate) fn of_fit(flag: Arg) -> Arg {
    let value: fn(&FitSettings) -> String = match flag.get_id().as_str() {
        "iterations" => |s| s.iterations.to_string(),
        "policy" => |s| s.policy.name().to_owned(),
        "init" => |s| {
            let blend = s.render.effects.blend;
            let is_used = |name: &&InitName| Init::from_name(&name_of(*name), blend).as_ref() == Ok(&s.init);
            InitName::value_variants().iter().find(is_used).map(name_of).unwrap_or_default()
        },
        "loss" => |s| named::<LossName, _>(s.loss),
        "tune" => |s| named::<TuneName, _>(s.tune),
        "blend" => |s| named::<BlendName, _>(s.render.effects.blend),
        "antialias" => |s| named::<AntialiasName, _>(s.render.effects.antialias),
        "parameterization" => |s| named::<ParameterizationName, _>(s.parameterization),
        "seed" => |s| s.seed.to_string(),
        _ => return flag,
    };
    let order = [Preset::Standard, Preset::Quick, Preset::Best, Preset::Paper];
    with_default(flag, order.map(|preset| (preset.name(), value(&preset.settings(1, (768, 512))))))
}

/// A flag of `gs train` with its default in each preset.
pub(crate) fn of_train(flag: Arg) -> Arg {
    let value: fn(&TrainSettings) -> String = match flag.get_id().as_str() {
        "policy" => |s| s.policy.name().to_owned(),
        "loss" => |s| named::<LossName, _>(s.loss),
        "parameterization" => |s| named::<ParameterizationName, _>(s.parameterization),
        "sh_degree" => |s| s.render.effects.sh_degree.to_string(),
        "order" => |s| named::<OrderName, _>(s.render.effects.order),
        "coarse" => |s| s.resolution.factor(0.0).to_string(),
        "exposure" => |s| named::<ExposureName, _>(s.exposure),
        "depth_weight" => |s| s.depth_loss.weight.to_string(),
        "participants" => |s| named::<ParticipantsName, _>(s.adam.participants),
        "opacity_weight" => |s| s.adam.penalty.opacity.to_string(),
        "scale_weight" => |s| s.adam.penalty.scale.to_string(),
        "seed" => |s| s.seed.to_string(),
        _ => return flag,
    };
    with_default(flag, TrainPreset::ALL.map(|preset| (preset.name(), value(&preset.settings(None)))))
}

/// The name of a value in flags.
fn named<N: ValueEnum, V: From<N> + PartialEq>(value: V) -> String {
    let is_used = |name: &&N| V::from((*name).clone()) == value;
    N::value_variants().iter().find(is_used).map(name_of).unwrap_or_default()
}

/// The flag, whose help ends with the default of the first preset, and with those of the others that
/// differ.
fn with_default<const N: usize>(flag: Arg, presets: [(&str, String); N]) -> Arg {
    let usual = &presets[0].1;
    let mut default = format!("[default: {usual}");
    let mut others: Vec<(Vec<&str>, &String)> = Vec::new();
    for (preset, value) in presets.iter().filter(|(_, value)| value != usual) {
        match others.iter_mut().find(|(_, other)| *other == value) {
            Some((names, _)) => names.push(preset),
            None => others.push((vec![preset], value)),
        }
    }
    for (at, (names, value)) in others.iter().enumerate() {
        let separator = if at == 0 { "; " } else { ", " };
        default += &format!("{separator}{}: {value}", names.join(" and "));
    }
    let help = flag.get_help().map(ToString::to_string).unwrap_or_default();
    flag.help(format!("{help} {default}]"))
}
