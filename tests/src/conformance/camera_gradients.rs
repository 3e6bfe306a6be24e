//! Cases of gradients by the camera of 3D scenes, compared with the oracle's.

use gs_core::{
    Binning, CameraGradient, Error, Image, Loss, Optimizer, Output, Parameterization, Scene3d, TargetImage, TrainStep,
    Wait,
    effects::{Antialias, Blend, Order},
};
use pollster::FutureExt as _;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{CaseOutcome, checks::is_refused, place, refused};
use crate::{
    failure::Failure,
    oracle::Oracle,
    scenes::{Draw, Kind3d},
    subject::Subject,
    tolerance::compare_camera_gradients,
};

/// More steps than any backend has pending at once.
const STEPS: usize = 13;

/// Every kind of scene; every blending and antialiasing, also beyond the edge of the field of view,
/// where slopes are clamped; SH of every degree; the other outputs; every order.
fn draws() -> Vec<Draw<Scene3d>> {
    use Kind3d::{Edge, Needles, Overlapping, Tiny, Typical};
    let draw = |kind, blend, seed| Draw::for_3d(kind, blend, 20, (35, 26), seed).on([0.3, 0.6, 0.2]);
    let over = |kind, seed| draw(kind, Blend::Over, seed);
    let mut draws: Vec<_> = (2700..).zip(Kind3d::ALL).map(|(seed, kind)| over(kind, seed)).collect();
    draws.extend((2710..).zip([Typical, Edge]).map(|(seed, kind)| draw(kind, Blend::Sum, seed)));
    for antialias in [Antialias::Dilate, Antialias::Mip, Antialias::Compensated] {
        draws.extend((2720..).zip([Tiny, Needles, Edge]).map(|(seed, kind)| over(kind, seed).antialiased(antialias)));
    }
    for (seed, degree) in (2730..).zip(0..=3) {
        let mut draw = over(Overlapping, seed);
        draw.settings.effects.sh_degree = degree;
        draws.push(draw);
    }
    for (seed, output) in (2740..).zip([Output::InverseDepth, Output::Alpha]) {
        for kind in [Typical, Edge] {
            let mut draw = over(kind, seed);
            draw.settings.output = output;
            draws.push(draw);
        }
    }
    draws.extend([Order::Index, Order::PerPixel].map(|order| over(Overlapping, 2750).in_order(order)));
    draws
}

/// Gradients by the camera match, of losses and of given gradients of the image. Where they are not
/// asked for, they are an error, and all else has the same bits.
pub(crate) fn camera_gradients_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<CaseOutcome, Failure> {
    for (number, mut draw) in draws().into_iter().enumerate() {
        if draw.settings.effects.order == Order::PerPixel && is_refused(rasterizer, &draw)? {
            continue;
        }
        draw.settings.camera_gradient = true;
        if is_refused(rasterizer, &draw)? {
            return Ok(CaseOutcome::Skipped("gradients by the camera".to_owned()));
        }
        let in_place = |failure: Failure| failure.at(format!("{}, {:?}", place(&draw), draw.settings.output));
        // Far from a target of colours, the gradients of L1 by other outputs nearly cancel.
        let losses = if draw.settings.output == Output::Color { [Loss::L2, Loss::PAPER] } else { [Loss::L2; 2] };
        match number % 2 {
            0 => check_loss(rasterizer, &draw, losses[number / 2 % 2]),
            _ => check_image_vjp(rasterizer, &draw),
        }
        .map_err(in_place)?;
    }
    Ok(CaseOutcome::Passed)
}

fn check_loss<R: Optimizer<Scene3d>>(rasterizer: &R, draw: &Draw<Scene3d>, loss: Loss) -> Result<(), Failure> {
    let target = draw.target()?;
    let splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
    let uploaded = rasterizer.upload_target(&target)?;
    let backward = |asks: bool| {
        let settings = draw.settings.with(|s| s.camera_gradient = asks);
        let pass = rasterizer.forward(&splats, &draw.view, &settings).block_on()?;
        let image = rasterizer.image(&pass).block_on()?;
        let (value, gradients) = rasterizer.backward(&splats, pass, &uploaded, &loss).block_on()?;
        let rows = rasterizer.gradients(&splats, &gradients).block_on()?.rows_of_gradients();
        Ok::<_, Failure>(((image, value.to_bits(), rows), rasterizer.camera_gradient(&gradients).block_on()))
    };
    let ((others, found), (plain, missing)) = (backward(true)?, backward(false)?);
    Failure::unless(others == plain, || "image, loss or gradients depend on camera_gradient".to_owned())?;
    refused("a gradient that was not asked for", missing, |error| matches!(error, Error::State(_)))?;
    let scene = rasterizer.download(&splats).block_on()?.rows();
    let expected = Oracle::new(draw.view, draw.settings)?.gradients(&scene, &target, &loss)?;
    compare_camera_gradients(&expected.view, found?)?;
    Ok(())
}

