//! Cases of wrong arguments, which must be typed errors.

use glam::Vec2;
use gs_core::{
    Accuracy, Binning, Canvas, Error, Image, Loss, Optimizer, Parameterization, RenderSettings, Scene2d, SplatsState,
    Tensor, TensorData, TrainStep, effects::Blend,
};
use pollster::FutureExt as _;

use super::{is_refused, losses_of};
use crate::{
    failure::Failure,
    scenes::{Draw, Kind2d},
    subject::Subject,
};

pub(crate) fn refused<T>(what: &str, result: Result<T, Error>, right: impl Fn(&Error) -> bool) -> Result<(), Failure> {
    match result {
        Ok(_) => Err(Failure::Broken(format!("{what} is accepted"))),
        Err(error) if right(&error) => Ok(()),
        Err(error) => Err(Failure::Broken(format!("{what} is refused with the wrong error: {error}"))),
    }
}

/// Scenes with values that are not finite, or with arrays of different lengths, are refused.
pub(crate) fn scenes_that_are_not_finite_are_refused<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let scene = Draw::new(Kind2d::Typical, Blend::Over, 6, (10, 10), 1900).scene;
    let mut wrong = vec![scene; 6];
    wrong[0].means[3].x = f32::NAN;
    wrong[1].log_scales[5].y = f32::INFINITY;
    wrong[2].rotations[0] = f32::NEG_INFINITY;
    wrong[3].opacity_logits[2] = f32::NAN;
    wrong[4].colors[1].z = f32::NAN;
    wrong[5].colors.pop();
    for parameterization in [Parameterization::ScaleRotation, Parameterization::CovarianceFactor] {
        for (i, scene) in wrong.iter().enumerate() {
            refused(&format!("broken scene {i}"), rasterizer.upload(scene, parameterization), |error| match error {
                Error::NotFinite { .. } => i < 5,
                Error::Length { .. } => i == 5,
                _ => false,
            })?;
        }
    }
    Ok(())
}

/// Invalid canvases, settings and losses are errors, in a forward pass and in a training step,
/// which then changes nothing.
pub(crate) fn bad_views_and_settings_are_errors<R: Optimizer<Scene2d>>(rasterizer: &R) -> Result<(), Failure> {
    let draw = Draw::new(Kind2d::Typical, Blend::Over, 6, (10, 10), 1900);
    let view = draw.view;
    let views = [
        ("a canvas of no columns", Canvas { width: 0, ..view }, SIZE),
        ("a canvas of 20000 rows", Canvas { height: 20_000, ..view }, SIZE),
        ("a canvas of no extent", view.showing(Vec2::ZERO, Vec2::new(0.0, 1.0)), SETTING),
        ("a canvas of NaN extent", view.showing(Vec2::ZERO, Vec2::NAN), SETTING),
        ("a canvas at infinity", view.showing(Vec2::INFINITY, Vec2::ONE), SETTING),
    ];
    bad_are_errors(rasterizer, &draw, &views)?;
    let mut dropout = draw;
    dropout.settings.dropout.rate = 0.1;
    Failure::unless(is_refused(rasterizer, &dropout)?, || "dropout in a 2D scene is accepted".to_owned())
}

/// A predicate for the expected error.
pub(super) type Right = fn(&Error) -> bool;

pub(super) const SETTING: Right = |error| matches!(error, Error::Setting { .. });
pub(super) const SIZE: Right = |error| matches!(error, Error::Size { .. });

