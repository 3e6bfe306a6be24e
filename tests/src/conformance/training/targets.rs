//! Cases: targets with an alpha, a mask and weights.

use gs_core::{
    Binning, Error, Image, Loss, Optimizer, Parameterization, TargetImage, TrainStep,
    effects::{Blend, Statistics},
    math::completed,
};
use pollster::FutureExt as _;

use crate::conformance::{LOSSES, losses_of, refused};
use crate::{failure::Failure, subject::Subject};

/// A target with alpha and mask equals the target that was completed by hand: blended with the
/// background, and with the rendered colours where the mask excludes a pixel. Losses, gradients,
/// steps and statistics agree within rounding, also where the target is compact; the loss alone equals
/// that with gradients.
pub(crate) fn incomplete_targets_are_completed<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        let mut draw = S::typical(blend, 20, (37, 25), 1301).on([0.2, 0.7, 0.4]);
        let image = draw.target()?.rounded_to_8_bits();
        let splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
        let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
        let rendered = rasterizer.image(&pass).block_on()?;
        let pixels = image.pixels().len();
        let alpha: Vec<f32> = (0..pixels).map(|i| (i % 6) as f32 / 5.0).collect();
        let mask: Vec<bool> = (0..pixels).map(|i| i % 7 != 3 && i > pixels / 4).collect();
        let background = draw.settings.background_color();
        let (alpha, mask) = (Some(&alpha[..]), Some(&mask[..]));
        for (alpha, mask) in [(None, None), (alpha, None), (None, mask), (alpha, mask)] {
            let incomplete = TargetImage { alpha, mask, ..TargetImage::from(&image) };
            let coverage = incomplete.coverage().unwrap_or_else(|| vec![1.0; pixels]);
            let colors = image.pixels().iter().zip(rendered.pixels()).zip(&coverage);
            let colors = colors.map(|((target, rendered), &coverage)| {
                std::array::from_fn(|k| completed(target[k], coverage, background[k], rendered[k]))
            });
            let complete = Image::from_pixels(image.width(), image.height(), colors.collect())?;
            let compact = TargetImage { compact: true, ..incomplete };
            let targets = [TargetImage::from(&complete), incomplete, compact];
            let targets =
                targets.into_iter().map(|target| rasterizer.upload_target(target)).collect::<Result<Vec<_>, _>>()?;
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
                let (of_complete, of_others) = of_targets.split_first().expect("three targets");
                let whats = ["loss", "a step's loss", "gradients", "pixel errors"].into_iter().cycle();
                let pairs = of_others.iter().flat_map(|of_other| of_complete.iter().zip(of_other));
                for (what, (expected, found)) in whats.zip(pairs) {
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

/// Weights are factors of the loss of each pixel and of its gradient: loss and gradients are those of
/// the weighted gradient of the image, computed here. D-SSIM refuses them.
pub(crate) fn weights_are_factors_of_the_loss<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    for blend in [Blend::Sum, Blend::Over] {
        let draw = S::typical(blend, 20, (37, 25), 1302).on([0.2, 0.7, 0.4]);
        let image = draw.target()?;
        let weights = weights_of(&image);
        let weighted = TargetImage { weights: Some(&weights), ..TargetImage::from(&image) };
        let target = rasterizer.upload_target(weighted)?;
        let splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
        let forward = || rasterizer.forward(&splats, &draw.view, &draw.settings).block_on();
        for loss in LOSSES {
            let place = || format!("{blend:?}, {loss:?}");
            if !loss.is_pointwise() {
                let found = rasterizer.backward(&splats, forward()?, &target, &loss).block_on();
                refused(&place(), found, |error| matches!(error, Error::Unsupported { .. }))?;
                continue;
            }
            let rendered = rasterizer.image(&forward()?).block_on()?;
            let count = (3 * image.pixels().len()) as f64;
            let (mut expected, mut v_image) = (0.0, Vec::new());
            for ((c, y), &weight) in rendered.pixels().iter().zip(image.pixels()).zip(&weights) {
                v_image.push(std::array::from_fn(|k| {
                    let (d, weight) = (f64::from(c[k] - y[k]), f64::from(weight) / count);
                    let (value, slope) = if loss == Loss::L2 { (d * d, 2.0 * d) } else { (d.abs(), d.signum()) };
                    expected += weight * value;
                    (weight * if d == 0.0 { 0.0 } else { slope }) as f32
                }));
            }
            let v_image = Image::from_pixels(image.width(), image.height(), v_image)?;
            let (found, gradients) = rasterizer.backward(&splats, forward()?, &target, &loss).block_on()?;
            let alone = rasterizer.loss(&splats, forward()?, &target, &loss).block_on()?;
            Failure::unless((f64::from(found) - expected).abs() <= 1e-5 * expected && alone == found, || {
                format!("{}: the loss is {found}, alone {alone}, instead of {expected}", place())
            })?;
            let alpha = vec![1.0; weights.len()];
            for compact in [false, true] {
                let same = TargetImage { alpha: Some(&alpha), compact, ..weighted };
                let same = rasterizer.upload_target(same)?;
                let (same, _) = rasterizer.backward(&splats, forward()?, &same, &loss).block_on()?;
                Failure::unless((same - found).abs() <= 1e-6 * found, || {
                    format!("{}: the loss is {same} with an alpha of 1, {found} without", place())
                })?;
            }
            let by_hand = rasterizer.image_vjp(&splats, forward()?, &v_image).block_on()?;
            let [found, by_hand] = [&gradients, &by_hand].map(|gradients| rasterizer.gradients(&splats, gradients));
            let [found, by_hand] = [found.block_on()?, by_hand.block_on()?].map(|scene| scene.rows_of_gradients());
            for (g, (found, by_hand)) in found.iter().zip(&by_hand).enumerate() {
                let most = by_hand.iter().fold(0.0f64, |most, v| most.max(v.abs()));
                let close = found.iter().zip(by_hand).all(|(a, b)| (a - b).abs() <= 1e-4 * most);
                Failure::unless(close, || {
                    format!("{}: gradients of Gaussian {g} are {found:?} instead of {by_hand:?}", place())
                })?;
            }
        }
    }
    Ok(())
}

/// Weights of an image's pixels from 0 to 3, unlike from pixel to pixel.
pub(crate) fn weights_of(image: &Image) -> Vec<f32> {
    (0..image.pixels().len()).map(|i| [0.0, 0.3, 1.0, 1.7, 3.0][i * 7 % 5]).collect()
}

fn widened(values: &[f32]) -> Vec<f64> {
    values.iter().copied().map(f64::from).collect()
}
