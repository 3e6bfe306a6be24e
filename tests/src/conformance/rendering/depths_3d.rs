//! Cases of renderings of inverse depths and of alpha, and of the gradients of a second loss in a step.

use gs_core::{
    Added, Binning, Image, Loss, Optimizer, Output, Parameterization, Participants, RenderSettings, Scene3d, TrainStep,
    effects::{Antialias, Blend, Order},
};
use pollster::FutureExt as _;

use crate::conformance::{
    check_gradients, check_image, is_refused, parameterizations,
    training::{compare_parameters, distinct},
};
use crate::{
    adam_reference::AdamReference,
    failure::Failure,
    oracle::Oracle,
    scenes::{Draw, Kind3d},
    subject::Subject,
};

/// Images of inverse depths and their gradients match, in every order that the backend offers, for
/// both blends and every parameterization.
pub(crate) fn inverse_depths_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    output_matches(rasterizer, Output::InverseDepth)
}

/// Alphas and their gradients match likewise, and are what shows of the background: the difference of
/// a picture before white and before black is 1 − alpha.
pub(crate) fn alphas_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    output_matches(rasterizer, Output::Alpha)?;
    for (seed, kind) in (2670..).zip([Kind3d::Typical, Kind3d::Overlapping]) {
        let draw = Draw::for_3d(kind, Blend::Over, 20, (35, 26), seed);
        let image = |settings: &RenderSettings| rasterizer.render(&draw.scene, &draw.view, settings).block_on();
        let [black, white] = [0.0, 1.0].map(|value| image(&draw.settings.on([value; 3])));
        let (black, white, alpha) = (black?, white?, image(&draw.settings.of_alpha())?);
        let values = |image: &Image| image.pixels().as_flattened().to_vec();
        let (black, white, alpha) = (values(&black), values(&white), values(&alpha));
        let off = |i: usize| (white[i] - black[i] - (1.0 - alpha[i])).abs();
        let worst = (0..alpha.len()).map(off).fold(0.0, f32::max);
        Failure::unless(worst < 1e-5, || format!("{kind:?}: alpha is off by {worst}"))?;
        let most = alpha.iter().copied().fold(0.0, f32::max);
        Failure::unless(most > 0.5 && most <= 1.0, || format!("{kind:?}: alpha reaches {most}"))?;
    }
    Ok(())
}

fn output_matches<R: Optimizer<Scene3d>>(rasterizer: &R, output: Output) -> Result<(), Failure> {
    for (order, blend, antialias) in [
        (Order::Global, Blend::Over, Antialias::Dilate),
        (Order::Global, Blend::Sum, Antialias::None),
        (Order::Index, Blend::Over, Antialias::Mip),
        (Order::PerPixel, Blend::Over, Antialias::None),
    ] {
        for (seed, kind) in (2660..).zip([Kind3d::Typical, Kind3d::Overlapping, Kind3d::Edge]) {
            let mut draw = Draw::for_3d(kind, blend, 20, (35, 26), seed).in_order(order).antialiased(antialias);
            draw.settings.output = output;
            if order == Order::PerPixel && is_refused(rasterizer, &draw)? {
                continue;
            }
            check_image(rasterizer, &draw)?;
            for parameterization in parameterizations::<Scene3d, R>(rasterizer)? {
                for loss in [Loss::L1, Loss::L2] {
                    check_gradients(rasterizer, &draw, &loss, parameterization)?;
                }
            }
        }
    }
    Ok(())
}

/// A step with added gradients equals Adam in `f64` along both gradients. Gaussians that the step's
/// own view does not show receive none of the added ones.
pub(crate) fn added_gradients_join_the_step<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<(), Failure> {
    let draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 14, (30, 24), 2613);
    let mut own = draw.clone();
    own.view.near = 5.0;
    let target = rasterizer.upload_target(&draw.target()?)?;
    let depths = draw.settings.with(|s| s.output = Output::InverseDepth);
    let mut rates = distinct::<Scene3d>(1e-3);
    for participants in [Participants::All, Participants::Visible] {
        rates.participants = participants;
        let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
        let mut reference = AdamReference::new(draw.scene.rows());
        for (steps, weight) in (1..).zip([0.7, 0.0, 3.0]) {
            let drawn =
                Oracle::new(own.view, own.settings)?.render(&rasterizer.download(&splats).block_on()?.rows()).drawn;
            let seen: Vec<usize> = (0..drawn.len()).filter(|&g| drawn[g]).collect();
            Failure::unless((3..12).contains(&seen.len()), || format!("{} of 14 are in view", seen.len()))?;
            let gradients = |view, settings, loss| {
                let pass = rasterizer.forward(&splats, view, settings).block_on()?;
                rasterizer.backward(&splats, pass, &target, loss).block_on()
            };
            let (_, of_own) = gradients(&own.view, &own.settings, &Loss::L2)?;
            let (_, added) = gradients(&draw.view, &depths, &Loss::L1)?;
            let mut rows = rasterizer.gradients(&splats, &of_own).block_on()?.rows_of_gradients();
            let others = rasterizer.gradients(&splats, &added).block_on()?.rows_of_gradients();
            for &g in &seen {
                rows[g].iter_mut().zip(&others[g]).for_each(|(sum, by)| *sum += f64::from(weight) * by);
            }
            let step = TrainStep { settings: &own.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
            let added = Some(Added { gradients: &added, weight });
            rasterizer.train_step_with(&mut splats, &own.view, &target, &step, added).block_on()?;
            match participants {
                Participants::All => reference.step(&rows, &rates),
                Participants::Visible => reference.step_some(&seen, &rows, &rates),
            }
            let found = rasterizer.download(&splats).block_on()?.rows();
            compare_parameters::<Scene3d>(&reference.scene, &found, &rates, steps)
                .map_err(|failure| failure.at(format!("{participants:?}, step {steps}")))?;
        }
    }
    Ok(())
}
