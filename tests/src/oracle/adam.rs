//! Adam in `f64` from Kingma & Ba 2015, algorithm 1, with a step count per Gaussian: what a backend's stage `adam` is held against.

use gs_core::adam::{AdamRates, Rate};

use super::parameters::{OPACITY, OracleScene, Parameters, ROTATION};

/// Parameters and moments of every Gaussian in the chart of ln-scale and rotation.
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
        let count = scene.gaussians.len();
        Self { scene, first: vec![[0.0; 9]; count], second: vec![[0.0; 9]; count], steps: vec![0; count] }
    }

    /// Appends a Gaussian with zero moments.
    pub fn push(&mut self, gaussian: Parameters) {
        self.scene.gaussians.push(gaussian);
        self.first.push([0.0; 9]);
        self.second.push([0.0; 9]);
        self.steps.push(0);
    }

    /// One step of all Gaussians.
    pub fn step(&mut self, gradients: &[Parameters], rates: &AdamRates) {
        let all: Vec<usize> = (0..self.steps.len()).collect();
        self.step_some(&all, gradients, rates);
    }

    /// One step of some Gaussians, by index; the others keep even their step counts.
    pub fn step_some(&mut self, which: &[usize], gradients: &[Parameters], rates: &AdamRates) {
        let (floor, ceiling) = (f64::from(rates.min_scale).ln(), f64::from(rates.max_scale).ln());
        for &g in which {
            self.steps[g] += 1;
            for i in 0..9 {
                let Rate { learning_rate, beta1, beta2 } = *rate_of(i, rates);
                let [rate, beta1, beta2] = [learning_rate, beta1, beta2].map(f64::from);
                let gradient = gradients[g][i];
                self.first[g][i] = beta1 * self.first[g][i] + (1.0 - beta1) * gradient;
                self.second[g][i] = beta2 * self.second[g][i] + (1.0 - beta2) * gradient * gradient;
                let first = self.first[g][i] / (1.0 - beta1.powi(self.steps[g]));
                let second = self.second[g][i] / (1.0 - beta2.powi(self.steps[g]));
                let value = &mut self.scene.gaussians[g][i];
                *value -= rate * first / (second.sqrt() + f64::from(rates.epsilon));
                if i == 2 || i == 3 {
                    *value = value.clamp(floor, ceiling);
                }
            }
        }
    }
}

/// The rate of the group that parameter `index` belongs to.
pub(crate) fn rate_of(index: usize, rates: &AdamRates) -> &Rate {
    match index {
        0 | 1 => &rates.mean,
        2 | 3 => &rates.scale,
        ROTATION => &rates.rotation,
        OPACITY => &rates.opacity,
        _ => &rates.color,
    }
}
