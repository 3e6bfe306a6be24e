//! Every number that two crates must agree on, each with its unit, its source, and what breaks when it moves.
//!
//! Shaders print their prelude from here (`{:?}` of an `f32` parses back bit for bit in WGSL), so there is no second copy.

/// α below this adds nothing. Unit: none.
///
/// *Source:* 3DGS. One display step of 8 bits. The image is discontinuous here: finite differences need
/// [`Cut::Smooth`](crate::settings::Cut). Smaller values widen every Gaussian (radius `√(2 ln(1/cut))` σ: 3.33 σ here) and with it the time.
pub const ALPHA_CUT: f32 = 1.0 / 255.0;

/// Half a step of an 8-bit display: a pixel that changes by no more than this may look the same. Unit: colour, 0 to 1.
///
/// By it, it is decided which effects a scene calls for ([`Effects::called_for`](crate::Effects::called_for)). More, and effects are left out
/// whose absence shows.
pub const HALF_DISPLAY_STEP: f32 = 1.0 / 512.0;

/// A Gaussian is narrower than a pixel where its standard deviation is below this in some direction. Unit: px.
///
/// Twice that, across its middle, is a pixel's side. Such Gaussians change with where they lie between pixel centres, unless an
/// [`Antialias`](crate::effects::Antialias) widens them.
pub const NARROW_PX: f32 = 0.5;

/// α never exceeds this under [`Blend::Over`](crate::effects::Blend). Unit: none.
///
/// *Source:* gsplat (3DGS itself has 0.99). The gradient of a clamped α is zero, so forward and backward must use the
/// same value. At 1 the transmittance would reach 0 and the backward pass would divide by it.
pub const ALPHA_MAX: f32 = 0.999;

/// A pixel is full, and nothing further back counts, when its transmittance would fall below this. Unit: none.
///
/// *Source:* 3DGS. The Gaussian that would cross it does not count, forward and backward alike.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;

/// How sharply the noise on means ends where opacity begins: k of 3DGS-MCMC. Unit: none.
///
/// *Source:* the code of 3DGS-MCMC. Smaller shakes Gaussians that are seen.
pub const NOISE_STEEPNESS: f32 = 100.0;

/// The opacity at which the noise on means has half its strength: t of 3DGS-MCMC, 1 − t in its code. Unit: none.
///
/// *Source:* the code of 3DGS-MCMC. Larger shakes Gaussians that are seen.
pub const NOISE_OPACITY: f32 = 0.005;

/// What [`Antialias::Dilate` and `Compensated`](crate::effects::Antialias) add to the diagonal of Σ′. Unit: px².
///
/// *Source:* 3DGS; gsplat with `rasterize_mode="antialiased"`. Smaller lets sub-pixel Gaussians fall between pixel centres and flicker.
pub const DILATION_PX2: f32 = 0.3;

/// What [`Antialias::Mip`](crate::effects::Antialias) adds to the diagonal of Σ′ before its opacity compensation. Unit: px².
///
/// *Source:* Mip-Splatting.
pub const MIP_DILATION_PX2: f32 = 0.1;

/// A Gaussian whose det Σ′ is not at least this is culled and counted as degenerate. Unit: px⁴.
///
/// Needles: `a·c − b²` goes negative by cancellation or FMA contraction. The smallest scale training allows
/// ([`MIN_SCALE_PX`]) has det 4e-3 px⁴, so nothing that training makes is culled. What is lost is what is seen at one pixel's centre out of thirty such
/// Gaussians: 0.03 × 0.03 px, or 0.001 × 1 px.
pub const MIN_DETERMINANT_PX4: f32 = 1e-6;

/// A quaternion whose squared norm is not at least this is culled and counted as degenerate. Unit: none.
///
/// Down to a length of 1e-19 it would still have a direction. In training lengths grow, as gradients are orthogonal to the quaternion.
pub const MIN_QUATERNION_NORM2: f32 = 1e-6;

/// A quaternion whose square is beyond `f32` is taken times this, 2⁻⁶⁶: it has the same direction. Unit: none.
///
/// What overflows is at least 2⁶³ long, and at most 2¹²⁹; after this it is between 2⁻³ and 2⁶³, whose squares are normal numbers.
pub const QUATERNION_SHRINK: f32 = 1.355_252_7e-20;

/// Between these, the square of a length has all its digits, and so has the direction that is found by it. Unit: world units².
pub const SAFE_SQUARES: [f32; 2] = [1e-30, 1e37];

/// Largest entry of ξ in one step of [`Parameterization::CovarianceFactor`](crate::Parameterization::CovarianceFactor): how many of its own scales a mean moves along each axis. Unit:
/// none.
///
/// Beyond, a Gaussian would be drawn where nothing of its gradient came from; rates a hundred times too high take all out of the picture in a few
/// steps, from where no gradient leads back.
pub const MAX_XI: f32 = 1.0;

/// Largest entry of η in one step of [`Parameterization::CovarianceFactor`](crate::Parameterization::CovarianceFactor). Unit: none.
///
/// exp(η) is taken to second order, which shrinks by ½ at an eigenvalue of −1 and less again beyond it. At ½ it is 1.4 % less than exp(½).
pub const MAX_ETA: f32 = 0.5;

/// Adam takes a larger derivative for this, of the same sign. Unit: loss per unit of the parameter.
///
/// Beyond 1.8e19 a square is ∞, v̂ with it for ever after, and the parameter never moves again. Nothing that is not to overflow soon is near.
pub const MAX_DERIVATIVE: f32 = 1e18;

/// Adam's first moments below this become 0. Unit: loss per unit of the parameter.
///
/// Where no gradient comes any more they would decay to denormals, which take many times as long. What is lost is a step of at most 1e-30/ε learning
/// rates.
pub const VANISHING_MOMENT: f32 = 1e-30;

