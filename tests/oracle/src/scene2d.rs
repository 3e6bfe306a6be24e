//! The projection of a 2D Gaussian in `f64`: centre and precision matrix in pixels, and the
//! derivatives of σ = ½ dᵀ Σ′⁻¹ d by each of its parameters (paper eq. 3, 5, 7).

use std::f64::consts::PI;

use gs_core::{
    Canvas, CullCause, Error, RenderSettings,
    constants::MIN_DETERMINANT_PX4,
    effects::{Antialias, Blend, Order},
};

use super::{
    parameters::{COLOR, OPACITY, ROTATION},
    rounded::{F32_ROUNDING, Rounded},
    splat::{Appearance, Depth, Exponent, Lean, OracleView, Projection, Splat},
};

/// Roundings of a derivative of σ, in its own terms.
const OPERATIONS: f64 = 8.0;

/// Roundings for sums that are rotated into other axes: a few operations, rarely all of one sign.
const TURNING: f64 = 1.0 / 64.0;

/// A projected 2D Gaussian, px. Its share is by its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Splat2d {
    /// Centre, px.
    center: [f64; 2],
    /// Uncertainty of the centre in `f32`, px.
    center_rounding: [f64; 2],
    /// Σ′⁻¹ as (xx, xy, yy), px⁻².
    precision: [f64; 3],
    /// Unit vectors of the two axes, plane.
    axes: [[f64; 2]; 2],
    /// Squared scales along them, plane px².
    variances: [f64; 2],
    /// Pixels per unit of the plane.
    zoom: [f64; 2],
    /// Whether Σ′ is dilated.
    dilated: bool,
    /// ∂o/∂(ln s₁, ln s₂, θ, logit), if the opacity compensates for the dilation.
    compensated: Option<[Rounded; 4]>,
    appearance: Appearance,
}

impl OracleView for Canvas {
    fn has_depth(&self) -> bool {
        false
    }

    fn numbers(&self) -> usize {
        0
    }

    fn check(&self, settings: &RenderSettings) -> Result<(), Error> {
        self.validate()?;
        let effects = settings.effects;
        if effects.order != Order::Index {
            return Err(Error::unsupported("oracle", format!("{effects:?}")));
        }
        if !settings.dropout.is_none() {
            return Err(Error::unsupported("oracle", "dropout in a 2D scene"));
        }
        Ok(())
    }

    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// From units of the plane to pixels of the canvas, and from these to normalised device units.
    fn device_units(&self) -> [f64; 2] {
        [f64::from(self.extent.x) / 2.0, f64::from(self.extent.y) / 2.0]
    }

