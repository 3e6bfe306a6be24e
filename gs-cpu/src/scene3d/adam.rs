//! Stage `adam`: one step of every Gaussian, a vector of 16 parameters at a time, and its
//! statistics. Parallel over Gaussians.

use fearless_simd::{Simd, prelude::*};
use glam::Vec3;
use gs_core::{
    AdamRates, Parameterization, Participants, Penalty,
    adam::Rate,
    constants::{MAX_XI, VANISHING_MOMENT},
    effects::Statistics,
    math::covariance_factor::{stretched, sum_of_scales_vjp},
    sigmoid,
};
use rayon::prelude::*;

use super::{
    own::Own3d,
    project_bwd::{BLOCK, Backward, Block},
    splats::{self, FACTOR, LOG_SCALE, MEAN, OPACITY, ROTATION, SH, STRETCH, Splats3d},
};
use crate::{
    bias::{Bias, BiasTable},
    lanes::{LANES, Whole, bounded_derivative, load, splat, store},
    level::{Level, dispatch},
    workspace::Workspace,
};

/// Groups of parameters with their own rates: mean, scale, rotation, opacity, SH of degree 0, other
/// SH.
pub(crate) const GROUPS: usize = 6;

/// Gaussians per task.
const CHUNK: usize = 256;

/// The group of each number in a row's first vector. All later numbers are in the last group.
///
/// Numbers that a parameterization does not use stay 0.
fn groups_of(parameterization: Parameterization) -> [usize; LANES] {
    std::array::from_fn(|lane| match (lane, parameterization) {
        (0..3, _) => 0,
        (3..6, _) | (6..12, Parameterization::CovarianceFactor) => 1,
        (6..12, Parameterization::ScaleRotation) => 2,
        (OPACITY, _) => 3,
        _ => 4,
    })
}

const _: () = assert!(MEAN.end == 3 && LOG_SCALE.end == 6 && ROTATION.start == 6 && OPACITY == 12 && SH + 3 == LANES);

/// The arguments of a step that all Gaussians share.
struct Step<'a> {
    parameterization: Parameterization,
    groups: [Rate; GROUPS],
    group_of: [usize; LANES],
    rates: &'a AdamRates,
    bias: &'a BiasTable<GROUPS>,
    /// ln of the smallest and largest scale.
    log_scales: [f32; 2],
    /// The penalty's weights for one Gaussian's opacity and for each of its scales; `None` if both
    /// are 0.
    penalty: Option<[f32; 2]>,
}

/// One Gaussian's row of parameters, moments and gradients.
struct Row<'a> {
    parameters: &'a mut [f32],
    first: &'a mut [f32],
    second: &'a mut [f32],
    /// `None` where no tile lists the Gaussian: a gradient of zeros.
    gradient: Option<&'a [f32]>,
}

/// Takes one Adam step along the workspace's gradients, and adds to the statistics if they are
/// collected.
///
/// Whole vectors of SH above the evaluated degree keep their values and moments, and cost nothing.
pub(crate) fn step(
    splats: &mut Splats3d,
    table: &mut BiasTable<GROUPS>,
    rates: &AdamRates,
    level: Level,
    workspace: &Workspace<Own3d>,
) {
    let width = workspace.own.gradient_pitch();
    step_along(splats, table, rates, level, workspace, |first, count, _, block| {
        for i in 0..count {
            let listed = workspace.lists(first + i);
            block.shares[i] = listed.then(|| workspace.own.shares[first + i]);
            if listed {
                block.rows[i][..width].copy_from_slice(workspace.own.gradient(first + i));
            }
        }
    });
}

/// Runs stages `project_bwd`, with gradients times `scale`, and `adam` in one pass.
///
/// The gradients are never written to memory, and parameters are read once.
pub(crate) fn update(
    splats: &mut Splats3d,
    table: &mut BiasTable<GROUPS>,
    rates: &AdamRates,
    level: Level,
    workspace: &Workspace<Own3d>,
    scale: f32,
) {
    let Some(backward) = Backward::new(workspace, splats, scale) else { return };
    step_along(splats, table, rates, level, workspace, |first, _, parameters, block| {
        backward.block(first, parameters, block);
    });
}

