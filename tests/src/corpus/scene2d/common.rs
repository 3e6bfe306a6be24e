//! What 2D hard cases have in common.

use glam::{Vec2, Vec3};
use gs_core::{Canvas, Gaussian2d, RenderSettings, Scene2d, effects::Blend};

use crate::corpus::case::{Case, Source};

/// Both blends, whose kernels have nothing in common.
pub(super) const BLENDS: [Blend; 2] = [Blend::Sum, Blend::Over];

/// An image of neither whole tiles nor whole vectors.
pub(super) const VIEW: (u32, u32) = (24, 19);

/// A half-opaque Gaussian in the middle of the image, 3 px by 2 px.
pub(super) const PLAIN: Gaussian2d = Gaussian2d {
    mean: Vec2::new(11.3, 9.6),
    log_scale: Vec2::new(1.1, 0.7),
    rotation: 0.4,
    opacity_logit: 0.3,
    color: Vec3::new(0.7, 0.4, 0.9),
};

/// Makes a scene of these Gaussians, without opacities under `Sum`.
pub(super) fn scene(blend: Blend, gaussians: impl IntoIterator<Item = Gaussian2d>) -> Scene2d {
    let opaque = |g: Gaussian2d| match blend {
        Blend::Sum => Gaussian2d { opacity_logit: f32::INFINITY, ..g },
        Blend::Over => g,
    };
    gaussians.into_iter().map(opaque).collect()
}

/// A case with [`VIEW`] and a background that is not black.
pub(super) fn case(
    name: impl std::fmt::Display,
    why: &'static str,
    source: Source,
    blend: Blend,
    gaussians: impl IntoIterator<Item = Gaussian2d>,
) -> Case<Scene2d> {
    let settings = RenderSettings::blended(blend).on([0.2, 0.3, 0.1]);
    let name = format!("{name}, {}", named(blend));
    Case::new(name, why, source, scene(blend, gaussians), Canvas::new(VIEW.0, VIEW.1), settings)
}

/// A blend in the name of a case.
pub(super) fn named(blend: Blend) -> &'static str {
    match blend {
        Blend::Sum => "sum",
        Blend::Over => "over",
    }
}
