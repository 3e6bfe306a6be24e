//! Puts a backend through a case: forward, backward, and training in every chart that the backend offers.

use std::time::Instant;

use gs_core::{Binning, Chart, Image, Rasterizer, TrainStep, Wait, statistics::Culled};

use super::{
    case::{Case, Drawn, Expected, NEGLIGIBLE, Picture, Slopes, Training},
    report::{Observed, Record},
};
use crate::{
    failure::Failure,
    oracle::{Gradients, Oracle},
    subject::Subject,
    tolerance::{Agreement, ROUNDINGS, compare_gradients, compare_images, compare_loss},
};

/// How much worse the last loss of a run may be than its first, relative, where it must be no worse: Adam's steps do not shrink at an optimum.
const NO_WORSE: f32 = 0.02;

/// Puts `rasterizer` through one case.
pub fn run<S: Subject, R: Rasterizer<S>>(rasterizer: &R, case: &Case<S>) -> Record {
    let start = Instant::now();
    let outcome = outcome(rasterizer, case);
    Record { case: case.name.clone(), backend: rasterizer.describe(), outcome, took: start.elapsed() }
}

fn outcome<S: Subject, R: Rasterizer<S>>(rasterizer: &R, case: &Case<S>) -> Result<Observed, Failure> {
    let drawn = match &case.expected {
        Expected::Drawn(drawn) => drawn,
        Expected::Refused(right) => {
            return match rasterizer.render(&case.scene, &case.view, &case.settings) {
                Ok(_) => Err(Failure::Broken("accepted, where it must be refused".to_owned())),
                Err(error) if right(&error) => Ok(Observed::default()),
                Err(error) => Err(error.into()),
            };
        }
    };
    let mut observed = Observed { runs: 1, ..Observed::default() };
    for chart in crate::conformance::charts::<S, R>(rasterizer)? {
        let in_chart = |failure: Failure| failure.at(format!("{chart:?}"));
        let shown = forward(rasterizer, case, drawn, chart, &mut observed).map_err(in_chart)?;
        backward(rasterizer, case, drawn, chart, &shown, &mut observed).map_err(in_chart)?;
        train(rasterizer, case, drawn, chart, &shown, &mut observed).map_err(in_chart)?;
    }
    Ok(observed)
}

/// Whether gradients are by what the scene says, number by number. In local frames they are not: axes are found from a frame that is rounded
/// itself, which turns a needle by as much as its aspect times the rounding, and those of what is round are any.
fn is_comparable(chart: Chart) -> bool {
    chart == Chart::ScaleRotation
}

/// Takes the agreement in one more chart into account.
fn add(all: &mut Option<Agreement>, more: Agreement) {
    *all = Some(all.map_or(more, |before| before.and(more)));
}

fn forward<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    case: &Case<S>,
    drawn: &Drawn,
    chart: Chart,
    observed: &mut Observed,
) -> Result<Image, Failure> {
    let cloud = rasterizer.upload(&case.scene, chart)?;
    let frame = rasterizer.forward(&cloud, &case.view, &case.settings)?;
    let (image, culled) = (rasterizer.image(&frame)?, rasterizer.culled(&frame)?);
    let finite = image.pixels().as_flattened().iter().all(|v| v.is_finite());
    Failure::unless(finite, || "the image is not finite".to_owned())?;
    Failure::unless(culled == drawn.culled, || format!("left out {culled:?}, expected {:?}", drawn.culled))?;
    observed.drawn = [case.scene.len() as u64 - culled.total(), culled.total()];
    match &drawn.picture {
        Picture::Oracle => {
            let rows = match chart {
                Chart::ScaleRotation => case.scene.rows(),
                Chart::LocalFrame => case.scene.rows_of_frames(rasterizer.save(&cloud)?.matrix("frame")?.1),
            };
            let expected = Oracle::new(case.view, case.settings)?.render(&rows);
            // To the oracle, those behind full pixels are as much outside as those beyond the image; a backend's lists have them.
            let hidden = expected.culled.outside.saturating_sub(drawn.culled.outside);
            let agreed = Culled { outside: expected.culled.outside - hidden, ..expected.culled } == drawn.culled;
            Failure::unless(agreed, || {
                format!("the oracle leaves out {:?}, the case says {:?}", expected.culled, drawn.culled)
            })?;
            if expected.drawn.contains(&true) {
                add(&mut observed.image, compare_images(&expected, &image)?);
            } else {
                let same = image == expected.image();
                Failure::unless(same, || "there is more than the background".to_owned())?;
            }
        }
        Picture::Exact(expected) => {
            let bits = |image: &Image| image.pixels().as_flattened().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            let same = expected.size() == image.size() && bits(expected) == bits(&image);
            Failure::unless(same, || format!("{:?} and so on is not to the bit what is expected", image.pixels()[0]))?;
        }
        Picture::Within(expected, share) => {
            expected.same_size(&image)?;
            let mut agreement = Agreement::default();
            for (found, expected) in image.pixels().as_flattened().iter().zip(expected.pixels().as_flattened()) {
                let off = (found - expected).abs();
                Failure::unless(off <= share * expected.abs(), || format!("{found:e} where {expected:e} is expected"))?;
                agreement.worst_share = agreement.worst_share.max(f64::from(off));
                agreement.compared += 1;
            }
            add(&mut observed.image, agreement);
        }
    }
    Ok(image)
}

