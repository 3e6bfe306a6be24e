//! Gradients of hard scenes, compared with central finite differences of the oracle in `f64` with
//! the smooth cut.
//!
//! Two comparisons: the oracle's gradients must be within [`ORACLE_SHARE`] of its own differences.
//! A backend's must be within [`BACKEND_SHARE`]; it has no smooth cut, and so renders with the
//! smallest hard one. Two uncertainties are added. First, that of the difference quotient: of
//! several step sizes, the one is used whose quotients agree best, and their disagreement is
//! allowed. Second, that of an ill-conditioned function: the oracle's error analysis gives the
//! change of each gradient by one rounding of `f32` in every operation, and [`ROUNDINGS`] of that
//! are allowed. A gradient is ill-conditioned if this exceeds its share. It is still compared, but
//! at most [`ILL_CONDITIONED_SHARE`] of a set may be so.

use gs_core::{Cut, Image, Loss, Optimizer, Parameterization, RenderSettings};
use pollster::FutureExt as _;

use super::case::NEGLIGIBLE;
use crate::{
    failure::Failure,
    oracle::{Gradients, Oracle, OracleScene},
    scenes::Draw,
    subject::Subject,
    tolerance::ROUNDINGS,
};

/// Largest relative difference of the oracle's gradients from difference quotients.
pub const ORACLE_SHARE: f64 = 1e-3;

/// Largest relative difference of a backend's gradients from difference quotients.
pub const BACKEND_SHARE: f64 = 1e-2;

/// Largest share of ill-conditioned gradients of a set. Worst measured: 0.38 with L2 and 0.44 with
/// L1 and D-SSIM, for needles in 3D and 3D Gaussians far outside the field of view.
pub const ILL_CONDITIONED_SHARE: f64 = 0.5;

/// The smallest hard cut: weights below it are less than a rounding.
const FINEST_CUT: f32 = 1e-6;

/// Relative rounding of a loss in `f64`, a sum over pixels.
const LOSS_ROUNDING: f64 = 1e-14;

/// The result of a comparison with difference quotients.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Differences {
    /// Number of compared gradients.
    pub compared: usize,
    /// Number of ill-conditioned gradients.
    pub ill_conditioned: usize,
    /// The largest relative difference of the other numbers.
    pub worst: f64,
}

impl Differences {
    /// The sum of two results.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            compared: self.compared + other.compared,
            ill_conditioned: self.ill_conditioned + other.ill_conditioned,
            worst: self.worst.max(other.worst),
        }
    }

    /// Fails if too many gradients are ill-conditioned.
    ///
    /// # Errors
    /// [`Failure::Nothing`].
    pub fn means_something(self) -> Result<(), Failure> {
        let most = ILL_CONDITIONED_SHARE * self.compared as f64;
        if self.compared > 0 && self.ill_conditioned as f64 <= most {
            return Ok(());
        }
        Err(Failure::Nothing(format!("{} of {} gradients are ill-conditioned", self.ill_conditioned, self.compared)))
    }
}

/// The difference quotients of one drawing by all parameters of all Gaussians.
#[derive(Debug, Clone)]
pub struct Quotients<S: Subject> {
    draw: Draw<S>,
    loss: Loss,
    target: Image,
    /// The oracle's gradients with their uncertainty.
    analysis: Gradients,
    /// `[N]` rows; `None` for infinite parameters.
    rows: Vec<Vec<Option<Quotient>>>,
}

impl<S: Subject> Quotients<S> {
    /// The difference quotients of a drawing's loss.
    ///
    /// # Errors
    /// Errors of the oracle.
    pub fn new(draw: Draw<S>, loss: Loss) -> Result<Self, Failure> {
        let oracle = Oracle::new(draw.view, smooth(draw.settings))?;
        let (target, scene) = (draw.target()?, draw.scene.rows());
        let analysis = oracle.gradients(&scene, &target, &loss)?;
        let mut rows = Vec::new();
        for (g, row) in scene.gaussians.iter().enumerate() {
            let mut quotients = Vec::new();
            for (i, value) in row.iter().enumerate() {
                let quotient = || Quotient::of(&oracle, &scene, &target, &loss, (g, i));
                quotients.push(value.is_finite().then(quotient).transpose()?);
            }
            rows.push(quotients);
        }
        Ok(Self { draw, loss, target, analysis, rows })
    }