/// Takes one Adam step along the gradients that `gradients(first, count, parameters, block)` finds
/// of `count` Gaussians from `first` on.
fn step_along(
    splats: &mut Splats3d,
    table: &mut BiasTable<GROUPS>,
    rates: &AdamRates,
    level: Level,
    workspace: &Workspace<Own3d>,
    gradients: impl Fn(usize, usize, &[f32], &mut Block) + Sync,
) {
    let groups = [rates.mean, rates.scale, rates.rotation, rates.opacity, rates.color, rates.color_rest];
    table.prepare(groups.map(|g| [g.beta1, g.beta2]), &splats.steps);
    let collect = workspace.tiles.settings.effects.statistics != Statistics::None;
    let log_scales = [rates.min_scale.ln(), rates.max_scale.ln()];
    let count = splats.steps.len().max(1) as f32;
    let Penalty { opacity, scale } = rates.penalty;
    let penalty = (rates.penalty != Penalty::NONE).then_some([opacity / count, scale / (3.0 * count)]);
    let step = Step {
        parameterization: splats.parameterization,
        groups,
        group_of: groups_of(splats.parameterization),
        rates,
        bias: table,
        log_scales,
        penalty,
    };
    let pitch = splats.pitch();
    let width = workspace.own.gradient_pitch().min(pitch);
    let Splats3d { parameters, moments: [first, second], steps, shared, .. } = splats;
    let statistics = &mut shared.statistics;
    let rows = parameters
        .par_chunks_mut(BLOCK * pitch)
        .zip(first.par_chunks_mut(BLOCK * pitch))
        .zip(second.par_chunks_mut(BLOCK * pitch))
        .zip(steps.par_chunks_mut(BLOCK));
    let counted = statistics.signal_sum.par_chunks_mut(BLOCK).zip(statistics.visible.par_chunks_mut(BLOCK));
    let blocks = rows.zip(counted).enumerate().with_min_len(CHUNK / BLOCK);
    blocks.for_each(|(number, ((((parameters, first), second), steps), (sums, visible)))| {
        let mut block = Block::EMPTY;
        gradients(number * BLOCK, steps.len(), parameters, &mut block);
        for i in 0..steps.len() {
            let share = block.shares[i];
            if share.is_none() && rates.participants == Participants::Visible {
                continue;
            }
            steps[i] = steps[i].saturating_add(1);
            let of = i * pitch..i * pitch + width;
            let row = Row {
                parameters: &mut parameters[of.clone()],
                first: &mut first[of.clone()],
                second: &mut second[of],
                gradient: share.is_some().then_some(&block.rows[i][..width]),
            };
            dispatch!(level, simd => move_row(simd, row, &step, steps[i]));
            if let Some(share) = share.filter(|_| collect) {
                sums[i] += share;
                visible[i] = visible[i].saturating_add(1);
            }
        }
    });
}

#[inline(always)]
fn move_row<S: Simd>(simd: S, row: Row<'_>, step: &Step<'_>, steps: u32) {
    let bias = step.bias.at(steps);
    let mut lanes = Lanes::<S>::of_first(simd, step, bias);
    let zero: Whole<S> = splat(simd, 0.0);
    let epsilon: Whole<S> = splat(simd, step.rates.epsilon);
    let vanishing: Whole<S> = splat(simd, VANISHING_MOMENT);
    for at in (0..row.parameters.len()).step_by(LANES) {
        if at == LANES {
            lanes = Lanes::of_rest(simd, step, bias);
        }
        let g: Whole<S> = match row.gradient {
            _ if at == 0 => load(simd, &geometric(&row, step), 0),
            Some(gradient) => load(simd, gradient, at),
            None => zero,
        };
        let g = bounded_derivative(simd, g);
        let m = load::<S, Whole<S>>(simd, row.first, at).mul_add(lanes.beta1, g * (1.0 - lanes.beta1));
        let m = m.abs().simd_lt(vanishing).select(zero, m);
        let v = load::<S, Whole<S>>(simd, row.second, at).mul_add(lanes.beta2, g * g * (1.0 - lanes.beta2));
        store(m, row.first, at);
        store(v, row.second, at);
        let moved = lanes.rate * (m * lanes.first) / ((v * lanes.second).sqrt() + epsilon);
        if at == 0 && step.parameterization == Parameterization::CovarianceFactor {
            move_factored(row.parameters, moved.into(), step.rates);
        } else {
            store(load::<S, Whole<S>>(simd, row.parameters, at) - moved, row.parameters, at);
        }
    }
    if step.parameterization == Parameterization::ScaleRotation {
        let [floor, ceiling] = step.log_scales;
        for scale in &mut row.parameters[LOG_SCALE] {
            // NaN stays, so that the Gaussian is pruned.
            if *scale < floor {
                *scale = floor;
            } else if *scale > ceiling {
                *scale = ceiling;
            }
        }
    }
}