/// Checks refused views, and settings and losses that are invalid for every view.
pub(super) fn bad_are_errors<S: Subject, R: Optimizer<S>>(
    rasterizer: &R,
    draw: &Draw<S>,
    views: &[(&'static str, S::View, Right)],
) -> Result<(), Failure> {
    let good = draw.settings;
    let accuracy = |accuracy| good.with(|s| s.accuracy = accuracy);
    let usual = Accuracy::default();
    let mut cases: Vec<_> = views.iter().map(|&(what, view, right)| (what, view, good, right)).collect();
    let view = draw.view;
    cases.push(("a NaN background", view, good.on([0.0, f32::NAN, 0.0]), SETTING));
    let mut degree = good;
    degree.effects.sh_degree = 4;
    cases.push(("SH degree 4", view, degree, SETTING));
    let dropout = |rate: f32| good.with(|s| s.dropout.rate = rate);
    cases.push(("a dropout rate of 0.95", view, dropout(0.95), SETTING));
    cases.push(("dropout under `Sum`", view, dropout(0.1).with(|s| s.effects.blend = Blend::Sum), SETTING));
    for alpha_cut in [0.0, 0.9, f32::NAN] {
        cases.push(("an impossible cut", view, accuracy(usual.with(|s| s.alpha_cut = alpha_cut)), SETTING));
    }
    for alpha_max in [0.0, 1.0, f32::NAN] {
        cases.push(("an impossible clamp", view, accuracy(usual.with(|s| s.alpha_max = alpha_max)), SETTING));
    }
    for transmittance_min in [-0.1, 0.9, f32::NAN] {
        cases.push((
            "an impossible minimum",
            view,
            accuracy(usual.with(|s| s.transmittance_min = transmittance_min)),
            SETTING,
        ));
    }
    let target = rasterizer.upload_target(&draw.target()?)?;
    let rates = S::adam().at(0.0);
    let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
    let before = rasterizer.save(&splats).block_on()?;
    for (what, view, settings, right) in cases {
        refused(what, rasterizer.forward(&splats, &view, &settings).block_on(), right)?;
        let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
        refused(what, rasterizer.train_step(&mut splats, &view, &target, &step).block_on(), right)?;
    }
    for lambda in [-0.5, 1.5, f32::NAN] {
        let loss = Loss::L1Dssim { lambda };
        let pass = rasterizer.forward(&splats, &draw.view, &good).block_on()?;
        refused("an impossible λ", rasterizer.backward(&splats, pass, &target, &loss).block_on(), SETTING)?;
        let step = TrainStep { settings: &good, loss, rates: &rates, binning: Binning::Fresh };
        refused("an impossible λ", rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on(), SETTING)?;
    }
    let losses = losses_of(rasterizer, &mut splats)?;
    Failure::unless(losses.is_empty(), || format!("refused training steps have losses: {losses:?}"))?;
    Failure::unless(rasterizer.save(&splats).block_on()? == before, || {
        "a refused training step changed the splats".to_owned()
    })
}

/// Targets of another size, gradients of other splats, invalid states, and solving for colours
/// under `Over` are errors.
pub(crate) fn mismatches_are_errors<S: Subject, R: Optimizer<S>>(rasterizer: &R) -> Result<(), Failure> {
    let draw = S::typical(Blend::Over, 6, (10, 10), 1903);
    let mut splats = rasterizer.upload(&draw.scene, Parameterization::ScaleRotation)?;
    let before = rasterizer.save(&splats).block_on()?;
    let rates = S::adam().at(0.0);
    let sizes_differ = |error: &Error| matches!(error, Error::SizesDiffer { .. });
    for (width, height) in [(11, 10), (10, 9), (5, 20), (1, 100)] {
        let target = rasterizer.upload_target(&Image::filled(width, height, [0.5; 3])?)?;
        let what = format!("a target of {width}x{height} px for a canvas of 10x10 px");
        let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
        refused(&what, rasterizer.backward(&splats, pass, &target, &Loss::L2).block_on(), sizes_differ)?;
        let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
        refused(&what, rasterizer.train_step(&mut splats, &draw.view, &target, &step).block_on(), sizes_differ)?;
        if S::SOLVES_COLORS {
            let settings = RenderSettings::blended(Blend::Sum);
            refused(
                &what,
                rasterizer.solve_colors(&mut splats, &draw.view, &target, &settings, 2).block_on(),
                sizes_differ,
            )?;
        }
    }

    let target = rasterizer.upload_target(&draw.target()?)?;
    let unsupported = |error: &Error| matches!(error, Error::Unsupported { .. });
    let solved = rasterizer.solve_colors(&mut splats, &draw.view, &target, &draw.settings, 2);
    refused("solving for colours under `Over`", solved.block_on(), unsupported)?;

    let mut smaller = rasterizer.upload(&draw.scene.picked(0..5), Parameterization::ScaleRotation)?;
    let pass = rasterizer.forward(&splats, &draw.view, &draw.settings).block_on()?;
    let (_, gradients) = rasterizer.backward(&splats, pass, &target, &Loss::L2).block_on()?;
    let is_state = |error: &Error| matches!(error, Error::State(_));
    refused("gradients of other splats", rasterizer.step(&mut smaller, &gradients, &rates).block_on(), is_state)?;

    // A missing or short tensor may be reported as either.
    let of_state = |error: &Error| matches!(error, Error::State(_) | Error::Length { .. });
    refused("an empty state", rasterizer.restore(&SplatsState::new(Parameterization::ScaleRotation)), of_state)?;
    for (name, tensor) in &before.tensors {
        let mut short = before.clone();
        short.tensors.insert(name.clone(), without_last_row(tensor));
        refused(&format!("a state with a row of `{name}` missing"), rasterizer.restore(&short), of_state)?;
    }
    for name in before.tensors.keys().filter(|name| !S::OPTIONAL_TENSORS.contains(&name.as_str())) {
        let mut lacking = before.clone();
        lacking.tensors.remove(name);
        refused(&format!("a state without `{name}`"), rasterizer.restore(&lacking), of_state)?;
    }
    let other = SplatsState { parameterization: Parameterization::CovarianceFactor, ..before.clone() };
    let is_parameterization_error =
        |error: &Error| of_state(error) || unsupported(error) || matches!(error, Error::Setting { .. });
    refused("a state of the other parameterization", rasterizer.restore(&other), is_parameterization_error)?;
    Failure::unless(rasterizer.save(&splats).block_on()? == before, || "a refused call changed the splats".to_owned())
}

fn without_last_row(tensor: &Tensor) -> Tensor {
    let width = tensor.shape.iter().skip(1).product::<usize>();
    let data = match &tensor.data {
        TensorData::F32(values) => TensorData::F32(values[..values.len() - width].to_vec()),
        TensorData::U32(values) => TensorData::U32(values[..values.len() - width].to_vec()),
    };
    let mut shape = tensor.shape.clone();
    shape[0] -= 1;
    Tensor { shape, data }
}
