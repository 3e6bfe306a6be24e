//! How a scene was trained, as far as its file says, so that it can be rendered in the same way.
//!
//! | format | antialiasing | order of blending | frame |
//! |---|---|---|---|
//! | PLY, compressed PLY | comment `gs antialias: NAME`; read as well: `SplatRenderMode: mip` or `default` (Brush, PlayCanvas), `antialiased 1` or `0` (Postshot) | comment `gs order: NAME` | comment `gs frame: origin X Y Z unit U` |
//! | SPZ | flag 1 | – | – |
//! | glTF, 3D Tiles | `extras.gs.antialias` of the primitive | `extras.gs.order` of the primitive | `extras.gs.frame` of the primitive |
//! | SOG, streamed SOG | `antialias` | – | – |
//! | `.splat`, `.ksplat` | – | – | – |
//!
//! SPZ's flag is documented as "antialiased mode (mip splatting)", so it is read as
//! [`Antialias::Mip`]; a file without it is meant for the rendering of 3DGS, [`Antialias::Dilate`].

use gs_core::{
    Blend, Choice as _, RenderSettings,
    effects::{Antialias, Order},
};
use serde::Deserialize;
use serde_json::{Value, json};

use super::conversion_loss::ConversionLoss;
use crate::WorldFrame;

/// The start of our PLY comments, and the key in a glTF's extras.
const OURS: &str = "gs";

/// How a scene was trained, and where it is in the world; `None` where that is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct TrainedWith {
    /// The treatment of Gaussians narrower than a pixel.
    pub antialias: Option<Antialias>,
    /// The sort order of blending.
    pub order: Option<Order>,
    /// The frame of the scene's coordinates; the world itself where a file says nothing.
    pub frame: WorldFrame,
}

gs_core::impl_with!(TrainedWith);

impl TrainedWith {
    /// What other viewers assume by default: the rendering of 3DGS.
    const USUAL: (Antialias, Order) = (Antialias::Dilate, Order::Global);

    /// The settings to render a scene of this SH degree with, before this background: completed by
    /// what 3DGS uses.
    pub fn render_settings(&self, sh_degree: u8, background: [f32; 3]) -> RenderSettings {
        let mut render = RenderSettings::blended(Blend::Over).on(background);
        render.effects.sh_degree = sh_degree;
        render.effects.antialias = self.antialias.unwrap_or(Self::USUAL.0);
        render.effects.order = self.order.unwrap_or(Self::USUAL.1);
        render
    }

    /// Antialiasing and order, as far as they are known.
    pub(crate) fn in_words(&self) -> String {
        let antialias = self.antialias.map(|antialias| format!("antialias {}", antialias.name()));
        let order = self.order.map(|order| format!("order {}", order.name()));
        antialias.into_iter().chain(order).collect::<Vec<_>>().join(", ")
    }

    /// The PLY comments that store it. Brush and PlayCanvas know only `mip` and `default`, so `mip`
    /// stands for scaled opacities.
    pub(crate) fn comments(&self) -> Vec<String> {
        let mode = self.antialias.and_then(|antialias| match antialias {
            Antialias::None => None,
            Antialias::Dilate => Some("SplatRenderMode: default".to_owned()),
            Antialias::Mip | Antialias::Compensated => Some("SplatRenderMode: mip".to_owned()),
        });
        let antialias = self.antialias.map(|antialias| format!("{OURS} antialias: {}", antialias.name()));
        let order = self.order.map(|order| format!("{OURS} order: {}", order.name()));
        let frame = (!self.frame.is_world()).then(|| format!("{OURS} frame: {}", self.frame.to_words()));
        mode.into_iter().chain(antialias).chain(order).chain(frame).collect()
    }

