//! A solver that follows the paper's formulas literally, in `f32` and without this project's
//! guards. It exists for [`super::instability`] only.
//!
//! Σ = R S Sᵀ Rᵀ is multiplied out (paper eq. 7), inverted by its determinant a·c − b², and blended
//! front to back (eq. 2); Adam moves the scales themselves, not their logarithms (§3.2: "a 2D
//! scaling vector"). Each of these loses digits, which gs-cpu avoids. It is dense and visits pixel
//! after pixel, for small images.

use gs_core::{Gaussian2d, Image, Scene2d, sigmoid};

/// Guards against vanishing scales.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Guards {
    /// Minimum scale after a step, px; `None` without a clamp.
    pub(super) min_scale_px: Option<f32>,
    /// Number added to the determinant of Σ, px⁴.
    pub(super) epsilon_px4: f32,
}

/// Step sizes of Adam, those of [`Adam::default`](gs_core::Adam). The one for scales, which here
/// are in px and not logarithms, is a setting.
const RATES: [f32; PARAMETERS] = [0.2, 0.2, 0.0, 0.0, 0.02, 0.05, 0.01, 0.01, 0.01];

/// Parameters of a Gaussian: mean x, y; scale 1, 2; rotation; opacity logit; colour.
const PARAMETERS: usize = 9;
const S1: usize = 2;
const S2: usize = 3;
const ANGLE: usize = 4;
const LOGIT: usize = 5;
const COLOR: usize = 6;

type Parameters = [f32; PARAMETERS];

/// A fit by this solver.
#[derive(Debug, Clone)]
pub(super) struct Textbook {
    gaussians: Vec<Parameters>,
    first: Vec<Parameters>,
    second: Vec<Parameters>,
    step: i32,
    guards: Guards,
    rates: [f32; PARAMETERS],
    background: [f32; 3],
}

/// The result of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// Mean |C − Y| before the step.
    pub(super) loss: f32,
    /// The smallest |scale| before the step, px.
    pub(super) smallest_scale_px: f32,
    /// Whether all gradients are finite.
    pub(super) has_finite_gradients: bool,
}

/// Σ⁻¹ by the determinant, as (xx, xy, yy), px⁻².
fn inverse_covariance(s1: f32, s2: f32, angle: f32, epsilon: f32) -> [f32; 3] {
    let [a, b, c] = covariance(s1, s2, angle);
    let determinant = a * c - b * b + epsilon;
    [c / determinant, -b / determinant, a / determinant]
}

/// Σ as (xx, xy, yy), px².
pub(super) fn covariance(s1: f32, s2: f32, angle: f32) -> [f32; 3] {
    let (sin, cos) = angle.sin_cos();
    let (v1, v2) = (s1 * s1, s2 * s2);
    [v1 * cos * cos + v2 * sin * sin, (v1 - v2) * sin * cos, v1 * sin * sin + v2 * cos * cos]
}

impl Textbook {
    /// Starts with a scene; `scale_rate_px` is Adam's step size for scales.
    pub(super) fn new(scene: &Scene2d, background: [f32; 3], guards: Guards, scale_rate_px: f32) -> Self {
        let mut rates = RATES;
        rates[S1..=S2].fill(scale_rate_px);
        let gaussians: Vec<Parameters> = scene.iter().map(|g| parameters(&g)).collect();
        let zeros = vec![[0.0; PARAMETERS]; gaussians.len()];
        Self { first: zeros.clone(), second: zeros, gaussians, step: 0, guards, rates, background }
    }

    /// Clamps the scales as after a step.
    pub(super) fn clamped(mut self) -> Self {
        self.clamp();
        self
    }

    /// Renders the present scene.
    pub(super) fn render(&self, width: u32, height: u32) -> Result<Image, gs_core::Error> {
        let conics = self.conics();
        let mut layers = vec![Layer::default(); self.gaussians.len()];
        Image::from_fn(width, height, |x, y| self.pixel(&conics, [x as f32 + 0.5, y as f32 + 0.5], &mut layers))
    }

