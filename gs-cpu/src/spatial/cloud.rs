//! The Gaussians where this backend computes, one row each, and how edits and checkpoints treat them.
//!
//! A row holds mean 3, log-scale 3, rotation 4, opacity logit, then the SH coefficients, R, G, B each; it is filled with zeros to whole
//! vectors. A Gaussian is thus a few neighbouring cache lines, and Adam runs over rows without knowing what is in them.

use std::ops::Range;

use glam::Vec3;
use gs_core::{
    Chart, CloudState, DensityStatistics, EditPlan, Error, Scene, SpatialGaussian, SpatialScene,
    edit::Source,
    perspective::Ellipsoid,
    scene::{logit, sigmoid},
    sh::coefficients,
};

use crate::{kind::Shared, lanes::LANES, rasterizer::unsupported};

/// Where a row holds what.
pub(crate) const MEAN: Range<usize> = 0..3;
pub(crate) const LOG_SCALE: Range<usize> = 3..6;
pub(crate) const ROTATION: Range<usize> = 6..10;
pub(crate) const OPACITY: usize = 10;
pub(crate) const SH: usize = 11;

/// Spatial Gaussians on the CPU, with their Adam moments and density statistics.
#[derive(Debug)]
pub struct SpatialCloud {
    pub(crate) sh_degree: u8,
    /// `[N, pitch]`.
    pub(crate) parameters: Vec<f32>,
    /// First and second moments, laid out as the parameters.
    pub(crate) moments: [Vec<f32>; 2],
    /// Adam steps that each has taken.
    pub(crate) steps: Vec<u32>,
    pub(crate) shared: Shared<SpatialScene>,
}

/// Numbers in a row that are parameters.
fn columns(sh_degree: u8) -> usize {
    SH + 3 * coefficients(sh_degree)
}

/// What a row holds besides its colour.
#[inline(always)]
pub(crate) fn ellipsoid(row: &[f32]) -> Ellipsoid {
    Ellipsoid {
        mean: Vec3::from_slice(&row[MEAN]),
        log_scale: Vec3::from_slice(&row[LOG_SCALE]),
        rotation: [row[6], row[7], row[8], row[9]],
        opacity_logit: row[OPACITY],
    }
}

/// The SH coefficients of a row, and what fills it up.
#[inline(always)]
pub(crate) fn sh(row: &[f32]) -> &[[f32; 3]] {
    row[SH..].as_chunks().0
}

fn write(g: &SpatialGaussian, row: &mut [f32], columns: usize) {
    g.mean.write_to_slice(&mut row[MEAN]);
    g.log_scale.write_to_slice(&mut row[LOG_SCALE]);
    row[ROTATION].copy_from_slice(&g.rotation);
    row[OPACITY] = g.opacity_logit;
    for (out, c) in row[SH..columns].as_chunks_mut::<3>().0.iter_mut().zip(&g.sh) {
        *out = c.to_array();
    }
}

impl SpatialCloud {
    pub(crate) fn new(scene: &SpatialScene, chart: Chart) -> Result<Self, Error> {
        if chart != Chart::ScaleRotation {
            return Err(unsupported(format!("chart {chart:?} for spatial scenes")));
        }
        scene.validate()?;
        let n = scene.len();
        let mut cloud = Self::zeros(n, scene.sh_degree);
        let (pitch, columns) = (cloud.pitch(), columns(scene.sh_degree));
        let k = scene.sh_len();
        for (i, row) in cloud.parameters.chunks_exact_mut(pitch).enumerate() {
            scene.means[i].write_to_slice(&mut row[MEAN]);
            scene.log_scales[i].write_to_slice(&mut row[LOG_SCALE]);
            row[ROTATION].copy_from_slice(&scene.rotations[i]);
            row[OPACITY] = scene.opacity_logits[i];
            for (out, c) in row[SH..columns].as_chunks_mut::<3>().0.iter_mut().zip(&scene.sh[i * k..]) {
                *out = c.to_array();
            }
        }
        Ok(cloud)
    }

    fn zeros(n: usize, sh_degree: u8) -> Self {
        let numbers = n * columns(sh_degree).next_multiple_of(LANES);
        Self {
            sh_degree,
            parameters: vec![0.0; numbers],
            moments: [vec![0.0; numbers], vec![0.0; numbers]],
            steps: vec![0; n],
            shared: Shared::new(DensityStatistics::zeros(n)),
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.steps.len()
    }

    /// Numbers from a row to the next.
    pub(crate) fn pitch(&self) -> usize {
        columns(self.sh_degree).next_multiple_of(LANES)
    }

    /// Rows of parameters, or of what is laid out as they are, as a scene.
    pub(crate) fn scene_of<'r>(&self, rows: impl Iterator<Item = &'r [f32]>) -> SpatialScene {
        let mut scene = SpatialScene { sh_degree: self.sh_degree, ..SpatialScene::default() };
        let k = coefficients(self.sh_degree);
        for row in rows {
            let g = ellipsoid(row);
            scene.means.push(g.mean);
            scene.log_scales.push(g.log_scale);
            scene.rotations.push(g.rotation);
            scene.opacity_logits.push(g.opacity_logit);
            scene.sh.extend(sh(row)[..k].iter().map(|&c| Vec3::from_array(c)));
        }
        scene
    }

    pub(crate) fn scene(&self) -> SpatialScene {
        self.scene_of(self.parameters.chunks_exact(self.pitch()))
    }

    pub(crate) fn shift_means(&mut self, shifts: &[f32]) -> Result<(), Error> {
        let (expected, pitch) = (3 * self.len(), self.pitch());
        if shifts.len() != expected {
            return Err(Error::Length { what: "mean", expected, found: shifts.len() });
        }
        for (row, shift) in self.parameters.chunks_exact_mut(pitch).zip(shifts.chunks_exact(3)) {
            row[MEAN].iter_mut().zip(shift).for_each(|(value, shift)| *value += shift);
        }
        Ok(())
    }

