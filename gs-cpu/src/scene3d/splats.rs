//! 3D splats: one row of numbers per Gaussian, with edits, saving and restoring.
//!
//! A row holds mean 3, log-scale 3, rotation 4, two unused numbers, opacity logit, then the SH
//! coefficients, R, G, B each. Zeros fill it to whole vectors. A Gaussian is thus a few neighbouring
//! cache lines, and Adam moves most of a row without regard to its meaning.

use std::ops::Range;

use glam::{Mat3, Vec3};
use gs_core::{
    DensityStatistics, EditPlan, Error, Gaussian3d, MeanNoise, Parameterization, SavedState, SavedTensor, Scene,
    Scene3d, SplatsState, TensorType, check_len,
    edit::{self, Source},
    logit,
    math::{
        perspective::Ellipsoid,
        sh::{MOST_COEFFICIENTS, coefficients},
    },
    sigmoid,
};
use rayon::prelude::*;

use super::moments::Moments;
use crate::{
    kind::{Shared, Splats},
    lanes::LANES,
    rows::Moves,
};

/// Rows that are brought to the host at once.
const BLOCK_ROWS: usize = 16_384;

/// The mean's place in a row.
pub(crate) const MEAN: Range<usize> = 0..3;
/// The log-scales.
pub(crate) const LOG_SCALE: Range<usize> = 3..6;
/// The quaternion.
pub(crate) const ROTATION: Range<usize> = 6..10;
/// The opacity logit.
pub(crate) const OPACITY: usize = 12;
/// The first SH coefficient.
pub(crate) const SH: usize = 13;

/// Numbers in the longest row, of degree 3.
pub(crate) const MOST_NUMBERS: usize = (SH + 3 * MOST_COEFFICIENTS).next_multiple_of(LANES);

/// 3D Gaussians on the CPU, with their Adam moments and density statistics.
#[derive(Debug)]
pub struct Splats3d {
    pub(crate) sh_degree: u8,
    /// `[N, pitch]`.
    pub(crate) parameters: Vec<f32>,
    pub(crate) moments: Moments,
    /// Number of Adam steps of each Gaussian.
    pub(crate) steps: Vec<u32>,
    pub(crate) shared: Shared<Scene3d>,
}

/// Numbers in a row without the padding.
fn columns(sh_degree: u8) -> usize {
    SH + 3 * coefficients(sh_degree)
}

/// Numbers in a row with SH of this degree, with the padding.
///
/// A row of a lower degree is the beginning of a row of a higher degree.
pub(crate) fn pitch_of(sh_degree: u8) -> usize {
    columns(sh_degree).next_multiple_of(LANES)
}

/// A row's mean.
#[inline(always)]
pub(crate) fn mean(row: &[f32]) -> Vec3 {
    Vec3::from_slice(&row[MEAN])
}

/// A row without its colour.
#[inline(always)]
pub(crate) fn ellipsoid(row: &[f32]) -> Ellipsoid {
    Ellipsoid {
        mean: mean(row),
        log_scale: Vec3::from_slice(&row[LOG_SCALE]),
        rotation: [row[6], row[7], row[8], row[9]],
        opacity_logit: row[OPACITY],
    }
}

/// The SH coefficients of a row, and the padding.
#[inline(always)]
pub(crate) fn sh(row: &[f32]) -> &[[f32; 3]] {
    row[SH..].as_chunks().0
}