fn check_image_vjp<R: Optimizer<Scene3d>>(rasterizer: &R, draw: &Draw<Scene3d>) -> Result<(), Failure> {
    let mut rng = Pcg64::seed_from_u64(draw.target_seed);
    let v_image =
        Image::from_fn(draw.view.width, draw.view.height, |_, _| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))?;
    let splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
    let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
    let gradients = rasterizer.image_vjp(&splats, pass, &v_image).block_on()?;
    let found = rasterizer.camera_gradient(&gradients).block_on()?;
    let scene = rasterizer.download(&splats).block_on()?.rows();
    let expected = Oracle::new(draw.view, draw.settings)?.image_vjp(&scene, &v_image)?;
    compare_camera_gradients(&expected.view, found)?;
    Ok(())
}

/// Each training step that asks for it reports its gradient by the camera once and in order, by the
/// parameters before the step, also towards a target with a mask. The bits are the same whether the
/// caller waits for each step, polls, or waits at the end.
pub(crate) fn camera_gradients_of_steps_match<R: Optimizer<Scene3d>>(rasterizer: &R) -> Result<CaseOutcome, Failure> {
    let mut draw = Draw::for_3d(Kind3d::Typical, Blend::Over, 15, (30, 24), 2761).antialiased(Antialias::Mip);
    draw.settings.camera_gradient = true;
    if is_refused(rasterizer, &draw)? {
        return Ok(CaseOutcome::Skipped("gradients by the camera".to_owned()));
    }
    let image = draw.target()?;
    let mask: Vec<bool> = (0..image.pixels().len()).map(|i| i % 7 != 3 && i > 200).collect();
    let masked = TargetImage { mask: Some(&mask), ..TargetImage::from(&image) };
    let targets = [rasterizer.upload_target(masked)?, rasterizer.upload_target(&image)?];
    let oracle = Oracle::new(draw.view, draw.settings)?;
    let fresh = || rasterizer.upload(&draw.scene, Parameterization::ScaleRotation);
    let asks = |number: usize| number % 3 != 1;
    let send = |splats: &mut R::Splats, number: usize| {
        let settings = draw.settings.with(|s| s.camera_gradient = asks(number));
        let rates = Scene3d::adam().at(number as f32 / STEPS as f32);
        let loss = [Loss::L2, Loss::L1][number % 2];
        let step = TrainStep { settings: &settings, loss, rates: &rates, binning: Binning::Fresh };
        rasterizer.train_step(splats, &draw.view, &targets[number % 2], &step).block_on()
    };

    let (mut splats, mut one_by_one) = (fresh()?, Vec::new());
    for number in 0..STEPS {
        let scene = rasterizer.download(&splats).block_on()?.rows();
        let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
        let rendered = rasterizer.image(&pass).block_on()?;
        send(&mut splats, number)?;
        let mut found = Vec::new();
        rasterizer.camera_gradients(&mut splats, Wait::All, &mut found).block_on()?;
        Failure::unless(found.len() == usize::from(asks(number)), || {
            format!("{} gradients by the camera of step {number}", found.len())
        })?;
        if let Some(&found) = found.first() {
            let expected = match number % 2 {
                0 => oracle.gradients(&scene, &unmasked(&image, &mask, &rendered)?, &Loss::L2)?,
                _ => oracle.gradients(&scene, &image, &Loss::L1)?,
            };
            let in_place = |failure: Failure| failure.at(format!("step {number}"));
            compare_camera_gradients(&expected.view, found).map_err(in_place)?;
        }
        one_by_one.extend(found);
    }

    let (mut splats, mut polled) = (fresh()?, vec![CameraGradient::default()]);
    for number in 0..STEPS {
        send(&mut splats, number)?;
        rasterizer.camera_gradients(&mut splats, Wait::Arrived, &mut polled).block_on()?;
    }
    rasterizer.camera_gradients(&mut splats, Wait::All, &mut polled).block_on()?;
    let (mut splats, mut at_once) = (fresh()?, Vec::new());
    (0..STEPS).try_for_each(|number| send(&mut splats, number))?;
    rasterizer.camera_gradients(&mut splats, Wait::All, &mut at_once).block_on()?;
    let bits = |all: &[CameraGradient]| all.iter().map(|g| g.to_array().map(f32::to_bits)).collect::<Vec<_>>();
    let same = bits(&polled[1..]) == bits(&one_by_one) && bits(&at_once) == bits(&one_by_one);
    Failure::unless(same, || {
        format!("waiting for each: {one_by_one:?}, polled: {:?}, all at once: {at_once:?}", &polled[1..])
    })?;
    Ok(CaseOutcome::Passed)
}

/// The target with the rendered colours where the mask excludes pixels.
fn unmasked(image: &Image, mask: &[bool], rendered: &Image) -> Result<Image, Error> {
    let colors = image.pixels().iter().zip(rendered.pixels()).zip(mask);
    let colors = colors.map(|((target, rendered), &counts)| if counts { *target } else { *rendered });
    Image::from_pixels(image.width(), image.height(), colors.collect())
}
