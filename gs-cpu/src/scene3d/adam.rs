//! Stage `adam`: one step of every Gaussian, a vector of 16 parameters at a time, and its
//! statistics. Parallel over Gaussians.

use std::ops::Range;

use fearless_simd::{Simd, prelude::*};
use gs_core::{
    AdamRates, DensityStatistics, Participants, Penalty, adam::Rate, constants::VANISHING_MOMENT, effects::Statistics,
    sigmoid,
};

use super::{
    buffers::Buffers3d,
    camera_sum::CameraSum,
    moments::{self, Moments, Rest},
    project_bwd::Block,
    splats::{LOG_SCALE, MEAN, OPACITY, ROTATION, SH, Splats3d},
};
use crate::{
    bias::{Bias, BiasTable},
    lanes::{LANES, Whole, bound_scales, bounded_derivative, load, splat, store},
    level::{Level, dispatch},
    workspace::Workspace,
};

/// Groups of parameters with their own rates: mean, scale, rotation, opacity, SH of degree 0, other
/// SH.
pub(crate) const GROUPS: usize = 6;

/// Gaussians per task.
const CHUNK: usize = 256;

/// The group of each number in a row's first vector, of which two are unused. All later numbers are
/// in the last group.
const GROUP_OF: [usize; LANES] = [0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 2, 3, 4, 4, 4];

const _: () = assert!(MEAN.end == 3 && LOG_SCALE.end == 6 && ROTATION.start == 6 && OPACITY == 12 && SH + 3 == LANES);

/// The arguments of a step that all Gaussians share.
struct Step<'a> {
    /// Numbers from a row of parameters to the next, and how many of them move.
    pitch: usize,
    width: usize,
    groups: [Rate; GROUPS],
    rates: &'a AdamRates,
    bias: &'a BiasTable<GROUPS>,
    /// ln of the smallest and largest scale.
    log_scales: [f32; 2],
    /// The penalty's weights for one Gaussian's opacity and for each of its scales; `None` if both
    /// are 0.
    penalty: Option<[f32; 2]>,
}

/// What a step changes of neighbouring Gaussians.
struct Rows<'a> {
    /// `[N, pitch]`.
    parameters: &'a mut [f32],
    /// Moments of each row's first vector.
    moments: [&'a mut [f32]; 2],
    rest: RestMut<'a>,
    steps: &'a mut [u32],
    signal_sum: &'a mut [f32],
    visible: &'a mut [u32],
}