    pub(crate) fn edit(&mut self, plan: &EditPlan<SpatialGaussian>) -> Result<(), Error> {
        let sources = plan.sources(self.len())?;
        let (pitch, columns) = (self.pitch(), columns(self.sh_degree));
        let mut parameters = vec![0.0; sources.len() * pitch];
        for (row, source) in parameters.chunks_exact_mut(pitch).zip(&sources) {
            match *source {
                Source::Kept(i) => row.copy_from_slice(&self.parameters[i as usize * pitch..][..pitch]),
                Source::Changed { change, .. } => write(&plan.changed[change as usize].gaussian, row, columns),
                Source::Added(k) => write(&plan.added[k as usize].gaussian, row, columns),
            }
        }
        self.parameters = parameters;
        // Whose moments each inherits, by the rule for moments.
        let indices: Vec<Option<u32>> = (0..self.len() as u32).map(Some).collect();
        let heirs = plan.gather_moments(&sources, &indices);
        for moments in &mut self.moments {
            let mut after = vec![0.0; sources.len() * pitch];
            for (row, from) in after.chunks_exact_mut(pitch).zip(&heirs) {
                if let Some(i) = from {
                    row.copy_from_slice(&moments[*i as usize * pitch..][..pitch]);
                }
            }
            *moments = after;
        }
        self.steps = plan.gather_steps(&sources, &self.steps);
        let statistics = &self.shared.statistics;
        self.shared.edited(DensityStatistics {
            gradient_sum: plan.gather_statistics(&sources, &statistics.gradient_sum),
            visible: plan.gather_statistics(&sources, &statistics.visible),
        });
        if let Some(ceiling) = plan.opacity_ceiling {
            for row in self.parameters.chunks_exact_mut(pitch) {
                if !(sigmoid(row[OPACITY]) <= ceiling) {
                    row[OPACITY] = logit(ceiling);
                }
            }
            for moments in &mut self.moments {
                moments.chunks_exact_mut(pitch).for_each(|row| row[OPACITY] = 0.0);
            }
        }
        Ok(())
    }

    pub(crate) fn save(&self) -> CloudState {
        let (pitch, columns) = (self.pitch(), columns(self.sh_degree));
        let mut state = CloudState::new(Chart::ScaleRotation);
        let cut = |numbers: &[f32], range: Range<usize>| -> Vec<f32> {
            numbers.chunks_exact(pitch).flat_map(|row| &row[range.clone()]).copied().collect()
        };
        for (name, range) in tensors(columns) {
            state.insert_matrix(name, range.len(), cut(&self.parameters, range));
        }
        for (name, moments) in ["moment1", "moment2"].into_iter().zip(&self.moments) {
            state.insert_matrix(name, columns, cut(moments, 0..columns));
        }
        state.insert_u32("steps", self.steps.clone());
        state.insert("gradient_sum", self.shared.statistics.gradient_sum.iter().map(|&g| [g]));
        state.insert_u32("visible", self.shared.statistics.visible.clone());
        state
    }

    pub(crate) fn restore(state: &CloudState) -> Result<Self, Error> {
        if state.chart != Chart::ScaleRotation {
            return Err(unsupported(format!("chart {:?} for spatial scenes", state.chart)));
        }
        let (sh_columns, _) = state.matrix("sh")?;
        let Some(sh_degree) = (0..=3).find(|&degree| 3 * coefficients(degree) == sh_columns) else {
            return Err(Error::State(format!("tensor `sh` has {sh_columns} columns, not 3, 12, 27 or 48")));
        };
        let steps = state.integers("steps")?;
        let mut cloud = Self::zeros(steps.len(), sh_degree);
        let (pitch, columns) = (cloud.pitch(), columns(sh_degree));
        let paste = |name: &'static str, range: Range<usize>, into: &mut [f32]| {
            let (found, numbers) = state.matrix(name)?;
            if found != range.len() {
                return Err(Error::State(format!("tensor `{name}` has {found} columns, not {}", range.len())));
            }
            check_len(name, steps.len(), numbers.len() / found)?;
            for (row, values) in into.chunks_exact_mut(pitch).zip(numbers.chunks_exact(found)) {
                row[range.clone()].copy_from_slice(values);
            }
            Ok::<(), Error>(())
        };
        for (name, range) in tensors(columns) {
            paste(name, range, &mut cloud.parameters)?;
        }
        for (name, moments) in ["moment1", "moment2"].into_iter().zip(&mut cloud.moments) {
            paste(name, 0..columns, moments)?;
        }
        let statistics = DensityStatistics {
            gradient_sum: state.rows::<1>("gradient_sum")?.into_iter().flatten().collect(),
            visible: state.integers("visible")?,
        };
        check_len("gradient_sum", steps.len(), statistics.gradient_sum.len())?;
        check_len("visible", steps.len(), statistics.visible.len())?;
        cloud.shared = Shared::new(statistics);
        cloud.steps = steps;
        Ok(cloud)
    }
}

/// The tensors of parameters, and where a row holds them.
fn tensors(columns: usize) -> [(&'static str, Range<usize>); 5] {
    [
        ("mean", MEAN),
        ("log_scale", LOG_SCALE),
        ("rotation", ROTATION),
        ("opacity_logit", OPACITY..OPACITY + 1),
        ("sh", SH..columns),
    ]
}

fn check_len(what: &'static str, expected: usize, found: usize) -> Result<(), Error> {
    if found == expected { Ok(()) } else { Err(Error::Length { what, expected, found }) }
}