    fn project(&self, g: &[f64], settings: &RenderSettings, _: Lean) -> Projection {
        let finite_in_f32 = |v: f64| v.abs() <= f64::from(f32::MAX); // NaN fails
        let all_but_logit = g.iter().enumerate().filter(|&(i, _)| i != OPACITY).all(|(_, &v)| finite_in_f32(v));
        if !all_but_logit || g[OPACITY].is_nan() {
            return Projection::Left(CullCause::NotFinite);
        }
        let origin = [f64::from(self.origin.x), f64::from(self.origin.y)];
        let zoom =
            [f64::from(self.width) / f64::from(self.extent.x), f64::from(self.height) / f64::from(self.extent.y)];
        let (sin, cos) = sin_cos(g[ROTATION]);
        let axes = [[cos, sin], [-sin, cos]];
        let variances = [(2.0 * g[2]).exp(), (2.0 * g[3]).exp()];
        // Σ′ᵢⱼ = zoomᵢ zoomⱼ Σₖ varianceₖ axisₖᵢ axisₖⱼ
        let entry = |i: usize, j: usize| {
            zoom[i] * zoom[j] * (variances[0] * axes[0][i] * axes[0][j] + variances[1] * axes[1][i] * axes[1][j])
        };
        let antialias = settings.effects.antialias;
        let dilation = f64::from(antialias.dilation());
        let thin = variances[0] * variances[1] * (zoom[0] * zoom[1]).powi(2);
        let determinant = thin + dilation * (entry(0, 0) + entry(1, 1)) + dilation * dilation;
        let (xx, xy, yy) = (entry(0, 0) + dilation, entry(0, 1), entry(1, 1) + dilation);
        // The product must be finite, too, because backends compute it.
        if ![xx, xy, yy, xx * yy, determinant].into_iter().all(finite_in_f32) {
            return Projection::Left(CullCause::NotFinite);
        }
        if determinant < f64::from(MIN_DETERMINANT_PX4) {
            return Projection::Left(CullCause::Degenerate);
        }
        let center = [0, 1].map(|i| (g[i] - origin[i]) * zoom[i]);
        let stored = 1.0 / (1.0 + (-g[OPACITY]).exp());
        let compensates = matches!(antialias, Antialias::Mip | Antialias::Compensated);
        let compensates = compensates && settings.effects.blend == Blend::Over;
        let opacity = if compensates { stored * (thin / determinant).sqrt() } else { stored };
        // ln ρ = ½ (ln D − ln D′), and D′ = D + δ tr + δ²: ∂(ln ρ)/∂(ln sₖ) = 1 − (D + δ ∂(½
        // tr)/∂(ln sₖ))/D′.
        let compensated = compensates.then(|| {
            let [thin, determinant] = [thin, determinant].map(Rounded::exact);
            let along = |k: usize, l: usize| (0..2).map(|i| zoom[i].powi(2) * axes[k][i] * axes[l][i]).sum::<f64>();
            let [first, second] = [0, 1].map(|k| Rounded::exact(dilation * variances[k] * along(k, k)) / determinant);
            let turned = Rounded::exact(dilation * (variances[0] - variances[1]) * along(0, 1)) / determinant;
            let whole = Rounded::ONE - thin / determinant;
            [whole - first, whole - second, -turned, Rounded::exact(1.0 - stored)]
                .map(|by| Rounded::exact(opacity) * by)
        });
        Projection::Drawable(Box::new(Splat2d {
            center,
            center_rounding: [0, 1]
                .map(|i| F32_ROUNDING * (center[i].abs() + (g[i].abs() + origin[i].abs()) * zoom[i])),
            precision: [yy / determinant, -xy / determinant, xx / determinant],
            axes,
            variances,
            zoom,
            dilated: dilation > 0.0,
            compensated,
            appearance: Appearance {
                opacity,
                opacity_rounding: 0.0, // Among the operations of a weight.
                opacity_slope: if compensates { 1.0 } else { opacity * (1.0 - opacity) },
                color: [g[COLOR], g[COLOR + 1], g[COLOR + 2]],
                color_rounding: [0.0; 3],
                undecided: false,
            },
        }))
    }
}

/// Sine and cosine, 0 within the rounding of the angle: a needle along an axis of the canvas must
/// not gain extent across it.
fn sin_cos(angle: f64) -> (f64, f64) {
    let rounding = f64::EPSILON * angle.abs().min(PI);
    let significant = |v: f64| if v.abs() < rounding { 0.0 } else { v };
    let (sin, cos) = angle.sin_cos();
    (significant(sin), significant(cos))
}

