//! The interface of a view: the projection of one Gaussian in `f64`, and its derivatives. Pixels,
//! losses and statistics are the same for all views.

use std::fmt::Debug;

use gs_core::{CullCause, Error, RenderSettings, effects::Order};

use super::rounded::Rounded;
use crate::ROUNDINGS;

/// The numbers of one projected Gaussian, or derivatives by them: five of its shape as in
/// [`Exponent::derivatives`], then opacity ([`Appearance::opacity_slope`]), red, green, blue.
pub(crate) type Share = [f64; 9];

/// Index of the opacity in a [`Share`].
pub(crate) const OPACITY_SHARE: usize = 5;
/// Index of red in a [`Share`]; green and blue follow.
pub(crate) const COLOR_SHARE: usize = 6;

/// A canvas or a camera.
pub trait OracleView: Debug + Send + Sync + 'static {
    /// Whether Gaussians have depths.
    fn has_depth(&self) -> bool;

    /// Number of parameters of the view with gradients: ten for a camera, none for a canvas.
    fn numbers(&self) -> usize;

    /// Fails for an invalid view, and for effects that the oracle does not have for this kind of
    /// view.
    ///
    /// # Errors
    /// [`Error::Size`], [`Error::Setting`] or [`Error::Unsupported`].
    fn check(&self, settings: &RenderSettings) -> Result<(), Error>;

    /// Columns and rows of the image.
    fn size(&self) -> (u32, u32);

    /// Normalised device units per unit of the first two numbers of a share, along x and y.
    fn device_units(&self) -> [f64; 2];

    /// Projects a Gaussian, whose parameters are a row of [`OracleScene`](super::OracleScene).
    fn project(&self, gaussian: &[f64], settings: &RenderSettings, lean: Lean) -> Projection;
}

/// The result of the guards for a Gaussian.
#[derive(Debug)]
pub enum Projection {
    /// The Gaussian can be drawn.
    Drawable(Box<dyn Splat>),
    /// The Gaussian is culled for this cause.
    Left(CullCause),
}

/// A Gaussian that can be drawn.
pub trait Splat: Debug + Send + Sync {
    /// σ at the pixel centre `p`.
    fn exponent(&self, p: [f64; 2]) -> Exponent;

    /// σ at the pixel centre `p`, without derivatives.
    fn sigma(&self, p: [f64; 2]) -> f64;

    /// The properties that do not depend on the pixel.
    fn appearance(&self) -> &Appearance;

    /// The depth by which it is sorted at the pixel centre `p`.
    fn depth(&self, p: [f64; 2], order: Order) -> Depth;

    /// ∂(share)/∂(parameters): a row for each parameter.
    fn jacobian(&self) -> Vec<[Rounded; 9]>;

    /// ∂(share)/∂(numbers of the view): a row for each of [`OracleView::numbers`].
    fn view_jacobian(&self) -> Vec<[Rounded; 9]>;
}

/// σ of a Gaussian at a pixel, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exponent {
    /// σ = ½ dᵀ Σ′⁻¹ d.
    pub sigma: f64,
    /// Uncertainty of σ by its textbook formula in `f32`.
    pub rounding: f64,
    /// ∂σ/∂(the five numbers of the shape).
    pub derivatives: [f64; 5],
    /// Uncertainty of each derivative alone.
    pub derivative_rounding: [f64; 5],
    /// Common change of the derivatives by an uncertain centre, along x and along y.
    pub displaced: [[f64; 5]; 2],
}

/// The properties of a Gaussian that are the same at every pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Appearance {
    /// o, with antialiasing's compensation.
    pub opacity: f64,
    /// Relative uncertainty of the opacity in `f32`.
    pub opacity_rounding: f64,
    /// ∂o/∂(the opacity's entry of a share).
    pub opacity_slope: f64,
    /// RGB.
    pub color: [f64; 3],
    /// Uncertainty of the colour in `f32`.
    pub color_rounding: [f64; 3],
    /// Whether the decision of a guard is within rounding.
    pub undecided: bool,
}

/// A depth at a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Depth {
    /// The depth; smaller is in front.
    pub value: f64,
    /// Uncertainty of the depth in `f32`.
    pub rounding: f64,
    /// The numbers that it was computed from. Depths of equal origins are equal in any arithmetic.
    pub origin: [f64; 8],
}

impl Depth {
    /// Whether the order of two depths is within rounding.
    pub(crate) fn is_tied_with(&self, other: &Self) -> bool {
        let band = ROUNDINGS * (self.rounding + other.rounding);
        band > 0.0 && (self.value - other.value).abs() <= band && self.origin != other.origin
    }
}

/// The side to which decisions within rounding fall.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lean {
    /// The side of the `f64` value.
    Exact,
    /// A Gaussian that nearly contributes does.
    More,
    /// A Gaussian that nearly does not contribute does not.
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
