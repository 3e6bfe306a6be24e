//! 2D scenes and canvases for tests: seeded generators, and proptest strategies.

use std::ops::Range;

use glam::{Vec2, Vec3};
use gs_core::{Canvas, Gaussian2d, RenderSettings, Scene2d, effects::Blend};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{Draw, blends, counts, sizes};

/// Kinds of scenes. Scales are standard deviations in px of the plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind2d {
    /// Scales 0.8 to 6 px, translucent.
    Typical,
    /// Scales 20 to 200 px: each covers the whole image.
    Large,
    /// Scales 0.25 to 0.6 px: many fall between pixel centres.
    Tiny,
    /// One scale 0.3 to 0.6 px, the other 10 to 30 times that.
    Needles,
    /// Typical, but most means lie outside the image.
    OffCanvas,
    /// Opacities 0.99 to 1, some logits +∞: the clamp of α and full pixels.
    Opaque,
    /// Scales 4 to 9 px, all means in the middle: many Gaussians at each pixel.
    Overlapping,
}

impl Kind2d {
    /// All kinds.
    pub const ALL: [Self; 7] =
        [Self::Typical, Self::Large, Self::Tiny, Self::Needles, Self::OffCanvas, Self::Opaque, Self::Overlapping];

    fn scales(self) -> Range<f32> {
        match self {
            Self::Typical | Self::OffCanvas | Self::Opaque => 0.8..6.0,
            Self::Large => 20.0..200.0,
            Self::Tiny => 0.25..0.6,
            Self::Needles => 0.3..0.6,
            Self::Overlapping => 4.0..9.0,
        }
    }
}

/// `count` Gaussians over a plane of `size` px, determined by the seed. Colours are 0 to 1 under
/// `Over`, −0.5 to 1 under `Sum`, where no opacities are stored.
pub fn scene(kind: Kind2d, blend: Blend, count: usize, size: Vec2, seed: u64) -> Scene2d {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut within = |range: Range<f32>| rng.random_range(range);
    (0..count)
        .map(|i| {
            let unit = Vec2::new(within(0.0..1.0), within(0.0..1.0));
            let mean = match kind {
                Kind2d::OffCanvas if i % 3 != 0 => size * (unit * 1.6 - 0.3),
                Kind2d::Overlapping => size * (0.35 + 0.3 * unit),
                _ => size * unit,
            };
            let log_scale = match kind {
                Kind2d::Needles => {
                    let short = within(kind.scales()).ln();
                    let long = short + within(10.0..30.0).ln();
                    if i % 2 == 0 { Vec2::new(long, short) } else { Vec2::new(short, long) }
                }
                _ => Vec2::new(within(kind.scales()).ln(), within(kind.scales()).ln()),
            };
            let opacity_logit = match kind {
                Kind2d::Opaque if i % 4 == 0 => f32::INFINITY,
                Kind2d::Opaque => within(4.6..9.0),
                _ => within(-2.0..2.0),
            };
            let darkest = if blend == Blend::Sum { -0.5 } else { 0.0 };
            Gaussian2d {
                mean,
                log_scale,
                rotation: within(-3.2..3.2),
                opacity_logit: if blend == Blend::Sum { f32::INFINITY } else { opacity_logit },
                color: Vec3::new(within(darkest..1.0), within(darkest..1.0), within(darkest..1.0)),
            }
        })
        .collect()
}

impl Draw<Scene2d> {
    /// A seeded scene of a kind, with a canvas of its own size.
    pub fn new(kind: Kind2d, blend: Blend, count: usize, size: (u32, u32), seed: u64) -> Self {
        let plane = Vec2::new(size.0 as f32, size.1 as f32);
        Self {
            kind,
            scene: scene(kind, blend, count, plane, seed),
            view: Canvas::new(size.0, size.1),
            settings: RenderSettings::blended(blend),
            target_seed: seed,
        }
    }
}

/// Every [`Kind2d`].
pub fn kinds() -> impl Strategy<Value = Kind2d> {
    proptest::sample::select(Kind2d::ALL.as_slice())
}

/// Canvases of up to 48 × 40 px: of the plane's own size, or a zoomed and
/// shifted part of it.
pub fn views() -> impl Strategy<Value = Canvas> {
    let own = sizes(48, 40).prop_map(|(w, h)| Canvas::new(w, h));
    let part = (own.clone(), -10.0f32..20.0, -10.0f32..20.0, 0.5f32..2.5, 0.5f32..2.5)
        .prop_map(|(own, x, y, zoom_x, zoom_y)| own.showing(Vec2::new(x, y), own.extent / Vec2::new(zoom_x, zoom_y)));
    prop_oneof![2 => own, 1 => part]
}

/// Scenes of up to 24 Gaussians within a view: both blends, with and without
/// background.
pub fn draws() -> impl Strategy<Value = Draw> {
    let background = proptest::option::of(proptest::array::uniform3(0.0f32..1.0));
    (kinds(), blends(), views(), counts(), any::<u64>(), background).prop_map(
        |(kind, blend, view, count, seed, background)| {
            let mut scene = scene(kind, blend, count, view.extent, seed);
            scene.means.iter_mut().for_each(|mean| *mean += view.origin);
            let settings = RenderSettings::blended(blend);
            let settings = background.map_or(settings, |color| settings.on(color));
            Draw { kind, scene, view, settings, target_seed: seed }
        },
    )
}

#[cfg(test)]
mod tests {
    use gs_core::Scene;

    use super::*;

    #[test]
    fn the_same_seed_draws_the_same_valid_scene() {
        for kind in Kind2d::ALL {
            for blend in [Blend::Sum, Blend::Over] {
                let draw = Draw::new(kind, blend, 20, (40, 30), 7);
                draw.scene.validate().unwrap();
                assert_eq!(draw.scene.len(), 20);
                assert_eq!(draw, Draw::new(kind, blend, 20, (40, 30), 7));
                assert_ne!(draw.scene, Draw::new(kind, blend, 20, (40, 30), 8).scene);
                assert_eq!(draw.scene.has_opacity(), blend == Blend::Over);
            }
        }
    }
}
