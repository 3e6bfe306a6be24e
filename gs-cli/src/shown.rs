//! How a scene in space is shown: what its files do not say.

use clap::Args;
use gs_core::{
    Blend, RenderSettings, SpatialScene,
    effects::{Antialias, Order},
};

use crate::{
    train::{AntialiasName, OrderName},
    values::Color,
};

/// The flags of commands that show a scene in space.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Scenes in space")]
pub(crate) struct ShownArgs {
    /// The colour behind: black, white, or R,G,B [default: black; of a Blender data set white]
    #[arg(long, value_name = "COLOUR")]
    background: Option<Color>,
    /// Highest degree of the spherical harmonics, 0 to 3 [default: the scene's]
    #[arg(long, value_name = "D", value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: Option<u8>,
    /// In which order Gaussians are blended [default: tile-depth]
    #[arg(long, value_enum, value_name = "ORDER")]
    order: Option<OrderName>,
    /// What is done about Gaussians narrower than a pixel [default: dilate]
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

    /// How the scene is shown; before black, if nothing else is asked for.
    pub(crate) fn settings(&self, scene: &SpatialScene) -> RenderSettings {
        let mut render = RenderSettings::blended(Blend::Over).on(self.background.map_or([0.0; 3], |color| color.0));
        render.effects.sh_degree = self.sh_degree.unwrap_or(scene.sh_degree);
        render.effects.order = self.order.map_or(Order::TileDepth, Into::into);
        render.effects.antialias = self.antialias.map_or(Antialias::Dilate, Into::into);
        render
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
    pub(crate) fn settings_beside(&self, scene: &SpatialScene, dataset: &gs_io::dataset::Dataset) -> RenderSettings {
        let render = self.settings(scene);
        match self.background {
            None => render.on(crate::train::usual_background(dataset)),
            Some(_) => render,
        }
    }
}