    /// One step of Adam on the mean absolute difference from `target`.
    pub(super) fn step(&mut self, target: &Image) -> Step {
        let conics = self.conics();
        let mut gradients = vec![[0.0f32; PARAMETERS]; self.gaussians.len()];
        let mut layers = vec![Layer::default(); self.gaussians.len()];
        let per_value = 1.0 / (3.0 * target.pixels().len() as f32);
        let mut loss = 0.0;
        let width = target.width() as usize;
        for (index, wanted) in target.pixels().iter().enumerate() {
            let at = [(index % width) as f32 + 0.5, (index / width) as f32 + 0.5];
            let color = self.pixel(&conics, at, &mut layers);
            let v_color = [0, 1, 2].map(|k| {
                let difference = color[k] - wanted[k];
                loss += difference.abs() * per_value;
                // The sign; NaN stays NaN.
                if difference == 0.0 { 0.0 } else { difference / difference.abs() * per_value }
            });
            self.pixel_bwd(v_color, &layers, &mut gradients);
        }
        let smallest_scale_px = self.smallest_scale_px();
        let has_finite_gradients = gradients.iter().flatten().all(|v| v.is_finite());
        self.adam(&gradients);
        Step { loss, smallest_scale_px, has_finite_gradients }
    }

    /// The smallest |scale| of the present scene, px.
    pub(super) fn smallest_scale_px(&self) -> f32 {
        self.gaussians.iter().flat_map(|g| [g[S1].abs(), g[S2].abs()]).fold(f32::INFINITY, f32::min)
    }

    fn conics(&self) -> Vec<[f32; 3]> {
        let conic = |g: &Parameters| inverse_covariance(g[S1], g[S2], g[ANGLE], self.guards.epsilon_px4);
        self.gaussians.iter().map(conic).collect()
    }

    /// The colour of the pixel centred at `p`, and each Gaussian's contribution.
    fn pixel(&self, conics: &[[f32; 3]], p: [f32; 2], layers: &mut [Layer]) -> [f32; 3] {
        let (mut color, mut transmittance) = ([0.0f32; 3], 1.0f32);
        for ((g, [a, b, c]), layer) in self.gaussians.iter().zip(conics).zip(layers) {
            let d = [p[0] - g[0], p[1] - g[1]];
            let q = [a * d[0] + b * d[1], b * d[0] + c * d[1]];
            let weight = (-0.5 * (q[0] * d[0] + q[1] * d[1])).exp();
            let alpha = sigmoid(g[LOGIT]) * weight;
            *layer = Layer { q, alpha, transmittance };
            for k in 0..3 {
                color[k] += transmittance * alpha * g[COLOR + k];
            }
            transmittance *= 1.0 - alpha;
        }
        for k in 0..3 {
            color[k] += transmittance * self.background[k];
        }
        color
    }

    /// Adds the gradients of a pixel, from the last Gaussian to the first, which needs no division
    /// by 1 − α.
    fn pixel_bwd(&self, v_color: [f32; 3], layers: &[Layer], gradients: &mut [Parameters]) {
        let mut behind = self.background;
        for ((g, layer), v) in self.gaussians.iter().zip(layers).zip(gradients).rev() {
            let Layer { q, alpha, transmittance } = *layer;
            let (mut v_alpha, opacity) = (0.0, sigmoid(g[LOGIT]));
            for k in 0..3 {
                v_alpha += transmittance * (g[COLOR + k] - behind[k]) * v_color[k];
                v[COLOR + k] += transmittance * alpha * v_color[k];
                behind[k] = alpha * g[COLOR + k] + (1.0 - alpha) * behind[k];
            }
            // α = o exp(−σ), and ∂σ/∂Σ = −½ q qᵀ with q = Σ⁻¹ d.
            let v_sigma = -alpha * v_alpha;
            let (sin, cos) = g[ANGLE].sin_cos();
            let along = [cos * q[0] + sin * q[1], cos * q[1] - sin * q[0]];
            v[0] -= v_sigma * q[0];
            v[1] -= v_sigma * q[1];
            v[S1] -= v_sigma * g[S1] * along[0] * along[0];
            v[S2] -= v_sigma * g[S2] * along[1] * along[1];
            v[ANGLE] -= v_sigma * (g[S1] * g[S1] - g[S2] * g[S2]) * along[0] * along[1];
            v[LOGIT] += alpha * v_alpha * (1.0 - opacity);
        }
    }

