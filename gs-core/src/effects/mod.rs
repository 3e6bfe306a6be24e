//! The effects that a rendering simulates, and which of them a scene requires
//! ([`Effects::required`]).
//!
//! An effect that is off costs nothing: backends turn an [`Effects`] value into a type or a
//! pipeline, never into a branch per pixel. [`Order`], [`Blend`], [`Antialias`], [`Background`] and
//! [`Statistics`] are exhaustive on purpose: every backend must handle each value, and the compiler
//! finds the places that a new one concerns.

mod effect;
mod required;

use serde::{Deserialize, Serialize};

pub use self::{
    effect::Effect,
    required::{EffectDecision, RequiredEffects, Requirement, RequiresEffects},
};
use crate::constants::{DILATION_PX2, MIP_DILATION_PX2};

crate::choices! {
    /// Order in which Gaussians are blended at a pixel. It matters under [`Blend::Over`] only.
    #[derive(Default)]
    pub enum Order {
        /// Order by index in the scene, the first in front. No other order is needed in 2D scenes.
        #[default]
        Index = "index": "By index in the scene",
        /// Order by one depth per Gaussian, that of its mean (3DGS, paper §2.3.1); ties by index. 3D
        /// scenes.
        Global = "global": "By the depth of the means (3DGS)",
        /// Order by depth along each pixel's ray, ties by index: no popping (paper §5.4). A Gaussian's
        /// depth at a pixel is the mean of z given that the ray goes through the pixel
        /// ([`Projection::depth_slope`]). 3D scenes.
        ///
        /// [`Projection::depth_slope`]: crate::math::perspective::Projection::depth_slope
        PerPixel = "per-pixel": "By the depth at each pixel: no popping, slower",
    }
}

crate::choices! {
    /// How the Gaussians at a pixel are combined into its colour.
    #[derive(Default)]
    pub enum Blend {
        /// C = Σ wᵢ cᵢ: order-free, no opacity (*source:* GaussianImage, ECCV 2024). Colours may be
        /// negative.
        Sum = "sum": "Sum without order or opacity; fastest",
        /// C = Σ cᵢ αᵢ Π_{j<i} (1 − αⱼ), front to back (*source:* paper eq. 2).
        #[default]
        Over = "over": "Front to back with opacities, as in splat viewers",
    }
}

crate::choices! {
    /// Treatment of Gaussians narrower than a pixel.
    #[derive(Default)]
    pub enum Antialias {
        /// Nothing.
        #[default]
        None = "none": "No treatment",
        /// Σ′ + 0.3 px² · I (3DGS).
        Dilate = "dilate": "Widen by 0.3 px² (3DGS)",
        /// Σ′ + 0.1 px² · I with the opacity scaled by √(det Σ′ / det(Σ′ + 0.1 I)) (Mip-Splatting).
        /// Under [`Blend::Sum`], which has no opacity, nothing is scaled.
        Mip = "mip": "Widen by 0.1 px² and fade accordingly (Mip-Splatting)",
        /// [`Self::Mip`] with 0.3 px² (gsplat's `antialiased`, also offered by Nerfstudio, PlayCanvas
        /// and others).
        Compensated = "compensated": "Widen by 0.3 px² and fade accordingly (`antialiased` in gsplat and Nerfstudio)",
    }
}

crate::choices! {
    /// Background behind the last Gaussian.
    #[derive(Default)]
    pub enum Background {
        /// Black.
        #[default]
        None = "none",
        /// The colour [`RenderSettings::background`](crate::RenderSettings::background), weighted by
        /// the transmittance that is left. Under [`Blend::Sum`], which has no transmittance, it is
        /// added to every pixel.
        Solid = "solid",
    }
}

crate::choices! {
    /// Statistic that a training step collects per Gaussian for the density policy.
    #[derive(Default)]
    pub enum Statistics {
        /// Nothing.
        #[default]
        None = "none",
        /// ‖∂L/∂μ′‖ in normalised device units (3DGS; paper §2.2.2).
        MeanGradient = "mean-gradient",
        /// ‖Σ |∂L/∂μ′ through one pixel|‖ in normalised device units (*source:* AbsGS, Ye et al. 2024).
        ///
        /// With μ′ = (u, v) in px of a canvas of W×H px, each pixel p contributes ∂L/∂C(p) · ∂C(p)/∂(u,
        /// v) to ∂L/∂(u, v). The magnitudes of these contributions are summed over the pixels, axis by
        /// axis, and the statistic is ‖(Σ|u part| · W/2, Σ|v part| · H/2)‖. In the mean gradient, the
        /// contributions of two sides of a large Gaussian that is pulled both ways cancel; here they do
        /// not, so it is never below the mean gradient.
        AbsoluteGradient = "absolute-gradient",
        /// m f ‖∂L/∂μ′‖ in normalised device units times px, weighted by m: the pixel-aware gradient
        /// (*source:* Pixel-GS, Zhang et al. 2024, arXiv 2403.15530).
        ///
        /// m is the number of pixels in which the Gaussian is blended. f, between 0 and 1, lets the
        /// gradients of near Gaussians fade: see
        /// [`RenderSettings::statistic_weight`](crate::RenderSettings::statistic_weight). Σ m f
        /// ‖∂L/∂μ′‖ / Σ m over the steps is a mean in which views that show only the edge of a large
        /// Gaussian count little.
        PixelGradient = "pixel-gradient",
        /// Σ T α e over the pixels, px: the part of the image's error that falls to a Gaussian
        /// (*source:* Rota Bulò et al. 2024, with the absolute difference for their auxiliary error).
        ///
        /// e is the mean of |C − Y| over the three channels, whatever the loss. T α is the Gaussian's
        /// share of the pixel; under [`Blend::Sum`] it is the cut weight w.
        PixelError = "pixel-error",
    }
}

impl Antialias {
    /// Variance that is added to the diagonal of Σ′, px².
    pub fn dilation(self) -> f32 {
        match self {
            Self::None => 0.0,
            Self::Dilate | Self::Compensated => DILATION_PX2,
            Self::Mip => MIP_DILATION_PX2,
        }
    }

    /// Whether the opacity is scaled by ρ = √(det Σ′ before dilation / det Σ′ after), so that a
    /// widened Gaussian adds as much light as before.
    pub const fn compensates(self) -> bool {
        matches!(self, Self::Mip | Self::Compensated)
    }
}

/// The effects of a rendering. Exhaustive: a backend must handle or refuse each field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Effects {
    /// Order of blending.
    pub order: Order,
    /// Kind of blending.
    pub blend: Blend,
    /// Highest SH degree that is evaluated, 0 to 3. 3D scenes.
    pub sh_degree: u8,
    /// Treatment of sub-pixel Gaussians.
    pub antialias: Antialias,
    /// Background.
    pub background: Background,
    /// Statistic collected in training.
    pub statistics: Statistics,
}
