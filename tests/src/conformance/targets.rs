//! Cases: targets with an alpha and a mask.

use gs_core::{
    Binning, Image, Optimizer, Parameterization, TargetImage, TrainStep,
    effects::{Blend, Statistics},
    math::completed,
};
use pollster::FutureExt as _;

use super::{LOSSES, losses_of};
use crate::{failure::Failure, subject::Subject};

/// A target with alpha and mask equals the target that was completed by hand: blended with the
/// background, and with the rendered colours where the mask excludes a pixel. Losses, gradients,
/// steps and statistics agree within rounding; the loss alone equals that with gradients.
pub fn incomplete_targets_are_completed<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        let mut draw = S::typical(blend, 20, (37, 25), 1301).on([0.2, 0.7, 0.4]);
        let image = draw.target()?;
        let splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
        let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
        let rendered = rasterizer.image(&pass).block_on()?;
        let pixels = image.pixels().len();
        let alpha: Vec<f32> = (0..pixels).map(|i| (i % 5) as f32 / 4.0).collect();
        let mask: Vec<bool> = (0..pixels).map(|i| i % 7 != 3 && i > pixels / 4).collect();
        let background = draw.settings.background_color();
        for (alpha, mask) in [(Some(&alpha[..]), None), (None, Some(&mask[..])), (Some(&alpha[..]), Some(&mask[..]))] {
            let incomplete = TargetImage { image: &image, alpha, mask, compact: false };
            let coverage = incomplete.coverage().unwrap_or_default();
            let colors = image.pixels().iter().zip(rendered.pixels()).zip(&coverage);
            let colors = colors.map(|((target, rendered), &coverage)| {
                std::array::from_fn(|k| completed(target[k], coverage, background[k], rendered[k]))
            });
            let complete = Image::from_pixels(image.width(), image.height(), colors.collect())?;
            let targets = [rasterizer.upload_target(&complete)?, rasterizer.upload_target(incomplete)?];
            for loss in LOSSES {
                let place = || format!("{blend:?}, {loss:?}, alpha {}, mask {}", alpha.is_some(), mask.is_some());
                let mut of_targets = Vec::new();
                for target in &targets {
                    let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
                    let (value, gradients) = rasterizer.backward(&splats, pass, target, &loss).block_on()?;
                    let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
                    let alone = rasterizer.loss(&splats, pass, target, &loss).block_on()?;
                    Failure::unless(alone.to_bits() == value.to_bits(), || {
                        format!("{}: the loss alone is {alone}, with gradients {value}", place())
                    })?;
                    let rows = rasterizer.gradients(&splats, &gradients).block_on()?.rows_of_gradients();
                    draw.settings.effects.statistics = Statistics::PixelError;
                    let (rates, mut trained) = (S::adam().at(0.0), rasterizer.upload(&draw.scene, Default::default())?);
                    let step = TrainStep { settings: &draw.settings, loss, rates: &rates, binning: Binning::Fresh };
                    rasterizer.train_step(&mut trained, &draw.view, target, &step).block_on()?;
                    let reported = losses_of(rasterizer, &mut trained)?;
                    let statistics = rasterizer.statistics(&trained).block_on()?.signal_sum;
                    draw.settings.effects.statistics = Statistics::None;
                    let numbers = rows.into_iter().flatten().collect::<Vec<_>>();
                    of_targets.push([vec![f64::from(value)], widened(&reported), numbers, widened(&statistics)]);
                }
                for (what, (expected, found)) in ["loss", "a step's loss", "gradients", "pixel errors"]
                    .iter()
                    .zip(of_targets[0].iter().zip(&of_targets[1]))
                {
                    let most = expected.iter().fold(0.0f64, |most, v| most.max(v.abs()));
                    let close = expected.len() == found.len()
                        && expected.iter().zip(found).all(|(a, b)| (a - b).abs() <= 1e-4 * most);
                    Failure::unless(close, || {
                        format!("{}: {what} of the completed target: {expected:?}, found {found:?}", place())
                    })?;
                }
            }
        }
    }
    Ok(())
}

fn widened(values: &[f32]) -> Vec<f64> {
    values.iter().copied().map(f64::from).collect()
}
