//! How a 3D scene is rendered: as flags ask, otherwise as it was trained.

use clap::Args;
use gs_core::{
    Culled, RenderSettings, counted,
    effects::{Antialias, Background, Order},
};
use gs_io::{File3d, TrainedWith, dataset::Dataset};

use super::values::{Behind, Color, by_name, one_of, whole};
use crate::terminal::output;

/// The orders of 3D scenes.
pub(crate) const DEPTH_ORDERS: [Order; 2] = [Order::Global, Order::PerPixel];

/// The flags of commands that render a 3D scene.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "3D scenes")]
pub(crate) struct RenderArgs3d {
    /// Background colour: black, white, or R,G,B [default: black; white for a Blender data set]
    #[arg(long, value_name = "COLOUR", value_parser = Behind::solid)]
    pub(crate) background: Option<Behind>,
    /// Highest degree of spherical harmonics (SH), 0 to 3 [default: the scene's]
    #[arg(long, value_name = "D", value_parser = whole::<u8>(0..=3))]
    pub(crate) sh_degree: Option<u8>,
    /// Order of blending [default: as the file says, otherwise global]
    #[arg(long, value_parser = one_of(&DEPTH_ORDERS), value_name = "ORDER")]
    pub(crate) order: Option<Order>,
    /// Treatment of Gaussians narrower than a pixel [default: as the file says, otherwise dilate]
    #[arg(long, value_parser = by_name::<Antialias>(), value_name = "ANTIALIAS")]
    antialias: Option<Antialias>,
}

impl RenderArgs3d {
    /// Whether any of these flags is given.
    pub(crate) fn is_some(&self) -> bool {
        let Self { background, sh_degree, order, antialias } = self;
        background.is_some() || sh_degree.is_some() || order.is_some() || antialias.is_some()
    }

    /// How a scene was trained: as flags say, otherwise as its file does.
    pub(crate) fn trained_with(&self, file: TrainedWith) -> TrainedWith {
        TrainedWith::default().with(|s| {
            s.antialias = self.antialias.or(file.antialias);
            s.order = self.order.or(file.order);
            s.frame = file.frame;
        })
    }

    /// Notes on standard error that the antialiasing is a guess, if neither the file nor a flag
    /// names it.
    pub(crate) fn note_guess(&self, file: &File3d) {
        if self.trained_with(file.trained_with).antialias.is_none() {
            output::note(
                "note: the file does not say how the scene was antialiased in training; dilate, as in 3DGS, is assumed: \
                 --antialias names another",
            );
        }
    }

    /// The settings to render a scene with, beside a data set if there is one.
    pub(crate) fn settings(&self, file: &File3d, dataset: Option<&Dataset>) -> RenderSettings {
        let mut render = file.render_settings(dataset);
        let effects = &mut render.effects;
        effects.sh_degree = self.sh_degree.unwrap_or(effects.sh_degree);
        effects.order = self.order.unwrap_or(effects.order);
        effects.antialias = self.antialias.unwrap_or(effects.antialias);
        match self.background {
            Some(Behind::Solid(color)) => return render.on(color.0),
            Some(Behind::None) => render.effects.background = Background::None,
            None => {}
        }
        render
    }
}

/// The effects that a scene is rendered with, in the words of the flags.
pub(crate) fn describe(render: &RenderSettings) -> String {
    format!("{}, background {}", describe_scene(render), Color(render.background_color()))
}

/// [`describe`] without the background.
pub(crate) fn describe_scene(render: &RenderSettings) -> String {
    let effects = &render.effects;
    let (order, antialias) = (effects.order.name(), effects.antialias.name());
    format!("order {order}, antialias {antialias}, SH degree {}", effects.sh_degree)
}

/// Why nothing of a scene is in sight, if that is so. `culled` is the sum over `views` renderings.
pub(crate) fn why_empty(culled: Culled, gaussians: usize, views: usize) -> Option<String> {
    if culled.total() < gaussians as u64 * views as u64 {
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
        .map(|(count, cause)| format!("{} {cause}", u64::from(*count).div_ceil(views.max(1) as u64)))
        .collect();
    Some(format!("of {} {}", counted(gaussians, "Gaussian"), causes.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_picture_is_explained() {
        let culled = Culled { degenerate: 6, transparent: 4, ..Culled::default() };
        assert_eq!(
            why_empty(culled, 5, 2).as_deref(),
            Some("of 5 Gaussians 3 without rotation or extent, 2 transparent")
        );
        assert_eq!(why_empty(culled, 6, 2), None, "two are drawn");
    }
}
