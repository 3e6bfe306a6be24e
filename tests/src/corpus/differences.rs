//! Gradients of hard scenes against central finite differences of the oracle, in `f64` and with the smooth cut.
//!
//! Two questions. Are the oracle's derivatives those of its own loss: within [`ORACLE_SHARE`]? Are a backend's: within [`BACKEND_SHARE`], where
//! the backend, which has no smooth cut, renders with the smallest hard one there is? Two things are taken into account beside that share. A
//! difference quotient is itself uncertain: of a ladder of steps the one is taken on which two of them agree best, and by how much they
//! disagree is allowed for. And the function may be ill-conditioned: then not the derivative, but the rounding of numbers on the way to it
//! decides. The oracle's running error analysis says by how much one rounding of `f32` in every operation may change each gradient, and
//! [`ROUNDINGS`] of that are allowed for. A gradient of which that is more than its share is counted as ill-conditioned: it is compared, but
//! says little, and no more than [`ILL_CONDITIONED_SHARE`] of a set of scenes may be so.

use gs_core::{Image, Loss, Optimizer, Parameterization, RenderSettings, settings::Cut};
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

/// Largest share of a set's gradients that may be uncertain by more than their own share. Worst measured: 0.38 with L2 and 0.44
/// with L1 and D-SSIM, of needles in 3D and of 3D Gaussians far beyond the field of view.
pub const ILL_CONDITIONED_SHARE: f64 = 0.5;

/// The smallest hard cut: what is below it in a smooth one is less than a rounding beside what is above.
const FINEST_CUT: f32 = 1e-6;

/// Relative rounding of a loss in `f64`, a sum over pixels.
const LOSS_ROUNDING: f64 = 1e-14;

/// How a set of gradients compares with difference quotients.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Differences {
    /// Gradients compared.
    pub compared: usize,
    /// Those of them whose uncertainty is more than their share.
    pub ill_conditioned: usize,
    /// The largest relative difference of those that are not.
    pub worst: f64,
}

impl Differences {
    /// Both together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            compared: self.compared + other.compared,
            ill_conditioned: self.ill_conditioned + other.ill_conditioned,
            worst: self.worst.max(other.worst),
        }
    }

    /// Fails where a set of scenes says too little.
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

/// The difference quotients of one drawing, by all parameters of all Gaussians, to hold any number of backends against.
#[derive(Debug, Clone)]
pub struct Quotients<S: Subject> {
    draw: Draw<S>,
    loss: Loss,
    target: Image,
    /// The oracle's own gradients, and what it says about rounding.
    analysis: Gradients,
    /// `[N]` rows; none by a parameter that is infinite.
    rows: Vec<Vec<Option<Quotient>>>,
}

impl<S: Subject> Quotients<S> {
    /// Those of a drawing's loss.
    ///
    /// # Errors
    /// What the oracle refuses.
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

    /// Holds the oracle's gradients against them.
    ///
    /// # Errors
    /// [`Failure::Differs`] naming the first that is too far off.
    pub fn check_oracle(&self) -> Result<Differences, Failure> {
        self.compare(&self.analysis.values, (ORACLE_SHARE, 0.0))
    }

    /// Holds a backend's gradients against them.
    ///
    /// # Errors
    /// [`Failure::Differs`] naming the first that is too far off; what the backend refuses.
    pub fn check_backend<R: Optimizer<S>>(&self, rasterizer: &R) -> Result<Differences, Failure> {
        let mut settings = smooth(self.draw.settings);
        (settings.accuracy.cut, settings.accuracy.alpha_cut) = (Cut::Hard, FINEST_CUT);
        let splats = rasterizer.upload(&self.draw.scene, Parameterization::ScaleRotation)?;
        let frame = rasterizer.forward(&splats, &self.draw.view, &settings).block_on()?;
        let target = rasterizer.upload_target(&self.target)?;
        let (_, gradients) = rasterizer.backward(&splats, frame, &target, &self.loss).block_on()?;
        let found = rasterizer.gradients(&splats, &gradients).block_on()?.rows_of_gradients();
        self.compare(&found, (BACKEND_SHARE, ROUNDINGS))
    }

    /// `share`, `roundings`: what a gradient may be off by, relative, and in roundings of the analysis.
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

/// A central difference quotient, and how far it is to be believed.
#[derive(Debug, Clone, Copy)]
struct Quotient {
    value: f64,
    uncertainty: f64,
}

impl Quotient {
    /// By entry `i` of Gaussian `g`: of a ladder of steps the one on which a quotient and that of half the step agree best. Their difference is
    /// three quarters of the larger's error, so the smaller's less a third of it is of fourth order (Richardson).
    fn of<V: crate::oracle::OracleView>(
        oracle: &Oracle<V>,
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