impl Splats3d {
    fn zeros(n: usize, sh_degree: u8) -> Self {
        let numbers = n * pitch_of(sh_degree);
        Self {
            sh_degree,
            parameters: vec![0.0; numbers],
            moments: Moments::zeros(n, sh_degree),
            steps: vec![0; n],
            shared: Shared::new(DensityStatistics::zeros(n)),
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.steps.len()
    }

    /// Numbers from a row to the next.
    pub(crate) fn pitch(&self) -> usize {
        pitch_of(self.sh_degree)
    }

    /// A scene of ellipsoids and of rows with their SH. SH that a row does not have are 0.
    pub(crate) fn scene_of<'r>(&self, rows: impl Iterator<Item = (Ellipsoid, &'r [f32])>) -> Scene3d {
        let (count, k) = (self.len(), coefficients(self.sh_degree));
        // Vectors that grow would have room for up to twice as many.
        let mut scene = Scene3d {
            sh_degree: self.sh_degree,
            means: Vec::with_capacity(count),
            log_scales: Vec::with_capacity(count),
            rotations: Vec::with_capacity(count),
            opacity_logits: Vec::with_capacity(count),
            sh: Vec::with_capacity(count * k),
        };
        for (g, row) in rows {
            scene.means.push(g.mean);
            scene.log_scales.push(g.log_scale);
            scene.rotations.push(g.rotation);
            scene.opacity_logits.push(g.opacity_logit);
            let held = sh(row).iter().take(k).map(|&c| Vec3::from_array(c));
            scene.sh.extend(held.chain(std::iter::repeat(Vec3::ZERO)).take(k));
        }
        scene
    }

    fn write(&self, g: &Gaussian3d, row: &mut [f32]) {
        g.mean.write_to_slice(&mut row[MEAN]);
        g.log_scale.write_to_slice(&mut row[LOG_SCALE]);
        row[ROTATION].copy_from_slice(&g.rotation);
        row[OPACITY] = g.opacity_logit;
        let columns = columns(self.sh_degree);
        for (out, c) in row[SH..columns].as_chunks_mut::<3>().0.iter_mut().zip(&g.sh) {
            *out = c.to_array();
        }
    }
}

impl Splats<Scene3d> for Splats3d {
    fn new(scene: &Scene3d, parameterization: Parameterization) -> Result<Self, Error> {
        parameterization.check_3d()?;
        scene.validate()?;
        let n = scene.len();
        let mut splats = Self::zeros(n, scene.sh_degree);
        let (pitch, columns) = (splats.pitch(), columns(scene.sh_degree));
        let k = scene.sh_len();
        for (i, row) in splats.parameters.chunks_exact_mut(pitch).enumerate() {
            scene.means[i].write_to_slice(&mut row[MEAN]);
            scene.log_scales[i].write_to_slice(&mut row[LOG_SCALE]);
            row[ROTATION].copy_from_slice(&scene.rotations[i]);
            row[OPACITY] = scene.opacity_logits[i];
            for (out, c) in row[SH..columns].as_chunks_mut::<3>().0.iter_mut().zip(&scene.sh[i * k..]) {
                *out = c.to_array();
            }
        }
        Ok(splats)
    }

    fn scene(&self) -> Scene3d {
        let pitch = self.pitch();
        let blocks = self.parameters.chunks(pitch * BLOCK_ROWS);
        self.scene_of(blocks.flat_map(|block| {
            let ellipsoids: Vec<_> = block.par_chunks_exact(pitch).map(ellipsoid).collect();
            ellipsoids.into_iter().zip(block.chunks_exact(pitch))
        }))
    }