fn backward<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    case: &Case<S>,
    drawn: &Drawn,
    chart: Chart,
    shown: &Image,
    observed: &mut Observed,
) -> Result<(), Failure> {
    let goal = case.goal.image(shown)?;
    let target = rasterizer.upload_target(&goal)?;
    let cloud = rasterizer.upload(&case.scene, chart)?;
    let frame = rasterizer.forward(&cloud, &case.view, &case.settings)?;
    let (loss, gradients) = rasterizer.backward(&cloud, frame, &target, &case.loss)?;
    let gradients = rasterizer.download_gradients(&cloud, &gradients)?;
    let rows = gradients.rows_of_gradients();
    let named = |wrong: fn(f64) -> bool, what: &str| {
        let found = rows.iter().enumerate().find_map(|(g, row)| Some((g, row.iter().position(|&v| wrong(v))?)));
        Failure::unless(found.is_none(), || {
            let (g, i) = found.unwrap_or_default();
            format!("gradient of Gaussian {g}, {}, is {:e}, not {what}", S::parameter_name(i), rows[g][i])
        })
    };
    if drawn.training != Training::Moves {
        named(|v| !v.is_finite(), "finite")?;
        Failure::unless(loss.is_finite(), || format!("the loss is {loss}"))?;
    }
    match drawn.slopes {
        Slopes::Finite(_) => {}
        Slopes::Zero => named(|v| v != 0.0, "0")?,
        Slopes::Oracle | Slopes::Leading(_) if !is_comparable(chart) => {}
        Slopes::Oracle | Slopes::Leading(_) => {
            let oracle = Oracle::new(case.view, case.settings)?;
            let mut expected = oracle.gradients(&case.scene.rows(), &goal, &case.loss)?;
            if drawn.slopes != Slopes::Oracle {
                allow_for_negligible(&mut expected);
            }
            compare_loss(&expected, loss)?;
            observed.gradients = Some(compare_gradients(&expected, &gradients)?);
        }
    }
    Ok(())
}

/// Allows for an error of [`NEGLIGIBLE`] of a Gaussian's largest gradient in all of them.
fn allow_for_negligible(expected: &mut Gradients) {
    for (values, rounding) in expected.values.iter().zip(&mut expected.rounding) {
        let largest = values.iter().fold(0.0f64, |most, v| most.max(v.abs()));
        rounding.iter_mut().for_each(|v| *v += NEGLIGIBLE / ROUNDINGS * largest);
    }
}

