//! The splats of the faulty backend, with edits, saving and restoring.

use gs_conformance::{
    adam_reference::AdamReference,
    oracle::{OPACITY_3D, Oracle, OracleScene, Parameters, Rendering, SH_3D},
    subject::Subject,
};
use gs_core::{AdamRates, Camera, CameraGradient, Gaussian3d, Scene, Scene3d};

#[derive(Clone, Default)]
pub(crate) struct Splats {
    pub(super) sh_len: usize,
    /// The scene's parameters.
    pub(super) parameters: Vec<Vec<f32>>,
    pub(super) first: Vec<Vec<f32>>,
    pub(super) second: Vec<Vec<f32>>,
    pub(super) steps: Vec<u32>,
    pub(super) signal_sum: Vec<f32>,
    pub(super) visible: Vec<u32>,
    pub(super) losses: Vec<f32>,
    pub(super) camera_gradients: Vec<CameraGradient>,
    pub(super) last_view: Option<Camera>,
}

pub(crate) struct Pass {
    pub(super) view: Camera,
    pub(super) oracle: Oracle,
    pub(super) scene: OracleScene,
    pub(super) rendering: Rendering,
}

pub(crate) struct Gradients {
    pub(super) rows: Vec<Parameters>,
    pub(super) statistic: Vec<f64>,
    /// Weight of each value in the statistic.
    pub(super) weight: Vec<u32>,
    pub(super) drawn: Vec<bool>,
    /// The gradient by the camera, if it was asked for.
    pub(super) camera: Option<CameraGradient>,
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

/// The tensors of parameters in their order in a row, and their columns.
pub(super) fn tensors(sh_columns: usize) -> [(&'static str, usize); 5] {
    [("mean", 3), ("log_scale", 3), ("rotation", 4), ("opacity_logit", 1), ("sh", sh_columns)]
}

impl Splats {
    pub(super) fn of(scene: &Scene3d) -> Self {
        let empty = Self { sh_len: scene.sh_len(), ..Self::default() };
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

    /// Number of moments of a Gaussian.
    pub(super) fn moments(&self) -> usize {
        Scene3d::OPACITY_MOMENT + 1 + 3 * self.sh_len
    }

    pub(super) fn row_of(&self, g: &Gaussian3d) -> Vec<f32> {
        let mut scene = Scene3d { sh_degree: self.sh_len.isqrt() as u8 - 1, ..Scene3d::default() };
        scene.push(g.clone());
        scene.rows().gaussians[0].iter().map(|&v| v as f32).collect()
    }

    /// The Gaussians in the oracle's form.
    pub(super) fn rows(&self) -> OracleScene {
        OracleScene { gaussians: wide(&self.parameters) }
    }

    pub(super) fn forget_moments(&mut self) {
        self.first.iter_mut().chain(&mut self.second).for_each(|row| row.fill(0.0));
    }

    pub(super) fn adam(&mut self, which: &[usize], gradients: &[Parameters], rates: &AdamRates) {
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
