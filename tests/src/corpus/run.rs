//! Runs a case on a backend: forward, backward, and training in every parameterization that it
//! offers.

use pollster::FutureExt as _;
use std::{ops::RangeInclusive, time::Instant};

use gs_core::{Binning, Culled, Image, Optimizer, Parameterization, SplatsState, TrainStep, Wait};

use super::{
    case::{Case, Drawn, Expected, NEGLIGIBLE, Picture, Slopes, Training},
    report::{Observed, Record},
};
use crate::{
    failure::Failure,
    oracle::{Gradients, Oracle, OracleScene, Parameters},
    subject::Subject,
    tolerance::{Agreement, ROUNDINGS, compare_gradients, compare_images, compare_loss},
};

/// Runs one case on `rasterizer`.
pub fn run<S: Subject, R: Optimizer<S>>(rasterizer: &R, case: &Case<S>) -> Record {
    let start = Instant::now();
    let outcome = outcome(rasterizer, case);
    Record { case: case.name.clone(), backend: rasterizer.describe(), outcome, took: start.elapsed() }
}

fn outcome<S: Subject, R: Optimizer<S>>(rasterizer: &R, case: &Case<S>) -> Result<Observed, Failure> {
    let drawn = match &case.expected {
        Expected::Drawn(drawn) => drawn,
        Expected::Refused(right) => {
            return match rasterizer.render(&case.scene, &case.view, &case.settings).block_on() {
                Ok(_) => Err(Failure::Broken("accepted, where it must be refused".to_owned())),
                Err(error) if right(&error) => Ok(Observed::default()),
                Err(error) => Err(error.into()),
            };
        }
    };
    let mut observed = Observed { runs: 1, ..Observed::default() };
    for parameterization in crate::conformance::parameterizations::<S, R>(rasterizer)? {
        let run = Run { rasterizer, case, drawn, parameterization };
        run.run(&mut observed).map_err(|failure| failure.at(format!("{parameterization:?}")))?;
    }
    Ok(observed)
}

/// A scene's Gaussians in the oracle's form, which must be those of the splats.
pub(super) fn rows_of<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    scene: &S,
    splats: &R::Splats,
    parameterization: Parameterization,
) -> Result<OracleScene, Failure> {
    Ok(match parameterization {
        Parameterization::ScaleRotation => scene.rows(),
        Parameterization::CovarianceFactor => {
            scene.rows_of_factors(rasterizer.save(splats).block_on()?.matrix("factor")?.1)
        }
    })
}

/// Range of a Gaussian's aspect in which its axes can be read from a rounded factor. The axes of a
/// disc are arbitrary, and those of a needle are rotated by its aspect times the rounding.
const TELLING_RATIOS: RangeInclusive<f64> = 1.05..=100.0;

/// Whether gradients by the numbers of the rows are comparable.
fn is_comparable<S: Subject>(rows: &OracleScene, parameterization: Parameterization) -> bool {
    let has_axes = |row: &Parameters| {
        let mut log_scales = row[S::DIMENSIONS..2 * S::DIMENSIONS].to_vec();
        log_scales.sort_by(f64::total_cmp);
        log_scales.array_windows().all(|[a, b]| TELLING_RATIOS.contains(&(b - a).exp()))
    };
    parameterization == Parameterization::ScaleRotation || rows.gaussians.iter().all(has_axes)
}

/// Adds the agreement in another parameterization.
fn add(all: &mut Option<Agreement>, more: Agreement) {
    *all = Some(all.map_or(more, |before| before.and(more)));
}

/// A backend and a case in one parameterization.
struct Run<'r, S: Subject, R> {
    rasterizer: &'r R,
    case: &'r Case<S>,
    drawn: &'r Drawn,
    parameterization: Parameterization,
}

