//! The flag `--effects`: which effects are simulated, and why.

use std::{fmt::Write, str::FromStr};

use clap::Args;
use gs_core::{
    Effects, RenderSettings,
    effects::{Effect, EffectDecision, RequiredEffects, Requirement, RequiresEffects},
};

use crate::terminal::output::Verbosity;

/// The flag of commands that render.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct EffectsArgs {
    #[arg(long, value_name = "auto|all|LIST", help = help(), help_heading = "Rendering")]
    effects: Option<EffectsChoice>,
}

fn help() -> String {
    format!(
        "Effects to simulate: auto (those that change a pixel by more than 1/512), all, or a list of {}; gs effects shows \
         what each one costs [default: auto]",
        names()
    )
}

/// The names of the effects that can be left out.
fn names() -> String {
    Effect::OPTIONAL.map(Effect::name).join(", ")
}

/// Which effects are simulated.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum EffectsChoice {
    /// The effects that the scene requires.
    Auto,
    /// All effects.
    All,
    /// The listed effects. Blending cannot be chosen: a scene is trained for one.
    Only(Vec<Effect>),
}

impl FromStr for EffectsChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => return Ok(Self::Auto),
            "all" => return Ok(Self::All),
            _ => {}
        }
        let named = |name: &str| Effect::OPTIONAL.into_iter().find(|effect| effect.name() == name.trim());
        let list: Option<Vec<Effect>> = text.split(',').map(named).collect();
        list.map(Self::Only).ok_or_else(|| format!("write auto, all, or a list of {}", names()))
    }
}

impl EffectsArgs {
    /// What the flag says, or otherwise its default.
    pub(crate) fn choice(&self) -> EffectsChoice {
        self.effects.clone().unwrap_or(EffectsChoice::Auto)
    }
}

impl EffectsChoice {
    /// The settings to train a scene with, for which no effect can be decided yet.
    pub(crate) fn for_training(&self, wanted: &RenderSettings) -> RenderSettings {
        match self {
            Self::Auto | Self::All => *wanted,
            Self::Only(list) => listed(list, wanted).settings,
        }
    }

    /// The settings to render a scene with in these views, or in any view if there are none, and
    /// the reasons.
    pub(crate) fn choose<S: RequiresEffects>(
        &self,
        scene: &S,
        views: &[S::View],
        wanted: &RenderSettings,
    ) -> Result<RequiredEffects, gs_core::Error> {
        let all = |why: &str| RequiredEffects::decided(wanted, |_| (wanted.effects, why.to_owned()));
        Ok(match self {
            Self::Auto => Effects::required(scene, views, wanted)?,
            Self::All => all("--effects all"),
            Self::Only(list) => listed(list, wanted),
        })
    }
}

fn listed(list: &[Effect], wanted: &RenderSettings) -> RequiredEffects {
    RequiredEffects::decided(wanted, |effect| match effect {
        Effect::Blend => (wanted.effects, "as in training".to_owned()),
        _ if list.contains(&effect) => (wanted.effects, "in --effects".to_owned()),
        _ => (effect.off(&wanted.effects), "not in --effects".to_owned()),
    })
}

/// Which effects are simulated and which are left out, with reasons; `None` if there is nothing to
/// simulate.
pub(crate) fn describe(decisions: &[EffectDecision]) -> Option<String> {
    let mut text = "effects:".to_owned();
    let mut separator = " ";
    for EffectDecision { effect, wanted, value, answer, reason } in decisions {
        let written = match answer {
            Requirement::Off => continue,
            Requirement::Required => write!(text, "{separator}{effect} {value} ({reason})"),
            Requirement::InPart => write!(text, "{separator}{effect} {value} instead of {wanted} ({reason})"),
            Requirement::NotRequired => write!(text, "{separator}without {effect} {wanted} ({reason})"),
        };
        debug_assert!(written.is_ok(), "a string can always be written to");
        separator = "; ";
    }
    (separator != " ").then_some(text)
}

/// The text of [`describe`] as a line below a summary.
pub(crate) fn line_below(verbosity: Verbosity, decisions: &[EffectDecision]) -> String {
    match verbosity {
        Verbosity::Normal => String::new(),
        Verbosity::Verbose => {
            let none = || "effects: none; the Gaussians at a pixel are added up, in no order".to_owned();
            format!("\n{}", describe(decisions).unwrap_or_else(none))
        }
    }
}

#[cfg(test)]
mod tests {
    use gs_core::{Blend, Scene2d, effects::Antialias};

    use super::*;

    fn chosen(text: &str) -> RequiredEffects {
        let mut wanted = RenderSettings::blended(Blend::Over).on([0.0; 3]);
        wanted.effects.antialias = Antialias::Mip;
        wanted.effects.sh_degree = 3;
        let choice: EffectsChoice = text.parse().unwrap();
        choice.choose(&Scene2d::default(), &[], &wanted).unwrap()
    }

    #[test]
    fn the_flag_chooses_effects() {
        assert_eq!(chosen("all").settings.effects.sh_degree, 3);
        let only = chosen("antialias, background").settings.effects;
        let expected = Effects { antialias: Antialias::Mip, blend: Blend::Over, ..chosen("all").settings.effects };
        assert_eq!(only, Effects { sh_degree: 0, ..expected });
        assert_eq!(chosen("order").settings.effects, Effects { blend: Blend::Over, ..Effects::default() });
        assert_eq!(chosen("auto").settings.effects.sh_degree, 0);
        for wrong in ["", "none", "blend", "order,", "Auto"] {
            assert!(wrong.parse::<EffectsChoice>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_description_names_each_effect_with_its_reason() {
        let text = describe(&chosen("auto").decisions).unwrap();
        assert!(text.starts_with("effects: blend over (the scene is empty); without sh-degree 3 ("), "{text}");
        assert!(text.ends_with("without background solid (black looks the same as none)"), "{text}");
        let listed = chosen("order").decisions;
        assert!(describe(&listed).unwrap().contains("without antialias mip (not in --effects)"));
        assert_eq!((describe(&[]), line_below(Verbosity::Normal, &listed)), (None, String::new()));
        assert!(line_below(Verbosity::Verbose, &[]).starts_with("\neffects: none; "));
    }
}