/// The moments after the first vector.
enum RestMut<'a> {
    F32([&'a mut [f32]; 2]),
    Bf16(&'a mut [u32]),
}

impl<'a> Rows<'a> {
    fn of(splats: &'a mut Splats3d) -> Self {
        let Splats3d { parameters, moments: Moments { first_vector: [first, second], rest }, steps, shared, .. } =
            splats;
        let rest = match rest {
            Rest::F32([first, second]) => RestMut::F32([first, second]),
            Rest::Bf16(both) => RestMut::Bf16(both),
        };
        let DensityStatistics { signal_sum, visible } = &mut shared.statistics;
        Self { parameters, moments: [first, second], rest, steps, signal_sum, visible }
    }

    /// The first `count` Gaussians, and the others.
    fn split(self, count: usize, pitch: usize) -> (Self, Self) {
        let (parameters, other_parameters) = self.parameters.split_at_mut(count * pitch);
        let [(first, other_first), (second, other_second)] = self.moments.map(|m| m.split_at_mut(count * LANES));
        let of_rest = count * (pitch - LANES);
        let (rest, other_rest) = match self.rest {
            RestMut::F32(both) => {
                let [(first, other_first), (second, other_second)] = both.map(|m| m.split_at_mut(of_rest));
                (RestMut::F32([first, second]), RestMut::F32([other_first, other_second]))
            }
            RestMut::Bf16(both) => {
                let (both, other) = both.split_at_mut(of_rest);
                (RestMut::Bf16(both), RestMut::Bf16(other))
            }
        };
        let (steps, other_steps) = self.steps.split_at_mut(count);
        let (signal_sum, other_sum) = self.signal_sum.split_at_mut(count);
        let (visible, other_visible) = self.visible.split_at_mut(count);
        let rows = Self { parameters, moments: [first, second], rest, steps, signal_sum, visible };
        let others = Self {
            parameters: other_parameters,
            moments: [other_first, other_second],
            rest: other_rest,
            steps: other_steps,
            signal_sum: other_sum,
            visible: other_visible,
        };
        (rows, others)
    }

    /// Runs `work(index of the first Gaussian, rows)` for chunks of at most [`CHUNK`] Gaussians, in
    /// parallel; `first` is the index of the first of all. Returns the sum, whose order depends on
    /// the number of Gaussians only.
    fn for_each_chunk(
        self,
        first: usize,
        pitch: usize,
        work: &(impl Fn(usize, Rows<'_>) -> CameraSum + Sync),
    ) -> CameraSum {
        let count = self.steps.len();
        if count <= CHUNK {
            return work(first, self);
        }
        let half = count / 2;
        let (rows, others) = self.split(half, pitch);
        let second = || others.for_each_chunk(first + half, pitch, work);
        let (sum, after) = rayon::join(|| rows.for_each_chunk(first, pitch, work), second);
        sum.plus(after)
    }

    /// Moves the Gaussians of these places, along the gradients of a block, and adds to the statistics
    /// if they are collected; `first` is the index of the first of all.
    #[inline(always)]
    fn step_to<S: Simd>(
        &mut self,
        simd: S,
        first: usize,
        places: Range<usize>,
        block: &Block,
        step: &Step<'_>,
        collect: bool,
    ) {
        let mut members = block.members[..block.len].iter().zip(&block.rows).zip(block.shares).peekable();
        // Neighbours mostly have taken as many steps.
        let mut of_steps = self.steps[places.start].saturating_add(1);
        let mut lanes = Lanes::both(simd, step, step.bias.at(of_steps));
        for i in places {
            let listed = members.next_if(|((place, _), _)| **place == i);
            if listed.is_none() && step.rates.participants == Participants::Visible {
                continue;
            }
            let gradient = listed.map(|((_, row), _)| &row[..step.width]);
            let steps = self.steps[i].saturating_add(1);
            self.steps[i] = steps;
            if steps != of_steps {
                (of_steps, lanes) = (steps, Lanes::both(simd, step, step.bias.at(steps)));
            }
            self.step(simd, (i, (first + i) as u32, steps), gradient, step, &lanes);
            if let Some((_, share)) = listed.filter(|_| collect) {
                share.add_to(&mut self.signal_sum[i], &mut self.visible[i]);
            }
        }
    }

    /// Moves Gaussian `i` of these, whose index is `index` and whose step is its `steps`-th, along a
    /// gradient of `width` numbers, or of zeros where no tile lists it.
    #[inline(always)]
    fn step<S: Simd>(
        &mut self,
        simd: S,
        (i, index, steps): (usize, u32, u32),
        gradient: Option<&[f32]>,
        step: &Step<'_>,
        [lanes, of_rest]: &[Lanes<S>; 2],
    ) {
        let parameters = &mut self.parameters[i * step.pitch..][..step.width];
        let (first_vector, parameters) = parameters.split_at_mut(LANES);
        let [first, second] = self.moments.each_mut().map(|moments| &mut moments[i * LANES..][..LANES]);
        let g = load(simd, &geometric(first_vector, gradient, step), 0);
        let mut both: [Whole<S>; 2] = [load(simd, first, 0), load(simd, second, 0)];
        let moved = lanes.moved(simd, g, &mut both);
        store(both[0], first, 0);
        store(both[1], second, 0);
        store(load::<S, Whole<S>>(simd, first_vector, 0) - moved, first_vector, 0);
        bound_scales(&mut first_vector[LOG_SCALE], step.log_scales);
        let from = i * (step.pitch - LANES);
        for at in (0..parameters.len()).step_by(LANES) {
            let g = gradient.map_or(splat(simd, 0.0), |gradient| load(simd, gradient, LANES + at));
            let moved = match &mut self.rest {
                RestMut::F32([first, second]) => {
                    let mut both = [load(simd, first, from + at), load(simd, second, from + at)];
                    let moved = of_rest.moved(simd, g, &mut both);
                    store(both[0], first, from + at);
                    store(both[1], second, from + at);
                    moved
                }
                RestMut::Bf16(packed) => {
                    let packed = &mut packed[from + at..][..LANES];
                    let mut both = moments::unpack(simd, packed);
                    let moved = of_rest.moved(simd, g, &mut both);
                    moments::pack::<S>(both, moments::random(simd, index, steps, at), packed);
                    moved
                }
            };
            store(load::<S, Whole<S>>(simd, parameters, at) - moved, parameters, at);
        }
    }
}

/// Takes one Adam step along gradients. Of a chunk that begins with the Gaussian `first`,
/// `gradients((first, from), parameters, block)` finds those of the next listed Gaussians from place
/// `from` on, and returns the place up to which it came. Returns the sum over the blocks' cameras.
pub(super) fn step_along(
    splats: &mut Splats3d,
    table: &mut BiasTable<GROUPS>,
    rates: &AdamRates,
    level: Level,
    workspace: &Workspace<Buffers3d>,
    gradients: impl Fn((usize, usize), &[f32], &mut Block) -> usize + Sync,
) -> CameraSum {
    splats.moments.convert(rates.color_rest_moments);
    let groups = [rates.mean, rates.scale, rates.rotation, rates.opacity, rates.color, rates.color_rest];
    table.prepare(groups.map(|g| [g.beta1, g.beta2]), &splats.steps);
    let collect = workspace.tiles.settings.effects.statistics != Statistics::None;
    let log_scales = [rates.min_scale.ln(), rates.max_scale.ln()];
    let count = splats.steps.len().max(1) as f32;
    let Penalty { opacity, scale } = rates.penalty;
    let penalty = (rates.penalty != Penalty::NONE).then_some([opacity / count, scale / (3.0 * count)]);
    let pitch = splats.pitch();
    let width = workspace.buffers.gradient_pitch().min(pitch);
    let step = Step { pitch, width, groups, rates, bias: table, log_scales, penalty };
    let fixed = (rates.fixed as usize).min(splats.steps.len());
    let (_, moving) = Rows::of(splats).split(fixed, pitch);
    moving.for_each_chunk(fixed, pitch, &|first, mut rows: Rows<'_>| {
        let mut block = Block::EMPTY;
        let mut from = 0;
        while from < rows.steps.len() {
            let end = gradients((first, from), rows.parameters, &mut block);
            dispatch!(level, simd => rows.step_to(simd, first, from..end, &block, &step, collect));
            from = end;
        }
        block.camera
    })
}

/// The gradient by the numbers of a row's first vector, with the penalty's gradient.
#[inline(always)]
fn geometric(parameters: &[f32], of_row: Option<&[f32]>, step: &Step<'_>) -> [f32; LANES] {
    let mut gradient = [0.0; LANES];
    if let Some(of_row) = of_row {
        gradient.copy_from_slice(&of_row[..LANES]);
    }
    if let Some(weights) = step.penalty {
        add_penalty(parameters, weights, &mut gradient);
    }
    gradient
}

/// Adds the penalty's gradient to that of a row's first vector: w o (1 − o) for the opacity logit,
/// and w s for each ln-scale.
fn add_penalty(parameters: &[f32], [opacity, scale]: [f32; 2], gradient: &mut [f32; LANES]) {
    if scale > 0.0 {
        LOG_SCALE.for_each(|axis| gradient[axis] += scale * parameters[axis].exp());
    }
    let o = sigmoid(parameters[OPACITY]);
    gradient[OPACITY] += opacity * o * (1.0 - o);
}

/// Adam's settings for 16 parameters of a row.
#[derive(Clone, Copy)]
struct Lanes<S: Simd> {
    rate: Whole<S>,
    beta1: Whole<S>,
    beta2: Whole<S>,
    /// Bias corrections of the first and second moment.
    first: Whole<S>,
    second: Whole<S>,
    epsilon: Whole<S>,
}

impl<S: Simd> Lanes<S> {
    /// Those of a row's first vector, and of each later one.
    #[inline(always)]
    fn both(simd: S, step: &Step<'_>, bias: &Bias<GROUPS>) -> [Self; 2] {
        [Self::of_first(simd, step, bias), Self::of_rest(simd, step, bias)]
    }

    #[inline(always)]
    fn of_first(simd: S, step: &Step<'_>, bias: &Bias<GROUPS>) -> Self {
        let (mut rate, mut beta1, mut beta2) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for (lane, group) in GROUP_OF.into_iter().enumerate() {
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
            epsilon: splat(simd, step.rates.epsilon),
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
            epsilon: splat(simd, step.rates.epsilon),
        }
    }

    /// Updates the moments by a gradient; returns what the parameters decrease by.
    #[inline(always)]
    fn moved(&self, simd: S, gradient: Whole<S>, [first, second]: &mut [Whole<S>; 2]) -> Whole<S> {
        let (zero, vanishing): (Whole<S>, Whole<S>) = (splat(simd, 0.0), splat(simd, VANISHING_MOMENT));
        let g = bounded_derivative(simd, gradient);
        let m = first.mul_add(self.beta1, g * (1.0 - self.beta1));
        *first = m.abs().simd_lt(vanishing).select(zero, m);
        *second = second.mul_add(self.beta2, g * g * (1.0 - self.beta2));
        self.rate * (*first * self.first) / ((*second * self.second).sqrt() + self.epsilon)
    }
}
