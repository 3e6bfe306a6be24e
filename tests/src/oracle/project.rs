//! One Gaussian seen through a canvas, in `f64`: its centre and precision matrix in pixels, and how σ = ½ dᵀ Σ′⁻¹ d depends on
//! each of its parameters (paper eq. 3, 5, 7).

use gs_core::{Canvas, constants::MIN_DETERMINANT_PX4};

use super::parameters::{OPACITY, Parameters, ROTATION};

/// Half the distance between neighbouring `f32` numbers, relative: the rounding of one operation.
pub(crate) const F32_ROUNDING: f64 = 5.960_464_477_539_063e-8;

/// What the guards make of a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Projection {
    /// It can be drawn.
    Drawable(Projected),
    /// A parameter or its covariance is NaN, or infinite in `f32`.
    NotFinite,
    /// det Σ′ below the minimum.
    Degenerate,
}

/// A Gaussian in pixels of the canvas.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Projected {
    /// Centre, px.
    center: [f64; 2],
    /// What rounding to `f32` may move the centre by, px.
    center_rounding: [f64; 2],
    /// Σ′⁻¹ as (xx, xy, yy), px⁻².
    precision: [f64; 3],
    /// Unit vectors of the two axes, plane.
    axes: [[f64; 2]; 2],
    /// Squared scales along them, plane px².
    variances: [f64; 2],
    /// Pixels per unit of the plane.
    zoom: [f64; 2],
    /// 1 / (1 + exp(−logit)).
    pub(crate) opacity: f64,
    /// RGB.
    pub(crate) color: [f64; 3],
}

/// σ of a Gaussian at a pixel, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Exponent {
    /// σ = ½ dᵀ Σ′⁻¹ d.
    pub(crate) sigma: f64,
    /// What evaluating σ in `f32` by its textbook formula may change it by.
    pub(crate) rounding: f64,
    /// ∂σ/∂(mean x, mean y, ln-scale 1, ln-scale 2, rotation).
    pub(crate) derivatives: [f64; 5],
    /// The same with every term of every sum taken by magnitude: what their own `f32` rounding is proportional to.
    pub(crate) magnitudes: [f64; 5],
}

impl Projection {
    pub(crate) fn of(g: &Parameters, view: &Canvas) -> Self {
        let finite_in_f32 = |v: f64| v.abs() <= f64::from(f32::MAX); // NaN fails
        let all_but_logit = g.iter().enumerate().filter(|&(i, _)| i != OPACITY).all(|(_, &v)| finite_in_f32(v));
        if !all_but_logit || g[OPACITY].is_nan() {
            return Self::NotFinite;
        }
        let origin = [f64::from(view.origin.x), f64::from(view.origin.y)];
        let zoom =
            [f64::from(view.width) / f64::from(view.extent.x), f64::from(view.height) / f64::from(view.extent.y)];
        let (sin, cos) = g[ROTATION].sin_cos();
        let axes = [[cos, sin], [-sin, cos]];
        let variances = [(2.0 * g[2]).exp(), (2.0 * g[3]).exp()];
        // Σ′ᵢⱼ = zoomᵢ zoomⱼ Σₖ varianceₖ axisₖᵢ axisₖⱼ
        let entry = |i: usize, j: usize| {
            zoom[i] * zoom[j] * (variances[0] * axes[0][i] * axes[0][j] + variances[1] * axes[1][i] * axes[1][j])
        };
        let (xx, xy, yy) = (entry(0, 0), entry(0, 1), entry(1, 1));
        let determinant = variances[0] * variances[1] * (zoom[0] * zoom[1]).powi(2);
        if ![xx, xy, yy, determinant].into_iter().all(finite_in_f32) {
            return Self::NotFinite;
        }
        if determinant < f64::from(MIN_DETERMINANT_PX4) {
            return Self::Degenerate;
        }
        let center = [0, 1].map(|i| (g[i] - origin[i]) * zoom[i]);
        Self::Drawable(Projected {
            center,
            center_rounding: [0, 1]
                .map(|i| F32_ROUNDING * (center[i].abs() + (g[i].abs() + origin[i].abs()) * zoom[i])),
            precision: [yy / determinant, -xy / determinant, xx / determinant],
            axes,
            variances,
            zoom,
            opacity: 1.0 / (1.0 + (-g[OPACITY]).exp()),
            color: [g[6], g[7], g[8]],
        })
    }
}

impl Projected {
    /// σ at the pixel centre `p`.
    ///
    /// With q = Σ′⁻¹ d: ∂σ/∂u = −q and ∂σ/∂Σ′ = −½ q qᵀ. Written in the plane, q becomes `zoom · q`; ∂Σ/∂(ln sₖ) = 2 sₖ² rₖ rₖᵀ and
    /// ∂Σ/∂θ = (s₁² − s₂²)(r₁ r₂ᵀ + r₂ r₁ᵀ).
    pub(crate) fn exponent(&self, p: [f64; 2]) -> Exponent {
        let [a, b, c] = self.precision;
        let d = [p[0] - self.center[0], p[1] - self.center[1]];
        let q = [a * d[0] + b * d[1], b * d[0] + c * d[1]];
        let q_magnitude = [a * d[0].abs() + b.abs() * d[1].abs(), b.abs() * d[0].abs() + c * d[1].abs()];
        let sigma_magnitude = 0.5 * (q_magnitude[0] * d[0].abs() + q_magnitude[1] * d[1].abs());
        let moved = (0..2).map(|i| q[i].abs() * (self.center_rounding[i] + F32_ROUNDING * p[i].abs())).sum::<f64>();
        let plane = [q[0] * self.zoom[0], q[1] * self.zoom[1]];
        let plane_magnitude = [q_magnitude[0] * self.zoom[0], q_magnitude[1] * self.zoom[1]];
        // The axes are eigenvectors: rₖ · Σ⁻¹ = rₖ / sₖ².
        let along = [0, 1].map(|k| self.axes[k][0] * plane[0] + self.axes[k][1] * plane[1]);
        let along_magnitude = [0, 1].map(|k| {
            let [x, y] = [0, 1].map(|i| (self.axes[k][i] * d[i] / self.zoom[i]).abs());
            (x + y) / self.variances[k]
        });
        let [v1, v2] = self.variances;
        Exponent {
            sigma: 0.5 * (q[0] * d[0] + q[1] * d[1]),
            rounding: F32_ROUNDING * sigma_magnitude + moved,
            derivatives: [
                -plane[0],
                -plane[1],
                -v1 * along[0] * along[0],
                -v2 * along[1] * along[1],
                -(v1 - v2) * along[0] * along[1],
            ],
            magnitudes: [
                plane_magnitude[0],
                plane_magnitude[1],
                v1 * along_magnitude[0].powi(2),
                v2 * along_magnitude[1].powi(2),
                (v1 - v2).abs() * along_magnitude[0] * along_magnitude[1],
            ],
        }
    }
}
