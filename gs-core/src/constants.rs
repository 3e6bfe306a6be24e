//! The numbers that two crates must agree on, each with its unit, its source, and what breaks when
//! it changes.
//!
//! Shaders print their prelude from here (`{:?}` of an `f32` parses back bit for bit in WGSL), so
//! there is no second copy.

/// The α cut: α below this adds nothing. Unit: none.
///
/// *Source:* 3DGS. One display step of 8 bits. The image is discontinuous here: finite differences
/// need [`Cut::Smooth`](crate::Cut). Smaller values widen every Gaussian (radius `√(2 ln(1/cut))`
/// σ: 3.33 σ here) and cost time.
pub const ALPHA_CUT: f32 = 1.0 / 255.0;

/// Half a step of an 8-bit display. Unit: colour, 0 to 1.
///
/// A pixel that changes by no more than this may look the same.
/// [`Effects::required`](crate::Effects::required) leaves out effects by it; with a larger value,
/// it would leave out effects whose absence is visible.
pub const HALF_DISPLAY_STEP: f32 = 1.0 / 512.0;

/// Standard deviation below which a Gaussian is narrower than a pixel. Unit: px.
///
/// Such Gaussians change with their place between pixel centres, unless an
/// [`Antialias`](crate::effects::Antialias) widens them.
pub const NARROW_PX: f32 = 0.5;

/// Upper bound of α under [`Blend::Over`](crate::effects::Blend). Unit: none.
///
/// *Source:* gsplat (3DGS itself has 0.99). The gradient of a clamped α is zero, so forward and
/// backward must use the same value. At 1 the transmittance would reach 0 and the backward pass
/// would divide by it.
pub const ALPHA_MAX: f32 = 0.999;

/// Transmittance below which a pixel is full, so that nothing further back counts. Unit: none.
///
/// *Source:* 3DGS. The Gaussian that would cross it does not count either, forward and backward
/// alike.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;

/// Steepness with which the noise on means fades with opacity: k of 3DGS-MCMC. Unit: none.
///
/// *Source:* the code of 3DGS-MCMC. Smaller values move Gaussians that are visible.
pub const NOISE_STEEPNESS: f32 = 100.0;

/// Opacity at which the noise on means has half its strength: t of 3DGS-MCMC, 1 − t in its code.
/// Unit: none.
///
/// *Source:* the code of 3DGS-MCMC. Larger values move Gaussians that are visible.
pub const NOISE_OPACITY: f32 = 0.005;

/// Variance that [`Antialias::Dilate` and `Compensated`](crate::effects::Antialias) add to the
/// diagonal of Σ′. Unit: px².
///
/// *Source:* 3DGS; gsplat with `rasterize_mode="antialiased"`. Smaller lets sub-pixel Gaussians
/// fall between pixel centres and flicker.
pub const DILATION_PX2: f32 = 0.3;

/// Variance that [`Antialias::Mip`](crate::effects::Antialias) adds to the diagonal of Σ′. Unit:
/// px².
///
/// *Source:* Mip-Splatting.
pub const MIP_DILATION_PX2: f32 = 0.1;

/// Smallest det Σ′; Gaussians below are culled and counted as degenerate. Unit: px⁴.
///
/// In needles, `a·c − b²` goes negative by cancellation or FMA contraction. The smallest scale that
/// training allows ([`MIN_SCALE_PX`]) has det 4e-3 px⁴, so nothing that training makes is culled. A
/// culled Gaussian is as small as 0.03 × 0.03 px or 0.001 × 1 px: only one in thirty of them
/// touches a pixel's centre.
pub const MIN_DETERMINANT_PX4: f32 = 1e-6;

/// Smallest squared norm of a quaternion; Gaussians below are culled and counted as degenerate.
/// Unit: none.
///
/// Training does not shorten quaternions, as gradients are orthogonal to them.
pub const MIN_QUATERNION_NORM2: f32 = 1e-6;

/// Factor for quaternions whose square overflows `f32`: 2⁻⁶⁶, which keeps the direction. Unit:
/// none.
///
/// Their length is between 2⁶³ and 2¹²⁹; scaled, it is between 2⁻³ and 2⁶³, whose squares are
/// normal numbers.
pub const QUATERNION_SHRINK: f32 = 1.355_252_7e-20;

/// Range in which the square of a length has all its digits, and also the direction computed from
/// it. Unit: world units².
pub const SAFE_SQUARES: [f32; 2] = [1e-30, 1e37];

/// Largest entry of ξ in one step of
/// [`Parameterization::CovarianceFactor`](crate::Parameterization::CovarianceFactor). Unit: none.
///
/// A mean moves by at most this many of its own scales along each axis. Beyond, a Gaussian would be
/// drawn where none of its gradient came from; learning rates a hundred times too high would move
/// all Gaussians out of the image in a few steps.
pub const MAX_XI: f32 = 1.0;

/// Largest entry of η in one step of
/// [`Parameterization::CovarianceFactor`](crate::Parameterization::CovarianceFactor). Unit: none.
///
/// exp(η) is taken to second order, which shrinks by ½ at an eigenvalue of −1 and less again beyond
/// it. At ½ it is 1.4 % less than exp(½).
pub const MAX_ETA: f32 = 0.5;

/// Largest magnitude of a derivative in Adam; larger ones are clamped. Unit: loss per unit of the
/// parameter.
///
/// The square of more than 1.8e19 is ∞, so v̂ would stay ∞ and the parameter would never move
/// again.
pub const MAX_DERIVATIVE: f32 = 1e18;