    fn saved(&self) -> SavedState<'_> {
        let (n, pitch) = (self.len(), self.pitch());
        let mut saved: Vec<SavedTensor<'_>> = Vec::new();
        for (name, range) in tensors(self.sh_degree) {
            saved.push(SavedTensor::new(name, vec![n, range.len()], TensorType::F32, move |to| {
                let rows = self.parameters.chunks_exact(pitch);
                rows.for_each(|row| to(bytemuck::cast_slice(&row[range.clone()])));
            }));
        }
        for (which, name) in MOMENTS.into_iter().enumerate() {
            let places = moment_places(self.sh_degree);
            saved.push(SavedTensor::new(name, vec![n, width(&places)], TensorType::F32, move |to| {
                self.moments.pass(which, &places, pitch, to);
            }));
        }
        let DensityStatistics { signal_sum, visible } = &self.shared.statistics;
        saved.push(SavedTensor::new("steps", vec![n], TensorType::U32, |to| to(&self.steps)));
        saved.push(SavedTensor::new("visible", vec![n], TensorType::U32, |to| to(visible)));
        let sums = |to: &mut dyn FnMut(&[u32])| to(bytemuck::cast_slice(signal_sum));
        saved.push(SavedTensor::new("gradient_sum", vec![n, 1], TensorType::F32, sums));
        SavedState { parameterization: Parameterization::ScaleRotation, tensors: saved }
    }

    fn restore(state: &SplatsState) -> Result<Self, Error> {
        state.parameterization.check_3d()?;
        let (sh_degree, steps) = (state.sh_degree()?, state.integers("steps")?);
        let mut splats = Self::zeros(steps.len(), sh_degree);
        let pitch = splats.pitch();
        for (name, range) in tensors(sh_degree) {
            let rows = state.matrix_of(name, [steps.len(), range.len()])?.chunks_exact(range.len());
            for (row, values) in splats.parameters.chunks_exact_mut(pitch).zip(rows) {
                row[range.clone()].copy_from_slice(values);
            }
        }
        let places = moment_places(sh_degree);
        for (which, name) in MOMENTS.into_iter().enumerate() {
            let numbers = state.matrix_of(name, [steps.len(), width(&places)])?;
            splats.moments.paste(which, &places, pitch, numbers);
        }
        let statistics = DensityStatistics {
            signal_sum: state.rows::<1>("gradient_sum")?.into_iter().flatten().collect(),
            visible: state.integers("visible")?,
        };
        check_len("gradient_sum", steps.len(), statistics.signal_sum.len())?;
        check_len("visible", steps.len(), statistics.visible.len())?;
        splats.shared = Shared::new(statistics);
        splats.steps = steps;
        Ok(splats)
    }

    fn edit(&mut self, plan: &EditPlan<Gaussian3d>) -> Result<(), Error> {
        let sources = plan.sources(self.len())?;
        let pitch = self.pitch();
        let kept = |source: &Source| match *source {
            Source::Kept(i) => Some(i),
            Source::Changed { .. } | Source::Added(_) => None,
        };
        Moves::new(&sources, kept).apply(&mut self.parameters, pitch);
        let mut parameters = std::mem::take(&mut self.parameters);
        for (row, source) in parameters.chunks_exact_mut(pitch).zip(&sources) {
            match *source {
                Source::Kept(_) => {}
                Source::Changed { change, .. } => self.write(&plan.changed[change as usize].gaussian, row),
                Source::Added(k) => self.write(&plan.added[k as usize].gaussian, row),
            }
        }
        self.parameters = parameters;
        self.moments.rearrange(&Moves::new(&sources, |source| plan.origin(source, edit::Moments::heir_of)), pitch);
        self.steps = plan.gather_steps(&sources, &self.steps);
        self.shared.edit(plan, &sources);
        if let Some(ceiling) = plan.opacity_ceiling {
            for row in self.parameters.chunks_exact_mut(pitch).skip(plan.fixed as usize) {
                if !(sigmoid(row[OPACITY]) <= ceiling) {
                    row[OPACITY] = logit(ceiling);
                }
            }
            self.moments.zero(OPACITY);
        }
        Ok(())
    }

    fn add_noise(&mut self, noise: &MeanNoise) {
        let pitch = self.pitch();
        let moving = self.parameters.par_chunks_exact_mut(pitch).enumerate().skip(noise.fixed as usize);
        moving.for_each(|(index, row)| {
            let factor = ellipsoid(row).factor().unwrap_or(Mat3::ZERO);
            let shift = noise.shift_3d(index as u32, factor, row[OPACITY]);
            row[MEAN].iter_mut().zip(shift.to_array()).for_each(|(value, shift)| *value += shift);
        });
    }

    fn shared(&self) -> &Shared<Scene3d> {
        &self.shared
    }

    fn shared_mut(&mut self) -> &mut Shared<Scene3d> {
        &mut self.shared
    }
}

/// The saved tensors of moments.
const MOMENTS: [&str; 2] = ["moment1", "moment2"];

/// The saved tensors of parameters, and their places in a row.
fn tensors(sh_degree: u8) -> [(&'static str, Range<usize>); 5] {
    [
        ("mean", MEAN),
        ("log_scale", LOG_SCALE),
        ("rotation", ROTATION),
        ("opacity_logit", OPACITY..SH),
        ("sh", SH..columns(sh_degree)),
    ]
}

/// The places in a row of moments that make a row of the saved tensor.
fn moment_places(sh_degree: u8) -> [Range<usize>; 2] {
    [MEAN.start..ROTATION.end, OPACITY..columns(sh_degree)]
}

fn width(places: &[Range<usize>]) -> usize {
    places.iter().map(ExactSizeIterator::len).sum()
}
