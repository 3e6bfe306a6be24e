//! A projected Gaussian: what the pixels need of it, in 2D and 3D scenes.
//!
//! Σ′ is held so that the exponent is a sum of squares, without the cancellation that a·dx² +
//! 2b·dx·dy + c·dy² suffers in needles: σ = ½ dx²/Σxx + ½ c (dy − slope·dx)², with slope = Σxy/Σxx
//! and c = Σxx/det Σ′. The determinant comes from the projection, where it does not cancel either.

use glam::{Mat2, Vec2};

/// Gaussians per task in the stages that are parallel over Gaussians.
pub(crate) const CHUNK: usize = 1024;

/// Largest |exponent| at a start of the kernels' recurrence, well inside the range of `f32`.
pub(crate) const SAFE_EXPONENT: f32 = 80.0;

/// Largest number of rows along which the kernels' recurrence computes a Gaussian's weights before
/// exp is called again. Its error grows with the square of its length.
pub(crate) const RECURRENCE_ROWS: f32 = 32.0;

/// The c below which the ratio of successive rows' weights is stored minus 1.
///
/// Near 1, the rounding of the ratio itself would grow with the square of the number of rows. For a
/// larger c there are few rows, and the ratio comes near 0, where subtracting 1 would lose digits.
pub(crate) const WIDE: f32 = 0.5;

/// 1 − e⁻ᶜ for c from 0 to [`WIDE`], to 2 ulp: a Taylor series with a remainder below 10⁻⁸ of it.
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
    /// Σxy/Σxx: rows that the ridge moves down per column.
    pub(crate) slope: f32,
    /// Σxx/det Σ′, px⁻².
    pub(crate) c: f32,
    /// exp(−c): the factor by which the ratio of successive rows' weights changes per row.
    pub(crate) ratio: f32,
    /// 1 − exp(−c), computed without cancellation, where c < [`WIDE`]; else 0.
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
    /// Rows after which the kernels' recurrence starts again.
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
    /// A Gaussian that adds nothing. No kernel can turn its numbers into NaN.
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

    /// A Gaussian whose covariance is not degenerate and whose opacity is at least `cut`.
    ///
    /// The recurrence starts again after at most [`RECURRENCE_ROWS`].
    #[inline]
    pub(crate) fn new(mean: Vec2, covariance: Covariance, color: [f32; 3], (opacity, cut): (f32, f32)) -> Self {
        let Covariance { xx, xy, yy, determinant } = covariance;
        let reach = 2.0 * (opacity / cut).ln();
        let c = xx / determinant;
        // A row whose weight is above the cut has σ ≤ reach/2; going back n rows adds at most n
        // √(c/2) to √σ.
        let restart = ((SAFE_EXPONENT.sqrt() - (0.5 * reach).sqrt()) / (0.5 * c).sqrt()).clamp(1.0, RECURRENCE_ROWS);
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

    /// A with Σ′⁻¹ d = A (dx, u).
    ///
    /// It maps the kernels' sums over (dx, u) to gradients by mean and covariance.
    #[inline]
    pub(crate) fn conic_of_ridge(&self) -> Mat2 {
        Mat2::from_cols(Vec2::new(self.inverse_xx, 0.0), Vec2::new(-self.slope * self.c, self.c))
    }
}

/// Gradient of a Gaussian: the sum of its entries' slots.
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
    /// Further sums for the statistic.
    pub(crate) collected: [f32; 2],
}

/// What one step adds to a Gaussian's statistics.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Share {
    pub(crate) signal: f32,
    /// What is added to the sum of weights.
    pub(crate) weight: u32,
}

impl Share {
    /// A value of weight 1.
    #[inline(always)]
    pub(crate) fn once(signal: f32) -> Self {
        Self { signal, weight: 1 }
    }

    /// A value that counts as often as there are pixels.
    #[inline(always)]
    pub(crate) fn weighted(value: f32, pixels: f32) -> Self {
        Self { signal: pixels * value, weight: pixels as u32 }
    }

    /// Adds this share to a Gaussian's sums.
    #[inline(always)]
    pub(crate) fn add_to(self, signal_sum: &mut f32, visible: &mut u32) {
        *signal_sum += self.signal;
        *visible = visible.saturating_add(self.weight);
    }
}

/// The depth of a Gaussian as a function of the pixel.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PixelDepth {
    /// z at the mean, world units; 0 for a Gaussian that is not drawn.
    pub(crate) depth: f32,
    /// Change of depth per px along x and y.
    pub(crate) slope: [f32; 2],
}