    /// Reads PLY comments. Ours take precedence over those of other programs, which say less;
    /// otherwise the last counts.
    pub(crate) fn of_comments<'a>(comments: impl IntoIterator<Item = &'a str>) -> Self {
        let (mut ours, mut others) = (Self::default(), None);
        for comment in comments {
            let comment = comment.to_lowercase();
            match comment.split_ascii_whitespace().collect::<Vec<_>>().as_slice() {
                [OURS, "antialias:", name] => ours.antialias = Antialias::from_name(name).or(ours.antialias),
                [OURS, "order:", name] => ours.order = Order::from_name(name).or(ours.order),
                [OURS, "frame:", words @ ..] => ours.frame = WorldFrame::of_words(words).unwrap_or(ours.frame),
                ["splatrendermode:", "mip"] | ["antialiased", "1"] => others = Some(Antialias::Mip),
                ["splatrendermode:", "default"] | ["antialiased", "0"] => others = Some(Antialias::Dilate),
                _ => {}
            }
        }
        Self { antialias: ours.antialias.or(others), ..ours }
    }

    /// The meaning of SPZ's flag.
    pub(crate) fn of_spz_flag(antialiased: bool) -> Self {
        Self { antialias: Some(if antialiased { Antialias::Mip } else { Antialias::Dilate }), ..Self::default() }
    }

    /// SPZ's flag.
    pub(crate) fn spz_flag(&self) -> bool {
        self.antialias.is_some_and(Antialias::compensates)
    }

    /// The extras of a glTF's primitive; `None` if nothing is known.
    pub(crate) fn extras(&self) -> Option<Value> {
        let mut said = serde_json::Map::new();
        said.extend(self.antialias.map(|antialias| ("antialias".to_owned(), json!(antialias.name()))));
        said.extend(self.order.map(|order| ("order".to_owned(), json!(order.name()))));
        said.extend((!self.frame.is_world()).then(|| ("frame".to_owned(), json!(self.frame))));
        (!said.is_empty()).then(|| json!({ OURS: said }))
    }

    /// Reads the extras of a glTF's primitive.
    pub(crate) fn of_extras(extras: &Value) -> Self {
        let name = |key: &str| extras[OURS][key].as_str();
        let frame = WorldFrame::deserialize(&extras[OURS]["frame"]).ok().filter(WorldFrame::is_valid);
        Self {
            antialias: name("antialias").and_then(Antialias::from_name),
            order: name("order").and_then(Order::from_name),
            frame: frame.unwrap_or_default(),
        }
    }

    /// What two values agree on.
    pub(crate) fn in_common(self, other: Self) -> Self {
        Self {
            antialias: self.antialias.filter(|_| self.antialias == other.antialias),
            order: self.order.filter(|_| self.order == other.order),
            frame: if self.frame == other.frame { self.frame } else { WorldFrame::WORLD },
        }
    }

    /// What is lost if a file's reader knows only `kept` and assumes the usual for the rest.
    pub(crate) fn lost(&self, kept: &Self) -> impl Iterator<Item = ConversionLoss> {
        let (antialias, order) = Self::USUAL;
        let antialias = self.antialias.filter(|&known| known != kept.antialias.unwrap_or(antialias));
        let order = self.order.filter(|&known| known != kept.order.unwrap_or(order));
        let shown = Self { antialias, order, ..Self::default() };
        let shown = (antialias.is_some() || order.is_some()).then_some(ConversionLoss::TrainedWith(shown));
        let frame = (self.frame != kept.frame).then_some(ConversionLoss::Frame(self.frame));
        shown.into_iter().chain(frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_extras_say_what_was_said() {
        let frame = WorldFrame { origin: glam::DVec3::new(4.5e6, -0.1, 3.0), unit: 100.0 };
        let orders = [None, Some(Order::Global), Some(Order::PerPixel)];
        let antialiases = Antialias::ALL.map(Some).into_iter().chain([None]);
        for (antialias, order) in antialiases.flat_map(|antialias| orders.map(|order| (antialias, order))) {
            let said = TrainedWith { antialias, order, frame: if order.is_some() { frame } else { WorldFrame::WORLD } };
            let comments = said.comments();
            assert_eq!(TrainedWith::of_comments(comments.iter().map(String::as_str)), said);
            assert_eq!(TrainedWith::of_extras(&said.extras().unwrap_or_default()), said);
        }
        assert_eq!(TrainedWith::of_extras(&json!([{ "gs": 3 }])), TrainedWith::default());
    }

    #[test]
    fn comments_of_other_programs_are_understood() {
        let read = |comments: &[&str]| TrainedWith::of_comments(comments.iter().copied()).antialias;
        assert_eq!(read(&["Exported from Brush", "SplatRenderMode: mip"]), Some(Antialias::Mip));
        assert_eq!(read(&["splatrendermode:  DEFAULT "]), Some(Antialias::Dilate));
        assert_eq!(read(&["antialiased 0", "antialiased 1"]), Some(Antialias::Mip));
        assert_eq!(read(&["gs antialias: compensated", "SplatRenderMode: default"]), Some(Antialias::Compensated));
        assert_eq!(read(&["SplatRenderMode: 2dgs", "gs antialias: sparkling", "antialiased"]), None);
    }

    #[test]
    fn settings_readers_assume_by_default_are_not_lost() {
        let lost = |antialias, order, kept: TrainedWith| {
            TrainedWith { antialias: Some(antialias), order, ..TrainedWith::default() }.lost(&kept).next()
        };
        let nothing = TrainedWith::default();
        assert_eq!(lost(Antialias::Dilate, Some(Order::Global), nothing), None);
        assert_eq!(lost(Antialias::Mip, None, TrainedWith::of_spz_flag(true)), None);
        let compensated = lost(Antialias::Compensated, Some(Order::PerPixel), TrainedWith::of_spz_flag(true));
        let expected = TrainedWith { antialias: Some(Antialias::Compensated), order: Some(Order::PerPixel), ..nothing };
        assert_eq!(compensated, Some(ConversionLoss::TrainedWith(expected)));
    }
}
