//! Initialisers: place, size and colour of the first Gaussians.

mod guided;
mod scattered;

use glam::Vec3;
use gs_core::{Blend, Error, Gaussian2d, Image, Scene2d, logit};
use gs_density::Rng;
use serde::{Deserialize, Serialize};

pub use guided::Guided;
pub use scattered::{Colors, Periphery, Random};

/// Opacity of the first Gaussians under [`Blend::Over`]: high enough that each counts, low enough
/// that the logit's gradient o (1 − o) is near its largest and Gaussians behind are visible. The
/// paper gives none.
const INITIAL_OPACITY: f32 = 0.7;

/// An initialiser. The `opacity` of each is used under [`Blend::Over`] only; scenes for
/// [`Blend::Sum`] have no opacities.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Init {
    /// Large Gaussians anywhere: the paper's experiment (§3.4).
    Random(Random),
    /// Small Gaussians along the border of the image: the paper's cold start (Fig. 9).
    Periphery(Periphery),
    /// Density by the magnitude of the gradient of luminance.
    Gradient(Guided),
}

gs_core::choices! {
    /// The kind of an [`Init`], as `kind` in a settings file.
    pub enum InitKind {
        /// [`Init::Random`].
        Random = "random": "Anywhere, large",
        /// [`Init::Periphery`].
        Periphery = "periphery": "Along the border of the image",
        /// [`Init::Gradient`].
        Gradient = "gradient": "At the edges of the image",
    }
}

impl Default for Init {
    fn default() -> Self {
        Self::Gradient(Guided::default())
    }
}

impl Init {
    /// The initialiser of this kind with its default settings for this blending. Under [`Blend::Sum`],
    /// random Gaussians have the target's colours.
    pub fn of_kind(kind: InitKind, blend: Blend) -> Self {
        let colors = match blend {
            Blend::Sum => Colors::Target,
            Blend::Over => Colors::Random,
        };
        match kind {
            InitKind::Random => Self::Random(Random { colors, ..Random::default() }),
            InitKind::Periphery => Self::Periphery(Periphery { colors, ..Periphery::default() }),
            InitKind::Gradient => Self::Gradient(Guided::default()),
        }
    }

    /// A scene of `count` Gaussians for `target`. Equal random numbers give an equal scene, for any
    /// number of threads.
    ///
    /// Under [`Blend::Sum`] the scene has no opacities, and colours from the target are divided by
    /// how many times the Gaussians cover the plane, so that their sum is near the target. Under
    /// [`Blend::Over`] colours are the target's; where sizes differ ([`Init::Gradient`]), the smallest
    /// Gaussians are in front.
    pub fn scene(&self, target: &Image, count: usize, blend: Blend, rng: &mut Rng) -> Scene2d {
        let mut gaussians = match self {
            Self::Random(random) => random.gaussians(target, count, blend, rng),
            Self::Periphery(periphery) => periphery.gaussians(target, count, blend, rng),
            Self::Gradient(guided) => guided.gaussians(target, count, blend, rng),
        };
        if blend == Blend::Over {
            gaussians.sort_by(|a, b| a.log_scale.element_sum().total_cmp(&b.log_scale.element_sum()));
        }
        gaussians.into_iter().collect()
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first value outside its range.
    pub(crate) fn validate(&self) -> Result<(), Error> {
        let opacity = match self {
            Self::Random(random) => {
                positive("the initial scale", random.scale_px)?;
                random.opacity
            }
            Self::Periphery(periphery) => {
                positive("the initial scale", periphery.scale_px)?;
                periphery.opacity
            }
            Self::Gradient(guided) => {
                guided.validate()?;
                guided.opacity
            }
        };
        Error::within("the initial opacity", opacity, f32::MIN_POSITIVE..1.0, "above 0 and below 1")
    }
}

fn positive(what: &'static str, value: f32) -> Result<(), Error> {
    Error::within(what, value, f32::MIN_POSITIVE..=f32::MAX, "positive and finite")
}

/// The opacity logit in a scene for this blending: that of `opacity`, or +∞ for none.
fn opacity_logit(blend: Blend, opacity: f32) -> f32 {
    match blend {
        Blend::Sum => f32::INFINITY,
        Blend::Over => logit(opacity),
    }
}

/// The target's colour, divided under `Sum` by how many times Gaussians of this σ cover the plane:
/// 2πσ² · `per_px2`, where `per_px2` is their number per square pixel.
fn shared_color(color: Vec3, blend: Blend, sigma: f32, per_px2: f32) -> Vec3 {
    match blend {
        Blend::Sum => color / (std::f32::consts::TAU * sigma * sigma * per_px2).max(1.0),
        Blend::Over => color,
    }
}

/// A round Gaussian.
fn round(mean: glam::Vec2, sigma: f32, opacity_logit: f32, color: Vec3) -> Gaussian2d {
    Gaussian2d { mean, log_scale: glam::Vec2::splat(sigma.ln()), rotation: 0.0, opacity_logit, color }
}

#[cfg(test)]
mod tests;
