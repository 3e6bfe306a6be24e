//! Cases of densification statistics, compared with the oracle's. A backend may refuse statistics
//! with sums of their own as [`Error::Unsupported`], but then in every pass, and without changing
//! anything.

use gs_core::{
    Binning, Loss, Optimizer, Parameterization, TrainStep,
    adam::Group,
    effects::{Blend, Statistics},
};
use pollster::FutureExt as _;

use super::{CaseOutcome, is_refused};
use crate::{
    failure::Failure,
    oracle::{Oracle, StepStatistics},
    scenes::Draw,
    subject::Subject,
    tolerance::COLLECTED_SHARE,
};

/// [`Statistics::MeanGradient`] is the length of the gradient by the projected mean alone.
pub(crate) fn mean_gradients_match<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<CaseOutcome, Failure> {
    check(rasterizer, Statistics::MeanGradient, |step| &step.mean_gradient)
}

/// [`Statistics::AbsoluteGradient`] sums magnitudes pixel by pixel: for both blends, for fused and
/// separate steps, and through a view of another scale.
pub(crate) fn absolute_gradients_match<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<CaseOutcome, Failure> {
    check(rasterizer, Statistics::AbsoluteGradient, |step| &step.absolute_gradient)
}

/// [`Statistics::PixelGradient`] weights the gradient of each step by the Gaussian's number of
/// pixels, which is summed, too, and in 3D by its depth.
pub(crate) fn pixel_gradients_match<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<CaseOutcome, Failure> {
    check(rasterizer, Statistics::PixelGradient, |step| &step.pixel_gradient)
}

/// [`Statistics::PixelError`] sums each pixel's share of a Gaussian times the pixel's error.
pub(crate) fn pixel_errors_match<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<CaseOutcome, Failure> {
    check(rasterizer, Statistics::PixelError, |step| &step.pixel_error)
}

/// Number of Gaussians of a drawing.
const COUNT: usize = 12;

/// Depth from which gradients count fully: beyond some of the Gaussians of 3D drawings, and before
/// others.
const FULL_DEPTH: f32 = 5.0;

/// Drawings, each with a loss.
fn drawings<S: Subject>(statistics: Statistics) -> Vec<(Draw<S>, Loss)> {
    let draw = |(blend, loss, through)| {
        let draw = match through {
            None => S::typical(blend, COUNT, (37, 70), 1651),
            Some(size) => {
                let draw = S::overlapping(blend, COUNT, (30, 24), 1651);
                let view = S::resized(&draw.view, size);
                draw.through(view)
            }
        };
        let mut draw = draw.on([0.3, 0.5, 0.2]);
        draw.settings.effects.statistics = statistics;
        draw.settings.full_depth = FULL_DEPTH;
        (draw, loss)
    };
    [
        (Blend::Sum, Loss::L2, None),
        (Blend::Sum, Loss::PAPER, None),
        (Blend::Sum, Loss::L2, Some((44, 20))),
        (Blend::Over, Loss::L2, None),
        (Blend::Over, Loss::PAPER, None),
        (Blend::Over, Loss::L1, Some((44, 20))),
    ]
    .map(draw)
    .into()
}

/// The statistics are collected for all drawings that the backend offers, or for none.
fn check<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    statistics: Statistics,
    of_step: impl Fn(&StepStatistics) -> &Vec<f64>,
) -> Result<CaseOutcome, Failure> {
    let (mut collected, mut refused) = (Vec::new(), Vec::new());
    for (draw, loss) in drawings::<S>(statistics) {
        let place = format!("{statistics:?}, {:?}, {loss:?}, {:?}", draw.settings.effects.blend, draw.view);
        if statistics != Statistics::MeanGradient && is_refused(rasterizer, &draw)? {
            let mut plain = draw;
            plain.settings.effects.statistics = Statistics::None;
            if !is_refused(rasterizer, &plain)? {
                refused.push(place);
            }
            continue;
        }
        collected_match(rasterizer, &draw, loss, &of_step).map_err(|failure| failure.at(&place))?;
        collected.push(place);
    }
    match (&collected[..], &refused[..]) {
        ([], []) => Err(Failure::Nothing(format!("no drawing is offered for {statistics:?}"))),
        ([], _) => Ok(CaseOutcome::Skipped(format!("{statistics:?}"))),
        (_, []) => Ok(CaseOutcome::Passed),
        _ => Err(Failure::Broken(format!("collected are {collected:?}, but {refused:?} are refused"))),
    }
}

/// Compares two steps of one drawing, one in separate stages and one fused.
fn collected_match<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    draw: &Draw<S>,
    loss: Loss,
    of_step: impl Fn(&StepStatistics) -> &Vec<f64>,
) -> Result<(), Failure> {
    let still = Group::constant(1e-4);
    let groups = S::adam().with(|s| {
        s.mean = still;
        s.scale = still;
        s.rotation = still;
        s.opacity = still;
    });
    let rates = groups
        .with(|s| {
            s.color = still;
            s.color_rest = still;
        })
        .at(0.0);
    let image = draw.target()?;
    let target = rasterizer.upload_target(&image)?;
    let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
    let step = TrainStep { settings: &draw.settings, loss, rates: &rates, binning: Binning::Fresh };

    let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
    let oracle = Oracle::new(draw.view, draw.settings)?;
    let is_weighted = draw.settings.effects.statistics == Statistics::PixelGradient;
    let (mut expected, mut drawn, mut weights) = ([0.0; COUNT], [0u32; COUNT], [0u32; COUNT]);
    let (_, gradients) = rasterizer.backward(&splats, pass, &target, &loss).block_on()?;
    for whole in [false, true] {
        let scene = rasterizer.download(&splats).block_on()?.rows();
        let collected = oracle.statistics(&scene, &image, &loss)?;
        for (g, value) in of_step(&collected).iter().enumerate() {
            expected[g] += value;
            drawn[g] += u32::from(collected.pixels[g] > 0);
            weights[g] += if is_weighted { collected.pixels[g] } else { u32::from(collected.pixels[g] > 0) };
        }
        if whole {
            rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on()?;
        } else {
            rasterizer.step(&mut splats, &gradients, &rates).block_on()?;
        }
    }
    if drawn.iter().filter(|&&n| n == 2).count() < 8 {
        return Err(Failure::Nothing(format!("hardly a Gaussian is drawn: {drawn:?}")));
    }
    let found = rasterizer.statistics(&splats).block_on()?;
    for (g, (&expected, &found)) in weights.iter().zip(&found.visible).enumerate() {
        // A tile may list a Gaussian that is below the cut in all its pixels.
        let is_listed_only = !is_weighted && expected < found && found <= 2;
        Failure::unless(expected == found || is_listed_only, || {
            format!("the weights of Gaussian {g} add up to {found} instead of {expected}")
        })?;
    }
    sums_match(&expected, &found.signal_sum)
}

fn sums_match(expected: &[f64], found: &[f32]) -> Result<(), Failure> {
    let largest = expected.iter().fold(0.0f64, |m, v| m.max(*v));
    if !(largest > 0.0) {
        return Err(Failure::Nothing("all statistics are 0".to_owned()));
    }
    for (g, (a, &b)) in expected.iter().zip(found).enumerate() {
        let tolerance = COLLECTED_SHARE * (a + 1e-3 * largest);
        if !((a - f64::from(b)).abs() <= tolerance) {
            let what = format!("statistic of Gaussian {g}");
            return Err(Failure::Differs { what, expected: *a, found: f64::from(b), tolerance, others: 0 });
        }
    }
    Ok(())
}
