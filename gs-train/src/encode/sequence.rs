//! Quantization in turns: a group of Gaussians is rounded and fixed, and those that are left adapt
//! to the error before the next group is rounded.
//!
//! The picture is a sum, so those that are left are trained on the target without the fixed ones.
//! Large Gaussians come first: smaller ones upon them can undo what their rounding does.

use gs_codec::{Code, Quantizer};
use gs_core::{
    Binning, Blend, Canvas, Gaussian2d, Image, Loss, Optimizer, Parameterization, RenderSettings, Scene2d, TargetImage,
    TrainStep,
};

use super::progress::Stage;
use crate::{
    error::Error,
    fit::{FitSettings, FitTarget},
};

/// Groups of Gaussians.
const GROUPS: usize = 16;

/// Steps of those that are left after each group.
const STEPS: u32 = 12;

/// First learning rate of these steps, as a share of that at the start of a fit; it falls linearly.
const RATE: f32 = 0.2;

/// Iterations of the solver of colours after these steps.
const SOLVER_ITERATIONS: u32 = 2;

/// Quantizes the scene of a fit to `target`, from which what others draw on `canvas` is subtracted.
pub(super) async fn quantize<R: Optimizer<Scene2d>>(
    on: &R,
    (target, canvas): (FitTarget<'_>, &Canvas),
    scene: &Scene2d,
    quantizer: &Quantizer,
    settings: &FitSettings,
    stage: &Stage<'_>,
) -> Result<Vec<Code>, Error> {
    let render = RenderSettings::blended(Blend::Sum);
    let mut rest: Vec<Gaussian2d> = scene.iter().collect();
    rest.sort_by(|a, b| b.log_scale.element_sum().total_cmp(&a.log_scale.element_sum()));
    let mut left = target.image.clone();
    let mut codes = Vec::with_capacity(rest.len());
    for group in 0..GROUPS {
        let later = rest.split_off(rest.len() / (GROUPS - group));
        let fixed: Vec<Code> = rest.iter().filter_map(|g| quantizer.quantize(g)).collect();
        rest = later;
        if rest.is_empty() {
            codes.extend(fixed);
            break;
        }
        let drawn = on.render(&fixed.iter().map(|code| quantizer.reconstruct(code)).collect(), canvas, &render).await?;
        left = difference(&left, &drawn)?;
        codes.extend(fixed);
        let goal = on.upload_target(TargetImage { weights: target.weights, ..TargetImage::from(&left) })?;
        let mut splats = on.upload(&rest.into_iter().collect(), Parameterization::CovarianceFactor)?;
        for step in 0..STEPS {
            let share = RATE * (1.0 - step as f32 / STEPS as f32);
            let rates = settings.adam.at(0.0).times(share);
            let binning = if step.is_multiple_of(settings.rebin_every) { Binning::Fresh } else { Binning::Reuse };
            let step = TrainStep { settings: &render, loss: Loss::L2, rates: &rates, binning };
            on.train_step(&mut splats, canvas, &goal, &step).await?;
        }
        on.solve_colors(&mut splats, canvas, &goal, &render, SOLVER_ITERATIONS).await?;
        rest = on.download(&splats).await?.iter().collect();
        stage.report((group + 1) as f64 / GROUPS as f64);
    }
    Ok(codes)
}

/// The difference of two images of one size, pixel by pixel.
pub(super) fn difference(a: &Image, b: &Image) -> Result<Image, Error> {
    plus(a, -1.0, b)
}

/// The sum of two images of one size, pixel by pixel.
pub(super) fn sum(a: &Image, b: &Image) -> Result<Image, Error> {
    plus(a, 1.0, b)
}

/// a + sign · b.
fn plus(a: &Image, sign: f32, b: &Image) -> Result<Image, Error> {
    a.same_size(b)?;
    let values = a.pixels().as_flattened().iter().zip(b.pixels().as_flattened());
    let values: Vec<f32> = values.map(|(&a, &b)| a + sign * b).collect();
    Ok(Image::from_pixels(a.width(), a.height(), values.as_chunks().0.to_vec())?)
}
