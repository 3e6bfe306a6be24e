//! Cases of pending training steps: all losses arrive, and every call sees the steps.

use gs_core::{
    Binning, EditPlan, Error, Image, Loss, Optimizer, Parameterization, SplatsState, TrainStep, Wait,
    edit::AfterEdit,
    effects::{Blend, Statistics},
};
use pollster::FutureExt as _;

use crate::conformance::{losses_of, parameterizations};
use crate::{failure::Failure, scenes::Draw, subject::Subject};

/// More steps than any backend has pending at once.
const STEPS: usize = 13;

/// A scene, and how to train it.
struct Training<S: Subject> {
    draw: Draw<S>,
    image: Image,
    parameterization: Parameterization,
}

impl<S: Subject> Training<S> {
    fn new<R: Optimizer<S>>(rasterizer: &R, blend: Blend) -> Result<Self, Failure> {
        let mut draw = S::typical(blend, 15, (30, 24), 2001);
        draw.settings.effects.statistics = Statistics::MeanGradient;
        let parameterization = parameterizations::<S, R>(rasterizer)?.pop().unwrap_or_default();
        Ok(Self { image: draw.target()?, draw, parameterization })
    }

    fn upload<R: Optimizer<S>>(&self, rasterizer: &R) -> Result<R::Splats, Failure> {
        Ok(rasterizer.upload(&self.draw.scene, self.parameterization)?)
    }

    /// Submits steps with the numbers `steps`, every third with new lists, and calls `after` after
    /// each.
    fn send<R: Optimizer<S>>(
        &self,
        rasterizer: &R,
        splats: &mut R::Splats,
        steps: std::ops::Range<usize>,
        mut after: impl FnMut(&mut R::Splats) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let target = rasterizer.upload_target(&self.image)?;
        for number in steps {
            // Every step has another schedule and loss, so that steps cannot be confused.
            let rates = S::adam().at(number as f32 / STEPS as f32);
            let binning = if number % 3 == 0 { Binning::Fresh } else { Binning::Reuse };
            let loss = [Loss::L2, Loss::L1][number % 2];
            let step = TrainStep { settings: &self.draw.settings, loss, rates: &rates, binning };
            rasterizer.train_step(splats, &self.draw.view, &target, &step).block_on()?;
            after(splats)?;
        }
        Ok(())
    }
}

fn same(what: &str, expected: &[f32], found: &[f32]) -> Result<(), Failure> {
    let bits = |losses: &[f32]| losses.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    Failure::unless(bits(expected) == bits(found), || format!("{what}: the losses are {found:?}, not {expected:?}"))
}

/// [`Optimizer::losses`] returns the loss of each step once and in order, after the caller's own
/// list.
///
/// The result is the same whether the caller waits for each step, polls, or waits at the end.
/// Refused steps have no loss.
pub(crate) fn losses_are_reported_once_and_in_order<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        let training = Training::<S>::new(rasterizer, blend)?;
        let mut splats = training.upload(rasterizer)?;
        let mut waited_for = losses_of(rasterizer, &mut splats)?;
        same("before any step", &[], &waited_for)?;
        training.send(rasterizer, &mut splats, 0..STEPS, |splats| {
            let one = losses_of(rasterizer, splats)?;
            Failure::unless(one.len() == 1, || format!("after one step there are {} losses", one.len()))?;
            waited_for.extend(one);
            Ok(())
        })?;
        let distinct = waited_for.iter().map(|v| v.to_bits()).collect::<std::collections::BTreeSet<_>>().len();
        Failure::unless(distinct == STEPS, || format!("only {distinct} of {STEPS} losses are distinct"))?;
        same("after the last", &[], &losses_of(rasterizer, &mut splats)?)?;

        let mut splats = training.upload(rasterizer)?;
        let mut arrived = vec![-1.0];
        training.send(rasterizer, &mut splats, 0..STEPS, |splats| {
            Ok(rasterizer.losses(splats, Wait::Arrived, &mut arrived).block_on()?)
        })?;
        rasterizer.losses(&mut splats, Wait::All, &mut arrived).block_on()?;
        same("as they arrive", &[&[-1.0], &waited_for[..]].concat(), &arrived)?;

        let mut splats = training.upload(rasterizer)?;
        training.send(rasterizer, &mut splats, 0..STEPS, |_| Ok(()))?;
        let wrong = rasterizer.upload_target(&Image::filled(3, 3, [0.5; 3])?)?;
        let rates = S::adam().at(0.0);
        let settings = &training.draw.settings;
        let step = TrainStep { settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
        let refused = rasterizer.train_step(&mut splats, &training.draw.view, &wrong, &step).block_on().is_err();
        Failure::unless(refused, || "a step towards a target of another size is accepted".to_owned())?;
        same("all at once", &waited_for, &losses_of(rasterizer, &mut splats)?)?;
    }
    Ok(())
}

