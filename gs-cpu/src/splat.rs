//! What the pixels need of one Gaussian, whatever kind of scene it is from.
//!
//! Σ′ is held so that the exponent is a sum of squares, without the cancellation that a·dx² + 2b·dx·dy + c·dy² suffers in needles:
//! σ = ½ dx²/Σxx + ½ c (dy − slope·dx)², with slope = Σxy/Σxx and c = Σxx/det Σ′. The determinant comes from the kind's own projection,
//! where it does not cancel either.

use glam::{Mat2, Vec2};

/// Gaussians a task of the stages over Gaussians handles.
pub(crate) const CHUNK: usize = 1024;

/// Largest |exponent| that the kernels' recurrence may start from, well inside the range of `f32`'s exponent.
const SAFE_EXPONENT: f32 = 80.0;

/// Gaussians with a smaller c hold the ratio of successive rows' weights less 1: near 1, the ratio's own rounding would add up with the
/// square of the number of rows. With a larger one there are few rows, and the ratio comes near 0, where less 1 would lose its digits.
const WIDE: f32 = 0.5;

/// 1 − e⁻ᶜ for c from 0 to [`WIDE`], to 2 ulp: Taylor's series, whose rest is below 10⁻⁸ of it.
#[inline]
fn fall(c: f32) -> f32 {
    let p = 1.0 / 40_320.0;
    let p = 1.0 / 5_040.0 - c * p;
    let p = 1.0 / 720.0 - c * p;
    let p = 1.0 / 120.0 - c * p;
    let p = 1.0 / 24.0 - c * p;
    let p = 1.0 / 6.0 - c * p;
    let p = 0.5 - c * p;
    c - c * c * p
}

/// One Gaussian on the image. Units: px.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Splat {
    pub(crate) mean: [f32; 2],
    /// 1/Σxx, px⁻².
    pub(crate) inverse_xx: f32,
    /// Σxy/Σxx: how far the ridge moves down per column.
    pub(crate) slope: f32,
    /// Σxx/det Σ′, px⁻².
    pub(crate) c: f32,
    /// exp(−c): by how much the ratio of successive rows' weights changes per row.
    pub(crate) ratio: f32,
    /// 1 − exp(−c), to its own precision, where the ratio is held less 1; else 0.
    pub(crate) fall: f32,
    pub(crate) color: [f32; 3],
    pub(crate) opacity: f32,
    /// A weight (times opacity, under `Over`) below this adds nothing; ∞ for a culled Gaussian.
    pub(crate) cut: f32,
    /// 2 ln(opacity/cut): dᵀ Σ′⁻¹ d on the ellipse outside which nothing is added.
    pub(crate) reach: f32,
    /// Half the ellipse's extent along x; negative for a culled Gaussian.
    pub(crate) half_x: f32,
    /// dx of the ellipse's lowest point (−dx of its highest).
    pub(crate) lowest_dx: f32,
    /// Rows after which the kernels' recurrence starts afresh.
    pub(crate) restart_rows: u32,
}

/// Σ′ of a Gaussian on the image, px², and its determinant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Covariance {
    pub(crate) xx: f32,
    pub(crate) xy: f32,
    pub(crate) yy: f32,
    pub(crate) determinant: f32,
}

impl Splat {
    /// A Gaussian that adds nothing, with numbers that no kernel can turn into NaN.
    pub(crate) const CULLED: Self = Self {
        mean: [0.0; 2],
        inverse_xx: 1.0,
        slope: 0.0,
        c: 1.0,
        ratio: 0.5,
        fall: 0.0,
        color: [0.0; 3],
        opacity: 0.0,
        cut: f32::INFINITY,
        reach: 0.0,
        half_x: -1.0,
        lowest_dx: 0.0,
        restart_rows: 1,
    };

    /// A Gaussian whose covariance is not degenerate and whose opacity is at least `cut`; the recurrence runs along `longest` rows at most.
    #[inline]
    pub(crate) fn new(
        mean: Vec2,
        covariance: Covariance,
        color: [f32; 3],
        (opacity, cut): (f32, f32),
        longest: f32,
    ) -> Self {
        let Covariance { xx, xy, yy, determinant } = covariance;
        let reach = 2.0 * (opacity / cut).ln();
        let c = xx / determinant;
        // A row whose weight is above the cut has σ ≤ reach/2; going back n rows adds at most n √(c/2) to √σ.
        let restart = ((SAFE_EXPONENT.sqrt() - (0.5 * reach).sqrt()) / (0.5 * c).sqrt()).clamp(1.0, longest);
        let half_y = (reach * yy).sqrt();
        Self {
            mean: mean.to_array(),
            inverse_xx: 1.0 / xx,
            slope: xy / xx,
            c,
            ratio: (-c).exp(),
            fall: if c < WIDE { fall(c) } else { 0.0 },
            color,
            opacity,
            cut,
            reach,
            half_x: (reach * xx).sqrt(),
            lowest_dx: xy / yy * half_y,
            restart_rows: restart as u32,
        }
    }

    pub(crate) fn is_culled(&self) -> bool {
        self.half_x < 0.0
    }

    /// How far up and down the ellipse of the cut reaches.
    #[inline]
    pub(crate) fn half_y(&self) -> f32 {
        (self.reach * (self.slope * self.slope / self.inverse_xx + 1.0 / self.c)).sqrt()
    }

    /// A with Σ′⁻¹ d = A (dx, u): what leads from the kernels' sums over (dx, u) to gradients by mean and covariance.
    #[inline]
    pub(crate) fn conic_of_ridge(&self) -> Mat2 {
        Mat2::from_cols(Vec2::new(self.inverse_xx, 0.0), Vec2::new(-self.slope * self.c, self.c))
    }
}

/// The sums of what a Gaussian's entries received from the kernels.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Received {
    /// v_colour.
    pub(crate) color: [f32; 3],
    /// Σ t (dx, u).
    pub(crate) first: Vec2,
    /// Σ t dx², Σ t dx·u, Σ t u².
    pub(crate) second: [f32; 3],
    /// Σ t; 0 under `Sum`.
    pub(crate) zeroth: f32,
    /// What is collected besides.
    pub(crate) collected: [f32; 2],
}