/// L2 is differentiated as if C − Y were within ± this. Unit: of the image.
///
/// Kernels multiply ∂L/∂C by the weights of all Gaussians that a tile lists, 0 where one does not reach a pixel: 0·∞ would be NaN in Gaussians
/// that have nothing to do with it. The loss itself is not bounded; it overflows, and stops the run.
pub const MAX_RESIDUAL: f32 = 1e18;

/// SSIM takes what is beyond ± this for it. Unit: of the image.
///
/// SSIM is a quotient of fourth powers: of 1e10 they are ∞, and ∞/∞ is NaN in the whole window.
pub const SSIM_MAX: f32 = 1e9;

/// The near plane of a [`Camera`](crate::view::Camera). Unit: world units. *Source:* gsplat (3DGS: 0.2).
pub const NEAR_WORLD: f32 = 0.01;

/// How far beyond the image, as a share of half its side, the slope x/z is followed that the perspective's Jacobian is taken at.
/// Unit: none.
///
/// *Source:* 3DGS (1.3 times the tangent of half the field of view), in gsplat's form for principal points off the centre. Further out the
/// affine approximation smears Gaussians over the whole image; the gradient of a clamped slope is zero.
pub const JACOBIAN_MARGIN: f32 = 0.3;

/// Y₀ of the real spherical harmonics. *Source:* 3DGS, whose constants, signs and order every splat file follows.
pub const SH_C0: f32 = 0.282_094_8;

/// The constant of degree 1: Y = −C y, C z, −C x.
pub const SH_C1: f32 = 0.488_602_5;

/// The constants of degree 2, which multiply xy, yz, 2z² − x² − y², xz, x² − y².
pub const SH_C2: [f32; 5] = [1.092_548_5, -1.092_548_5, 0.315_391_57, -1.092_548_5, 0.546_274_24];

/// The constants of degree 3, which multiply y(3x² − y²), xyz, y(4z² − x² − y²), z(2z² − 3x² − 3y²), x(4z² − x² − y²), z(x² − y²),
/// x(x² − 3y²).
pub const SH_C3: [f32; 7] =
    [-0.590_043_6, 2.890_611_4, -0.457_045_8, 0.373_176_34, -0.457_045_8, 1.445_305_7, -0.590_043_6];

/// Smallest scale that training lets a Gaussian shrink to. Unit: px.
///
/// The paper clamps at 1.0 (§3.4.2), which forbids sharp edges; below 0.25 a Gaussian falls between pixel centres
/// and receives no gradient.
pub const MIN_SCALE_PX: f32 = 0.25;

/// Largest scale that training lets a Gaussian grow to, unless a setting says less. Unit: px.
///
/// A Gaussian that fits a band lengthens without end: nothing in the image pulls it back, and once its scale overflows, its mean is
/// lost with it. Presets set the image's own size.
pub const MAX_SCALE_PX: f32 = 1e4;

/// The split's shrinking factor φ. Unit: none. *Source:* paper §2.2.2, 3DGS.
pub const SPLIT_PHI: f32 = 1.6;

/// The absolute growth threshold τ_pos on the positional gradient, in normalised device units.
///
/// *Source:* 3DGS, paper §5.2, which shows that it is not universal.
pub const TAU_POSITION: f32 = 2e-4;

/// The same on the absolute gradient, [`Statistics::AbsoluteGradient`](crate::effects::Statistics), in normalised device units.
///
/// *Source:* AbsGS. Twice [`TAU_POSITION`]: nothing cancels in the absolute gradient, so it is larger.
pub const TAU_ABSOLUTE: f32 = 4e-4;

/// The same on the pixel error, [`Statistics::PixelError`](crate::effects::Statistics). Unit: px.
///
/// A Gaussian grows that stands for a tenth of a pixel's worth of error. This project's choice: Rota Bulò et al. 2024 measure the error by
/// SSIM, on another scale. As the absolute threshold, it is not universal: errors grow with a Gaussian's area and the image's contrast.
pub const TAU_ERROR: f32 = 0.1;

/// Gaussians whose opacity is below this are pruned (ε_α). Unit: none. *Source:* 3DGS, paper §2.2.3.
pub const PRUNE_OPACITY: f32 = 5e-3;

/// Steps between opacity resets. *Source:* 3DGS, paper §2.2.3.
pub const OPACITY_RESET_EVERY: u32 = 3000;

/// What an opacity reset lowers every opacity to, at most. Unit: none. *Source:* 3DGS.
pub const OPACITY_RESET_TO: f32 = 0.01;

/// λ of the loss (1 − λ) L1 + λ D-SSIM. *Source:* paper eq. 6, 3DGS.
pub const DSSIM_LAMBDA: f32 = 0.2;

/// Side of SSIM's Gaussian window. Unit: px. *Source:* Wang et al. 2004.
pub const SSIM_WINDOW: usize = 11;

/// Standard deviation of SSIM's Gaussian window. Unit: px. *Source:* Wang et al. 2004.
pub const SSIM_SIGMA: f32 = 1.5;

/// SSIM's C1 = (0.01 · range)² with range 1. *Source:* Wang et al. 2004.
pub const SSIM_C1: f32 = 1e-4;

/// SSIM's C2 = (0.03 · range)² with range 1. *Source:* Wang et al. 2004.
pub const SSIM_C2: f32 = 9e-4;

/// Most Gaussians of a scene that is trained: at some 300 bytes each, 30 GB. A mistyped number is refused before memory is asked for.
pub const MAX_GAUSSIANS: u32 = 100_000_000;

/// Largest side of a canvas. Unit: px. Row numbers stay exact in `f32` with room for fractions, and a header bomb is refused.
pub const MAX_SIDE_PX: u32 = 16_384;
