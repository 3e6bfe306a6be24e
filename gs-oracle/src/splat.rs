//! What the oracle must know about a kind of view: how one Gaussian looks through it, in `f64`, and how that depends on its parameters. The
//! rest, pixels, losses and statistics, is the same for all kinds.

use std::fmt::Debug;

use gs_core::{Error, RenderSettings, effects::Order, statistics::Cause};

use super::rounded::Rounded;
use crate::ROUNDINGS;

/// What one Gaussian is on the image, or what there is once for each of that: five numbers of its shape, which of them
/// [`Exponent::derivatives`] says, then its opacity ([`Appearance::opacity_slope`]), red, green, blue.
pub(crate) type Share = [f64; 9];

/// Index of the opacity in a [`Share`].
pub(crate) const OPACITY_SHARE: usize = 5;
/// Index of red in a [`Share`]; green and blue follow.
pub(crate) const COLOR_SHARE: usize = 6;

/// What the oracle looks through.
pub trait OracleView: Copy + Debug + Send + Sync {
    /// One Gaussian as it is seen.
    type Splat: Splat + Send + Sync;

    /// Fails for an impossible view, and for effects that the oracle does not have for this kind of view.
    ///
    /// # Errors
    /// [`Error::Size`], [`Error::Setting`] or [`Error::Unsupported`].
    fn check(&self, settings: &RenderSettings) -> Result<(), Error>;

    /// Columns and rows of the image.
    fn size(&self) -> (u32, u32);

    /// Normalised device units per unit of the first two numbers of a share, along x and y.
    fn device_units(&self) -> [f64; 2];

    /// What the guards make of a Gaussian, whose parameters are a row of [`OracleScene`](super::OracleScene).
    fn project(&self, gaussian: &[f64], settings: &RenderSettings, lean: Lean) -> Projection<Self::Splat>;
}

/// What the guards make of a Gaussian.
#[derive(Debug, Clone, PartialEq)]
pub enum Projection<T> {
    /// It can be drawn.
    Drawable(T),
    /// It cannot, because.
    Left(Cause),
}

/// A Gaussian that can be drawn.
pub trait Splat: Debug + Clone {
    /// σ at the pixel centre `p`.
    fn exponent(&self, p: [f64; 2]) -> Exponent;

    /// σ at the pixel centre `p`, and nothing of its derivatives.
    fn sigma(&self, p: [f64; 2]) -> f64;

    /// What does not depend on the pixel.
    fn appearance(&self) -> &Appearance;

    /// What it is ordered by at the pixel centre `p`.
    fn depth(&self, p: [f64; 2], order: Order) -> Depth;

    /// ∂(share)/∂(parameters): a row for each parameter.
    fn jacobian(&self) -> Vec<[Rounded; 9]>;
}

/// σ of a Gaussian at a pixel, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exponent {
    /// σ = ½ dᵀ Σ′⁻¹ d.
    pub sigma: f64,
    /// What evaluating σ in `f32` by its textbook formula may change it by.
    pub rounding: f64,
    /// ∂σ/∂(the five numbers of the shape).
    pub derivatives: [f64; 5],
    /// What `f32` may change each by on its own.
    pub derivative_rounding: [f64; 5],
    /// What an uncertain centre changes all of them by together, along x and along y.
    pub displaced: [[f64; 5]; 2],
}

/// What a Gaussian has to show, the same at every pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Appearance {
    /// o, with antialiasing's compensation.
    pub opacity: f64,
    /// What `f32` may change it by, relative.
    pub opacity_rounding: f64,
    /// ∂o/∂(what stands for the opacity in a share).
    pub opacity_slope: f64,
    /// RGB.
    pub color: [f64; 3],
    /// What `f32` may change the colour by.
    pub color_rounding: [f64; 3],
    /// Whether a guard that let it through, or nearly did not, is within rounding.
    pub undecided: bool,
}

/// A depth at a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Depth {
    /// The depth; smaller is in front.
    pub value: f64,
    /// What `f32` may change it by.
    pub rounding: f64,
    /// All that it was computed from: of equal origins, depths are equal however they are computed.
    pub origin: [f64; 8],
}

impl Depth {
    /// Whether rounding may put two depths in either order.
    pub(crate) fn is_tied_with(&self, other: &Self) -> bool {
        let band = ROUNDINGS * (self.rounding + other.rounding);
        band > 0.0 && (self.value - other.value).abs() <= band && self.origin != other.origin
    }
}

/// To which side decisions fall that are within rounding of their threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lean {
    /// As `f64` has it.
    Exact,
    /// Whatever nearly counts, counts.
    More,
    /// Whatever nearly does not count, does not.
    Fewer,
}

impl Lean {
    /// Whether `value` reaches `threshold`, give or take a relative `band`.
    pub(crate) fn reaches(self, value: f64, threshold: f64, band: f64) -> bool {
        match self {
            Self::Exact => value >= threshold,
            Self::More => value * (1.0 + band) >= threshold,
            Self::Fewer => value * (1.0 - band) >= threshold,
        }
    }
}