/// Every call sees all steps that were submitted before it, and leaves the losses unchanged.
pub(crate) fn every_call_sees_pending_steps<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        let training = Training::<S>::new(rasterizer, blend)?;
        let target = rasterizer.upload_target(&training.image)?;
        let Draw { view, settings, .. } = &training.draw;
        let rates = S::adam().at(0.0);
        type Look<'a, C> = &'a dyn Fn(&mut C) -> Result<Vec<f32>, Failure>;
        let state =
            |splats: &mut R::Splats| -> Result<Vec<f32>, Failure> { Ok(floats(&rasterizer.save(splats).block_on()?)) };
        let looks: [(&str, Look<'_, R::Splats>); 8] = [
            ("save", &state),
            ("download", &|splats| {
                let rows = rasterizer.download(splats).block_on()?.rows().gaussians;
                Ok(rows.into_iter().flatten().map(|v| v as f32).collect())
            }),
            ("statistics", &|splats| Ok(rasterizer.statistics(splats).block_on()?.signal_sum)),
            ("forward", &|splats| {
                let image = rasterizer.image(&rasterizer.forward(splats, view, settings).block_on()?).block_on()?;
                Ok(image.pixels().as_flattened().to_vec())
            }),
            ("edit", &|splats| {
                rasterizer
                    .edit(splats, &EditPlan { statistics: AfterEdit::Restart, ..EditPlan::default() })
                    .block_on()?;
                state(splats)
            }),
            ("step", &|splats| {
                let pass = rasterizer.forward(splats, view, settings).block_on()?;
                let (_, gradients) = rasterizer.backward(splats, pass, &target, &Loss::L2).block_on()?;
                rasterizer.step(splats, &gradients, &rates).block_on()?;
                state(splats)
            }),
            ("solve_colors", &|splats| match rasterizer.solve_colors(splats, view, &target, settings, 3).block_on() {
                Ok(()) | Err(Error::Unsupported { .. }) => state(splats),
                Err(error) => Err(error.into()),
            }),
            ("len", &|splats| Ok(vec![rasterizer.len(splats) as f32])),
        ];
        for (what, look) in looks {
            // Both train on afterwards. Steps 5 and 8 would reuse lists, which an edit forbids.
            let run = |settled: bool| {
                let (mut splats, mut losses, mut seen) = (training.upload(rasterizer)?, Vec::new(), Vec::new());
                for steps in [0..5, 5..8] {
                    training.send(rasterizer, &mut splats, steps, |_| Ok(()))?;
                    if settled {
                        losses.extend(losses_of(rasterizer, &mut splats)?);
                    }
                    seen.extend(look(&mut splats)?);
                }
                losses.extend(losses_of(rasterizer, &mut splats)?);
                seen.extend(state(&mut splats)?);
                Ok::<_, Failure>((losses, seen))
            };
            let ((expected, seen), (losses, found)) = (run(true)?, run(false)?);
            Failure::unless(expected.len() == 8, || format!("{} losses of 8 steps", expected.len()))?;
            same(what, &expected, &losses)?;
            let equal = seen.iter().map(|v| v.to_bits()).eq(found.iter().map(|v| v.to_bits()));
            Failure::unless(equal, || format!("{blend:?}: `{what}` right after five steps does not see all of them"))?;
        }
    }
    Ok(())
}

/// All numbers of a state, one tensor after the other.
fn floats(state: &SplatsState) -> Vec<f32> {
    use gs_core::TensorData;
    let of = |data: &TensorData| match data {
        TensorData::F32(values) => values.clone(),
        TensorData::U32(values) => values.iter().map(|&v| f32::from_bits(v)).collect(),
    };
    state.tensors.values().flat_map(|tensor| of(&tensor.data)).collect()
}