impl<S: Subject, R: Optimizer<S>> Run<'_, S, R> {
    fn run(&self, observed: &mut Observed) -> Result<(), Failure> {
        let &Self { rasterizer, case, parameterization, .. } = self;
        let splats = rasterizer.upload(&case.scene, parameterization)?;
        let pass = rasterizer.forward(&splats, &case.view, &case.settings).block_on()?;
        let shown = self.forward(&splats, &pass, observed)?;
        let goal = case.goal.image(&shown)?;
        let target = rasterizer.upload_target(&goal)?;
        let slopes = self.backward(&splats, pass, (&goal, &target), observed)?;
        self.train(splats, &target, &slopes, observed)
    }

    /// The image.
    fn forward(&self, splats: &R::Splats, pass: &R::ForwardPass, observed: &mut Observed) -> Result<Image, Failure> {
        let &Self { rasterizer, case, drawn, .. } = self;
        let (image, culled) = (rasterizer.image(pass).block_on()?, rasterizer.culled(pass));
        image.check_finite("the image")?;
        Failure::unless(culled == drawn.culled, || format!("left out {culled:?}, expected {:?}", drawn.culled))?;
        observed.drawn = [case.scene.len() as u64 - culled.total(), culled.total()];
        match &drawn.picture {
            Picture::Oracle => self.is_the_oracles(splats, &image, observed)?,
            Picture::Exact(expected) => {
                let bits =
                    |image: &Image| image.pixels().as_flattened().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                let same = expected.size() == image.size() && bits(expected) == bits(&image);
                Failure::unless(same, || {
                    format!("{:?} and so on is not to the bit what is expected", image.pixels()[0])
                })?;
            }
            Picture::Within(expected, share) => add(&mut observed.image, is_within(&image, expected, *share)?),
        }
        Ok(image)
    }

    fn is_the_oracles(&self, splats: &R::Splats, image: &Image, observed: &mut Observed) -> Result<(), Failure> {
        let &Self { rasterizer, case, drawn, parameterization } = self;
        let rows = rows_of(rasterizer, &case.scene, splats, parameterization)?;
        let expected = Oracle::new(case.view, case.settings)?.render(&rows);
        // The oracle counts Gaussians behind full pixels as outside. A backend lists them.
        let hidden = expected.culled.outside.saturating_sub(drawn.culled.outside);
        let agreed = Culled { outside: expected.culled.outside - hidden, ..expected.culled } == drawn.culled;
        Failure::unless(agreed, || {
            format!("the oracle leaves out {:?}, the case says {:?}", expected.culled, drawn.culled)
        })?;
        if expected.drawn.contains(&true) {
            add(&mut observed.image, compare_images(&expected, image)?);
            return Ok(());
        }
        Failure::unless(*image == expected.image(), || "there is more than the background".to_owned())
    }

    /// The gradients as rows.
    fn backward(
        &self,
        splats: &R::Splats,
        pass: R::ForwardPass,
        (goal, target): (&Image, &R::Target),
        observed: &mut Observed,
    ) -> Result<Vec<Parameters>, Failure> {
        let &Self { rasterizer, case, drawn, parameterization } = self;
        let (loss, gradients) = rasterizer.backward(splats, pass, target, &case.loss).block_on()?;
        let gradients = rasterizer.gradients(splats, &gradients).block_on()?;
        let rows = gradients.rows_of_gradients();
        if drawn.training != Training::Moves {
            none_is::<S>(&rows, |v| !v.is_finite(), "finite")?;
            Failure::unless(loss.is_finite(), || format!("the loss is {loss}"))?;
        }
        match drawn.slopes {
            Slopes::Finite(_) => {}
            Slopes::Zero => none_is::<S>(&rows, |v| v != 0.0, "0")?,
            Slopes::Oracle | Slopes::Leading(_) => {
                let shapes = rows_of(rasterizer, &case.scene, splats, parameterization)?;
                if is_comparable::<S>(&shapes, parameterization) {
                    let oracle = Oracle::new(case.view, case.settings)?;
                    let mut expected = oracle.gradients(&shapes, goal, &case.loss)?;
                    if drawn.slopes != Slopes::Oracle {
                        allow_for_negligible(&mut expected);
                    }
                    compare_loss(&expected, loss)?;
                    add(&mut observed.gradients, compare_gradients(&expected, &gradients)?);
                }
            }
        }
        Ok(rows)
    }

    /// `slopes`: the gradients before the first step.
    fn train(
        &self,
        mut splats: R::Splats,
        target: &R::Target,
        slopes: &[Parameters],
        observed: &mut Observed,
    ) -> Result<(), Failure> {
        let &Self { rasterizer, case, drawn, .. } = self;
        let before = rasterizer.download(&splats).block_on()?;
        let rates = case.adam.at(0.0);
        let step = TrainStep { settings: &case.settings, loss: case.loss, rates: &rates, binning: Binning::Fresh };
        let mut last_but_one = before.clone();
        for i in 0..case.steps {
            if i + 1 == case.steps && drawn.training == Training::Moves {
                last_but_one = rasterizer.download(&splats).block_on()?;
            }
            rasterizer.train_step(&mut splats, &case.view, target, &step).block_on()?;
        }
        let mut losses = Vec::new();
        rasterizer.losses(&mut splats, Wait::All, &mut losses).block_on()?;
        check_losses(case, drawn, &losses)?;
        let after = rasterizer.download(&splats).block_on()?;
        self.stay_finite(&splats, &after)?;
        stay_bounded(case, &after)?;
        have_moved(case, slopes, &before, &after)?;
        are_counted(case, &rasterizer.save(&splats).block_on()?)?;
        self.came_to(&losses, [&before, &last_but_one, &after], observed)
    }

    /// Checks the losses, and the Gaussians before the first step, before the last step and after
    /// it.
    fn came_to(
        &self,
        losses: &[f32],
        [before, last_but_one, after]: [&S; 3],
        observed: &mut Observed,
    ) -> Result<(), Failure> {
        let (Some(&first), Some(&last)) = (losses.first(), losses.last()) else { return Ok(()) };
        observed.losses = Some([first, last]);
        match self.drawn.training {
            Training::Finite(_) => Ok(()),
            Training::Moves => {
                let still = (0..after.len()).find(|&i| after.gaussian(i) == last_but_one.gaussian(i));
                Failure::unless(still.is_none(), || format!("Gaussian {} moves no more", still.unwrap_or_default()))
            }
            Training::Improves => {
                Failure::unless(last <= first, || format!("the loss went from {first:e} to {last:e}"))
            }
            Training::StandsStill => {
                let equal = losses.iter().all(|&loss| loss == first);
                Failure::unless(equal, || format!("losses that must be the same begin {first:e} and end {last:e}"))?;
                Failure::unless(before == after, || "Gaussians without a gradient moved".to_owned())
            }
        }
    }

    /// Checks that all Gaussians are finite after training, except for those that were culled from
    /// the start because of a zero quaternion or size. Such Gaussians must be counted.
    fn stay_finite(&self, splats: &R::Splats, after: &S) -> Result<(), Failure> {
        let &Self { rasterizer, case, drawn, .. } = self;
        if after.validate().is_ok() {
            return Ok(());
        }
        let broken: Vec<_> = (0..after.len()).filter_map(|i| after.picked([i]).validate().err()).collect();
        let Some(first) = broken.first() else { return Ok(()) };
        let counted = rasterizer.culled(&rasterizer.forward(splats, &case.view, &case.settings).block_on()?);
        let (most, broken) = ((drawn.culled.degenerate + drawn.culled.not_finite) as usize, broken.len());
        Failure::unless(broken <= most && broken <= counted.not_finite as usize, || {
            format!(
                "after {} steps, {broken} are not finite, of which {} are counted: {first}",
                case.steps, counted.not_finite
            )
        })
    }
}