/// The gradient by the numbers of a row's first vector, in the coordinates of the parameterization,
/// with the penalty's gradient.
#[inline(always)]
fn geometric(row: &Row<'_>, step: &Step<'_>) -> [f32; LANES] {
    let mut gradient = [0.0; LANES];
    if let Some(of_row) = row.gradient {
        gradient.copy_from_slice(&of_row[..LANES]);
        if step.parameterization == Parameterization::CovarianceFactor {
            let by_xi = splats::factor(row.parameters).transpose() * splats::mean(of_row);
            by_xi.write_to_slice(&mut gradient[MEAN]);
        }
    }
    if let Some(weights) = step.penalty {
        add_penalty(row.parameters, step.parameterization, weights, &mut gradient);
    }
    gradient
}

/// Adds the penalty's gradient to that of a row's first vector.
///
/// It is w o (1 − o) for the opacity logit, and w s for each ln-scale or w V S Vᵀ for a factor.
fn add_penalty(
    parameters: &[f32],
    parameterization: Parameterization,
    [opacity, scale]: [f32; 2],
    gradient: &mut [f32; LANES],
) {
    match parameterization {
        _ if !(scale > 0.0) => {}
        Parameterization::ScaleRotation => LOG_SCALE.for_each(|axis| gradient[axis] += scale * parameters[axis].exp()),
        Parameterization::CovarianceFactor => {
            let by_stretch = sum_of_scales_vjp(splats::factor(parameters));
            STRETCH.zip(by_stretch).for_each(|(at, by)| gradient[at] += scale * by);
        }
    }
    let o = sigmoid(parameters[OPACITY]);
    gradient[OPACITY] += opacity * o * (1.0 - o);
}

/// Moves the numbers of a row's first vector: −`moved` has ξ, η and the changes of opacity and
/// colour.
#[inline(always)]
fn move_factored(parameters: &mut [f32], moved: [f32; LANES], rates: &AdamRates) {
    let factor = splats::factor(parameters);
    let xi = Vec3::from_slice(&moved[MEAN]).map(|entry| entry.clamp(-MAX_XI, MAX_XI));
    let mean = splats::mean(parameters) - factor * xi;
    mean.write_to_slice(&mut parameters[MEAN]);
    let eta = std::array::from_fn(|k| -moved[STRETCH.start + k]);
    parameters[FACTOR].copy_from_slice(&stretched(factor, eta, rates).to_cols_array());
    for at in OPACITY..LANES {
        parameters[at] -= moved[at];
    }
}

/// Adam's settings for 16 parameters of a row.
struct Lanes<S: Simd> {
    rate: Whole<S>,
    beta1: Whole<S>,
    beta2: Whole<S>,
    /// Bias corrections of the first and second moment.
    first: Whole<S>,
    second: Whole<S>,
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    fn of_first(simd: S, step: &Step<'_>, bias: &Bias<GROUPS>) -> Self {
        let (mut rate, mut beta1, mut beta2) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for (lane, group) in step.group_of.into_iter().enumerate() {
            let of = &step.groups[group];
            (rate[lane], beta1[lane], beta2[lane]) = (of.learning_rate, of.beta1, of.beta2);
            (first[lane], second[lane]) = (bias.first[group], bias.second[group]);
        }
        let vector = |values: [f32; LANES]| load(simd, &values, 0);
        Self {
            rate: vector(rate),
            beta1: vector(beta1),
            beta2: vector(beta2),
            first: vector(first),
            second: vector(second),
        }
    }

    #[inline(always)]
    fn of_rest(simd: S, step: &Step<'_>, bias: &Bias<GROUPS>) -> Self {
        let group = &step.groups[GROUPS - 1];
        Self {
            rate: splat(simd, group.learning_rate),
            beta1: splat(simd, group.beta1),
            beta2: splat(simd, group.beta2),
            first: splat(simd, bias.first[GROUPS - 1]),
            second: splat(simd, bias.second[GROUPS - 1]),
        }
    }
}
