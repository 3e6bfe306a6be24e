//! Defaults in the help of `gs fit` and `gs train`, read from the presets.

use clap::Arg;
use gs_train::{FitSettings, Init, InitKind, Preset, TrainPreset, TrainSettings};

/// A flag of `gs fit` with its default in each preset.
pub(crate) fn of_fit(flag: Arg) -> Arg {
    let value: fn(&FitSettings) -> String = match flag.get_id().as_str() {
        "iterations" => |s| s.iterations.to_string(),
        "policy" => |s| s.policy.name().to_owned(),
        "init" => |s| {
            let blend = s.render.effects.blend;
            let used = InitKind::ALL.into_iter().find(|kind| Init::of_kind(*kind, blend) == s.init);
            used.map_or_else(String::new, |kind| kind.to_string())
        },
        "loss" => |s| s.loss.to_string(),
        "tune" => |s| s.tune.to_string(),
        "blend" => |s| s.render.effects.blend.to_string(),
        "antialias" => |s| s.render.effects.antialias.to_string(),
        "parameterization" => |s| s.parameterization.to_string(),
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
        "loss" => |s| s.loss.to_string(),
        "sh_degree" => |s| s.render.effects.sh_degree.to_string(),
        "order" => |s| s.render.effects.order.to_string(),
        "coarse" => |s| s.resolution.factor(0.0).to_string(),
        "exposure" => |s| s.exposure.to_string(),
        "refine_poses" => |s| s.refine_poses.to_string(),
        "participants" => |s| s.adam.participants.to_string(),
        "seed" => |s| s.seed.to_string(),
        _ => return flag,
    };
    with_default(flag, TrainPreset::ALL.map(|preset| (preset.name(), value(&preset.settings(None)))))
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