/// Compares an image with an expected one within a relative error.
fn is_within(image: &Image, expected: &Image, share: f32) -> Result<Agreement, Failure> {
    expected.same_size(image)?;
    let mut agreement = Agreement::default();
    for (found, expected) in image.pixels().as_flattened().iter().zip(expected.pixels().as_flattened()) {
        let off = (found - expected).abs();
        Failure::unless(off <= share * expected.abs(), || format!("{found:e} where {expected:e} is expected"))?;
        agreement.worst_share = agreement.worst_share.max(f64::from(off));
        agreement.compared += 1;
    }
    Ok(agreement)
}

/// Fails where a gradient is `wrong`, so that it is not `what`.
fn none_is<S: Subject>(rows: &[Parameters], wrong: fn(f64) -> bool, what: &str) -> Result<(), Failure> {
    let found = rows.iter().enumerate().find_map(|(g, row)| Some((g, row.iter().position(|&v| wrong(v))?)));
    Failure::unless(found.is_none(), || {
        let (g, i) = found.unwrap_or_default();
        format!("gradient of Gaussian {g}, {}, is {:e}, not {what}", S::parameter_name(i), rows[g][i])
    })
}

/// Allows for an error of [`NEGLIGIBLE`] of a Gaussian's largest gradient in all of them.
fn allow_for_negligible(expected: &mut Gradients) {
    for (values, rounding) in expected.values.iter().zip(&mut expected.rounding) {
        let largest = values.iter().fold(0.0f64, |most, v| most.max(v.abs()));
        rounding.iter_mut().for_each(|v| *v += NEGLIGIBLE / ROUNDINGS * largest);
    }
}