fn train<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    case: &Case<S>,
    drawn: &Drawn,
    chart: Chart,
    shown: &Image,
    observed: &mut Observed,
) -> Result<(), Failure> {
    let target = rasterizer.upload_target(&case.goal.image(shown)?)?;
    let mut cloud = rasterizer.upload(&case.scene, chart)?;
    let before = rasterizer.download(&cloud)?;
    let rates = case.adam.at(0.0);
    let step = TrainStep { settings: &case.settings, loss: case.loss, rates: &rates, binning: Binning::Fresh };
    let mut last_but_one = before.clone();
    for i in 0..case.steps {
        if i + 1 == case.steps && drawn.training == Training::Moves {
            last_but_one = rasterizer.download(&cloud)?;
        }
        rasterizer.train_step(&mut cloud, &case.view, &target, &step)?;
    }
    let mut losses = Vec::new();
    rasterizer.losses(&mut cloud, Wait::All, &mut losses)?;
    Failure::unless(losses.len() == case.steps, || format!("{} losses of {} steps", losses.len(), case.steps))?;
    let wrong = losses.iter().position(|loss| match drawn.training {
        Training::Moves => loss.is_nan(),
        _ => !loss.is_finite(),
    });
    Failure::unless(wrong.is_none(), || {
        let at = wrong.unwrap_or_default();
        format!("the loss before step {at} is {}", losses[at])
    })?;
    let after = rasterizer.download(&cloud)?;
    stay_finite(rasterizer, case, drawn, &cloud, &after)?;
    stay_bounded(case, &after)?;
    let (Some(&first), Some(&last)) = (losses.first(), losses.last()) else { return Ok(()) };
    observed.losses = Some([first, last]);
    match drawn.training {
        Training::Finite(_) => Ok(()),
        Training::Moves => {
            let still = (0..after.len()).find(|&i| after.gaussian(i) == last_but_one.gaussian(i));
            Failure::unless(still.is_none(), || format!("Gaussian {} moves no more", still.unwrap_or_default()))
        }
        Training::Improves => {
            Failure::unless(last <= first * (1.0 + NO_WORSE), || format!("the loss went from {first:e} to {last:e}"))
        }
        Training::StandsStill => {
            let equal = losses.iter().all(|&loss| loss == first);
            Failure::unless(equal, || format!("losses that must be the same begin {first:e} and end {last:e}"))?;
            Failure::unless(before == after, || "Gaussians without a gradient moved".to_owned())
        }
    }
}

/// How far beyond their bounds scales may be, as a difference of logarithms: those of a frame are found again with roundings.
const BEYOND: f64 = 1e-2;

/// The scales of all Gaussians that are finite are within the optimiser's bounds after training.
fn stay_bounded<S: Subject>(case: &Case<S>, after: &S) -> Result<(), Failure> {
    if case.steps == 0 {
        return Ok(());
    }
    let bounds = [case.adam.min_scale, case.adam.max_scale].map(|scale| f64::from(scale).ln());
    for (g, row) in after.rows().gaussians.iter().enumerate() {
        for (i, &value) in
            row.iter().enumerate().filter(|&(i, v)| v.is_finite() && S::parameter_name(i).starts_with("ln-"))
        {
            let within = value >= bounds[0] - BEYOND && value <= bounds[1] + BEYOND;
            Failure::unless(within, || {
                let what = S::parameter_name(i);
                format!("after {} steps, {what} of Gaussian {g} is {value:e}, beyond {bounds:?}", case.steps)
            })?;
        }
    }
    Ok(())
}

/// All Gaussians are finite after training, but those that were left out from the start, because they have no direction or no size; of these,
/// those that are not are counted.
fn stay_finite<S: Subject, R: Rasterizer<S>>(
    rasterizer: &R,
    case: &Case<S>,
    drawn: &Drawn,
    cloud: &R::Cloud,
    after: &S,
) -> Result<(), Failure> {
    let broken: Vec<_> = (0..after.len()).filter_map(|i| after.picked([i]).validate().err()).collect();
    let Some(first) = broken.first() else { return Ok(()) };
    let counted = rasterizer.culled(&rasterizer.forward(cloud, &case.view, &case.settings)?)?;
    let (most, broken) = ((drawn.culled.degenerate + drawn.culled.not_finite) as usize, broken.len());
    Failure::unless(broken <= most && broken <= counted.not_finite as usize, || {
        format!(
            "after {} steps, {broken} are not finite, of which {} are counted: {first}",
            case.steps, counted.not_finite
        )
    })
}
