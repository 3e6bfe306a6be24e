//! Adam in `f64` (Kingma & Ba 2015, algorithm 1) with a step count per Gaussian: the reference for
//! a backend's stage `adam`.

use gs_core::adam::{AdamRates, Rate};

use crate::oracle::{
    COLOR, OPACITY, OPACITY_3D, OracleScene, PARAMETER_NAMES, Parameters, QUATERNION, ROTATION, SH_3D,
};

/// Parameters and moments of every Gaussian in the parameterization of ln-scale and rotation.
#[derive(Debug, Clone, PartialEq)]
pub struct AdamReference {
    /// The parameters.
    pub scene: OracleScene,
    first: Vec<Parameters>,
    second: Vec<Parameters>,
    steps: Vec<i32>,
}

impl AdamReference {
    /// Starts at a scene with zero moments.
    pub fn new(scene: OracleScene) -> Self {
        let zeros: Vec<Parameters> = scene.gaussians.iter().map(|g| vec![0.0; g.len()]).collect();
        Self { steps: vec![0; zeros.len()], first: zeros.clone(), second: zeros, scene }
    }

    /// Starts at a scene with these moments and step counts.
    pub fn resumed(scene: OracleScene, first: Vec<Parameters>, second: Vec<Parameters>, steps: Vec<i32>) -> Self {
        Self { scene, first, second, steps }
    }

    /// Appends a Gaussian with zero moments.
    pub fn push(&mut self, gaussian: Parameters) {
        self.first.push(vec![0.0; gaussian.len()]);
        self.second.push(vec![0.0; gaussian.len()]);
        self.steps.push(0);
        self.scene.gaussians.push(gaussian);
    }

    /// Moves all Gaussians by one step.
    pub fn step(&mut self, gradients: &[Parameters], rates: &AdamRates) {
        let all: Vec<usize> = (0..self.steps.len()).collect();
        self.step_some(&all, gradients, rates);
    }

    /// Moves some Gaussians by one step, by index. The others keep their step counts, too.
    pub fn step_some(&mut self, which: &[usize], gradients: &[Parameters], rates: &AdamRates) {
        let (floor, ceiling) = (f64::from(rates.min_scale).ln(), f64::from(rates.max_scale).ln());
        for &g in which {
            self.steps[g] += 1;
            let length = gradients[g].len();
            for i in 0..length {
                let steps = self.steps[g];
                let Rate { learning_rate, beta1, beta2 } = *rate_of(i, length, rates);
                let [rate, beta1, beta2] = [learning_rate, beta1, beta2].map(f64::from);
                let gradient = gradients[g][i];
                self.first[g][i] = beta1 * self.first[g][i] + (1.0 - beta1) * gradient;
                self.second[g][i] = beta2 * self.second[g][i] + (1.0 - beta2) * gradient * gradient;
                let first = self.first[g][i] / (1.0 - beta1.powi(steps));
                let second = self.second[g][i] / (1.0 - beta2.powi(steps));
                let value = &mut self.scene.gaussians[g][i];
                *value -= rate * first / (second.sqrt() + f64::from(rates.epsilon));
                if scales(length).contains(&i) {
                    *value = value.clamp(floor, ceiling);
                }
            }
        }
    }

    /// First moments, second moments and step count of a Gaussian.
    pub fn moments(&self, index: usize) -> (&Parameters, &Parameters, i32) {
        (&self.first[index], &self.second[index], self.steps[index])
    }
}

/// The indices of the ln-scales in a row of `length`.
fn scales(length: usize) -> std::ops::Range<usize> {
    if length == PARAMETER_NAMES.len() { 2..ROTATION } else { 3..QUATERNION }
}

/// Whether parameter `index` of a row of `length` is an SH coefficient above degree 0.
fn is_color_rest(index: usize, length: usize) -> bool {
    length != PARAMETER_NAMES.len() && index >= SH_3D + 3
}

/// The rate for parameter `index` of a row of `length`.
pub fn rate_of(index: usize, length: usize, rates: &AdamRates) -> &Rate {
    if length == PARAMETER_NAMES.len() {
        return match index {
            0 | 1 => &rates.mean,
            2 | 3 => &rates.scale,
            ROTATION => &rates.rotation,
            OPACITY => &rates.opacity,
            COLOR.. => &rates.color,
        };
    }
    match index {
        0..3 => &rates.mean,
        3..QUATERNION => &rates.scale,
        QUATERNION..OPACITY_3D => &rates.rotation,
        OPACITY_3D => &rates.opacity,
        _ if is_color_rest(index, length) => &rates.color_rest,
        _ => &rates.color,
    }
}
