//! The splats of the faulty backend, with edits, saving and restoring.

use gs_conformance::{
    oracle::{
        AdamReference, FactoredReference, OPACITY_3D, Oracle, OracleScene, Parameters, Rendering, SH_3D, factored_scene,
    },
    subject::Subject,
};
use gs_core::{AdamRates, Camera, Gaussian3d, Parameterization, Scene, Scene3d};

/// The place of M in a row of covariance factors, column by column.
pub(super) const FACTOR: std::ops::Range<usize> = 3..12;

#[derive(Clone, Default)]
pub(crate) struct Splats {
    pub(super) parameterization: Parameterization,
    pub(super) sh_len: usize,
    /// The scene's parameters or, for covariance factors: mean, columns of M, opacity, SH.
    pub(super) parameters: Vec<Vec<f32>>,
    pub(super) first: Vec<Vec<f32>>,
    pub(super) second: Vec<Vec<f32>>,
    pub(super) steps: Vec<u32>,
    pub(super) signal_sum: Vec<f32>,
    pub(super) visible: Vec<u32>,
    pub(super) losses: Vec<f32>,
    pub(super) last_view: Option<Camera>,
}

pub(crate) struct Pass {
    pub(super) oracle: Oracle<Camera>,
    pub(super) scene: OracleScene,
    pub(super) rendering: Rendering,
}

pub(crate) struct Gradients {
    pub(super) rows: Vec<Parameters>,
    pub(super) statistic: Vec<f64>,
    /// Weight of each value in the statistic.
    pub(super) weight: Vec<u32>,
    pub(super) drawn: Vec<bool>,
}

pub(super) fn narrow(rows: &[Parameters]) -> Vec<Vec<f32>> {
    rows.iter().map(|row| row.iter().map(|&v| v as f32).collect()).collect()
}

pub(super) fn wide(rows: &[Vec<f32>]) -> Vec<Parameters> {
    rows.iter().map(|row| row.iter().map(|&v| f64::from(v)).collect()).collect()
}

pub(super) fn scene_of(rows: &[Vec<f32>], sh_len: usize) -> Scene3d {
    let mut scene = Scene3d { sh_degree: sh_len.isqrt() as u8 - 1, ..Scene3d::default() };
    for row in rows {
        scene.push(Gaussian3d {
            mean: glam::Vec3::from_slice(&row[0..3]),
            log_scale: glam::Vec3::from_slice(&row[3..6]),
            rotation: [row[6], row[7], row[8], row[9]],
            opacity_logit: row[OPACITY_3D],
            sh: row[SH_3D..].chunks_exact(3).map(glam::Vec3::from_slice).collect(),
        });
    }
    scene
}

/// A Gaussian with its covariance factor as a row of parameters.
pub(super) fn factored_row(g: &FactoredReference) -> Vec<f32> {
    let geometry = g.mean.to_array().into_iter().chain(g.factor.to_cols_array());
    geometry.chain(g.rest.iter().copied()).map(|v| v as f32).collect()
}

/// The tensors of parameters in their order in a row, and their columns.
pub(super) fn tensors(parameterization: Parameterization, sh_columns: usize) -> Vec<(&'static str, usize)> {
    let shape: &[_] = match parameterization {
        Parameterization::ScaleRotation => &[("log_scale", 3), ("rotation", 4)],
        Parameterization::CovarianceFactor => &[("factor", 9)],
    };
    [("mean", 3)].iter().chain(shape).chain(&[("opacity_logit", 1), ("sh", sh_columns)]).copied().collect()
}

impl Splats {
    pub(super) fn of(scene: &Scene3d, parameterization: Parameterization) -> Self {
        let empty = Self { parameterization, sh_len: scene.sh_len(), ..Self::default() };
        let parameters: Vec<_> = (0..scene.len()).map(|i| empty.row_of(&scene.gaussian(i))).collect();
        let count = parameters.len();
        let zeros = vec![vec![0.0; empty.moments()]; count];
        Self {
            parameters,
            first: zeros.clone(),
            second: zeros,
            steps: vec![0; count],
            signal_sum: vec![0.0; count],
            visible: vec![0; count],
            ..empty
        }
    }

    /// Numbers of a row of parameters before the opacity.
    pub(super) fn geometry(&self) -> usize {
        if self.parameterization == Parameterization::CovarianceFactor { 12 } else { OPACITY_3D }
    }

    /// Number of moments of a Gaussian.
    pub(super) fn moments(&self) -> usize {
        Scene3d::opacity_moment(self.parameterization) + 1 + 3 * self.sh_len
    }

    pub(super) fn row_of(&self, g: &Gaussian3d) -> Vec<f32> {
        let mut scene = Scene3d { sh_degree: self.sh_len.isqrt() as u8 - 1, ..Scene3d::default() };
        scene.push(g.clone());
        let row = scene.rows().gaussians.remove(0);
        match self.parameterization {
            Parameterization::ScaleRotation => row.iter().map(|&v| v as f32).collect(),
            Parameterization::CovarianceFactor => factored_row(&FactoredReference::new(&row)),
        }
    }

    /// The Gaussians with their covariance factors.
    pub(super) fn factored(&self) -> Vec<FactoredReference> {
        let wide = |row: &[f32]| row.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
        let factored = |g: usize| {
            let row = wide(&self.parameters[g]);
            FactoredReference {
                mean: glam::DVec3::from_slice(&row),
                factor: glam::DMat3::from_cols_slice(&row[FACTOR]),
                rest: row[12..].to_vec(),
                first: wide(&self.first[g]),
                second: wide(&self.second[g]),
                steps: self.steps[g] as i32,
            }
        };
        (0..self.parameters.len()).map(factored).collect()
    }

    /// The Gaussians in the oracle's form.
    pub(super) fn rows(&self) -> OracleScene {
        match self.parameterization {
            Parameterization::ScaleRotation => OracleScene { gaussians: wide(&self.parameters) },
            Parameterization::CovarianceFactor => factored_scene(&self.factored()),
        }
    }

    pub(super) fn forget_moments(&mut self) {
        self.first.iter_mut().chain(&mut self.second).for_each(|row| row.fill(0.0));
    }

    pub(super) fn factors(&mut self, which: &[usize], gradients: &[Parameters], rates: &AdamRates) {
        let mut factored = self.factored();
        for &g in which {
            let row = factored[g].row();
            factored[g].step(&row, &gradients[g], rates);
            self.parameters[g] = factored_row(&factored[g]);
            let narrow = |moments: &[f64]| moments.iter().map(|&v| v as f32).collect();
            (self.first[g], self.second[g]) = (narrow(&factored[g].first), narrow(&factored[g].second));
            self.steps[g] += 1;
        }
    }

    pub(super) fn adam(&mut self, which: &[usize], gradients: &[Parameters], rates: &AdamRates) {
        if self.parameterization == Parameterization::CovarianceFactor {
            return self.factors(which, gradients, rates);
        }
        let steps = self.steps.iter().map(|&s| s as i32).collect();
        let scene = OracleScene { gaussians: wide(&self.parameters) };
        let mut adam = AdamReference::resumed(scene, wide(&self.first), wide(&self.second), steps);
        adam.step_some(which, gradients, rates);
        self.parameters = narrow(&adam.scene.gaussians);
        for g in 0..self.steps.len() {
            let (first, second, steps) = adam.moments(g);
            self.first[g] = first.iter().map(|&v| v as f32).collect();
            self.second[g] = second.iter().map(|&v| v as f32).collect();
            self.steps[g] = steps as u32;
        }
    }
}