    fn adam(&mut self, gradients: &[Parameters]) {
        const BETA1: f32 = 0.9;
        const BETA2: f32 = 0.999;
        self.step += 1;
        let (bias1, bias2) = (1.0 - BETA1.powi(self.step), 1.0 - BETA2.powi(self.step));
        for (i, v) in gradients.iter().enumerate() {
            for k in 0..PARAMETERS {
                let (m1, m2) = (&mut self.first[i][k], &mut self.second[i][k]);
                *m1 = BETA1 * *m1 + (1.0 - BETA1) * v[k];
                *m2 = BETA2 * *m2 + (1.0 - BETA2) * v[k] * v[k];
                self.gaussians[i][k] -= self.rates[k] * (*m1 / bias1) / ((*m2 / bias2).sqrt() + 1e-15);
            }
        }
        self.clamp();
    }

    fn clamp(&mut self) {
        if let Some(least) = self.guards.min_scale_px {
            for scale in self.gaussians.iter_mut().flat_map(|g| &mut g[S1..=S2]) {
                *scale = scale.max(least);
            }
        }
    }
}

/// The contribution of a Gaussian at a pixel.
#[derive(Debug, Clone, Copy, Default)]
struct Layer {
    /// Σ⁻¹ d, px⁻¹.
    q: [f32; 2],
    alpha: f32,
    /// The transmittance before it.
    transmittance: f32,
}

fn parameters(g: &Gaussian2d) -> Parameters {
    let scale = g.log_scale.map(f32::exp);
    let [r, green, b] = g.color.to_array();
    [g.mean.x, g.mean.y, scale.x, scale.y, g.rotation, g.opacity_logit, r, green, b]
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};

    use super::*;

    /// Two Gaussians for which every parameter matters.
    fn scene() -> Scene2d {
        let gaussian = |x: f32, rotation: f32, color: Vec3| Gaussian2d {
            mean: Vec2::new(x, 5.3),
            log_scale: Vec2::new(1.1, 0.4),
            rotation,
            opacity_logit: 0.6,
            color,
        };
        [gaussian(4.2, 0.4, Vec3::new(0.9, 0.2, 0.1)), gaussian(6.9, -0.7, Vec3::new(0.1, 0.5, 0.8))]
            .into_iter()
            .collect()
    }

    #[test]
    fn gradients_are_those_of_finite_differences() {
        let target = Image::filled(11, 10, [2.0, -1.0, 3.0]).unwrap(); // so far away that no difference changes its sign
        let textbook = Textbook::new(&scene(), [1.0; 3], Guards { min_scale_px: None, epsilon_px4: 0.0 }, 0.05);
        let loss = |fit: &Textbook| {
            let image = fit.render(11, 10).unwrap();
            gs_core::metrics::mean_absolute_error(&image, &target).unwrap()
        };
        // After the first step, Adam's first moment is 0.1 of the gradient.
        let mut stepped = textbook.clone();
        stepped.step(&target);
        for i in 0..2 {
            for k in 0..PARAMETERS {
                let moved = |by: f32| {
                    let mut fit = textbook.clone();
                    fit.gaussians[i][k] += by;
                    loss(&fit)
                };
                let numeric = (moved(1e-2) - moved(-1e-2)) / 2e-2;
                let found = f64::from(stepped.first[i][k]) / 0.1;
                assert!((found - numeric).abs() < 2e-4 * numeric.abs() + 2e-6, "{i} {k}: {found} against {numeric}");
            }
        }
    }
}