impl Splat for Splat2d {
    /// σ at the pixel centre `p`.
    ///
    /// With q = Σ′⁻¹ d: ∂σ/∂u = −q and ∂σ/∂Σ′ = −½ q qᵀ. Written in 2D, q becomes `zoom · q`;
    /// ∂Σ/∂(ln sₖ) = 2 sₖ² rₖ rₖᵀ and ∂Σ/∂θ = (s₁² − s₂²)(r₁ r₂ᵀ + r₂ r₁ᵀ).
    fn exponent(&self, p: [f64; 2]) -> Exponent {
        let [a, b, c] = self.precision;
        let d = [p[0] - self.center[0], p[1] - self.center[1]];
        let q = [a * d[0] + b * d[1], b * d[0] + c * d[1]];
        let q_magnitude = [a * d[0].abs() + b.abs() * d[1].abs(), b.abs() * d[0].abs() + c * d[1].abs()];
        let sigma_magnitude = 0.5 * (q_magnitude[0] * d[0].abs() + q_magnitude[1] * d[1].abs());
        let moved = (0..2).map(|i| q[i].abs() * (self.center_rounding[i] + F32_ROUNDING * p[i].abs())).sum::<f64>();
        let plane = [q[0] * self.zoom[0], q[1] * self.zoom[1]];
        let plane_magnitude = [q_magnitude[0] * self.zoom[0], q_magnitude[1] * self.zoom[1]];
        // Without dilation the axes are eigenvectors: rₖ · Σ⁻¹ = rₖ / sₖ².
        let along = [0, 1].map(|k| self.axes[k][0] * plane[0] + self.axes[k][1] * plane[1]);
        let along_magnitude = [0, 1].map(|k| {
            if self.dilated {
                return self.axes[k][0].abs() * plane_magnitude[0] + self.axes[k][1].abs() * plane_magnitude[1];
            }
            let [x, y] = [0, 1].map(|i| (self.axes[k][i] * d[i] / self.zoom[i]).abs());
            (x + y) / self.variances[k]
        });
        let [v1, v2] = self.variances;
        let sigma = 0.5 * (q[0] * d[0] + q[1] * d[1]);
        // Backends may sum over pixels in other axes and rotate the sums at the end. A number that
        // is nearly 0 along one axis is then a difference of numbers as large as 2σ.
        let turned = TURNING * 2.0 * sigma;
        let magnitudes = [
            plane_magnitude[0],
            plane_magnitude[1],
            v1 * along_magnitude[0].powi(2) + turned,
            v2 * along_magnitude[1].powi(2) + turned,
            (v1 - v2).abs() * along_magnitude[0] * along_magnitude[1],
        ];
        Exponent {
            sigma,
            rounding: F32_ROUNDING * sigma_magnitude + moved,
            derivatives: [
                -plane[0],
                -plane[1],
                -v1 * along[0] * along[0],
                -v2 * along[1] * along[1],
                -(v1 - v2) * along[0] * along[1],
            ],
            derivative_rounding: magnitudes.map(|magnitude| OPERATIONS * F32_ROUNDING * magnitude),
            displaced: [[0.0; 5]; 2], // The centre is as certain as the terms above.
        }
    }

    fn sigma(&self, p: [f64; 2]) -> f64 {
        let [a, b, c] = self.precision;
        let d = [p[0] - self.center[0], p[1] - self.center[1]];
        0.5 * ((a * d[0] + b * d[1]) * d[0] + (b * d[0] + c * d[1]) * d[1])
    }

    fn appearance(&self) -> &Appearance {
        &self.appearance
    }

    fn depth(&self, _: [f64; 2], _: Order) -> Depth {
        Depth { value: 0.0, rounding: 0.0, origin: [0.0; 8] }
    }

    fn jacobian(&self) -> Vec<[Rounded; 9]> {
        let mut rows: Vec<[Rounded; 9]> =
            (0..9).map(|i| std::array::from_fn(|j| if i == j { Rounded::ONE } else { Rounded::ZERO })).collect();
        // With compensation, the opacity depends on the shape.
        for (parameter, by) in [2, 3, ROTATION, OPACITY].into_iter().zip(self.compensated.into_iter().flatten()) {
            rows[parameter][OPACITY] = by;
        }
        rows
    }

    fn view_jacobian(&self) -> Vec<[Rounded; 9]> {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

    use super::*;

    fn projected(log_scales: [f64; 2], rotation: f64) -> Projection {
        let g = [4.0, 4.0, log_scales[0], log_scales[1], rotation, 0.0, 1.0, 1.0, 1.0];
        Canvas::new(8, 8).project(&g, &RenderSettings::default(), Lean::Exact)
    }

    #[test]
    fn a_product_of_variances_beyond_f32_is_culled() {
        // Rotated by 45°, Σ′xx = Σ′yy = ½ s₁², and det Σ′ = s₁² s₂². Of these the product ¼ s₁⁴ is
        // beyond f32 from s₁ = e^22.5 on, ½ s₁² from e^44.7 on, and det Σ′ from e^64.3 on.
        assert!(matches!(projected([22.0, -20.0], FRAC_PI_4), Projection::Drawable(_)));
        for long in [23.0, 43.0] {
            assert!(matches!(projected([long, -20.0], FRAC_PI_4), Projection::Left(CullCause::NotFinite)));
        }
    }

    #[test]
    fn the_rounding_of_an_angle_adds_no_variance() {
        // s₁² s₂² is finite in f32. With a sine of 10⁻¹⁶ for that of π, Σ′yy would be 10⁶.
        for quarter in -4..=4 {
            let needle = projected([43.75, -0.5], f64::from(quarter) * FRAC_PI_2);
            assert!(matches!(needle, Projection::Drawable(_)), "{quarter}");
        }
    }
}
