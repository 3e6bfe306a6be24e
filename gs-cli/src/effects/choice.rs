//! The flag `--effects`: whether the scene is asked which effects it calls for, and what was answered, in words.

use std::{fmt::Write, str::FromStr};

use clap::Args;
use gs_core::{
    Effects, RenderSettings,
    effects::{Effect, EffectDecision, RequiredEffects, Requirement, RequiresEffects},
};

use crate::training_arguments::Detail;

/// The flag of commands that show something.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct EffectsArgs {
    /// Which effects are simulated: auto (what the scene calls for; the rest changes no pixel by more than 1/512), all, or a list of
    /// order, sh-degree, antialias and background, without those that are not in it; gs effects tells what each one costs [default: auto]
    #[arg(long, value_name = "auto|all|LIST")]
    effects: Option<Choice>,
}

/// Which of the wanted effects are simulated.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Choice {
    /// Those that the scene calls for.
    Auto,
    /// All.
    All,
    /// All, as a file of settings says.
    AsChosen,
    /// These. What is blended is not among them: no scene is meant both ways.
    Only(Vec<Effect>),
}

impl FromStr for Choice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => return Ok(Self::Auto),
            "all" => return Ok(Self::All),
            _ => {}
        }
        let named = |name: &str| name.trim().parse().ok().filter(|effect| *effect != Effect::Blend);
        let list: Option<Vec<Effect>> = text.split(',').map(named).collect();
        list.map(Self::Only)
            .ok_or_else(|| "write auto, all, or a list of order, sh-degree, antialias and background".to_owned())
    }
}

impl EffectsArgs {
    /// The flag, where it is given; else the effects of a file of settings stay as it has them: what they change is in its budget.
    pub(crate) fn or_as_chosen(&self) -> Self {
        Self { effects: Some(self.effects.clone().unwrap_or(Choice::AsChosen)) }
    }

    fn choice(&self) -> &Choice {
        self.effects.as_ref().unwrap_or(&Choice::Auto)
    }

    /// What of these settings a scene is trained with that is not there yet, and so cannot be asked.
    pub(crate) fn before(&self, wanted: &RenderSettings) -> RenderSettings {
        match self.choice() {
            Choice::Auto | Choice::All | Choice::AsChosen => *wanted,
            Choice::Only(list) => listed(list, wanted).settings,
        }
    }

    /// What a scene is shown with in these views (without any: in whatever view), and why.
    ///
    /// # Errors
    /// Where the scene is asked, those of [`RenderSettings::validate`].
    pub(crate) fn choose<S: RequiresEffects>(
        &self,
        scene: &S,
        views: &[S::View],
        wanted: &RenderSettings,
    ) -> Result<RequiredEffects, gs_core::Error> {
        Ok(match self.choice() {
            Choice::Auto => Effects::required(scene, views, wanted)?,
            Choice::All => as_said(wanted, |_| Said { stays: wanted.effects, why: "--effects all" }),
            Choice::AsChosen => as_said(wanted, |_| Said { stays: wanted.effects, why: "as the settings have it" }),
            Choice::Only(list) => listed(list, wanted),
        })
    }
}

fn listed(list: &[Effect], wanted: &RenderSettings) -> RequiredEffects {
    as_said(wanted, |effect| match effect {
        Effect::Blend => Said { stays: wanted.effects, why: "as the scene is meant" },
        _ if list.contains(&effect) => Said { stays: wanted.effects, why: "in --effects" },
        _ => Said { stays: effect.off(&wanted.effects), why: "not in --effects" },
    })
}

/// What the flag says of an effect.
struct Said {
    stays: Effects,
    why: &'static str,
}

fn as_said(wanted: &RenderSettings, said: impl Fn(Effect) -> Said) -> RequiredEffects {
    let mut settings = *wanted;
    let verdicts = Effect::ALL.into_iter().map(|effect| {
        let Said { stays, why } = said(effect);
        settings.effects = effect.copied(&stays, &settings.effects);
        EffectDecision::new(effect, &wanted.effects, &stays, why.to_owned())
    });
    let verdicts = verdicts.collect();
    RequiredEffects { settings, decisions: verdicts }
}

/// Which effects are simulated and which are left out, each with its reason; nothing where nobody asked for any.
pub(crate) fn told(verdicts: &[EffectDecision]) -> Option<String> {
    let mut text = "effects:".to_owned();
    let mut separator = " ";
    for EffectDecision { effect, wanted, value, answer, reason } in verdicts {
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

/// The same as a line below a summary, where all is to be said.
pub(crate) fn told_in(detail: Detail, verdicts: &[EffectDecision]) -> String {
    match detail {
        Detail::Steps => String::new(),
        Detail::Rounds => {
            let none = || "effects: none; the Gaussians at a pixel are added up, in no order".to_owned();
            format!("\n{}", told(verdicts).unwrap_or_else(none))
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
        let args = EffectsArgs { effects: Some(text.parse().unwrap()) };
        args.choose(&Scene2d::default(), &[], &wanted).unwrap()
    }

    #[test]
    fn a_flag_says_what_stays() {
        assert_eq!(chosen("all").settings.effects.sh_degree, 3);
        let only = chosen("antialias, background").settings.effects;
        let expected = Effects { antialias: Antialias::Mip, blend: Blend::Over, ..chosen("all").settings.effects };
        assert_eq!(only, Effects { sh_degree: 0, ..expected });
        assert_eq!(chosen("order").settings.effects, Effects { blend: Blend::Over, ..Effects::default() });
        assert_eq!(chosen("auto").settings.effects.sh_degree, 0);
        for wrong in ["", "none", "blend", "order,", "Auto"] {
            assert!(wrong.parse::<Choice>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_is_told_names_each_with_its_reason() {
        let text = told(&chosen("auto").decisions).unwrap();
        assert!(text.starts_with("effects: blend over (the scene is empty); without sh-degree 3 ("), "{text}");
        assert!(text.ends_with("without background solid (black looks the same as none)"), "{text}");
        let listed = chosen("order").decisions;
        assert!(told(&listed).unwrap().contains("without antialias mip (not in --effects)"));
        assert_eq!((told(&[]), told_in(Detail::Steps, &listed)), (None, String::new()));
        assert!(told_in(Detail::Rounds, &[]).starts_with("\neffects: none; "));
    }
}
