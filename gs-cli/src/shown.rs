//! How a 3D scene is shown: as flags ask, otherwise as its file says that it was trained.

use clap::Args;
use gs_core::{
    Blend, Culled, RenderSettings, Scene3d, counted,
    effects::{Antialias, Order},
};
use gs_io::{TrainedWith, dataset::Dataset};

use crate::{
    output,
    train::OrderName,
    training_arguments::AntialiasName,
    values::{Color, whole},
};

/// The flags of commands that show a 3D scene.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Scenes in 3D")]
pub(crate) struct ShownArgs {
    /// The colour behind: black, white, or R,G,B [default: black; of a Blender data set white]
    #[arg(long, value_name = "COLOUR")]
    background: Option<Color>,
    /// Highest degree of the spherical harmonics, 0 to 3 [default: the scene's]
    #[arg(long, value_name = "D", value_parser = whole::<u8>(0..=3))]
    sh_degree: Option<u8>,
    /// In which order Gaussians are blended [default: as the file says, otherwise global]
    #[arg(long, value_enum, value_name = "ORDER")]
    order: Option<OrderName>,
    /// What is done about Gaussians narrower than a pixel [default: as the file says, otherwise dilate]
    #[arg(long, value_enum, value_name = "ANTIALIAS")]
    antialias: Option<AntialiasName>,
}

impl ShownArgs {
    /// Whether any of them is given.
    pub(crate) fn is_some(&self) -> bool {
        let Self { background, sh_degree, order, antialias } = self;
        background.is_some() || sh_degree.is_some() || order.is_some() || antialias.is_some()
    }

    /// Whether an order is asked for, which some commands have to choose themselves.
    pub(crate) fn has_order(&self) -> bool {
        self.order.is_some()
    }

    /// Whether something is asked for that no scene's file says.
    pub(crate) fn is_of_pictures(&self) -> bool {
        self.background.is_some() || self.sh_degree.is_some()
    }

    /// How a scene was trained: as flags say, otherwise as its file does.
    pub(crate) fn trained_with(&self, file: TrainedWith) -> TrainedWith {
        TrainedWith {
            antialias: self.antialias.map(Into::into).or(file.antialias),
            order: self.order.map(Into::into).or(file.order),
        }
    }

    /// Notes on standard error that the antialiasing is a guess, where neither the file nor a flag says it.
    pub(crate) fn note_guess(&self, file: TrainedWith) {
        if self.trained_with(file).antialias.is_none() {
            output::note(
                "note: the file does not say how the scene was antialiased in training; dilate, as in 3DGS, is assumed: \
                 --antialias names another",
            );
        }
    }

    /// How the scene is shown; before black, if nothing else is asked for.
    pub(crate) fn settings(&self, scene: &Scene3d, file: TrainedWith) -> RenderSettings {
        let TrainedWith { antialias, order } = self.trained_with(file);
        let mut render = RenderSettings::blended(Blend::Over).on(self.background.map_or([0.0; 3], |color| color.0));
        render.effects.sh_degree = self.sh_degree.unwrap_or(scene.sh_degree);
        render.effects.order = order.unwrap_or(Order::Global);
        render.effects.antialias = antialias.unwrap_or(Antialias::Dilate);
        render
    }

    /// The same of a scene that is known to be shown in this way: flags override it.
    pub(crate) fn settings_known(&self, scene: &Scene3d, known: RenderSettings) -> RenderSettings {
        let asked = self.settings(scene, TrainedWith::default());
        let render = self.overriding(known, &asked);
        if self.background.is_some() { render.on(asked.background) } else { render }
    }

    /// `chosen`, with what the flags ask for as it is in `asked`.
    pub(crate) fn overriding(&self, mut chosen: RenderSettings, asked: &RenderSettings) -> RenderSettings {
        let (effects, asked) = (&mut chosen.effects, &asked.effects);
        effects.order = if self.order.is_some() { asked.order } else { effects.order };
        effects.antialias = if self.antialias.is_some() { asked.antialias } else { effects.antialias };
        effects.sh_degree = if self.sh_degree.is_some() { asked.sh_degree } else { effects.sh_degree };
        chosen
    }

    /// The same; before white if the photographs are of an object without surroundings, unless something else is asked for.
    pub(crate) fn settings_beside(&self, scene: &Scene3d, file: TrainedWith, dataset: &Dataset) -> RenderSettings {
        let render = self.settings(scene, file);
        match self.background {
            None => render.on(crate::train::usual_background(dataset)),
            Some(_) => render,
        }
    }
}

/// How a scene was trained that was rendered so in training.
pub(crate) fn trained_with(render: &RenderSettings) -> TrainedWith {
    let effects = &render.effects;
    TrainedWith { antialias: Some(effects.antialias), order: Some(effects.order) }
}

/// The effects that a scene is shown with, in the words of the flags.
pub(crate) fn effects(render: &RenderSettings) -> String {
    let effects = &render.effects;
    let (order, antialias) = (effects.order.name(), effects.antialias.name());
    format!(
        "order {order}, antialias {antialias}, SH degree {}, background {}",
        effects.sh_degree,
        Color(render.background_color())
    )
}

/// Why nothing of a scene is to be seen, if that is so: `culled` of `frames` renderings together.
pub(crate) fn why_empty(culled: Culled, gaussians: usize, frames: usize) -> Option<String> {
    if culled.total() < gaussians as u64 * frames as u64 {
        return None;
    }
    let Culled { not_finite, near, degenerate, transparent, outside } = culled;
    let causes = [
        (not_finite, "not finite"),
        (near, "behind the camera or too near"),
        (degenerate, "without rotation or extent"),
        (transparent, "transparent"),
        (outside, "outside of the picture or too faint"),
    ];
    let causes: Vec<String> = causes
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, cause)| format!("{} {cause}", u64::from(*count).div_ceil(frames.max(1) as u64)))
        .collect();
    Some(format!("of {} {}", counted(gaussians, "Gaussian"), causes.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;

    #[test]
    fn flags_and_settings_files_have_the_same_names() {
        let flag = |name: &dyn Fn() -> Option<clap::builder::PossibleValue>| name().unwrap().get_name().to_owned();
        for name in OrderName::value_variants() {
            assert_eq!(flag(&|| name.to_possible_value()), Order::from(*name).name());
        }
        for name in AntialiasName::value_variants() {
            assert_eq!(flag(&|| name.to_possible_value()), Antialias::from(*name).name());
        }
    }

    #[test]
    fn an_empty_picture_has_its_causes_told() {
        let culled = Culled { degenerate: 6, transparent: 4, ..Culled::default() };
        assert_eq!(
            why_empty(culled, 5, 2).as_deref(),
            Some("of 5 Gaussians 3 without rotation or extent, 2 transparent")
        );
        assert_eq!(why_empty(culled, 6, 2), None, "two are drawn");
    }
}
