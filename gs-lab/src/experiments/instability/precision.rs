//! The precision of a determinant in `f32` as one scale goes to zero.

use glam::Mat2;

use super::guard::NEEDLE_PX;
use super::textbook::covariance;

/// The precision of a determinant in `f32`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Precision {
    /// Determinants by falling short scale.
    pub(super) determinants: Vec<Determinant>,
    /// The largest short scale at which a·c − b² is off by more than a tenth, px.
    pub(super) wrong_below_px: f64,
    /// The largest short scale at which it is not positive, px; Σ is then not a covariance.
    pub(super) singular_below_px: f64,
}

/// The determinant of a needle's covariance, the worst over many angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Determinant {
    /// The short scale, px.
    pub(super) short_px: f64,
    /// Relative error of a·c − b² of Σ.
    pub(super) of_covariance: f64,
    /// Relative error of the squared determinant of the covariance factor R S.
    pub(super) of_factor: f64,
    /// Whether a·c − b² is positive at all angles.
    pub(super) is_positive: bool,
}

impl Precision {
    /// The precision for a Gaussian of 10 px.
    pub(super) fn of_needle() -> Self {
        let determinants: Vec<_> = (0..=48).map(|i| Determinant::of_needle(10f32.powf(-(i as f32) / 8.0))).collect();
        let first = |is_so: &dyn Fn(&Determinant) -> bool| {
            determinants.iter().find(|&determinant| is_so(determinant)).map_or(0.0, |determinant| determinant.short_px)
        };
        Self {
            wrong_below_px: first(&|determinant| determinant.of_covariance > 0.1),
            singular_below_px: first(&|determinant| !determinant.is_positive),
            determinants,
        }
    }
}

impl Determinant {
    fn of_needle(short_px: f32) -> Self {
        let exact = f64::from(NEEDLE_PX).powi(2) * f64::from(short_px).powi(2);
        let error = |found: f32| (f64::from(found) - exact).abs() / exact;
        let mut worst = Self { short_px: short_px.into(), of_covariance: 0.0, of_factor: 0.0, is_positive: true };
        for angle in (0..32).map(|i| 0.05 + i as f32 * 0.093) {
            let [a, b, c] = covariance(NEEDLE_PX, short_px, angle);
            let determinant = a * c - b * b;
            let rotation = Mat2::from_angle(angle);
            let factor = Mat2::from_cols(rotation.x_axis * NEEDLE_PX, rotation.y_axis * short_px);
            worst.of_covariance = worst.of_covariance.max(error(determinant));
            worst.of_factor = worst.of_factor.max(error(factor.determinant().powi(2)));
            worst.is_positive &= determinant > 0.0;
        }
        worst
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factor_keeps_the_digits_that_the_covariance_loses() {
        let precision = Precision::of_needle();
        assert!((1e-3..0.1).contains(&precision.wrong_below_px), "{precision:?}");
        assert!((1e-4..precision.wrong_below_px).contains(&precision.singular_below_px), "{precision:?}");
        assert!(precision.determinants.iter().all(|determinant| determinant.of_factor < 1e-5), "{precision:?}");
        // A determinant that is not positive has an error of at least 1.
        let singular = precision.determinants.iter().filter(|determinant| !determinant.is_positive);
        assert!(singular.clone().count() > 0 && singular.clone().all(|d| d.of_covariance >= 1.0), "{precision:?}");
    }
}
