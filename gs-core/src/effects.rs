//! Which effects a rendering simulates. An effect that is off costs nothing: backends turn an [`Effects`] value into a
//! type or a pipeline, never into a branch per pixel. Which ones a scene calls for says [`Effects::called_for`].

pub mod called_for;
mod effect;
pub mod written;

use serde::{Deserialize, Serialize};

pub use self::{called_for::CalledFor, effect::Effect};
use crate::constants::{DILATION_PX2, MIP_DILATION_PX2};

/// In which order Gaussians are blended at a pixel. Matters under [`Blend::Over`] only.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// By their index in the scene, the first in front: all that a 2D scene can need.
    #[default]
    Index,
    /// By one depth per Gaussian, that of its mean (3DGS, paper §2.3.1); ties by index. 3D scenes.
    #[serde(alias = "tile-depth")]
    Global,
    /// By their depth along each pixel's ray, ties by index: no popping (paper §5.4). A Gaussian's depth there is the mean of z given that the
    /// ray goes through the pixel (`perspective::Projection::depth_slope`). 3D scenes.
    #[serde(alias = "pixel-depth")]
    PerPixel,
}

/// How the Gaussians at a pixel become its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Blend {
    /// C = Σ wᵢ cᵢ: order-free, no opacity (*source:* GaussianImage, ECCV 2024). Colours may be negative.
    Sum,
    /// C = Σ cᵢ αᵢ Π_{j<i} (1 − αⱼ), front to back (*source:* paper eq. 2).
    #[default]
    Over,
}

/// What is done about Gaussians narrower than a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Antialias {
    /// Nothing.
    #[default]
    None,
    /// Σ′ + 0.3 px² · I (3DGS).
    Dilate,
    /// Σ′ + 0.1 px² · I with the opacity scaled by √(det Σ′ / det(Σ′ + 0.1 I)) (Mip-Splatting). Under [`Blend::Sum`], which has no
    /// opacity, nothing is scaled.
    Mip,
    /// As [`Self::Mip`], but with 0.3 px² (gsplat's `antialiased`, which Nerfstudio, PlayCanvas and others also have).
    Compensated,
}

/// What is behind the last Gaussian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// Black.
    #[default]
    None,
    /// [`RenderSettings::background`](crate::settings::RenderSettings::background), seen through what transmittance is left.
    /// Under [`Blend::Sum`], which has no transmittance, it is added to every pixel.
    Solid,
}

/// What a forward pass yields besides colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outputs {
    /// Colour only.
    #[default]
    Color,
    /// Colour and alpha = 1 − the transmittance left.
    ColorAlpha,
    /// Colour, alpha and expected depth. 3D scenes.
    ColorAlphaDepth,
}

/// Correction of a view's exposure, while training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Exposure {
    /// None.
    #[default]
    None,
    /// An affine map of the colour per view.
    AffinePerView,
}

/// How rays bend. 3D scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Lens {
    /// They don't.
    #[default]
    Pinhole,
    /// By the coefficients of the data set's camera.
    Distorted,
}

/// What a training step collects per Gaussian for the density policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Statistics {
    /// Nothing.
    #[default]
    None,
    /// ‖∂L/∂μ′‖ in normalised device units (3DGS; paper §2.2.2).
    MeanGradient,
    /// ‖Σ |∂L/∂μ′ through one pixel|‖ in normalised device units (*source:* AbsGS, Ye et al. 2024). With μ′ = (u, v) in px of the canvas
    /// of W×H px: each pixel p has a share ∂L/∂C(p) · ∂C(p)/∂(u, v) in ∂L/∂(u, v); their magnitudes are summed over the pixels, axis by
    /// axis, and the statistic is ‖(Σ|share u| · W/2, Σ|share v| · H/2)‖. In the mean gradient, the shares of two sides of a large Gaussian
    /// that is pulled both ways cancel; here they do not, so that it is never below the mean gradient.
    AbsoluteGradient,
    /// Σ T α e over the pixels, px (*source:* Rota Bulò et al. 2024, with the absolute difference for their auxiliary error): the
    /// share of the picture's error that falls to a Gaussian. e = the mean of |C − Y| over the three channels, whatever the loss; T α is
    /// what the pixel shows of the Gaussian, under [`Blend::Sum`] its cut weight w.
    PixelError,
}

impl Order {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Index, Self::Global, Self::PerPixel];

    /// The order of this name; `None` where there is none.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|order| order.name() == name)
    }

    /// As settings files and flags have it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Index => "index",
            Self::Global => "global",
            Self::PerPixel => "per-pixel",
        }
    }
}

impl Blend {
    /// As settings files and flags have it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sum => "sum",
            Self::Over => "over",
        }
    }
}

impl Antialias {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::None, Self::Dilate, Self::Mip, Self::Compensated];

    /// The treatment of this name; `None` where there is none.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|antialias| antialias.name() == name)
    }

    /// As settings files and flags have it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Dilate => "dilate",
            Self::Mip => "mip",
            Self::Compensated => "compensated",
        }
    }

    /// What is added to the diagonal of Σ′, px².
    pub fn dilation(self) -> f32 {
        match self {
            Self::None => 0.0,
            Self::Dilate | Self::Compensated => DILATION_PX2,
            Self::Mip => MIP_DILATION_PX2,
        }
    }

    /// Whether the opacity is scaled by ρ = √(det Σ′ before dilation / det Σ′ after), so that a widened Gaussian adds as much light.
    pub const fn compensates(self) -> bool {
        matches!(self, Self::Mip | Self::Compensated)
    }
}

impl Background {
    /// As settings files and flags have it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Solid => "solid",
        }
    }
}

/// The effects of a rendering, together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Effects {
    /// Order of blending.
    pub order: Order,
    /// Kind of blending.
    pub blend: Blend,
    /// Highest degree of spherical harmonics that is evaluated, 0 to 3. 3D scenes.
    pub sh_degree: u8,
    /// Treatment of sub-pixel Gaussians.
    pub antialias: Antialias,
    /// What is behind.
    pub background: Background,
    /// What a forward pass yields.
    pub outputs: Outputs,
    /// Exposure correction.
    pub exposure: Exposure,
    /// Lens model.
    pub lens: Lens,
    /// Statistics collected in training.
    pub statistics: Statistics,
}