/// Checks that each step has a loss that is a number.
fn check_losses<S: Subject>(case: &Case<S>, drawn: &Drawn, losses: &[f32]) -> Result<(), Failure> {
    Failure::unless(losses.len() == case.steps, || format!("{} losses of {} steps", losses.len(), case.steps))?;
    let wrong = losses.iter().position(|loss| match drawn.training {
        Training::Moves => loss.is_nan(),
        _ => !loss.is_finite(),
    });
    Failure::unless(wrong.is_none(), || {
        let at = wrong.unwrap_or_default();
        format!("the loss before step {at} is {}", losses[at])
    })
}

/// Checks that Gaussians with gradients have moved. In the first step, a gradient as large as
/// Adam's ε moves a parameter by at least half the learning rate. After all steps, a Gaussian with
/// any gradient has moved.
fn have_moved<S: Subject>(case: &Case<S>, slopes: &[Parameters], before: &S, after: &S) -> Result<(), Failure> {
    let least = f64::from(case.adam.epsilon);
    let moves = |row: &Parameters| row.iter().any(|slope| slope.abs() >= least);
    let still = (0..slopes.len()).find(|&g| moves(&slopes[g]) && before.gaussian(g) == after.gaussian(g));
    Failure::unless(still.is_none(), || {
        let g = still.unwrap_or_default();
        format!("Gaussian {g} is where it was after {} steps, with gradients of {:?}", case.steps, slopes[g])
    })
}

/// Checks that all steps are counted for the bias correction, also for Gaussians without gradients.
fn are_counted<S: Subject>(case: &Case<S>, state: &SplatsState) -> Result<(), Failure> {
    let counted = state.integers("steps")?;
    let wrong = counted.iter().find(|&&steps| steps as usize != case.steps);
    Failure::unless(wrong.is_none(), || {
        format!("{} steps are counted of {}", wrong.copied().unwrap_or_default(), case.steps)
    })
}

/// Largest excess of a scale over its bounds, as a difference of logarithms. The scales of a factor
/// are rounded relative to the largest one; a millionth of a largest scale of 1 is a few dozen
/// roundings.
const BEYOND: f64 = 1e-1;

/// Checks that scales are within the optimizer's bounds after training, except for Gaussians with a
/// zero quaternion, which are never trained.
fn stay_bounded<S: Subject>(case: &Case<S>, after: &S) -> Result<(), Failure> {
    if case.steps == 0 {
        return Ok(());
    }
    let bounds = [case.adam.min_scale, case.adam.max_scale].map(|scale| f64::from(scale).ln());
    let within = |value: f64| !value.is_finite() || value >= bounds[0] - BEYOND && value <= bounds[1] + BEYOND;
    let rows = after.rows().gaussians;
    let named = |prefix: &str| -> Vec<usize> {
        (0..rows.first().map_or(0, Vec::len)).filter(|&i| S::parameter_name(i).starts_with(prefix)).collect()
    };
    let (scales, quaternion) = (named("ln-"), named("quaternion"));
    let has_direction = |row: &Parameters| quaternion.is_empty() || quaternion.iter().any(|&i| row[i] != 0.0);
    for (g, row) in rows.iter().enumerate().filter(|(_, row)| has_direction(row)) {
        let beyond = scales.iter().find(|&&i| !within(row[i]));
        Failure::unless(beyond.is_none(), || {
            let i = beyond.copied().unwrap_or_default();
            let (what, value) = (S::parameter_name(i), row[i]);
            format!("after {} steps, {what} of Gaussian {g} is {value:e}, beyond {bounds:?}", case.steps)
        })?;
    }
    Ok(())
}