    /// Compares the oracle's gradients with the quotients.
    ///
    /// # Errors
    /// [`Failure::Differs`] with the first that differs too much.
    pub fn check_oracle(&self) -> Result<Differences, Failure> {
        self.compare(&self.analysis.values, (ORACLE_SHARE, 0.0))
    }

    /// Compares a backend's gradients with the quotients.
    ///
    /// # Errors
    /// [`Failure::Differs`] with the first that differs too much; errors of the backend.
    pub fn check_backend<R: Optimizer<S>>(&self, rasterizer: &R) -> Result<Differences, Failure> {
        let mut settings = smooth(self.draw.settings);
        (settings.accuracy.cut, settings.accuracy.alpha_cut) = (Cut::Hard, FINEST_CUT);
        let splats = rasterizer.upload(&self.draw.scene, Parameterization::ScaleRotation)?;
        let pass = rasterizer.forward(&splats, &self.draw.view, &settings).block_on()?;
        let target = rasterizer.upload_target(&self.target)?;
        let (_, gradients) = rasterizer.backward(&splats, pass, &target, &self.loss).block_on()?;
        let found = rasterizer.gradients(&splats, &gradients).block_on()?.rows_of_gradients();
        self.compare(&found, (BACKEND_SHARE, ROUNDINGS))
    }

    /// `share` and `roundings` are the tolerance: relative, and in roundings of the analysis.
    fn compare(&self, found: &[Vec<f64>], (share, roundings): (f64, f64)) -> Result<Differences, Failure> {
        let Self { analysis, rows, .. } = self;
        let mut differences = Differences::default();
        for (g, row) in rows.iter().enumerate() {
            let size = analysis.values[g].iter().fold(0.0f64, |most, v| most.max(v.abs()));
            for (i, quotient) in row.iter().enumerate() {
                let Some(quotient) = quotient else { continue };
                let scale = quotient.value.abs().max(NEGLIGIBLE * size).max(1e-12);
                let uncertain = quotient.uncertainty + roundings * analysis.rounding[g][i] + analysis.flip[g][i];
                let off = (found[g][i] - quotient.value).abs();
                if !(off <= share * scale + uncertain) {
                    let what = format!("gradient of Gaussian {g}, {}", S::parameter_name(i));
                    let (expected, tolerance) = (quotient.value, share * scale + uncertain);
                    return Err(Failure::Differs { what, expected, found: found[g][i], tolerance, others: 0 });
                }
                differences.compared += 1;
                if uncertain > share * scale {
                    differences.ill_conditioned += 1;
                } else {
                    differences.worst = differences.worst.max(off / scale);
                }
            }
        }
        Ok(differences)
    }
}

/// Differentiable settings: no cut, never full.
fn smooth(mut settings: RenderSettings) -> RenderSettings {
    settings.accuracy.cut = Cut::Smooth;
    settings.accuracy.transmittance_min = 0.0;
    settings
}

/// A central difference quotient with its uncertainty.
#[derive(Debug, Clone, Copy)]
struct Quotient {
    value: f64,
    uncertainty: f64,
}

impl Quotient {
    /// The quotient by entry `i` of Gaussian `g`, for the step size at which the quotients of a
    /// step and half the step agree best. Their difference is three quarters of the larger one's
    /// error, so subtracting a third of it from the smaller one gives fourth order (Richardson).
    fn of(
        oracle: &Oracle,
        scene: &OracleScene,
        target: &Image,
        loss: &Loss,
        (g, i): (usize, usize),
    ) -> Result<Self, Failure> {
        let mut nudged = scene.clone();
        let place = scene.gaussians[g][i];
        let mut at = |step: f64| {
            nudged.gaussians[g][i] = place + step;
            oracle.loss(&nudged, target, loss)
        };
        let height = at(0.0)?.abs();
        let mut best = Self { value: 0.0, uncertainty: f64::INFINITY };
        for exponent in [3, 5, 7, 9, 11] {
            let step = 10f64.powi(-exponent) * place.abs().max(1.0);
            let (whole, half) = ((at(step)? - at(-step)?) / (2.0 * step), (at(0.5 * step)? - at(-0.5 * step)?) / step);
            let uncertainty = (whole - half).abs() + LOSS_ROUNDING * height / step;
            if uncertainty < best.uncertainty {
                best = Self { value: half + (half - whole) / 3.0, uncertainty };
            }
        }
        Ok(best)
    }
}