/// Smallest magnitude of Adam's first moments; smaller ones become 0. Unit: loss per unit of the
/// parameter.
///
/// Without gradients they would decay to denormals, with which processors take many times as long.
/// The error is a step of at most 1e-30/ε learning rates.
pub const VANISHING_MOMENT: f32 = 1e-30;

/// Bound on |C − Y| in the derivative of L2. Unit: that of the image.
///
/// Kernels multiply ∂L/∂C by the weights of all Gaussians that a tile lists, which are 0 where one
/// does not reach a pixel: 0·∞ would be NaN in Gaussians that do not touch the pixel. The loss
/// itself is not bounded; it overflows and stops the run.
pub const MAX_RESIDUAL: f32 = 1e18;

/// Bound on the values that SSIM sees; larger ones are clamped. Unit: that of the image.
///
/// SSIM is a quotient of fourth powers, which overflow at 1e10: ∞/∞ would be NaN in the whole
/// window.
pub const SSIM_MAX: f32 = 1e9;

/// Default near plane of a [`Camera`](crate::Camera). Unit: world units. *Source:* gsplat (3DGS:
/// 0.2).
pub const NEAR_WORLD: f32 = 0.01;

/// Margin around the image within which the Jacobian of the perspective follows the slope x/z, as a
/// share of half the side. Unit: none.
///
/// *Source:* 3DGS (1.3 times the tangent of half the field of view), in gsplat's form for principal
/// points off the centre. Further out the affine approximation smears Gaussians over the whole
/// image; the gradient of a clamped slope is zero.
pub const JACOBIAN_MARGIN: f32 = 0.3;

/// Y₀ of the real spherical harmonics. *Source:* 3DGS, whose constants, signs and order every splat
/// file follows.
pub const SH_C0: f32 = 0.282_094_8;

/// The SH constant of degree 1: Y = −C y, C z, −C x.
pub const SH_C1: f32 = 0.488_602_5;

/// The SH constants of degree 2, which multiply xy, yz, 2z² − x² − y², xz, x² − y².
pub const SH_C2: [f32; 5] = [1.092_548_5, -1.092_548_5, 0.315_391_57, -1.092_548_5, 0.546_274_24];

/// The SH constants of degree 3, which multiply y(3x² − y²), xyz, y(4z² − x² − y²), z(2z² − 3x² −
/// 3y²), x(4z² − x² − y²), z(x² − y²), x(x² − 3y²).
pub const SH_C3: [f32; 7] =
    [-0.590_043_6, 2.890_611_4, -0.457_045_8, 0.373_176_34, -0.457_045_8, 1.445_305_7, -0.590_043_6];

/// Default lower bound of scales in training. Unit: px.
///
/// The paper clamps at 1.0 (§3.4.2), which forbids sharp edges; below 0.25 a Gaussian falls between
/// pixel centres and receives no gradient.
pub const MIN_SCALE_PX: f32 = 0.25;

/// Default upper bound of scales in training. Unit: px. Presets use the image's size.
///
/// A Gaussian that fits a band grows longer without end, as nothing in the image limits it. Once
/// its scale overflows, its mean is lost.
pub const MAX_SCALE_PX: f32 = 1e4;

/// Factor φ by which a split divides scales. Unit: none. *Source:* paper §2.2.2, 3DGS.
pub const SPLIT_PHI: f32 = 1.6;

/// Growth threshold τ_pos on the positional gradient. Unit: normalised device units.
///
/// *Source:* 3DGS, paper §5.2, which shows that it is not universal.
pub const TAU_POSITION: f32 = 2e-4;

/// Growth threshold on the absolute gradient,
/// [`Statistics::AbsoluteGradient`](crate::effects::Statistics). Unit: normalised device units.
///
/// *Source:* AbsGS. Twice [`TAU_POSITION`]: nothing cancels in the absolute gradient, so it is
/// larger.
pub const TAU_ABSOLUTE: f32 = 4e-4;

/// Growth threshold on the pixel error, [`Statistics::PixelError`](crate::effects::Statistics).
/// Unit: px.
///
/// This project's choice: Rota Bulò et al. 2024 measure the error by SSIM, on another scale. Like
/// the absolute threshold, it is not universal: errors grow with a Gaussian's area and the image's
/// contrast.
pub const TAU_ERROR: f32 = 0.1;

/// Opacity below which Gaussians are pruned (ε_α). Unit: none. *Source:* 3DGS, paper §2.2.3.
pub const PRUNE_OPACITY: f32 = 5e-3;

/// Steps between opacity resets. *Source:* 3DGS, paper §2.2.3.
pub const OPACITY_RESET_EVERY: u32 = 3000;

/// Largest opacity after an opacity reset. Unit: none. *Source:* 3DGS.
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

/// Largest number of Gaussians in training. At some 300 bytes each they take 30 GB; a mistyped
/// number is refused early.
pub const MAX_GAUSSIANS: u32 = 100_000_000;

/// Largest side of an image. Unit: px. Row numbers stay exact in `f32` with room for fractions, and
/// a header bomb is refused.
pub const MAX_SIDE_PX: u32 = 16_384;

/// Share of the points' distance below which cameras stand in one place and only turn: a head that
/// pans moves a lens by millimetres, and text rounds positions.
pub const ONE_PLACE: f64 = 2e-3;

/// Share of the points, those nearest to the cameras, beyond which lies the distance that
/// [`ONE_PLACE`] is a share of: a sky far away does not make a scene small.
pub const NEAREST_POINTS: f64 = 0.05;
